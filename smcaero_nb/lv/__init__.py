"""Launch vehicle in ascent: the paper's second case study, eqs (7), (60)-(74), Table 3."""

from .plant import launcher, launcher_with_drift, pitch, pitch_and_acceleration
from .scenario import PRESETS, loop, transfer_function
from .task import gimbal, gimbal_to_control, misalignment, steps

__all__ = ["PRESETS", "gimbal", "gimbal_to_control", "launcher", "launcher_with_drift", "loop",
           "misalignment", "pitch", "pitch_and_acceleration", "steps", "transfer_function"]
