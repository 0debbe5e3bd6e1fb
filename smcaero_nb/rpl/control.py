"""The lander's laws: off-pulse 1-SMC, super-twisting and PID that do not wind up; allocation."""

import math
from typing import Annotated

from ..core import Param, block
from ..core.card import Allocation, Baseline, Law
from ..pid import pid
from ..smc1.adaptive import Gamma, grown
from ..smc2 import adaptive_super_twisting
from ..sources import KODE
from .pulses import (
    Amplitude,
    Band1,
    Band2,
    Band3,
    Coasts,
    Frequency,
    Hysteresis,
    Time1,
    Time2,
    dead_band,
    dither,
    modified_sign,
    ordered,
)

__all__ = ["allocation", "off_pulse_smc", "pid_within", "super_twisting_within"]

STW, PID = adaptive_super_twisting.params, pid.params
Low = Annotated[float, Param("v_{min}", "[v]", slider=(-1.0, 0.0),
                             help="extension: minimum control available")]
High = Annotated[float, Param("v_{max}", "[v]", slider=(0.0, 5.0),
                              help="extension: maximum control available")]
Waits = Annotated[bool, Param(
    "waits extension", help="extension: integrate only below the limit; off: it winds up")]


def accepted(t, values):
    """Return the dead band in use."""
    return dead_band(t, *(values[n] for n in dead_band.params))


@block(card=Law(r=1, adaptive=True, needs="that |xi| is bounded", band=accepted,
                gain="rho",
                guarantees="|sigma| of the size of the dead band", source=(KODE,)),
       check=ordered, output=Param("v"), state=dict(
    rho=(0.08, Param(r"\rho(0)", "[v]", low=0.0, slider=(0.0, 3.0), help="initial gain")),
    held=(0.0, Param("s(0)", low=-1.0, high=1.0, hidden=True, help="sign before the start"))))
def off_pulse_smc(t, sigma, z, tau, gamma: Gamma = 0.3,
                  capped: Annotated[bool, Param(
                      "capped extension", help="extension: limit the gain; off: no limit")] = True,
                  rho_max: Annotated[float, Param(
                      r"\rho_{max}", "[v]", low=0.0, slider=(0.0, 5.0),
                      help="extension: maximum gain, what the thrusters give")] = 0.14,
                  delta_1: Band1 = 0.05, delta_2: Band2 = 0.025, delta_3: Band3 = 0.01,
                  t_1: Time1 = 100.0, t_2: Time2 = 200.0, a: Amplitude = 0.0,
                  omega: Frequency = 20.0, hysteresis: Hysteresis = True, coasts: Coasts = True):
    r"""Off-pulse control with adaptive gain: first-order sliding mode control (1-SMC Lander).

    .. math::

        v = \rho\,\overline{\mathrm{sign}}(\sigma + a\sin\omega t), \qquad
        \dot\rho = \gamma\,|\sigma| \text{ if } |\sigma| > \delta(t), \text{ else } 0; \qquad
        \rho \le \rho_{max}

    with `dither`, `dead_band` and `modified_sign`.

    Parameters
    ----------
    t : float
        Time [s].
    sigma : float
        Sliding variable.
    gamma : float
        Speed of the adaptation [v]/([sigma] s).
    capped : bool
        Extension: limit the gain.
    rho_max : float
        Its limit [v].
    delta_1, delta_2, delta_3, t_1, t_2 : float
        Dead bands [sigma] and where they change [s].
    a, omega : float
        Dither [sigma], [rad/s].
    hysteresis, coasts : bool
        As in `modified_sign`.

    Returns
    -------
    float
        v, of :math:`\dot\sigma = \xi - v`: -rho, 0 or rho.

    Raises
    ------
    ParameterError
        Intervals that do not follow one another.

    Notes
    -----
    It is `smc1.adaptive_smc` with the modified sign and the dead band as accepted size. The gain
    acts once a sample, as in a flight computer. It comes to rest only if delta >= tau rho: in the
    lander's descent, 0.1 < 0.14, it never does.

    Erratum: nor does sigma stay within delta, as the paper claims; at most four fifths of the time
    towards the end.

    References
    ----------
    Paper eqs (44), (45), (52), (53), Table 1. The limit and the hysteresis are extensions.
    """
    rho, held = z
    delta = dead_band(t, delta_1, delta_2, delta_3, t_1, t_2)
    s, _ = modified_sign(sigma + dither(t, a, omega), (held,), delta, hysteresis, coasts)
    ahead = grown(rho, abs(sigma), tau, gamma, delta)
    return rho*s, (min(ahead, rho_max) if capped else ahead, s)


def outward(v, sigma, low, high):
    """Return whether a control at its limit is asked for more."""
    return v >= high and sigma > 0.0 or v <= low and sigma < 0.0


def crossed(values):
    """The condition that the limits of the control do not cross."""
    if not values["low"] < values["high"]:
        return (f"low = {values['low']:g} [v] is not allowed; it must be less than "
                f"high = {values['high']:g} [v]: the limits cross")


@block(card=adaptive_super_twisting.card, check=crossed, output=Param("v"),
       state={n: (0.0, m) for n, m in adaptive_super_twisting.states.items()})
def super_twisting_within(sigma, z, tau,
                          gamma: Annotated[float, STW["gamma"]] = 0.04,
                          mu: Annotated[float, STW["mu"]] = 0.008,
                          lam_min: Annotated[float, STW["lam_min"]] = 0.05,
                          eps: Annotated[float, STW["eps"]] = 0.1,
                          eta: Annotated[float, STW["eta"]] = 0.1,
                          waits: Waits = True, low: Low = -0.14, high: High = 0.14):
    r"""Adaptive super-twisting that waits while the actuator is at its limit (2-SMC Lander).

    .. math::

        v = v_{STW}(\sigma, \lambda, w), \qquad
        \dot w = 0 \text{ while } v \notin (v_{min}, v_{max})
        \text{ and } \sigma \text{ points outward}

    Parameters
    ----------
    sigma : float
        Sliding variable.
    gamma, mu, lam_min, eps, eta : float
        As in `smc2.adaptive_super_twisting`.
    waits : bool
        Extension; off: that law as it is, which winds up.
    low, high : float
        What the actuator can give [v].

    Returns
    -------
    float
        v, of :math:`\dot\sigma = \xi - v`, not limited.

    Raises
    ------
    ParameterError
        Limits that cross.

    References
    ----------
    Paper eqs (21), (24). The waiting is an extension: conditional integration.
    """
    v, (lam, w) = adaptive_super_twisting(sigma, z, tau, gamma, mu, lam_min, eps, eta)
    return v, (lam, z[1] if waits and outward(v, sigma, low, high) else w)


@block(card=Baseline(source=(KODE,)),
       check=crossed, output=Param("v"), state={n: (0.0, m) for n, m in pid.states.items()})
def pid_within(e, z, tau,
               k_p: Annotated[float, PID["k_p"]] = 10.0,
               k_i: Annotated[float, PID["k_i"]] = 0.1,
               k_d: Annotated[float, PID["k_d"]] = 0.5,
               waits: Waits = True, low: Low = -15.0, high: High = 15.0):
    r"""PID control that waits while the actuator is at its limit.

    .. math::

        v = k_p e + k_i q + k_d \dot e, \qquad \dot q = e, \text{ but } 0 \text{ while }
        v \notin (v_{min}, v_{max}) \text{ and } e \text{ points outward}

    Parameters
    ----------
    e : tuple of float
        Error and its derivative, that of the command included: `pid.pid` takes that of the
        measurement alone.
    k_p, k_i, k_d : float
        Gains.
    waits : bool
        Extension; off: it winds up.
    low, high : float
        What the actuator can give [v].

    Returns
    -------
    float
        v, not limited.

    Raises
    ------
    ParameterError
        Limits that cross.

    References
    ----------
    Paper eq (57). The waiting is an extension.
    """
    integral, = z
    v = k_p*e[0] + k_i*integral + k_d*e[1]
    return v, (integral if waits and outward(v, e[0], low, high) else integral + tau*e[0],)


@block(card=Allocation(source=(KODE,)), output=(Param("u_a", "N"), Param("u_d", "N")))
def allocation(y, v,
               m: Annotated[float, Param("m_0", "kg", low=1.0, slider=(500.0, 2000.0),
                                         help="mass that the control assumes")] = 1000.0,
               J: Annotated[float, Param("J_0", "kg m^2", low=1.0, slider=(100.0, 1000.0),
                                         help="inertia that the control assumes")] = 300.0,
               l_a: Annotated[float, Param("l_0", "m", low=0.1, slider=(0.5, 5.0),
                                           help="arm that the control assumes")] = 2.8,
               feedforward: Annotated[float, Param(
                   "g_0", "m/s^2", low=0.0, slider=(0.0, 2.0),
                   help="gravity that the thrust carries besides v")] = 0.0,
               guard: Annotated[bool, Param(
                   "guard extension",
                   help="extension: bound 1/sin(theta); off: as printed")] = True,
               s_min: Annotated[float, Param(
                   "s_{min}", low=0.01, high=1.0,
                   help="extension: minimum sin(theta) to divide by")] = 0.5):
    r"""Thrusts from virtual controls: the inverse of the lander's B.

    .. math::

        u_a = \frac{J_0}{l_0} v_a, \qquad u_d = \frac{m_0 (v_d + g_0)}{\sin\theta} - u_a, \qquad
        \sin\theta \to \max(\sin\theta, s_{min}); \quad u_d = 0 \text{ where } \sin\theta \le 0

    Parameters
    ----------
    y : tuple
        Attitude and altitude, each with its rate.
    v : tuple of 2 float
        Virtual controls [rad/s^2, m/s^2].
    m, J, l_a : float
        Nominal mass [kg], inertia [kg m^2], arm [m].
    feedforward : float
        g_0 [m/s^2]; 0 leaves the weight to the law.
    guard : bool
        Extension: the bound s_min, and no thrust where it would point down. Off: 1/sin(theta) as it
        is.
    s_min : float
        Minimum sin(theta) to divide by.

    Returns
    -------
    tuple of 2 float
        u_a, u_d [N], not limited.

    References
    ----------
    Paper eqs (50), (51), (54). The guard is an extension.
    """
    u_a, s = J*v[0]/l_a, math.sin(y[0][0])
    if s == 0.0 or guard and s < 0.0:
        return u_a, 0.0
    return u_a, m*(v[1] + feedforward)/(max(s, s_min) if guard else s) - u_a
