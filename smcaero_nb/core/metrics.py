"""Figures of merit of a run."""

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from .leaves import heads
from .param import Param, given
from .signal import flat

if TYPE_CHECKING:
    from .run import Run

__all__ = ["Metrics", "metrics", "reaching_time"]


@dataclass(frozen=True)
class Metrics:
    r"""Figures of merit of a run; with several channels, tuples of one value per channel.

    `Run.metrics` makes them.

    Attributes
    ----------
    J_e : float
        Mean absolute error, (1/T) int \|e\| dt: paper eq (73).
    J_u : float
        Mean absolute control, (1/T) int \|u\| dt: paper eq (74).
    max_u : float
        Maximum \|u\|.
    tail_e, tail_sigma : float
        Maximum \|e\|, \|sigma\| in the tail of the run, by default its last fifth.
    reaching_time : float
        Time after which \|sigma\| stays below twice its tail value [s].
    variation_u : float
        Chattering: total variation of u per second in the tail.
    turns_u : float
        Chattering: reversals of direction of u per second in the tail; for a relay, its switchings.
    diverged_at : float or None
        Time of divergence [s]; the other figures then hold for the valid part only.
    """

    J_e: float
    J_u: float
    max_u: float
    tail_e: float
    tail_sigma: float
    reaching_time: float
    variation_u: float
    turns_u: float
    diverged_at: float | None

    def rows(self) -> list[tuple[str, str, str]]:
        """Return (name, value, unit) of each figure that has a value, formatted."""
        units = {"reaching_time": "s", "variation_u": "1/s", "turns_u": "1/s", "diverged_at": "s"}
        rows = []
        for name, v in ((f.name, getattr(self, f.name)) for f in fields(self)):
            if v is not None:
                values = v if isinstance(v, tuple) else (v,)
                rows.append((name, ", ".join(f"{q:.4g}" for q in values), units.get(name, "")))
        return rows

    def __str__(self) -> str:
        return "   ".join(f"{n} = {v} {unit}".rstrip() for n, v, unit in self.rows())

    def _repr_html_(self) -> str:
        rows = self.rows()
        head = "".join(f"<th>{n} [{unit}]</th>" if unit else f"<th>{n}</th>" for n, _, unit in rows)
        body = "".join(f"<td>{v}</td>" for _, v, _ in rows)
        return f"<table><tr>{head}</tr><tr>{body}</tr></table>"


def reaching_time(run: "Run", band: float | None = None) -> list[float]:
    r"""Time after which \|sigma\| stays within `band`, channel by channel.

    Parameters
    ----------
    run : Run
    band : float, optional
        In the unit of sigma; default: twice the maximum \|sigma\| of the tail.

    Returns
    -------
    list of float
        [s], to within one recorded row; infinite if \|sigma\| is outside at the end or the run
        diverged; NaN if no band is given and the run ended before its tail.

    Raises
    ------
    ParameterError
        Something other than a run, or a band that is negative or not finite.
    """
    from .run import Run  # which imports this module

    given("reaching_time", "run", run, Run, "a Run, such as simulate(loop) gives")
    if band is not None:
        band = Param(low=0.0, unit="[sigma]").check("reaching_time", "band", band)
    times, leaves = [], run.leaves("sigma")
    lows, highs = heads(leaves, run.low.sigma), heads(leaves, run.high.sigma)
    tails = run.tail_sigma if isinstance(run.tail_sigma, tuple) else (run.tail_sigma,)
    for low, high, tail in zip(lows, highs, tails, strict=True):
        size = np.maximum(np.abs(low), np.abs(high))
        outside = np.flatnonzero(size > (2*tail if band is None else band))
        last = outside[-1] if len(outside) else -1
        never = run.diverged_at is not None or last == len(run.t) - 1
        unknown = band is None and tail != tail and not never
        times.append(math.inf if never else math.nan if unknown else float(run.t[last + 1]))
    return times


def _one(values: list) -> Any:
    """A figure, or a tuple of them, one per channel."""
    return values[0] if len(values) == 1 else tuple(values)


def metrics(run: "Run") -> Metrics:
    """Return the figures of merit of a run."""
    tail = run.tail or math.nan
    return Metrics(
        J_e=_one(heads(run.leaves("e"), run.mean_e)), J_u=_one(flat(run.mean_u)),
        max_u=_one(flat(run.max_u)), tail_e=run.tail_e, tail_sigma=run.tail_sigma,
        reaching_time=_one(reaching_time(run)),
        variation_u=_one([v/tail for v in flat(run.tail_variation_u)]),
        turns_u=_one([v/tail for v in flat(run.tail_turns_u)]), diverged_at=run.diverged_at)
