"""First-order sliding mode control."""

from .relay import quasi_smc, sign_smc

__all__ = ["quasi_smc", "sign_smc"]
