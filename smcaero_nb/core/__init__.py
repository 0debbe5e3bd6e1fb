"""The engine: blocks, closed loops, simulation."""

from .block import Block, BlockError, Channels, block, channels
from .engine import ClosedLoop, Run, simulate
from .metrics import Metrics, reaching_time
from .param import Param, ParameterError

__all__ = ["Block", "BlockError", "Channels", "ClosedLoop", "Metrics", "Param", "ParameterError", "Run", "block", "channels",
           "reaching_time", "simulate"]
