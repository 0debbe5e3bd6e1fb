"""Sliding mode control for aerospace: a teaching and analysis kit.

``import smcaero_nb as smc`` gives the engine (`block`, `Param`, `channels`, `ClosedLoop`,
`simulate`, `accuracy`), vectors for your own blocks (`vec`), the laws (`smc1`, `smc2`, `hosmc`,
`pid`), the differentiators that let them work from the output alone (`differentiators`), the design
of sliding variables (`surface`), plants to try them on (`applications`), the lunar lander (`rpl`),
the launch vehicle (`lv`), plants from python-control (`interop`), the practical relative degree
(`prd`), and the masks and plots (`ui`, loaded when it is first used). `catalogue` lists all blocks
with their cards (`card`), and `cite` their references.
"""

import importlib

from . import applications, differentiators, hosmc, interop, lv, pid, prd, rpl, smc1, smc2, surface
from .catalogue import catalogue, cite
from .core import (
    Block,
    BlockError,
    Channels,
    ClosedLoop,
    Metrics,
    Param,
    ParameterError,
    Run,
    accuracy,
    block,
    card,
    channels,
    simulate,
    vec,
)

__all__ = ["Block", "BlockError", "Channels", "ClosedLoop", "Metrics", "Param", "ParameterError",
           "Run", "accuracy", "applications", "block", "card", "catalogue", "channels", "cite",
           "differentiators", "hosmc", "interop", "lv", "pid", "prd", "rpl", "simulate", "smc1",
           "smc2", "surface", "vec"]
__version__ = "0.1.0"


def __getattr__(name):
    if name == "ui":  # plotly and ipywidgets take a second to load
        return importlib.import_module(".ui", __name__)
    raise AttributeError(f"module 'smcaero_nb' has no attribute {name!r}")
