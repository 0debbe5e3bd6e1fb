"""Off-pulse modulation, eqs (44), (45): dither, dead band, modified sign, hold, pulse modulator."""

import math
from collections.abc import Iterable, Sequence
from typing import Annotated

from ..core import Param, ParameterError, block
from ..core.card import Actuator, Part
from ..core.param import refused
from ..core.signal import sign
from ..sources import KODE

__all__ = ["dead_band", "dead_bands", "dither", "modified_sign", "pulse_modulator",
           "sample_and_hold", "thruster"]

Amplitude = Annotated[float, Param("a", "[sigma]", low=0.0, slider=(0.0, 0.1),
                                   help="amplitude of the dither; 0: none")]
Frequency = Annotated[float, Param(r"\omega", "rad/s", low=0.0, slider=(0.0, 60.0),
                                   help="frequency of the dither; not a multiple of pi/tau")]
Band = Annotated[float, Param(r"\delta", "[sigma]", low=0.0, slider=(0.0, 0.2), help="dead band")]
Band1 = Annotated[float, Param(r"\delta_1", "[sigma]", low=0.0, slider=(0.0, 0.2),
                               help="dead band until t_1")]
Band2 = Annotated[float, Param(r"\delta_2", "[sigma]", low=0.0, slider=(0.0, 0.2),
                               help="dead band from t_1 to t_2")]
Band3 = Annotated[float, Param(r"\delta_3", "[sigma]", low=0.0, slider=(0.0, 0.2),
                               help="dead band from t_2 on")]
Time1 = Annotated[float, Param("t_1", "s", low=0.0, slider=(0.0, 240.0),
                               help="end of the first interval")]
Time2 = Annotated[float, Param("t_2", "s", low=0.0, slider=(0.0, 240.0),
                               help="end of the second interval")]
Hysteresis = Annotated[bool, Param("hysteresis extension",
                                   help="extension: a pulse continues inside the dead band")]
Coasts = Annotated[bool, Param("coasts", help="a pulse ends where sigma changes its sign; off: at "
                                              "the other edge of the band")]
Low = Annotated[float, Param(r"u_{min}", "N", slider=(-30.0, 0.0), help="minimum thrust")]
High = Annotated[float, Param(r"u_{max}", "N", slider=(0.0, 3000.0), help="maximum thrust")]
Pulse = Annotated[float, Param("T_s", "s", low=0.0, samples=True, slider=(0.05, 1.0),
                               help="minimum duration of a pulse and of a pause")]
HELD = dict(held=(0.0, Param("u_h", "N", hidden=True,
                             help="thrust that is held; the first sample replaces it")))


@block(card=Part(source=(KODE,)), output=Param(r"\Delta", "[sigma]"))
def dither(t, a: Amplitude = 0.05, omega: Frequency = 20.0):
    r"""Dither, to be added to a sliding variable.

    .. math:: \bar\sigma = \sigma + \Delta, \qquad \Delta = a\sin\omega t, \qquad \omega = 2\pi/N

    Parameters
    ----------
    t : float
        Time [s].
    a : float
        Amplitude [sigma].
    omega : float
        Frequency [rad/s].

    Returns
    -------
    float
        The dither [sigma].

    Notes
    -----
    Erratum: the paper gives omega = 20 in Hz. Sampled every tau = 0.05 s, 20 Hz is sin(2 pi k) = 0
    at every sample k: it aliases to nothing, as does any multiple of pi/tau = 62.8 rad/s. As eq
    (44) defines it, omega is in rad/s, and 20 rad/s is sampled six times a period.

    References
    ----------
    Paper eq (44).
    """
    return a*math.sin(omega*t)


def ordered(values):
    """The condition that the intervals of the dead band follow one another."""
    if not values["t_1"] <= values["t_2"]:
        return (f"t_1 = {values['t_1']:g} s is not allowed; "
                f"it must be at most t_2 = {values['t_2']:g} s")


@block(card=Part(source=(KODE,)), check=ordered, output=Param(r"\delta", "[sigma]"))
def dead_band(t, delta_1: Band1 = 0.05, delta_2: Band2 = 0.025, delta_3: Band3 = 0.01,
              t_1: Time1 = 100.0, t_2: Time2 = 200.0):
    r"""Time-varying dead band: wide at first, for sparse pulses, narrow at the end, for accuracy.

    .. math::

        \delta = \delta_1 \text{ for } t < t_1, \quad \delta_2 \text{ for } t_1 \le t < t_2, \quad
        \delta_3 \text{ after}

    Parameters
    ----------
    t : float
        Time [s].
    delta_1, delta_2, delta_3 : float
        Dead bands of the intervals [sigma].
    t_1, t_2 : float
        Where the second and the third interval begin [s].

    Returns
    -------
    float
        The dead band [sigma].

    Raises
    ------
    ParameterError
        Intervals that do not follow one another.

    References
    ----------
    Paper, Table 1 and the text above eq (45). The default is its attitude row; `dead_bands` reads
    such a table.
    """
    return delta_1 if t < t_1 else delta_2 if t < t_2 else delta_3


def dead_bands(table: Iterable[Sequence[float]]) -> dict[str, float]:
    r"""Parameters of `dead_band` from a table of intervals.

    .. math:: \delta(t) = \delta_i \text{ for } t_{i-1} \le t < t_i

    Parameters
    ----------
    table : sequence of (begin, end, delta)
        One to three rows, begin and end in s, delta in the unit of sigma.

    Returns
    -------
    dict
        ``delta_1``, ``delta_2``, ``delta_3``, ``t_1``, ``t_2``, for `with_`.

    Raises
    ------
    ParameterError
        A table that does not begin at 0 s, has gaps or overlaps, or more than three rows, or a dead
        band that is not allowed.

    References
    ----------
    Paper, Table 1.

    Examples
    --------
    >>> dead_band.with_(**dead_bands([(0, 100, 0.1), (100, 200, 0.075), (200, 240, 0.05)]))(150.0)
    0.075
    """
    try:
        rows = [tuple(row) for row in table]
    except TypeError:
        rows = []
    if not 1 <= len(rows) <= 3 or any(len(row) != 3 for row in rows):
        raise refused("dead_bands", "table", table,
                      "one to three rows of (begin [s], end [s], delta)")
    columns = {n: Param(unit=unit, low=0.0)
               for n, unit in (("begin", "s"), ("end", "s"), ("delta", "[sigma]"))}
    rows = [tuple(m.check("dead_bands", f"table[{i}], {n}", v)
                  for (n, m), v in zip(columns.items(), row, strict=True))
            for i, row in enumerate(rows)]
    last = 0.0
    for i, (begin, end, _) in enumerate(rows):
        meets = math.isclose(begin, last, rel_tol=1e-9)
        if not (meets and end > begin):
            what = "interval without duration" if meets else "overlap" if begin < last else "gap"
            raise ParameterError(f"dead_bands: table[{i}] from {begin:g} to {end:g} s is not "
                                 f"allowed, {what}; it must begin at {last:g} s and end later")
        last = end
    rows += [rows[-1]]*(3 - len(rows))
    (_, t_1, delta_1), (_, t_2, delta_2), (_, _, delta_3) = rows
    return dict(delta_1=delta_1, delta_2=delta_2, delta_3=delta_3, t_1=t_1, t_2=t_2)


@block(card=Part(source=(KODE,)), output=Param("s"),
       state=dict(held=(0.0, Param("s(0)", low=-1.0, high=1.0, help="sign before the start"))))
def modified_sign(sigma, z, delta: Band = 0.05, hysteresis: Hysteresis = True,
                  coasts: Coasts = True):
    r"""Sign with a dead band: a relay that has three levels, or two with memory.

    .. math::

        \overline{\mathrm{sign}}(\sigma) = \mathrm{sign}(\sigma) \text{ if } |\sigma| > \delta,
        \text{ else }
        \begin{cases} 0 & \text{without hysteresis} \\
        s \text{ while } s\sigma > 0, \text{ then } 0 & \text{coasting} \\
        s & \text{not coasting} \end{cases}

    with s the value before.

    Parameters
    ----------
    sigma : float
        Sliding variable, with dither where there is one.
    delta : float
        Dead band [sigma].
    hysteresis : bool
        Extension: what began outside the dead band continues inside.
    coasts : bool
        With hysteresis: end a pulse at the change of sign, for thrusters that push both ways. Off:
        hold it to the other edge of the band, for thrusters that push one way against gravity.

    Returns
    -------
    float
        -1, 0 or 1.

    Notes
    -----
    Without hysteresis a narrower dead band does not make the pulses denser, which the paper wants
    it to do. A one-sided thruster with a plain dead band only shifts sigma: it fires at one edge of
    the band, never at the other.

    References
    ----------
    Paper eq (45) for the dead band; the hysteresis is an extension.
    """
    held, = z
    goes_on = hysteresis and (held*sigma > 0.0 or not coasts)
    s = sign(sigma) if abs(sigma) > delta else held if goes_on else 0.0
    return s, (s,)


@block(card=Actuator(source=(KODE,)), state=HELD, output=Param("u", "N"))
def sample_and_hold(t, u, z, tau, pulse: Pulse = 0.05):
    r"""Sample and hold: the thrust changes only every `pulse` seconds.

    .. math:: u(t) = u(k T_s), \qquad k T_s \le t < (k + 1) T_s

    Parameters
    ----------
    t : float
        Time [s].
    u : float
        Wanted thrust [N].
    pulse : float
        T_s [s], a multiple of the sampling step.

    Returns
    -------
    float
        Thrust [N].

    Notes
    -----
    With tau = T_s it changes nothing: the loop itself samples and holds.

    References
    ----------
    Paper, text above eq (45), "S&H"; 0.05 s in the case study.
    """
    held, = z
    held = held if round(t/tau) % max(round(pulse/tau), 1) else u
    return held, (held,)


def crossed(values):
    """The condition that the limits of the thrust do not cross."""
    if not values["low"] < values["high"]:
        return (f"low = {values['low']:g} N is not allowed; it must be less than "
                f"high = {values['high']:g} N: they cross")


@block(card=Actuator(source=(KODE,)), state=HELD, check=crossed, output=Param("u", "N"))
def thruster(t, u, z, tau, low: Low = -15.0, high: High = 15.0, pulse: Pulse = 0.05):
    r"""Thrusters with limits, held for a minimum duration.

    .. math:: u(t) = \max(u_{min}, \min(u_{max}, u(k T_s))), \qquad k T_s \le t < (k + 1) T_s

    Parameters
    ----------
    t : float
        Time [s].
    u : float
        Wanted thrust [N].
    low, high : float
        Limits [N]; low = 0 for thrusters that push one way.
    pulse : float
        T_s, minimum duration of a pulse and of a pause [s], a multiple of the sampling step.

    Returns
    -------
    float
        Thrust [N].

    Raises
    ------
    ParameterError
        Limits that cross.

    References
    ----------
    Paper, section "Simulation setup": limits and 0.05 s.
    """
    return sample_and_hold(t, max(low, min(high, u)), z, tau, pulse)


@block(card=Actuator(source=(KODE,)),
       state={"owed": (0.0, Param("q", "N s", help="impulse owed at the start")), **HELD},
       check=crossed, output=Param("u", "N"))
def pulse_modulator(t, u, z, tau, low: Low = -15.0, high: High = 15.0, pulse: Pulse = 0.05):
    r"""Pulse modulation of a continuous thrust: full thrust or none, the same impulse.

    .. math::

        \dot q = \mathrm{sat}(u) - u_f, \qquad u_f = \begin{cases} u_{max} & q > u_{max} T_s/2 \\
        u_{min} & q < u_{min} T_s/2 \\ 0 & \text{else} \end{cases}

    Parameters
    ----------
    t : float
        Time [s].
    u : float
        Wanted thrust [N], limited to [low, high] before it counts.
    low, high : float
        The thrust of a pulse [N]; low = 0 for thrusters that push one way.
    pulse : float
        T_s, minimum duration of a pulse and of a pause [s], a multiple of the sampling step; u_f is
        chosen every T_s.

    Returns
    -------
    float
        u_f [N]: low, 0 or high.

    Raises
    ------
    ParameterError
        Limits that cross.

    Notes
    -----
    The impulse owed, q, stays within what a pulse gives: the mean thrust follows u. A wanted thrust
    of half the limit makes a pulse every other T_s, the most that is possible.

    References
    ----------
    Paper eq (45), which does not specify its PWM: this is the error feedback of delta-sigma
    modulators.
    """
    owed, held = z
    owed += tau*max(low, min(high, u))
    chosen = high if owed > 0.5*high*pulse else low if owed < 0.5*low*pulse else 0.0
    fired, after = sample_and_hold(t, chosen, (held,), tau, pulse)
    return fired, (owed - tau*fired, *after)
