"""Robust exact differentiation: e, e', ..., e^(n_d) of a sampled, noisy signal, in a loop or from a record."""

from .lipschitz import lipschitz
from .observer import observer
from .recorded import differentiate
from .sampled import differentiator
from .table import LAMBDA

__all__ = ["LAMBDA", "differentiate", "differentiator", "lipschitz", "observer"]
