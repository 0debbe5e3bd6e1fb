"""Practical relative degree: which derivative of the output steps with the input."""

from .analyser import Analysis
from .identify import identify, sweep
from .interactive import Probe, experiment
from .power_law import PowerLaw
from .results import PRDResult, PRDSweep, VectorPRD
from .step_response import Record, read_csv

__all__ = ["Analysis", "PRDResult", "PRDSweep", "PowerLaw", "Probe", "Record", "VectorPRD",
           "experiment", "identify", "read_csv",
           "sweep"]
