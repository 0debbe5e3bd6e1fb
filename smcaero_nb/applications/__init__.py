"""Plants to try the laws on: a perturbed chain of integrators, a double integrator, a DC motor."""

from .chain import chain, chain_output, chain_perturbation, perturbed_chain
from .dc_motor import dc_motor
from .double_integrator import double_integrator

__all__ = ["chain", "chain_output", "chain_perturbation", "dc_motor", "double_integrator",
           "perturbed_chain"]
