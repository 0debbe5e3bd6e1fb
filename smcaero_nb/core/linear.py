"""A loop linearised at a recorded row of its run."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from .block import Channels
from .program import parts
from .rows import row
from .signal import filled, flat, shape

if TYPE_CHECKING:
    from .run import Run

__all__ = ["called", "given", "jacobian", "motion", "vector"]

STEP = 1e-6  # of a difference, relative to 1 + |x|
SMOOTH = 1e-3  # relative difference of the slopes on both sides, above which there is a kink


def vector(s: Any) -> np.ndarray:
    """Return the leaves of a signal as an array."""
    return np.hstack(flat(s)).astype(float)


def given(run: "Run", i: int) -> dict[str, Any]:
    """Return t, x, u and d of a recorded row."""
    x = tuple(row(getattr(run.x, n), i) for n in run.loop.stages["plant"].states)
    return {"t": float(run.t[i]), "x": x, "u": row(run.u, i), "d": row(run.d, i)}


def motion(run: "Run") -> Callable[[dict[str, Any], np.ndarray], np.ndarray]:
    """Return dx/dt as a function of t, u and d, as `given`, and of x.

    A perturbation without memory that asks for x follows it.
    """
    plant, world = (run.loop.stages[s] for s in ("plant", "perturbation"))
    form, p, blocks = shape(plant.z0), run.loop.p["plant"], parts(world)
    follows = any("x" in b.signals for b in blocks) and not any(b.states for b in blocks)

    def rate(at: dict[str, Any], x: np.ndarray) -> np.ndarray:
        values = {**at, "x": filled(form, iter(x.tolist()))}
        if follows:
            values["d"] = called(world, values)
        try:
            return vector(plant.f(*(values[n] for n in plant.signals), *p))
        except (ArithmeticError, ValueError):
            return np.full(len(x), np.nan)

    return rate


def called(b: Any, values: dict[str, Any]) -> Any:
    """Return the output of a block, or of channels, each of which sees its part of the signals."""
    if isinstance(b, Channels):
        return tuple(called(q, {n: v if n in ("t", "x") else v[i] for n, v in values.items()
                                if n in q.signals}) for i, q in enumerate(b.parts.values()))
    return b.f(*(values[n] for n in b.signals), *b.p)


def jacobian(f: Callable[[np.ndarray], np.ndarray], x: np.ndarray,
             floor: float = 0.0) -> np.ndarray | None:
    """Return df/dx by differences; None where f is not smooth, or cannot be evaluated.

    The slope ahead and that behind, over three times the distance, must agree, but for `floor`: a
    step of f, as of dry friction, or a kink has no derivative.
    """
    steps = STEP*(1.0 + np.abs(x))
    here = f(x)
    ahead, behind = (np.column_stack([f(q) for q in x + np.diag(k*steps)]) for k in (1.0, -3.0))
    ahead, behind = (ahead - here[:, None])/steps, (here[:, None] - behind)/(3.0*steps)
    noise = 1e-14*np.abs(here)[:, None]/steps  # of rounding
    bound = SMOOTH*(np.abs(ahead) + np.abs(behind)) + noise + floor
    return 0.75*ahead + 0.25*behind if (np.abs(ahead - behind) <= bound).all() else None
