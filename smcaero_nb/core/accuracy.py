"""The order of sliding, measured: how the accuracy depends on the sampling step."""

import math
from dataclasses import dataclass

import numpy as np

from .assumptions import degree, laws
from .param import ParameterError, function, positive, refused, several
from .signal import flat
from .simulate import simulate, timed

__all__ = ["Accuracy", "accuracy"]

FACTORS = (4.0, 2.0, 1.0, 0.5, 0.25)
NEAR = 0.25  # a slope as near as this to a whole number is that order
STILL = 3.0  # a sigma that falls by this factor from one half of the tail to the other is still converging
NOISE = 1e-16  # of the greatest sigma: less is not resolved by float64


@dataclass(frozen=True)
class Accuracy:
    r"""Accuracy against sampling step; made by `accuracy`.

    Attributes
    ----------
    tau : ndarray
        Sampling steps [s], falling.
    names : tuple of str
        What was measured: ``"sigma"``, ``"sigma'"``, ..., with several inputs ``"sigma[0]"``, ...
    sizes : ndarray, (len(names), len(tau))
        Greatest absolute value of each over the second half of the run; NaN where the run diverged,
        ended before it, had not settled, or went below what float64 resolves.
    slopes : tuple of float
        Slope of each over tau, both logarithmic; NaN with fewer than four good steps.
    order : int or None
        The order of sliding p: \|sigma^(i)\| ~ tau^(p-i) for all i. None if no whole number fits.
    why : str
        What was left out, and why; empty if nothing was.
    loop : ClosedLoop
    """

    tau: np.ndarray
    names: tuple
    sizes: np.ndarray
    slopes: tuple
    order: int | None
    why: str
    loop: object

    def explain(self):
        """Say in words what was measured."""
        said = ", ".join(f"|{n}| ~ tau^{s:.2f}" for n, s in zip(self.names, self.slopes, strict=True) if math.isfinite(s))
        if not said:
            return f"No order of sliding was found: {self.why}."
        if self.order:
            verdict = f"sliding of order {self.order}"
        elif all(abs(s) < NEAR for s in self.slopes if math.isfinite(s)):
            verdict = "no order of sliding: the accuracy does not come from sampling, smaller steps do not improve it"
        else:
            verdict = "no whole order of sliding fits"
        return f"{verdict[0].upper()}{verdict[1:]}: {said}" + (f" ({self.why})." if self.why else ".")

    def __str__(self):
        return self.explain()


def accuracy(loop, duration=None, dt=None, tau=None, *, factors=FACTORS, method="euler", progress=None):
    r"""Measure the order of sliding of a loop: the slope of its accuracy over the sampling step.

    A sliding mode of order p, sampled every tau, keeps :math:`|\sigma^{(i)}| \le m_i \tau^{p-i}`.
    The loop is run with several steps, and the greatest :math:`|\sigma^{(i)}|` of the second half
    of each run is compared.

    Parameters
    ----------
    loop : ClosedLoop
        With a law.
    duration, dt, tau : float, optional
        As in `simulate` [s]; default: the loop's own.
    factors : sequence of float
        The sampling steps are these times tau, at least four of them, and so is dt.
    method : str
        As in `simulate`.
    progress : callable, optional
        Called with the fraction done (0 to 1); what it raises ends the measurement.

    Returns
    -------
    Accuracy

    Raises
    ------
    ParameterError
        Fewer than four different factors, or one that is not positive; a loop without a law; and
        what `simulate` raises.

    Notes
    -----
    The slopes are those of real numbers: at a high order, small steps reach the
    resolution of float64, and steps whose result is below it are left out. An actuator that the law
    does not know, noise, or a boundary layer hide the order: the slope is then near 0.

    References
    ----------
    A. Levant, Int. J. Control 58 (1993) 1247, for real sliding; Int. J.
    Control 76 (2003) 924, for the exponents.

    Examples
    --------
    >>> accuracy(smc.applications.perturbed_chain(smc.smc2.super_twisting, 1)).order
    2
    """
    duration, dt, step = timed("accuracy", loop, duration, dt, tau)
    function("accuracy", "progress", progress)
    if loop.stages["law"] is None:
        raise ParameterError("accuracy: the loop has no law, so there is no sliding to measure")
    given = several("accuracy", "factors", factors)
    factors = {positive("accuracy", f"factors[{i}]", f, "1") for i, f in enumerate(given)}
    if len(factors) < 4:
        raise refused("accuracy", "factors", given, "at least four different numbers")
    factors = sorted(factors, reverse=True)
    cost, done, sizes, left = np.array([1.0/f for f in factors]), 0.0, [], {}
    for f, part in zip(factors, cost/cost.sum(), strict=True):
        watched = progress and (lambda q, done=done, part=part: progress(done + part*q))
        run = simulate(loop, duration, f*dt, f*step, method=method, tail=0.5, progress=watched)
        names, size, why = _measured(run)
        sizes.append(size)
        if why:
            left.setdefault(why, []).append(f"{f*step:.3g}")
        done += part
    steps, sizes = step*np.array(factors), np.array(sizes).T
    slopes = []
    for size in sizes:
        good = np.isfinite(size) & (size > 0.0)
        slopes.append(float(np.polyfit(np.log(steps[good]), np.log(size[good]), 1)[0]) if good.sum() >= 4 else math.nan)
    why = "; ".join(f"tau = {', '.join(q)} s left out: {said}" for said, q in left.items())
    return Accuracy(steps, tuple(n for n, _ in names), sizes, tuple(slopes), _order(slopes, [i for _, i in names]), why, loop)


def _measured(run):
    """[(name, derivative)], the greatest size of each in the tail, and why it does not count."""
    names, sizes = [], []
    why = "diverged" if run.diverged_at is not None else "" if run.tail else "ended before its second half"
    many = hasattr(run.loop.stages["law"], "parts")
    tails = run.tail_peaks.sigma if many else (run.tail_peaks.sigma,)
    lows, highs, peaks = ((q if many else (q,)) for q in (run.low.sigma, run.high.sigma, run.max_sigma))
    for c, ((b, s, v, _), *parts) in enumerate(zip(laws(run), tails, lows, highs, peaks, strict=True)):
        vector = isinstance(v, tuple)
        for i, (tail, low, high, peak) in enumerate(zip(*map(flat, parts), strict=True)):
            if not vector and i >= max(degree(b, s, v), 1):
                continue  # a derivative that contains the control
            where = f"[{c}]"*many + f"[{i}]"*vector
            names.append((f"sigma{where}" + "'"*(0 if vector else i), 0 if vector else i))
            half = len(run.t)//2
            first, last = (max(np.abs(low[q]).max(initial=0.0), np.abs(high[q]).max(initial=0.0))
                           for q in (slice(half, half + half//2), slice(half + half//2, None)))
            small = tail <= NOISE*peak
            unsettled = "still converging" if first > STILL*last else ""
            why = why or ("below the resolution of float64" if small else unsettled)
            sizes.append(tail)
    return names, np.full(len(sizes), math.nan) if why else np.array(sizes), why


def _order(slopes, derivatives):
    """The whole number p of which all slopes are p - i."""
    orders = {round(s) + i if math.isfinite(s) and abs(s - round(s)) <= NEAR else 0
              for s, i in zip(slopes, derivatives, strict=True)}
    order = orders.pop()
    return None if orders or order <= 0 else order
