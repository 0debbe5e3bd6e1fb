"""Runs with more or fewer rows: what a screen resolves, and what is zoomed."""

import types
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ..core import ClosedLoop, Run

__all__ = ["joined", "thinned", "window", "zoomed"]

RECORDED = ("r", "y", "y_m", "e", "e_hat", "sigma", "v", "u", "d", "x", "z", "probe", "integral_v")
MOST = 3000  # rows of what is zoomed


def _each(f: Callable, *nested: Any) -> Any:
    """The result of a function of arrays for nested ones."""
    if isinstance(nested[0], types.SimpleNamespace):
        return types.SimpleNamespace(**{n: _each(f, *(getattr(q, n) for q in nested))
                                        for n in vars(nested[0])})
    if isinstance(nested[0], tuple):
        return tuple(_each(f, *q) for q in zip(*nested, strict=True))
    return None if nested[0] is None else f(*nested)


def _with(run: Run, t: np.ndarray, rows: dict[str, Any]) -> Run:
    """A run with other rows; its xi is averaged between them."""
    return replace(run, t=t, **rows)


def thinned(run: Run, rows: int) -> Run:
    """Return the run with about so many of its rows, at most."""
    k = -(-(len(run.t) - 1)//rows)
    if k < 2:
        return run
    kept = np.unique(np.append(np.arange(0, len(run.t), k), len(run.t) - 1))
    groups = np.append(0, kept[:-1] + 1)  # from after the row before
    made = {n: _each(lambda q: q[kept], getattr(run, n)) for n in RECORDED}
    made |= {n: _each(lambda q, f=f: f.reduceat(q, groups), getattr(run, n))
             for n, f in (("low", np.minimum), ("high", np.maximum))}
    return _with(run, run.t[kept], made)


def window(run: Run, span: tuple[float, float], dt: float) -> dict[str, Any]:
    """Return the arguments with which `simulate` records a stretch of a run at full resolution.

    The stretch begins and ends at rows of the run. Nothing is returned if the run has them all.
    """
    if len(run.t) < 2 or not span[0] < run.t[-1] or not span[1] > run.t[0]:
        return {}
    first = max(int(np.searchsorted(run.t, span[0], "right")) - 1, 0)
    last = min(int(np.searchsorted(run.t, span[1])), len(run.t) - 1)
    since, until = float(run.t[first]), float(run.t[last])
    record = min(round((until - since)/dt), MOST)
    return dict(since=since, duration=until, record=record) if record > last - first else {}


def joined(run: Run, fine: Run) -> Run:
    """Return the run with the rows of `fine`, a stretch of it, in place of its own."""
    if len(fine.t) < 2:
        return run
    # the first row of `fine` is one of the run's, which knows what lies before it
    before, after = run.t < fine.t[0] + 1e-9, run.t > fine.t[-1] + 1e-9

    def join(a, b):
        return np.concatenate([a[before], b[1:], a[after]])

    made = {n: _each(join, getattr(run, n), getattr(fine, n)) for n in (*RECORDED, "low", "high")}
    return _with(run, join(run.t, fine.t), made)


def zoomed(loop: ClosedLoop, run: Run, span: tuple, times: dict[str, Any], simulate: Callable,
           progress: Callable) -> Run:
    """Return a run with all the rows of what is zoomed to, if anything is."""
    dt = times.get("dt") or loop.dt
    part = window(run, span, dt) if span and dt else {}
    return joined(run, simulate(loop, **times | part, progress=progress)) if part else run
