"""The paper's performance analyser: differentiate until a derivative steps."""

from dataclasses import dataclass, field
from math import comb, nan

import numpy as np

from ..differentiators import differentiate

__all__ = ["Analysis", "analyse"]

ORDERS = range(1, 6)
MARGIN = 4.0  # of the differentiator's L over what the record shows; 1 to 32 give the same answers
# noise of a derivative before the step, relative to its peak after it, up to which its step counts
HEARD = 0.2


@dataclass(frozen=True, eq=False)
class Analysis:
    r"""Evidence of the paper's performance analyser; made by `identify`.

    Lists have one entry per order k = 1, ..., 5.

    Attributes
    ----------
    prd : int or None
        The lowest order whose derivative steps.
    jumps : list of float
        Share of its excursion that z_k makes within the window (1: all of it, a step); from
        1 - alpha on it counts as a step.
    bends : list of float
        Slope of z_(k-1) in the first half of the window, relative to that in the second: about 1
        where it changes at once, small where it only grows, as of t^2 (1/3) or t^3 (1/7); large
        where z_(k-1) itself has stepped.
    noise : list of float
        Maximum excursion of z_k before the step, relative to the one after it.
    jump_times : list of float
        Times at which z_k has made half of its excursion [s].
    L : list of float
        Bounds that the differentiators were given [y/s^(k+1)].
    derivatives : ndarray
        z_k over the times of the result, one row per order, [y/s^k].
    reason : str
        Why there is no answer; empty where there is one.
    """

    prd: int | None
    jumps: list = field(default_factory=list)
    bends: list = field(default_factory=list)
    noise: list = field(default_factory=list)
    jump_times: list = field(default_factory=list)
    L: list = field(default_factory=list)
    derivatives: np.ndarray = field(default_factory=lambda: np.empty((len(ORDERS), 0)))
    reason: str = ""


@np.errstate(over="ignore")  # evidence beyond float64 is infinite, and the answer does not need it
def analyse(t, away, start, n, h, alpha):
    """Differentiate with order k = 1, 2, ... and find the first z_k that steps.

    The step begins at the index `start`; the window has `n` samples, `h` apart.

    Inside, time is counted in windows and the response in its peak, so that one set of numbers
    serves all records.
    """
    window, size = n*h, np.abs(away).max()
    s, f = (np.arange(len(t)) - start)/n, away/size
    half, end = start + n//2, start + n
    jumps, bends, noise, jump_times, bounds, derivatives, before = [], [], [], [], [], [], f
    for k in ORDERS:
        stride = max(1, n//(2*k))
        part = f[max(0, start - k*stride):]
        peak = np.abs(sum((-1)**j*comb(k, j)*part[(k - j)*stride:len(part) - j*stride]
                          for j in range(k + 1))).max()
        L = MARGIN*peak*(n/stride)**k
        z = differentiate(s, f, L, k)[k] if L > 0.0 else np.zeros_like(f)
        moved = np.abs(z - z[max(0, start - 20):start].mean())
        top = moved[half:].max()
        early, late = abs(before[half] - before[start - 1]), abs(before[end] - before[half])
        jumps.append(float(moved[half:end + 1].max()/top) if top > 0.0 else 0.0)
        bends.append(float(early/late) if late > 0.0 else nan)
        noise.append(float(moved[:start].max()/top) if top > 0.0 else nan)
        jump_times.append(float(t[start + np.argmax(moved[start:] >= 0.5*top)]) if top > 0.0
                          else nan)
        bounds.append(float(L*size/window**(k + 1)))
        derivatives.append(z*size/window**k)
        before = z
    k = next((k for k in ORDERS if jumps[k - 1] >= 1.0 - alpha), None)
    y, why = np.abs(f), ""
    if y[half] >= (1.0 - alpha)*y[half:].max():
        why = "the output itself steps within the window: relative degree 0 at this time scale"
    elif k is None:
        why = (f"none of the derivatives 1 to {ORDERS[-1]} makes {1 - alpha:.0%} of its excursion "
               "within the window")
    elif not noise[k - 1] < HEARD:
        why = (f"derivative {k} steps, but its noise before the step was already "
               f"{noise[k - 1]:.0%} of that (allowed: {HEARD:.0%})")
    return Analysis(None if why else k, jumps, bends, noise, jump_times, bounds,
                    np.array(derivatives), why)
