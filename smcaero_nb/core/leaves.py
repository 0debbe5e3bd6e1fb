"""Leaves: the numbers of a signal, leaves_of."""

from dataclasses import dataclass
from typing import Any

from .param import Param
from .signal import leaves
from .stages import SIGNALS

__all__ = ["Leaf", "at", "found", "heads", "leaves_of", "named"]


@dataclass(frozen=True)
class Leaf:
    """One number of a signal.

    Attributes
    ----------
    key : str
        Its name in tables and files: ``"e"``, ``"e'"``, ``"u[1]"``, ``"y.theta"``.
    signal : str
    path : tuple of int
        Its place in the signal.
    channel : int
    derivative : int or None
        0 for the quantity itself, 1 for its rate; None where no item of the signal is a derivative
        of another one.
    meta : Param
    """

    key: str
    signal: str
    path: tuple[int, ...]
    channel: int
    derivative: int | None
    meta: Param


def at(signal: Any, path: tuple[int, ...]) -> Any:
    """Return the item of a nested signal at a path."""
    for i in path:
        signal = signal[i]
    return signal


def _meta(metas: Any, path: tuple[int, ...]) -> Param:
    """Return the metadata at a path of a signal; empty where none is declared."""
    for i in path:
        if isinstance(metas, tuple):
            metas = metas[i] if i < len(metas) else None
    while isinstance(metas, tuple):
        metas = metas[0] if metas else None
    return metas or Param()


def found(signal: str, shape: Any, metas: Any, many: bool,
          names: tuple[str, ...] = ()) -> tuple[Leaf, ...]:
    """Return the leaves of a signal.

    Nested items are channels, and the items of a channel are derivatives. The items of a flat
    signal are derivatives of one another, or channels if `many`; with `names`, named channels.
    """
    nested = not names and shape is not None and any(v is not None for v in shape)
    made = []
    for q in leaves(shape):
        path = tuple(int(i) for i in q[1:-1].split("][")) if q else ()
        channel = path[0] if path and (nested or many) else 0
        inner = path[1:] if nested or many else path
        derivative = None if not nested and many else (inner[-1] if inner else 0)
        several = shape is not None and (nested or many) and len(shape) > 1
        mark = f"[{channel}]" if several else ""
        key = f"{signal}{mark}" + "'"*(derivative or 0)
        if names:
            key = f"{signal}.{names[channel]}" + "".join(f"[{i}]" for i in path[1:])
        made.append(Leaf(key, signal, path, channel, derivative, _meta(metas, path)))
    return tuple(made)


def leaves_of(loop: Any, shapes: dict[str, Any], signal: str) -> tuple[Leaf, ...]:
    """Return the leaves of a signal of a loop, given the shapes of all its signals."""
    plant, output = loop.stages["plant"], loop.stages["output"]
    nested = shapes["e"] is not None and any(v is not None for v in shapes["e"])
    channels = nested or loop.stages["law"] is not None and shapes["v"] is not None
    names = () if output or shapes["x"] == (None,) else tuple(plant.states)
    passed = signal == "e_hat" and not loop.stages["differentiator"]
    outward = signal in ("r", "y", "y_m", "e", "e_m") or passed
    rows = signal == "sigma" and not loop.stages["surface"] and any(shapes["x"])
    states = names if (outward or rows) and shapes[signal] == shapes["x"] else ()
    metas = loop.metadata(signal)
    if (outward or states) and not output and metas is None:
        metas = tuple(plant.states.values())
    many = bool(states) or signal in ("v", "u", "d", "probe") or signal == "sigma" and channels
    return found(signal, shapes[signal], metas, many, states)


def named(loop: Any, shapes: dict[str, Any]) -> dict[str, tuple[Leaf, ...]]:
    """Return the leaves of all signals of a loop, by signal."""
    return {s: leaves_of(loop, shapes, s) for s in (*SIGNALS[1:], "e_m", "probe") if s in shapes}


def heads(leaves_: tuple[Leaf, ...], values: Any) -> list:
    """Return the values of a signal without its derivatives, one per channel."""
    return [at(values, q.path) for q in leaves_ if not q.derivative]
