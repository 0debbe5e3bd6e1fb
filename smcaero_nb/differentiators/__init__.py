"""Robust exact differentiation: e, e', ..., e^(n_d) of a sampled, noisy signal, in a loop or from a record."""

from .lipschitz import lipschitz
from .observer import observer
from .recorded import differentiate
from .sampled import differentiator
from .table import LAMBDA
from .trial import Signal, Trial, read_csv, trial

__all__ = ["LAMBDA", "Signal", "Trial", "differentiate", "differentiator", "lipschitz", "observer", "read_csv", "trial"]
