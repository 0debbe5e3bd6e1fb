"""The engine: blocks, closed loops, simulation; text files of numbers."""

from .accuracy import Accuracy, accuracy
from .block import Block, BlockError, Channels, block, channels
from .engine import ClosedLoop, Run, simulate
from .metrics import Metrics, reaching_time
from .param import Param, ParameterError
from .table import Table
from .theorem import exceeds

__all__ = ["Accuracy", "Block", "BlockError", "Channels", "ClosedLoop", "Metrics", "Param", "ParameterError", "Run", "Table",
           "accuracy", "block", "channels", "exceeds", "reaching_time", "simulate"]
