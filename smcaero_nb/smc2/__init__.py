"""Second-order sliding mode control."""

from .super_twisting import adaptive_super_twisting

__all__ = ["adaptive_super_twisting"]
