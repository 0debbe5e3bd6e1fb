"""The order of sliding, measured by how the accuracy depends on the sampling step."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .assumptions import degree, laws
from .leaves import Leaf, at
from .loop import ClosedLoop
from .param import ParameterError, function, positive, refused, several
from .run import Run
from .simulate import simulate, timed

__all__ = ["Accuracy", "accuracy"]

FACTORS = (4.0, 2.0, 1.0, 0.5, 0.25)
NEAR = 0.25  # a slope this close to a whole number is that order
STILL = 3.0  # a sigma smaller by this factor in the second half of the tail is still converging
NOISE = 1e-16  # fraction of the maximum sigma below which float64 resolves nothing


@dataclass(frozen=True)
class Accuracy:
    r"""Accuracy against sampling step; made by `accuracy`.

    Attributes
    ----------
    tau : ndarray
        Sampling steps [s], in decreasing order.
    names : tuple of str
        Quantities measured, by their leaves (`Run.leaves`): ``"sigma"``, ``"sigma'"``, ...; with
        several inputs ``"sigma[0]"``, ...
    sizes : ndarray, (len(names), len(tau))
        Maximum absolute value of each over the second half of the run; NaN where the run diverged,
        ended before it, had not settled, or went below the resolution of float64.
    slopes : tuple of float
        Slope of each over tau, both logarithmic; NaN with fewer than four usable steps.
    order : int or None
        The order of sliding p: \|sigma^(i)\| ~ tau^(p-i) for all i. None if no whole number fits.
    why : str
        Steps left out, and the reason; empty if there are none.
    loop : ClosedLoop
    """

    tau: np.ndarray
    names: tuple[str, ...]
    sizes: np.ndarray
    slopes: tuple[float, ...]
    order: int | None
    why: str
    loop: ClosedLoop

    def explain(self) -> str:
        """Describe the result in words."""
        said = ", ".join(f"|{n}| ~ tau^{s:.2f}"
                         for n, s in zip(self.names, self.slopes, strict=True) if math.isfinite(s))
        if not said:
            return f"No order of sliding was found: {self.why}."
        if self.order:
            verdict = f"sliding of order {self.order}"
        elif all(abs(s) < NEAR for s in self.slopes if math.isfinite(s)):
            verdict = ("no order of sliding: the accuracy does not come from sampling, "
                       "so smaller steps do not improve it")
        else:
            verdict = "no whole order of sliding fits"
        why = f" ({self.why})" if self.why else ""
        shown = "; shown from this start and under this perturbation"*bool(self.order)
        return f"{verdict[0].upper()}{verdict[1:]}: {said}{why}{shown}."

    def __str__(self) -> str:
        return self.explain()


def accuracy(loop: ClosedLoop, duration: float | None = None, dt: float | None = None,
             tau: float | None = None, *, factors: Sequence[float] = FACTORS,
             method: str | None = None, progress: Callable[[float], Any] | None = None) -> Accuracy:
    r"""Measure the order of sliding of a loop: the slope of its accuracy over the sampling step.

    A sliding mode of order p, sampled every tau, keeps :math:`|\sigma^{(i)}| \le m_i \tau^{p-i}`.
    The loop is run with several sampling steps, and the maxima of :math:`|\sigma^{(i)}|` over the
    second halves of the runs are compared.

    Parameters
    ----------
    loop : ClosedLoop
        With a law.
    duration, dt, tau : float, optional
        As in `simulate` [s]; default: the loop's own.
    factors : sequence of float
        Multiples of tau, and of dt, to run with; at least four. A latency, and the duration of a
        pulse, stay as they are: they must be multiples of each dt, and of each tau.
    method : str, optional
        As in `simulate`.
    progress : callable, optional
        Called with the fraction done (0 to 1); an exception that it raises ends the
        measurement.

    Returns
    -------
    Accuracy

    Raises
    ------
    ParameterError
        Fewer than four different factors, or one that is not positive; a loop without a law; also
        for the reasons of `simulate`, with any of the factors.

    Notes
    -----
    It shows the order from this start and under this perturbation; it does not prove it for others.
    The theory assumes exact arithmetic: at a high order, small steps reach the resolution of
    float64, and steps whose result is below it are left out. An actuator that the law does not
    know, noise, or a boundary layer hides the order: the slope is then near 0.

    References
    ----------
    A. Levant, Int. J. Control 58 (1993) 1247, for real sliding; Int. J. Control 76 (2003) 924, for
    the exponents.

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
    different = {positive("accuracy", f"factors[{i}]", f, "1") for i, f in enumerate(given)}
    if len(different) < 4:
        raise refused("accuracy", "factors", given, "at least four different numbers")
    multiples = sorted(different, reverse=True)
    cost, done, sizes, left = np.array([1.0/f for f in multiples]), 0.0, [], {}
    seen: list[Leaf] = []
    for f, part in zip(multiples, cost/cost.sum(), strict=True):
        watched = progress and (lambda q, done=done, part=part: progress(done + part*q))
        try:
            run = simulate(loop, duration, f*dt, f*step, method=method, tail=0.5, progress=watched)
        except ParameterError as why:
            if f == 1.0:
                raise
            raise ParameterError("accuracy: tau and dt are multiplied by the factors, here by "
                                 f"{f:g}, and then: {why} (or choose other factors)") from None
        seen, size, why = _measured(run)
        sizes.append(size)
        if why:
            left.setdefault(why, []).append(f"{f*step:.3g}")
        done += part
    steps, sizes = step*np.array(multiples), np.array(sizes).T
    slopes = [_slope(steps, size) for size in sizes]
    why = "; ".join(f"tau = {', '.join(q)} s left out: {said}" for said, q in left.items())
    order = _order(slopes, [q.derivative or 0 for q in seen])
    return Accuracy(steps, tuple(q.key for q in seen), sizes, tuple(slopes), order, why, loop)


def _slope(steps: np.ndarray, size: np.ndarray) -> float:
    """The logarithmic slope of a size over the steps; NaN with fewer than four usable ones."""
    good = np.isfinite(size) & (size > 0.0)
    if good.sum() < 4:
        return math.nan
    return float(np.polyfit(np.log(steps[good]), np.log(size[good]), 1)[0])


def _measured(run: Run) -> tuple[list[Leaf], np.ndarray, str]:
    """Leaves of sigma, the maximum of each in the tail, and the reason to leave them out."""
    seen, sizes, why = [], [], ""
    if run.diverged_at is not None:
        why = "diverged"
    elif not run.tail:
        why = "ended before its second half"
    channels, many = laws(run), hasattr(run.loop.stages["law"], "parts")
    half, quarter = len(run.t)//2, len(run.t)//2//2
    for q in run.leaves("sigma"):
        b, sigma, v, _ = channels[q.channel if many else 0]
        if (q.derivative or 0) >= max(degree(b, sigma, v), 1):
            continue  # a derivative that contains the control
        tail, low, high, peak = (at(signal, q.path) for signal in (
            run.tail_peaks.sigma, run.low.sigma, run.high.sigma, run.max_sigma))
        first, last = (max(np.abs(low[k]).max(initial=0.0), np.abs(high[k]).max(initial=0.0))
                       for k in (slice(half, half + quarter), slice(half + quarter, None)))
        if not why and tail <= NOISE*peak:
            why = "below the resolution of float64"
        elif not why and first > STILL*last:
            why = "still converging"
        seen.append(q)
        sizes.append(tail)
    return seen, np.full(len(sizes), math.nan) if why else np.array(sizes), why


def _order(slopes: list[float], derivatives: list[int]) -> int | None:
    """The whole number p for which all slopes are p - i, or None."""
    orders = {round(s) + i if math.isfinite(s) and abs(s - round(s)) <= NEAR else 0
              for s, i in zip(slopes, derivatives, strict=True)}
    order = orders.pop()
    return None if orders or order <= 0 else order
