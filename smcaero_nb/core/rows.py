"""A stage evaluated at recorded rows, outside the run."""

from typing import TYPE_CHECKING, Any

import numpy as np

from .block import Block
from .chain import Chain
from .stages import STAGES, salt

if TYPE_CHECKING:
    from .run import Run

__all__ = ["evaluated", "row", "taken"]


def evaluated(run: "Run", stage: str, given: dict[str, Any], rows: Any = slice(None)) -> Any:
    """Return what the blocks of a stage give at recorded rows, nested as its signal is.

    Parameters
    ----------
    run : Run
    stage : str
    given : dict
        Signals that replace those that the control saw.
    rows : slice or array of int

    Notes
    -----
    States are those that the sample left. A block whose function takes no arrays is called row by
    row.
    """
    b = run.loop.stages[stage]
    signals = {n: taken(getattr(run, n), rows) for n in ("t", "r", "sigma", "v", "u")}
    signals |= {"y": taken(run.y_m, rows), "e": taken(run.e_hat, rows), "tau": run.tau}
    signals |= {"k": np.floor(signals["t"]/run.tau + 1e-6)} | given
    z = getattr(run.z, stage, None)
    if not hasattr(b, "parts"):
        return _called(b, signals | {"salt": salt(stage)}, z, rows)
    results = []
    for i, (n, p) in enumerate(b.parts.items()):
        seen = signals | {"salt": salt(f"{stage}__{n}")}
        if not isinstance(b, Chain):
            seen = {name: q[i] if isinstance(q, tuple) else q for name, q in seen.items()}
        elif results:
            seen[STAGES[stage].passes.removesuffix("_hat")] = results[-1]
        results.append(_called(p, seen, getattr(z, n, None), rows))
    return results[-1] if isinstance(b, Chain) else tuple(results)


def taken(s: Any, rows: Any) -> Any:
    """Return some rows of a signal."""
    return tuple(taken(q, rows) for q in s) if isinstance(s, tuple) else s[rows]


def row(s: Any, i: int) -> Any:
    """Return a recorded signal at one row; what is not recorded, as it is."""
    if isinstance(s, tuple):
        return tuple(row(q, i) for q in s)
    return float(s[i]) if isinstance(s, np.ndarray) else s


def _called(b: Block, signals: dict[str, Any], z: Any, rows: Any) -> Any:
    """What a block gives, its states left out."""
    if b.buffers:
        raise ValueError(f"{b.name} remembers samples that are not recorded")
    z = tuple(taken(getattr(z, n), rows) for n in b.states)
    asked = [z if n == "z" else signals[n] for n in b.signals]
    count = len(signals["t"])

    def given(result):
        return result[0] if b.states else result

    try:
        with np.errstate(all="ignore"):
            result = given(b.f(*asked, *b.p))
        return _filled(result, count)
    except Exception:
        results = [given(b.f(*(row(q, i) for q in asked), *b.p)) for i in range(count)]
        return _gathered(results)


def _filled(s: Any, count: int) -> Any:
    """A signal as arrays of `count` numbers each."""
    if isinstance(s, tuple):
        return tuple(_filled(q, count) for q in s)
    return np.broadcast_to(np.asarray(s, float), (count,))


def _gathered(results: list) -> Any:
    if isinstance(results[0], tuple):
        return tuple(_gathered([*q]) for q in zip(*results, strict=True))
    return np.array(results, float)
