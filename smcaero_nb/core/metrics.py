"""Figures of merit of a run."""

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from .leaves import at, heads
from .param import Param, given
from .signal import flat
from .sliding import at_limit, gains, growing, rows_of, slides
from .step_response import stepped

if TYPE_CHECKING:
    from .run import Run

__all__ = ["Metrics", "metrics", "reaching_time"]

#: Where they are not 1.
UNITS = {"reaching_time": "s", "variation_u": "1/s", "turns_u": "1/s", "diverged_at": "s",
         "settling_time": "s", "rise_time": "s", "overshoot": "%", "iae": "s", "ise": "s",
         "energy_u": "s", "limit_time": "s"}


@dataclass(frozen=True)
class Metrics:
    r"""Figures of merit of a run; with several channels, tuples of one value per channel.

    `Run.metrics` makes them. First those of the paper, then those usual elsewhere; a figure that
    makes no sense for the run is None, and `rows` leaves it out.

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
    reaching_time : float or None
        Time after which sigma is at rest [s], infinite if it never is: see `reaching_time`. None
        without a sliding mode law.
    variation_u : float
        Chattering: total variation of u per second in the tail.
    turns_u : float
        Chattering: reversals of direction of u per second in the tail; for a relay, its switchings.
    diverged_at : float or None
        Time of divergence [s]; the other figures then hold for the valid part only.
    settling_time : float or None
        Time from the last step of the reference after which \|e\| stays within 2 % of the step [s];
        infinite if it does not. Of a constant reference, from the start.
    rise_time : float or None
        Time from 10 to 90 % of that step [s]; infinite if y does not get there.
    overshoot : float or None
        How far y goes beyond the reference after that step [%].
    rms_e : float
        Root mean square of e.
    iae, ise : float
        int \|e\| dt and int e^2 dt [s].
    energy_u : float
        Control energy, int u^2 dt [s].
    limit_time : float or None
        Time at which the actuator is at its limit [s]; None where none is known: see `Run.doubts`.

    Notes
    -----
    `iae` is of every step of the run. `rms_e`, `ise`, `energy_u` and the figures of a step are of
    the recorded rows: exact to a row in time, and what happens between rows counts as on them.
    `limit_time` is of 100 rows.
    """

    J_e: Any
    J_u: Any
    max_u: Any
    tail_e: Any
    tail_sigma: Any
    reaching_time: Any
    variation_u: Any
    turns_u: Any
    diverged_at: float | None
    settling_time: Any = None
    rise_time: Any = None
    overshoot: Any = None
    rms_e: Any = None
    iae: Any = None
    ise: Any = None
    energy_u: Any = None
    limit_time: Any = None

    def rows(self) -> list[tuple[str, str, str]]:
        """Return (name, value, unit) of each figure that has a value, formatted."""
        rows = []
        for name, v in ((f.name, getattr(self, f.name)) for f in fields(self)):
            values = v if isinstance(v, tuple) else (v,)
            if any(q is not None for q in values):
                rows.append((name, ", ".join(_said(name, q) for q in values), UNITS.get(name, "")))
        return rows

    def _grouped(self) -> list[list[tuple[str, str, str]]]:
        """The figures of the paper, and those usual elsewhere."""
        rows, own = self.rows(), [f.name for f in fields(self)].index("settling_time")
        paper = {f.name for f in fields(self)[:own]}
        groups = [q for q in rows if q[0] in paper], [q for q in rows if q[0] not in paper]
        return [q for q in groups if q]

    def __str__(self) -> str:
        return "   ".join(_with_unit(*q) for q in self.rows())

    def _repr_html_(self) -> str:
        lines = []
        for group in self._grouped():
            head = "".join(f"<th>{n} [{unit}]</th>" if unit else f"<th>{n}</th>"
                           for n, _, unit in group)
            body = "".join(f"<td>{v}</td>" for _, v, _ in group)
            lines.append(f"<tr>{head}</tr><tr>{body}</tr>")
        return f"<table>{''.join(lines)}</table>"


def _said(name: str, v: float | None) -> str:
    """A figure in words."""
    if v is None or math.isnan(v):
        return "no sliding" if name == "reaching_time" else "none"
    missed = {"reaching_time": "not reached", "settling_time": "not settled",
              "rise_time": "not reached"}
    return missed[name] if v == math.inf and name in missed else f"{v:.4g}"


def _with_unit(name: str, v: str, unit: str) -> str:
    return f"{name} = {v} {unit}".rstrip() if v[-1:].isdigit() else f"{name} = {v}"


def reaching_time(run: "Run", band: float | None = None) -> list[float | None]:
    r"""Time after which sigma is at rest, channel by channel.

    Parameters
    ----------
    run : Run
    band : float, optional
        \|sigma\| that counts as rest, in the unit of sigma. Default: see Notes.

    Returns
    -------
    list of float or None
        [s], to within one recorded row. Infinite if sigma is not at rest at the end, or the run
        diverged: a minimum over runs never picks such a one. None without a sliding mode law,
        unless a band is given.

    Raises
    ------
    ParameterError
        Something other than a run, or a band that is negative or not finite.

    Notes
    -----
    Without a `band`, sigma is at rest if, throughout the tail, \|sigma\| is at most the sum of

    - the band that the law itself accepts, where its card has one: 19 eps of a sigmoid, 1.84 eps of
      a tanh (\|v\| is then 95 % of rho), eps of a saturation, 1.25 delta, 12 mu, 3 sqrt(mu_1) of
      the adaptive laws, the dead band of an on-off thruster; but eps, delta, mu, sqrt(mu_1) where
      \|xi\| exceeds the bound of the law, the actuator is at its limit for 95 % of the tail, or
      more of v does not move sigma down;
    - what sampling allows: as far as sigma moves, at the greatest \|sigma'\| of the tail, in
      5 2^(p-1) samples, p the order of sliding (5, 10, 20, 40 for p = 1 to 4); behind a
      differentiator with n outputs in 3^n or 3^p, whichever is more; nothing where sigma depends
      on u itself;
    - 1e-5 of the maximum \|sigma\|; where sigma is estimated or behind a sensor, 2e-3, and twice
      what the estimate of a sliding variable is wrong by, at most 5 %;

    and if the gain that an adaptive law adapts does not still grow. The reaching time is then that
    after which \|sigma\| stays within this sum, of a sigmoid or tanh with eps, of an adaptive law
    with delta or mu, and with no more of what sampling allows than a tenth of the maximum
    \|sigma\|; or within twice its tail value, if that is more. So neither a sigma that stands
    still, nor one that grows, nor a limit cycle of many samples, be it of a latency, counts as
    sliding. Of a run recorded from `since` on, it is at most the time that is found.

    The tail is that of the run, but at least a tenth and at most half of it, or the last fifth of a
    run that ended before it; where the command jumps in it, the longest part between two jumps, if
    that is 30 % of it, its first half left out after a jump. Measured on all
    laws of the kit, for r = 1 to 4 and tau from 1e-4 to 1e-2 s, sliding takes up to 1, 2.1, 4.6 and
    8.5 samples for p = 1 to 4, behind an actuator as fast as the sampling up to 4, and with a
    differentiator up to 6, 15 and 46 for 2 to 4 outputs.
    """
    from .run import Run  # which imports this module

    given("reaching_time", "run", run, Run, "a Run, such as simulate(loop) gives")
    if band is None:
        return _rested(run)
    own = Param(low=0.0, unit="[sigma]").check("reaching_time", "band", band)
    lows, highs = (heads(run.leaves("sigma"), q.sigma) for q in (run.low, run.high))
    return [_entered(run, np.maximum(np.abs(low), np.abs(high)), own)
            for low, high in zip(lows, highs, strict=True)]


def _rested(run: "Run") -> list[float | None]:
    """Time after which each sigma rests in a band of its own."""
    law = run.loop.stages["law"]
    if not len(run.t):
        return [math.inf]*sum(not q.derivative for q in run.leaves("sigma"))
    parts = [*law.parts.values()] if hasattr(law, "parts") else [law]
    found = run._motions
    grows = [growing(run, k) for _, k in gains(run)] if law else [False]
    many = len(parts) == len(found)
    times: list[float | None] = []
    for i, motion in enumerate(found):
        b, more = (parts[i], grows[i]) if many else (parts[0], any(grows))
        lost = more or not motion.rests
        times.append(None if not slides(b) else math.inf if lost
                     else _entered(run, motion.size, motion.near))
    return times


def _entered(run: "Run", size: np.ndarray, band: float) -> float:
    """Time after which a size stays within a band."""
    outside = np.flatnonzero(size > band)
    last = outside[-1] if len(outside) else -1
    never = run.diverged_at is not None or last == len(run.t) - 1
    return math.inf if never else float(run.t[last + 1])


def _one(values: list) -> Any:
    """A figure, or a tuple of them, one per channel; None where none has a value."""
    if all(v is None for v in values):
        return None
    return values[0] if len(values) == 1 else tuple(values)


def metrics(run: "Run") -> Metrics:
    """Return the figures of merit of a run."""
    tail, leaves = run.tail or math.nan, run.leaves("e")
    end = float(run.t[-1]) if len(run.t) else 0.0
    e, u = heads(leaves, run.e), flat(run.u)
    means = heads(leaves, run.mean_e)
    ise = [_integral(run.t, q*q) for q in e]
    steps = [stepped(run.t, at(run.y, q.path), at(run.e, q.path))
             for q in leaves if not q.derivative]
    return Metrics(
        J_e=_one(means), J_u=_one(flat(run.mean_u)),
        max_u=_one(flat(run.max_u)), tail_e=run.tail_e, tail_sigma=run.tail_sigma,
        reaching_time=_one(_rested(run)),
        variation_u=_one([v/tail for v in flat(run.tail_variation_u)]),
        turns_u=_one([v/tail for v in flat(run.tail_turns_u)]), diverged_at=run.diverged_at,
        settling_time=_one([q and q.settling_time for q in steps]),
        rise_time=_one([q and q.rise_time for q in steps]),
        overshoot=_one([q and q.overshoot for q in steps]),
        rms_e=_one([math.sqrt(q/end) if end else math.nan for q in ise]),
        iae=_one([q*end for q in means]), ise=_one(ise),
        energy_u=_one([_integral(run.t, q*q, held=True) for q in u]),
        limit_time=_limit_time(run, end))


def _integral(t: np.ndarray, q: np.ndarray, held: bool = False) -> float:
    """Integral of what is recorded; of a quantity that is held from row to row, a sum."""
    return float(np.diff(t) @ (q[:-1] if held else 0.5*(q[:-1] + q[1:])))


def _limit_time(run: "Run", end: float) -> Any:
    """Time at which each input is at its limit."""
    found = at_limit(run, rows_of(slice(0, len(run.t)))) if len(run.t) else None
    return _one([float(q.mean())*end for q in found]) if found else None
