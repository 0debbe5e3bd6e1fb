"""Resource Prospector Lander: the paper's first case study, eqs (44)-(59), Tables 1 and 2."""

from .control import allocation, off_pulse_smc, pid_within, super_twisting_within
from .plant import (
    altitude,
    attitude_and_altitude,
    command,
    governed_command,
    lander,
    left_right,
    perturbations,
)
from .pulses import (
    dead_band,
    dead_bands,
    dither,
    modified_sign,
    pulse_modulator,
    sample_and_hold,
    thruster,
)
from .results import Landing, Pulses, landing, pulses
from .scenario import PRESETS, TABLE_1, loop
from .surface import braking, braking_surface, conditional_integral

__all__ = ["PRESETS", "TABLE_1", "Landing", "Pulses", "allocation", "altitude",
           "attitude_and_altitude", "braking", "braking_surface", "command", "conditional_integral",
           "dead_band", "dead_bands", "dither", "governed_command", "lander", "landing",
           "left_right", "loop", "modified_sign", "off_pulse_smc", "perturbations", "pid_within",
           "pulse_modulator", "pulses", "sample_and_hold", "super_twisting_within", "thruster"]
