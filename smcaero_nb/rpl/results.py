"""What became of a descent: the landing and its verdict, the pulse trains."""

import math
from dataclasses import dataclass

import numpy as np

from ..core import ParameterError
from .control import allocation

__all__ = ["Landing", "Pulses", "landing", "pulses"]

DEG = math.pi/180.0
#: What "softly" means at the end: {attribute: (greatest size, factor and unit to say it in)}.
SOFT = {"altitude": (0.5, 1.0, "m"), "velocity": (0.5, 1.0, "m/s"), "e_theta": (DEG, 1.0/DEG, "deg"),
        "dtheta": (1.14*DEG, 1.0/DEG, "deg/s")}


@dataclass(frozen=True)
class Landing:
    """How a descent ended; made by `landing`.

    Attributes
    ----------
    t, altitude, velocity, e_theta, dtheta : float
        The end: time [s], altitude [m], vertical velocity [m/s], pitch error [rad] and pitch rate [rad/s].
    touchdown : tuple of 2 float, or None
        Time [s] and vertical velocity [m/s] at the first contact with the ground.
    lost_at : float or None
        When the thrust, tilted, could no longer hold the lander: authority over the altitude was lost [s].
    reasons : tuple of str
        Why it was not soft; empty if it was. A landing is true if it was soft.
    """

    t: float
    altitude: float
    velocity: float
    e_theta: float
    dtheta: float
    touchdown: tuple | None
    lost_at: float | None
    reasons: tuple

    soft = property(lambda self: not self.reasons)
    __bool__ = soft.fget

    def __str__(self):
        lost = f" Authority over the altitude was lost after {self.lost_at:.1f} s." if self.lost_at is not None else ""
        if self.soft:
            return f"Landed softly after {self.t:.1f} s at {self.velocity:.2f} m/s.{lost}"
        return f"Did not land softly: {'; '.join(self.reasons)}.{lost}"


def landing(run):
    r"""Whether a run of the lander ended softly, and if not, how hard and why.

    Parameters
    ----------
    run : Run
        Of a loop made by `loop`, with its stage `stop` or without.

    Returns
    -------
    Landing

    Notes
    -----
    Softly means at the end, at contact or at T: \|x\| < 0.5 m, \|x'\| < 0.5 m/s, \|e_theta\| < 1 deg, \|theta'\| < 1.14 deg/s,
    and no contact faster than 0.5 m/s before it. Without `stop` the contact is found between two recorded rows.

    References
    ----------
    Paper, section "Simulation results and discussions": the bounds of the rates.
    """
    x, v, t = run.x.altitude, run.x.velocity, run.t
    end = dict(t=t[-1], altitude=x[-1], velocity=v[-1], e_theta=run.e[0][0][-1], dtheta=run.x.dtheta[-1])
    below = np.flatnonzero(x <= 0.0)
    touchdown, reasons = None, []
    if len(below):
        k = below[0]
        share = x[k - 1]/(x[k - 1] - x[k]) if k and run.stopped_at is None else 1.0
        touchdown = tuple(float(q[k - 1] + share*(q[k] - q[k - 1]) if k else q[0]) for q in (t, v))
        if abs(touchdown[1]) >= SOFT["velocity"][0]:
            reasons.append(f"it hit the ground after {touchdown[0]:.1f} s at {touchdown[1]:.1f} m/s")
    if run.diverged_at is not None:
        reasons.append(f"it diverged after {run.diverged_at:.1f} s")
    reasons += [f"{n} = {end[n]*factor:.3g} {unit} at {t[-1]:.1f} s, not within {bound*factor:.3g} {unit}"
                for n, (bound, factor, unit) in SOFT.items() if not abs(end[n]) < bound]
    hover = (run.loop.stages["allocation"] or allocation).values["s_hover"]
    lost = np.flatnonzero(np.sin(run.x.theta) < hover)
    return Landing(**{n: float(q) for n, q in end.items()}, touchdown=touchdown, reasons=tuple(reasons),
                   lost_at=float(t[lost[0]]) if len(lost) else None)


@dataclass(frozen=True)
class Pulses:
    r"""The pulse train of a channel; made by `pulses`.

    Attributes
    ----------
    duty : float
        Share of the time in which it fires [1].
    rates : tuple of float
        Pulses per second that begin in each interval [1/s]; NaN for an interval that the run does not reach.
    shortest_on, shortest_off : float
        Shortest whole pulse and shortest whole pause [s]; infinite if there is none.
    impulse : float
        Impulse spent, int \|u\| dt [N s], to which the propellant is proportional.
    """

    duty: float
    rates: tuple
    shortest_on: float
    shortest_off: float
    impulse: float


def pulses(run, intervals=(0.0, 100.0, 200.0, 240.0)):
    """The pulse trains of a run of the lander.

    Parameters
    ----------
    run : Run
        With a row for each sample: ``simulate(loop, record=4800)``.
    intervals : sequence of float
        Times between which pulses are counted [s].

    Returns
    -------
    tuple of 2 Pulses
        Attitude and descent.

    Raises
    ------
    ParameterError
        Rows too far apart to see every pulse.

    Notes
    -----
    A pulse lasts while the thrust keeps its sign; where it changes from one sign to the other, one ends and another begins.

    References
    ----------
    Paper, figures of the off-pulse controls, and eq (59) for the impulse over T.
    """
    t, tau = run.t, run.tau
    if len(t) < 2 or np.diff(t).max() > tau*(1 + 1e-9):
        raise ParameterError(f"pulses: the run has a row every {np.diff(t).max() if len(t) > 1 else math.inf:g} s; it must have "
                             f"one every tau = {tau:g} s: simulate(..., record={round(run.loop.duration/tau)})")
    found = []
    for u, mean in zip(run.u, run.mean_u, strict=True):
        s = np.sign(u[:-1])
        begins = np.concatenate([[0], np.flatnonzero(np.diff(s)) + 1])
        lasts, on = np.diff(np.append(t[begins], t[-1])), s[begins] != 0.0
        starts = t[begins[on]]
        rates = [np.sum((starts >= a) & (starts < b))/(min(b, t[-1]) - a) if t[-1] > a else math.nan
                 for a, b in zip(intervals[:-1], intervals[1:], strict=True)]
        shortest = [float(lasts[1:-1][q[1:-1]].min(initial=math.inf)) for q in (on, ~on)]  # the first and last may be cut off
        found.append(Pulses(float(np.diff(t)[s != 0.0].sum()/t[-1]), tuple(map(float, rates)), *shortest, float(mean*t[-1])))
    return tuple(found)
