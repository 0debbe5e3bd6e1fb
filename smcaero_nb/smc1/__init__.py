"""First-order sliding mode control."""

from .adaptive import (
    adaptive_quasi_smc,
    adaptive_quasi_unit_vector,
    adaptive_smc,
    adaptive_unit_vector,
    plestan_smc,
)
from .decoupling import decoupling
from .dual_layer import dual_layer_quasi_smc, dual_layer_smc, dual_layer_unit_vector
from .relay import quasi_smc, saturation_smc, sign_smc, tanh_smc
from .unit_vector import quasi_unit_vector, unit_vector

__all__ = ["adaptive_quasi_smc", "adaptive_quasi_unit_vector", "adaptive_smc",
           "adaptive_unit_vector", "decoupling", "dual_layer_quasi_smc", "dual_layer_smc",
           "dual_layer_unit_vector", "plestan_smc", "quasi_smc", "quasi_unit_vector",
           "saturation_smc", "sign_smc", "tanh_smc", "unit_vector"]
