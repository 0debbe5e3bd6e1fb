"""How the sliding variable answers a push: more of v, without the rest of the loop."""

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from .program import parts
from .rows import row

if TYPE_CHECKING:
    from .run import Run

__all__ = ["answer", "direct", "gain", "told"]

LEAD, FEW = 20, 25  # samples, but not more steps, in which a plant shows which way it moves
MOST = 400  # steps in which it shows by how much


def told(f: Callable) -> Any:
    """Return a function of a run that gives None where a block of it cannot be evaluated."""
    @functools.wraps(f)
    def asked(*args):
        try:
            return f(*args)
        # a block is anybody's: it may not be defined there, or remember what is not recorded
        except (ArithmeticError, LookupError, TypeError, ValueError):
            return None

    return asked


def _led(run: "Run", steps: int) -> np.ndarray | None:
    """What a little more of v adds to each sliding variable, so many steps after the last row."""
    from .linear import given, motion, vector  # most processes judge no run
    from .zeros import pushed, slid

    at = given(run, -1) | {n: row(getattr(run, n), -1) for n in ("r", "y", "e", "v")}
    found, push = slid(run, at), pushed(run, at)
    if found is None or push is None:
        return None
    rate, ends, v = motion(run), [], vector(push[0])
    for w in (v, v + np.maximum(1e-3, 1e-3*np.abs(v))):
        x, u = vector(at["x"]), push[1](w)
        for k in range(steps):
            x = x + run.dt*rate({**at, "t": at["t"] + k*run.dt, "u": u}, x)
        ends.append(found(x, u))
    return ends[1] - ends[0]


@told
def answer(run: "Run") -> float | None:
    """Return how far a little more of v moves sigma: down, unless the gain has the wrong sign.

    The plant is led on from the last row, without and with it; known of loops with one input.
    """
    if isinstance(run.u, tuple) or isinstance(run.v, tuple):
        return None
    moved = _led(run, min(LEAD*round(run.tau/run.dt), FEW))
    return None if moved is None or not np.isfinite(moved[0]) else float(moved[0])


@told
def gain(run: "Run") -> float | None:
    """Return by how much sigma' changes with v, at least 1, as rows that lie apart do not tell."""
    if isinstance(run.u, tuple) or isinstance(run.v, tuple):
        return None
    moved = _led(run, round(run.tau/run.dt) if run.tau < MOST*run.dt else MOST)
    size = max(1e-3, 1e-3*abs(float(run.v[-1])))
    return None if moved is None else max(1.0, float(abs(moved[0]))/(size*run.tau))


@told
def direct(run: "Run") -> list[bool] | None:
    """Return whether each sliding variable depends on u itself, with nothing that holds it back."""
    output, actuator = run.loop.stages["output"], run.loop.stages["actuator"]
    asks = output is not None and any("u" in q.signals for q in parts(output))
    if not asks or actuator is not None and any(q.states for q in parts(actuator)):
        return None
    moved = _led(run, 0)
    return None if moved is None else [bool(q != 0.0) for q in moved]
