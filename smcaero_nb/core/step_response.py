"""Figures of the response to the last step of a reference."""

import math
from typing import NamedTuple

import numpy as np

__all__ = ["Response", "stepped"]

BAND = 0.02  # of the step: settled
LOW, HIGH = 0.1, 0.9  # of the step: between them it rises
SAME = 1e-9  # of the size of the signals: a reference that does not change, a step of nothing


class Response(NamedTuple):
    """Response to a step: settling and rise time [s], overshoot [%]."""

    settling_time: float
    rise_time: float
    overshoot: float


def stepped(t: np.ndarray, y: np.ndarray, e: np.ndarray) -> Response | None:
    """Return the response to the last step of r = y + e; None if r never stays at a value.

    A constant reference is a step from y(0). Its size is r - y at that moment, so that a reference
    that steps where y already is makes no step. python-control's `step_info` has the same
    definitions, with r as the final value.
    """
    if len(t) < 3 or not np.isfinite(e[-1]):
        return None
    r = y + e
    final, same = r[-1], SAME*(np.abs(y).max() + np.abs(e).max())
    changed = np.flatnonzero(np.abs(r - final) > same)
    first = changed[-1] + 1 if len(changed) else 0
    if first > len(t) - 3:
        return None
    size = final - y[first]
    if abs(size) <= 1e3*same:
        return None
    part = (y[first:] - y[first])/size
    t = t[first:] - t[first]
    outside = np.flatnonzero(np.abs(part - 1.0) > BAND)
    settled = outside[-1] + 1 if len(outside) else 0
    low, high = (np.flatnonzero(part >= q) for q in (LOW, HIGH))
    return Response(float(t[settled]) if settled < len(t) else math.inf,
                    float(t[high[0]] - t[low[0]]) if len(high) else math.inf,
                    float(max(0.0, 100.0*(part.max() - 1.0))))
