"""Relative degree from the power law of the first motion: y grows as t^r."""

import math
from dataclasses import dataclass

import numpy as np

__all__ = ["PowerLaw", "power_law"]

QUIET = 20.0  # the fit starts where the response exceeds the noise this many times
HIGHEST = 5
# distance from a whole number up to which the slope names one, and of the slopes of its halves
NEAR = 0.35


@dataclass(frozen=True)
class PowerLaw:
    r"""Evidence of the power law of the first motion; made by `identify`.

    Attributes
    ----------
    prd : int or None
        The whole number next to the slope, where it is one from 1 to 5 and near.
    slope : float
        Slope of log \|y - y_0\| over log(t - step_time); NaN where there was nothing to fit.
    octave : tuple of 2 float
        Times after the step between which it was fitted [s].
    noise : float
        Noise of the record, as one standard deviation [y].
    reason : str
        Why there is no answer; empty where there is one.
    onset : float
        The slopes of the octave's halves, extrapolated to the step: a whole number where the
        response is t^r from the step on.
    """

    prd: int | None
    slope: float
    octave: tuple
    noise: float
    reason: str = ""
    onset: float = math.nan


def extrapolated(near, far, ratio):
    """Slope at the step, from the slopes at two times after it, the second `ratio` times later."""
    return near - (far - near)/(ratio - 1.0)


def power_law(t, y, noise, span):
    r"""Fit the power law over one octave.

    It begins at a quarter of the span, or later if noise hides the response until then.

    .. math:: y - y_0 \approx \frac{J (t - \tau)^r}{r!}

    `t` counts from the step, `y` from the equilibrium.
    """
    hidden = np.flatnonzero(np.abs(y) <= QUIET*noise)
    start = max(t[min(hidden[-1] + 1, len(t) - 1)] if len(hidden) else 0.0, span/4)
    end = min(2*start, span)
    octave = float(start), float(end)
    m = (t >= start) & (t <= end)
    if end < 1.5*start or m.sum() < 8:
        return PowerLaw(None, math.nan, octave, noise,
                        f"the response stands out of the noise ({QUIET:g} times its {noise:.2g}) "
                        "too late in the window, or not at all")
    if np.ptp(np.sign(y[m])) > 0:
        return PowerLaw(None, math.nan, octave, noise,
                        "the response changes its sign, as no power law does")
    logs = np.log(t[m]), np.log(np.abs(y[m]))
    slope = float(np.polyfit(*logs, 1)[0])
    first = logs[0] < 0.5*(logs[0][0] + logs[0][-1])
    halves = [float(np.polyfit(logs[0][q], logs[1][q], 1)[0]) for q in (first, ~first)]
    near, far = (math.exp(logs[0][q].mean()) for q in (first, ~first))
    r = round(slope)
    if r < 1:
        why = f"the slope {slope:.2f} does not fit any relative degree from 1 to {HIGHEST}" + (
            ": the output jumps with the input (relative degree 0), or has settled" if slope < 0.5
            else "")
    elif r > HIGHEST:
        why = (f"the slope {slope:.2f} is above {HIGHEST}, the highest order sought; identify a "
               "derivative of the output, or take a longer window")
    else:
        why = f"the slope {slope:.2f} is not near a whole number" if abs(slope - r) > NEAR else ""
        if abs(halves[1] - halves[0]) > NEAR:
            why = (f"the slope goes from {halves[0]:.2f} to {halves[1]:.2f} within the octave, "
                   "as no power law does")
    onset = extrapolated(halves[0], halves[1], far/near)
    return PowerLaw(None if why else r, slope, octave, noise, why, onset)
