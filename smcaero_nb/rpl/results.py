"""Results of a descent: the landing and its verdict, the pulse trains."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core import ParameterError, Run
from ..core.param import given, refused
from ..records import numbers

__all__ = ["Landing", "Pulses", "landing", "pulses"]

DEG = math.pi/180.0
#: What "softly" means at the end: {what: (bound of the size, factor and unit for messages)}.
SOFT = {"altitude": (0.5, 1.0, "m"), "velocity": (0.5, 1.0, "m/s"),
        "pitch error": (DEG, 1.0/DEG, "deg"), "pitch rate": (1.14*DEG, 1.0/DEG, "deg/s")}


def digits(value):
    """Return the text of a number with three digits, or as a whole number."""
    return f"{value:.3g}" if abs(value) < 1e3 else f"{value:.0f}"


def of_the_lander(run, owner):
    """Raise `ParameterError` if this is not a run of the lander's plant."""
    given(owner, "run", run, Run, "a Run, such as simulate(rpl.loop()) gives")
    name = run.loop.stages["plant"].name
    if not {"left", "right", "m", "g_m"} <= set(run.loop.stages["plant"].params):
        raise ParameterError(f"{owner}: a run of the plant {name} is not allowed; "
                             "it must be one of rpl.lander")


@dataclass(frozen=True)
class Landing:
    """Outcome of a descent; made by `landing`.

    Attributes
    ----------
    t, altitude, velocity, e_theta, dtheta : float
        The end: time [s], altitude [m], vertical velocity [m/s], pitch error [rad] and pitch rate
        [rad/s].
    touchdown : tuple of 2 float, or None
        Time [s] and vertical velocity [m/s] at the hardest contact with the ground.
    lost_at : float or None
        When full thrust could no longer hold the lander, because of its tilt or its weight:
        authority over the altitude was lost [s].
    reasons : tuple of str
        Why the landing was not soft; empty if it was. A landing is true if it was soft.
    """

    t: float
    altitude: float
    velocity: float
    e_theta: float
    dtheta: float
    touchdown: tuple[float, float] | None
    lost_at: float | None
    reasons: tuple[str, ...]

    @property
    def soft(self) -> bool:
        """Whether the landing was soft."""
        return not self.reasons

    def __bool__(self) -> bool:
        return self.soft

    def __str__(self) -> str:
        lost = (f" Authority over the altitude was lost after {self.lost_at:.1f} s."
                if self.lost_at is not None else "")
        if self.soft:
            return f"Landed softly after {self.t:.1f} s at {self.velocity:.2f} m/s.{lost}"
        return f"Did not land softly: {'; '.join(self.reasons)}.{lost}"


def landing(run: Run) -> Landing:
    r"""Judge whether a run of the lander ended softly, and if not, how hard and why.

    Parameters
    ----------
    run : Run
        Of a loop made by `loop`, with its stage `stop` or without.

    Returns
    -------
    Landing

    Raises
    ------
    ParameterError
        A run of something else.

    Notes
    -----
    Softly means at the end, at contact or at T: \|x\| < 0.5 m, \|x'\| < 0.5 m/s,
    \|e_theta\| < 1 deg, \|theta'\| < 1.14 deg/s, and no contact faster than 0.5 m/s before it.
    Without `stop`, contacts are found between two recorded rows.

    References
    ----------
    Paper, section "Simulation results and discussions": the bounds of the rates.
    """
    of_the_lander(run, "landing")
    x, v, t = run.x.altitude, run.x.velocity, run.t
    if not len(t):
        return Landing(math.nan, math.nan, math.nan, math.nan, math.nan, None, None,
                       ("the start is beyond the limits of the plant",))
    end = float(x[-1]), float(v[-1]), float(run.e[0][0][-1]), float(run.x.dtheta[-1])
    touchdown: tuple[float, float] | None = None
    reasons = []
    for k in np.flatnonzero((x <= 0.0) & (np.append(math.inf, x[:-1]) > 0.0)):
        share = x[k - 1]/(x[k - 1] - x[k]) if k and run.stopped_at is None else 1.0
        when, speed = (float(q[k - 1] + share*(q[k] - q[k - 1]) if k else q[0]) for q in (t, v))
        touchdown = min(touchdown or (when, speed), (when, speed), key=lambda q: q[1])
    if touchdown and abs(touchdown[1]) >= SOFT["velocity"][0]:
        reasons.append(f"it hit the ground after {touchdown[0]:.1f} s at {touchdown[1]:.1f} m/s")
    if run.diverged_at is not None:
        reasons.append(f"it diverged after {run.diverged_at:.1f} s")
    p, actuator = run.loop.stages["plant"].values, run.loop.stages["actuator"]
    high = actuator.values.get("descent__high", math.inf) if actuator else math.inf
    thrust, weight = (p["left"] + p["right"])/12*high, p["m"]*p["g_m"]
    if thrust <= weight:
        reasons.append(f"full thrust, {thrust:.0f} N, is less than the weight, {weight:.0f} N")
    reasons += [f"{n} = {digits(q*SOFT[n][1])} {SOFT[n][2]} at {t[-1]:.1f} s, "
                f"not within {SOFT[n][0]*SOFT[n][1]:.3g} {SOFT[n][2]}"
                for n, q in zip(SOFT, end, strict=True)
                if not abs(q) < SOFT[n][0] and not (n == "velocity" and reasons)]
    lost = np.flatnonzero(np.sin(run.x.theta)*thrust <= weight)
    return Landing(float(t[-1]), *end, touchdown, float(t[lost[0]]) if len(lost) else None,
                   tuple(reasons))


@dataclass(frozen=True)
class Pulses:
    r"""The pulse train of a channel; made by `pulses`.

    Attributes
    ----------
    duty : float
        Fraction of the time in which it fires [1].
    rates : tuple of float
        Pulses per second that begin in each interval [1/s]; NaN for an interval that the run does
        not reach.
    shortest_on, shortest_off : float
        Shortest whole pulse and shortest whole pause [s]; infinite if there is none.
    impulse : float
        Impulse spent, int \|u\| dt [N s], to which the propellant is proportional.
    """

    duty: float
    rates: tuple[float, ...]
    shortest_on: float
    shortest_off: float
    impulse: float


def pulses(run: Run, intervals: Sequence[float] = (0.0, 100.0, 200.0, 240.0)
           ) -> tuple[Pulses, Pulses]:
    """Return the pulse trains of a run of the lander.

    Parameters
    ----------
    run : Run
        With a row for each sample: ``simulate(loop, record=4800)``.
    intervals : sequence of float
        Times between which pulses are counted [s], increasing.

    Returns
    -------
    tuple of 2 Pulses
        Attitude and descent.

    Raises
    ------
    ParameterError
        A run of something else, rows too far apart to see every pulse, or intervals that do not
        increase.

    Notes
    -----
    A pulse lasts while the thrust keeps its sign; where it changes from one sign to the other, one
    pulse ends and another begins.

    References
    ----------
    Paper, figures of the off-pulse controls, and eq (59) for the impulse over T.
    """
    of_the_lander(run, "pulses")
    t, tau, ends = run.t, run.tau, numbers("pulses", "intervals", intervals)
    if ends.ndim != 1 or len(ends) < 2 or not (ends[1:] > ends[:-1]).all():
        raise refused("pulses", "intervals", intervals, "two times [s] or more that increase")
    apart = np.diff(t).max() if len(t) > 1 else math.inf
    if apart > tau*(1 + 1e-9):
        rows = round((run.steps*run.tau if run.loop.duration is None else run.loop.duration)/tau)
        raise ParameterError(
            f"pulses: the run has a row every {apart:g} s; it must have one every tau = {tau:g} s: "
            f"simulate(..., record={rows})")
    attitude, descent = (_train(t, u, float(mean), ends)
                         for u, mean in zip(run.u, run.mean_u, strict=True))
    return attitude, descent


def _train(t, u, mean, ends):
    """Return the pulses of a thrust `u` at the times `t`, of the mean size `mean`."""
    s = np.sign(u[:-1])
    begins = np.concatenate([[0], np.flatnonzero(np.diff(s)) + 1])
    lasts, on = np.diff(np.append(t[begins], t[-1])), s[begins] != 0.0
    starts = t[begins[on]]
    rates = [np.sum((starts >= a) & (starts < b))/(min(b, t[-1]) - a) if t[-1] > a else math.nan
             for a, b in zip(ends[:-1], ends[1:], strict=True)]
    whole = slice(1, -1)  # the first and last may be cut off
    shortest_on, shortest_off = (float(lasts[whole][q[whole]].min(initial=math.inf))
                                 for q in (on, ~on))
    return Pulses(float(np.diff(t)[s != 0.0].sum()/t[-1]), tuple(map(float, rates)), shortest_on,
                  shortest_off, float(mean*t[-1]))
