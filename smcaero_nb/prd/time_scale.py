"""The answer of both methods for one record, at one time scale or the shortest that serves."""

import math
from dataclasses import replace

import numpy as np

from ..core import ParameterError
from .analyser import ORDERS, Analysis, analyse
from .power_law import PowerLaw, extrapolated, power_law
from .results import PRDResult
from .step_response import Record

__all__ = ["SHORTEST", "answer", "longest_window", "shortest_answer"]

SPAN = 1.25  # windows after the step over which a derivative is followed
SHORTEST = 40  # minimum number of samples in a window
REST = 0.05  # drift before the step, relative to the response: with more, the plant was not at rest
FINE = 1e-9  # relative noise up to which the sixth difference may show the response itself
STEPPED = 2.0  # early slope of z_(k-1) relative to its later one: with more, it has itself stepped
CLEAN = 0.02  # distance of the slope at the step from a whole number to trust the power law alone
ONSET = 0.2  # the same, to trust both methods with another window


def longest_window(record: Record) -> float:
    """Return the longest window that fits behind the step of a record [s]."""
    return (record.until - record.step_time - 2*record.h)/SPAN


def _ripple(y):
    """Noise of samples, seen in their sixth difference, where everything smooth vanishes."""
    if len(y) <= 12:
        return 0.0
    return float(np.sqrt(np.mean(np.diff(y, 6)**2)/924))  # 924: sum of the squared weights


def _fits(record, window):
    """Samples in a window and in its span; None if the record is too short or too coarse."""
    if not window < record.t[-1] - record.t[0]:
        return None
    n = round(window/record.h)
    span = round(SPAN*n)
    usable = np.searchsorted(record.t, record.until, "right")
    return (n, span) if n >= SHORTEST and record.start + span < usable else None


def _silent(before, drift, size, start):
    """Return the reason why a record cannot be judged; empty if it can."""
    if size == 0.0:
        return "the output does not respond to the input"
    if drift > REST and drift > 6.0*_ripple(before)/np.sqrt(start/5):
        return (f"the plant was not at rest before the step: the output drifted by {drift:.0%} of "
                "the response")
    return ""


def _chosen(analysis, power, noise):
    """Return the order that the two methods give together, or None, and the doubt about it."""
    a, b, bends = analysis.prd, power.prd, analysis.bends[:analysis.prd or 0]
    why = ""
    if a == b or b and abs(power.onset - b) <= CLEAN:
        prd = b
    elif bends and bends == sorted(bends) and bends[-1] <= STEPPED:
        prd = None if b and noise > FINE else a  # z_a steps; in noise either method may err
    elif b and not a and noise > FINE:
        prd = b
    else:
        prd, why = None, ("no derivative steps as it would from rest: within the window the plant "
                          "moves by itself; ")
    if analysis.jumps and not (prd is not None and a == b):
        slope = f"PRD {b}, slope {power.slope:.2f}, {power.onset:.2f} at the step"
        why += (f"analyser: {analysis.reason or f'PRD {a}'}; power law: {power.reason or slope}")
    return prd, why


def answer(record: Record, window: float, alpha: float) -> PRDResult:
    """Return the result for one record at one time scale."""
    if not (fit := _fits(record, window)):
        low = f"{SHORTEST*record.h:.4g} s ({SHORTEST} samples)"
        high = f"{longest_window(record):.4g} s (1/{SPAN:g} of the record after the step)"
        raise ParameterError(f"prd.identify: window = {window:.4g} s is not allowed; for "
                             f"{record.name} it must be from {low} to {high}")
    n, span = fit
    low, start = max(0, record.start - span), min(span, record.start)
    t, y = record.t[low:record.start + span + 1], record.y[low:record.start + span + 1]
    away = y - np.median(y[:start])
    size = float(np.abs(away[start:]).max())
    f = away/(size or 1.0)  # whose square does not overflow
    before = f[:start]
    drift = float(np.ptp([np.median(q) for q in np.array_split(before, 5)]))
    noise = max(float(before.std()), _ripple(f[start + 8:]))
    if why := _silent(before, drift, size, start):
        analysis = Analysis(None, derivatives=np.zeros((len(ORDERS), len(t))), reason=why)
        power = PowerLaw(None, np.nan, (np.nan, np.nan), noise*size, why)
    else:
        power = power_law(t[start:] - record.step_time, away[start:], noise*size, SPAN*window)
        if noise > FINE:
            # a coarse log is quiet before the step and noisy after it: let the analyser hear
            # before the step the noise that comes after it
            hidden = size*np.sqrt(max(noise**2 - before.var(), 0.0))
            away[:start] += hidden*np.random.default_rng(0).standard_normal(start)
        analysis = analyse(t, away, start, n, record.h, alpha)
    prd, doubt = _chosen(analysis, power, noise)
    gain = np.nan
    if prd and prd == power.prd:  # y r!/t^r, extended to t = 0 by a straight line
        s = t[start + n//4:] - record.step_time
        gain = np.polyfit(s, away[start + n//4:]*math.factorial(prd)/s**prd, 1)[1]
    elif prd:
        gain = np.median(analysis.derivatives[prd - 1, start + n//2:start + n + 1])
    return PRDResult(prd, prd is not None and analysis.prd == power.prd, float(window), alpha,
                     analysis, power, float(gain)/record.amplitude, noise if size else np.nan,
                     why + doubt, t, y, record.step_time, record.amplitude, record.name)


def shortest_answer(record: Record, alpha: float) -> PRDResult:
    """Return the result at one of the shortest time scales at which the power law shows.

    It has an order only if both methods agree there.
    """
    window, results = longest_window(record), []
    while _fits(record, window) or not results:
        results.insert(0, answer(record, window, alpha))
        window /= 2
    first = next((i for i, q in enumerate(results) if q.power.prd), len(results) - 1)
    near, seen = results[first].power, results[first:first + 3]
    later = (q.power for q in results[first + 1:] if q.power.octave[0] > 1.4*near.octave[0])
    onset = np.nan
    if far := next(later, None):
        onset = extrapolated(near.slope, far.slope, far.octave[0]/near.octave[0])
    for q in seen:
        if q.confirmed and q.prd == near.prd and abs(onset - q.prd) <= ONSET:
            return q
    slopes = ", ".join(f"{q.power.slope:.2f} at {q.time_scale:.3g} s" for q in seen)
    why = ("the methods agree at no short time scale" if len(results) > 1 else
           "only one window fits, and it takes two to compare")
    return replace(seen[0], prd=None, confirmed=False, gain=np.nan,
                   reason=f"{why} (power law: {near.reason or f'slope {slopes}'}); give a window, "
                          "or a record with less noise or more samples")
