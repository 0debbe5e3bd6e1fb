"""Robust exact differentiation of a sampled, noisy signal, in a loop or from a record."""

from .coefficients import LAMBDA
from .differentiate import differentiate
from .differentiator import differentiator
from .interactive import Trial, trial
from .lipschitz import lipschitz
from .observer import observer
from .signal import Signal, read_csv

__all__ = ["LAMBDA", "Signal", "Trial", "differentiate", "differentiator", "lipschitz", "observer",
           "read_csv", "trial"]
