"""Robust exact differentiation: e, e', ..., e^(n_d) of a sampled, noisy signal, in a loop or from a record."""

from .coefficients import LAMBDA
from .differentiate import differentiate
from .differentiator import differentiator
from .interactive import Signal, Trial, read_csv, trial
from .lipschitz import lipschitz
from .observer import observer

__all__ = ["LAMBDA", "Signal", "Trial", "differentiate", "differentiator", "lipschitz", "observer", "read_csv", "trial"]
