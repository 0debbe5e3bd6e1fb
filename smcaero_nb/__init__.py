"""Sliding mode control for aerospace: a teaching and analysis kit.

``import smcaero_nb as smc`` gives the engine (`block`, `Param`, `channels`, `ClosedLoop`,
`simulate`, `accuracy`), vectors for your own blocks (`vec`), the laws (`smc1`, `smc2`, `hosmc`,
`pid`), the differentiators that let them work from the output alone (`differentiators`), the design
of sliding variables (`surface`), plants to try them on (`applications`), the lunar lander (`rpl`),
the launch vehicle (`lv`), plants from python-control (`interop`), the practical relative degree
(`prd`), and the masks and plots (`ui`). `catalogue` lists all blocks with their cards (`card`), and
`cite` their references. The vehicles, `prd` and `ui` are loaded when they are first used.
"""

import importlib
from typing import TYPE_CHECKING, Any

from . import differentiators, hosmc, interop, pid, smc1, smc2, surface
from .catalogue import catalogue, cite
from .core import (
    Block,
    BlockError,
    Buffer,
    Chain,
    Channels,
    ClosedLoop,
    Metrics,
    Param,
    ParameterError,
    Run,
    accuracy,
    block,
    card,
    chain,
    channels,
    simulate,
    vec,
)

__all__ = ["Block", "BlockError", "Buffer", "Chain", "Channels", "ClosedLoop", "Metrics",
           "Param", "ParameterError", "Run", "accuracy", "applications", "block", "card",
           "catalogue", "chain", "channels", "cite", "differentiators", "hosmc", "interop", "lv",
           "pid", "prd", "rpl", "simulate", "smc1", "smc2", "surface", "vec"]
__version__ = "0.1.0"


_LATER = ("applications", "lv", "prd", "rpl", "ui")  # plotly alone takes a second to load

if TYPE_CHECKING:
    from . import applications, lv, prd, rpl


def __getattr__(name: str) -> Any:
    if name in _LATER:
        return importlib.import_module(f".{name}", __name__)
    raise AttributeError(f"module 'smcaero_nb' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_LATER})
