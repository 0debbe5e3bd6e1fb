"""Second-order sliding mode control."""

from .super_twisting import adaptive_super_twisting, super_twisting
from .twisting import adaptive_twisting, gains, twisting

__all__ = ["adaptive_super_twisting", "adaptive_twisting", "gains", "super_twisting", "twisting"]
