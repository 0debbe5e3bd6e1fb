"""Practical relative degree: which derivative of the output steps with the input, seen at a time scale."""

from .analyser import Analysis
from .experiment import Probe, experiment
from .identify import identify, sweep
from .power_law import PowerLaw
from .records import Record, read_csv
from .results import PRDResult, PRDSweep, VectorPRD

__all__ = ["Analysis", "PRDResult", "PRDSweep", "PowerLaw", "Probe", "Record", "VectorPRD", "experiment", "identify", "read_csv",
           "sweep"]
