"""The engine: blocks, closed loops, simulation."""

from . import card, vec
from .accuracy import Accuracy, accuracy
from .assumptions import exceeds
from .block import Block, BlockError, Buffer, Channels, block, channels
from .chain import Chain, chain
from .loop import ClosedLoop
from .metrics import Metrics, reaching_time
from .param import Param, ParameterError
from .run import Run
from .simulate import simulate

__all__ = ["Accuracy", "Block", "BlockError", "Buffer", "Chain", "Channels", "ClosedLoop",
           "Metrics", "Param", "ParameterError", "Run", "accuracy", "block", "card", "chain",
           "channels", "exceeds", "reaching_time", "simulate", "vec"]
