"""The lander's control: sliding variable, off-pulse 1-SMC, super-twisting and PID that do not wind up, allocation."""

import math
from typing import Annotated

from ..core import Param, block
from ..core.signal import first
from ..pid import pid
from ..smc1.adaptive import Gamma, grown
from ..smc2 import adaptive_super_twisting
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

__all__ = ["allocation", "braking", "braking_surface", "conditional_integral", "off_pulse_smc", "pid_within",
           "super_twisting_within"]

Slope = Annotated[float, Param("c_0", "1/s", low=0.0, help="coefficient of the error", slider=(0.0, 10.0))]
IntegralGain = Annotated[float, Param("c_{-1}", "1/s^2", low=0.0, help="coefficient of the integral", slider=(0.0, 40.0))]
Limited = Annotated[bool, Param("braking extension", help="extension: ask only for speed that can be braked away; off: linear")]
Brake = Annotated[float, Param("a_b", "[e]/s^2", low=1e-6, log=True, help="extension: braking that sigma = 0 asks for at most",
                               slider=(1e-3, 10.0))]
Conditional = Annotated[bool, Param("conditional extension", help="extension: integrate near e = 0 only, and reset; off: always")]
Near = Annotated[float, Param("e_I", "[e]", low=0.0, log=True, help="extension: integrate where |e| is smaller",
                              slider=(1e-4, 10.0))]
Most = Annotated[float, Param("w_{max}", "[sigma]", low=0.0, help="extension: limit of the integral term", slider=(0.0, 1.0))]
Low = Annotated[float, Param("v_{min}", "[v]", help="extension: least control that there is", slider=(-1.0, 0.0))]
High = Annotated[float, Param("v_{max}", "[v]", help="extension: greatest control that there is", slider=(0.0, 5.0))]
Waits = Annotated[bool, Param("waits extension", help="extension: integrate below the limit only; off: it winds up")]
TERM = dict(w=(0.0, Param("w(0)", "[sigma]", help="integral term to start with", slider=(-0.1, 0.1))))


@block
def braking(e, c_0: Slope = 7.0, a_b: Brake = 0.05) -> Param("f(e)", "[sigma]"):
    r"""Extension: speed at which an error may be left to brake in time, linear near 0.

    .. math::

        f(e) = c_0 e \text{ if } |e| \le e_L = a_b/c_0^2, \text{ else } \mathrm{sign}(e)\sqrt{2 a_b (|e| - e_L/2)}

    Parameters
    ----------
    e : float
        Error.
    c_0 : float
        Slope at e = 0 [1/s].
    a_b : float
        Deceleration along e' = -f(e), at most [e]/s^2.

    Returns
    -------
    float
        f(e), with a continuous derivative; :math:`|f f'| \le a_b`.

    Notes
    -----
    Not in the paper: an extension. The linear :math:`\sigma = \dot e + c_0 e` asks for a deceleration :math:`c_0^2 |e|`: 1.4
    rad/s^2 in attitude where 0.14 is to be had, 3920 m/s^2 in altitude where 1.2 is.
    """
    size = abs(e)
    e_L = a_b/(c_0*c_0) if c_0 > 0.0 else math.inf
    return c_0*e if size <= e_L else math.copysign(math.sqrt(2.0*a_b*(size - 0.5*e_L)), e)


@block(state=TERM)
def conditional_integral(e, z, tau, c_int: IntegralGain = 25.0, e_I: Near = 0.003, w_max: Most = 0.0063) -> Param("w", "[sigma]"):
    r"""Extension: integral term that counts near e = 0 only, and is reset outside.

    .. math:: \dot w = c_{-1}\,e \text{ if } |e| < e_I, \text{ else } w = 0; \qquad |w| \le w_{max}

    Parameters
    ----------
    e : float or tuple of float
        Error; of a tuple the first.
    c_int : float
        Gain [1/s^2].
    e_I : float
        Where to integrate [e].
    w_max : float
        Limit of the term [sigma].

    Returns
    -------
    float
        w.

    Notes
    -----
    Not in the paper: an extension. It has to reset: a frozen integral would bias the altitude by 50 m.
    """
    w, e = z[0], first(e)
    return w, (max(-w_max, min(w_max, w + tau*c_int*e)) if abs(e) < e_I else 0.0,)


@block(state=TERM)
def braking_surface(e, z, tau, c_0: Slope = 7.0, c_int: IntegralGain = 25.0, limited: Limited = True, a_b: Brake = 0.05,
                    conditional: Conditional = True, e_I: Near = 0.003, w_max: Most = 0.0063) -> Param(r"\sigma"):
    r"""Sliding variable of a thruster that is weak for the errors it meets.

    .. math:: \sigma = \dot e + f(e) + w

    with `braking` as f and `conditional_integral` as w; both switched off it is :math:`\dot e + c_0 e + c_{-1}\int e\,dt`.

    Parameters
    ----------
    e : tuple of float
        Error and its derivative.
    c_0, c_int : float
        Coefficients [1/s], [1/s^2].
    limited : bool
        Extension: f(e) of `braking` instead of c_0 e.
    a_b : float
        Braking [e]/s^2.
    conditional : bool
        Extension: w of `conditional_integral` instead of the plain integral.
    e_I, w_max : float
        As there [e], [sigma].

    Returns
    -------
    float
        sigma.

    Notes
    -----
    Off and off it is (48), (49), and the lander tumbles. Behind it stands the relative degree: with e = r - y both channels are
    sigma' = xi - v.

    References
    ----------
    Paper eqs (9), (48), (49); `braking` and `conditional_integral` are extensions.
    """
    w, (ahead,) = conditional_integral(e, z, tau, c_int, e_I if conditional else math.inf, w_max if conditional else math.inf)
    return e[1] + (braking(e[0], c_0, a_b) if limited else c_0*e[0]) + w, (ahead,)


def accepted(t, values):
    """The dead band in use."""
    return dead_band(t, *(values[n] for n in dead_band.params))


@block(check=ordered, band=accepted, state=dict(
    rho=(0.08, Param(r"\rho(0)", "[v]", low=0.0, help="gain to start with", slider=(0.0, 3.0))),
    held=(0.0, Param("s(0)", low=-1.0, high=1.0, hidden=True, help="sign before the start"))))
def off_pulse_smc(t, sigma, z, tau, gamma: Gamma = 0.3,
                  capped: Annotated[bool, Param("capped extension", help="extension: limit the gain; off: it grows on")] = True,
                  rho_max: Annotated[float, Param(r"\rho_{max}", "[v]", low=0.0, slider=(0.0, 5.0),
                                                  help="extension: greatest gain, what the thrusters give")] = 0.14,
                  delta_1: Band1 = 0.05, delta_2: Band2 = 0.025, delta_3: Band3 = 0.01, t_1: Time1 = 100.0, t_2: Time2 = 200.0,
                  a: Amplitude = 0.0, omega: Frequency = 20.0, hysteresis: Hysteresis = True, coasts: Coasts = True
                  ) -> Param("v"):
    r"""Off-pulse control with adaptive gain: first-order sliding mode control of a lander (1-SMC Lander).

    .. math::

        v = \rho\,\overline{\mathrm{sign}}(\sigma + a\sin\omega t), \qquad
        \dot\rho = \gamma\,|\sigma| \text{ if } |\sigma| > \delta(t), \text{ else } 0; \qquad \rho \le \rho_{max}

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
    It is `smc1.adaptive_smc` with the modified sign and the dead band as accepted size. The gain acts once a sample, as in a
    flight computer. It comes to rest only if delta >= tau rho: in the lander's descent, 0.1 < 0.14, it never does.

    Erratum: nor does sigma stay within delta, as the paper has it; four fifths of the time at most towards the end.

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
    """Whether a control at its limit is asked for more."""
    return v >= high and sigma > 0.0 or v <= low and sigma < 0.0


def crossed(values):
    """The condition that the limits of the control do not cross."""
    if not values["low"] < values["high"]:
        return f"low = {values['low']:g} [v] is not allowed; it must be less than high = {values['high']:g} [v]: the limits cross"


Speed, Size, Least, Ratio, Growth = (Annotated[float, m] for m in adaptive_super_twisting.params.values())


@block(check=crossed, state={n: (0.0, m) for n, m in adaptive_super_twisting.states.items()})
def super_twisting_within(sigma, z, tau, gamma: Speed = 0.04, mu: Size = 0.008, lam_min: Least = 0.05, eps: Ratio = 0.1,
                          eta: Growth = 0.1, waits: Waits = True, low: Low = -0.14, high: High = 0.14) -> Param("v"):
    r"""Adaptive super-twisting that waits while the actuator is at its limit (2-SMC Lander).

    .. math:: v = v_{STW}(\sigma, \lambda, w), \qquad \dot w = 0 \text{ while } v \notin (v_{min}, v_{max}) \text{ and }
        \sigma \text{ points outward}

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


Proportional, Integral, Derivative = (Annotated[float, m] for m in pid.params.values())


@block(check=crossed, state={n: (0.0, m) for n, m in pid.states.items()})
def pid_within(e, z, tau, k_p: Proportional = 10.0, k_i: Integral = 0.1, k_d: Derivative = 0.5, waits: Waits = True,
               low: Low = -15.0, high: High = 15.0) -> Param("v"):
    r"""PID control that waits while the actuator is at its limit.

    .. math:: v = k_p e + k_i q + k_d \dot e, \qquad \dot q = e, \text{ but } 0 \text{ while } v \notin (v_{min}, v_{max})
        \text{ and } e \text{ points outward}

    Parameters
    ----------
    e : tuple of float
        Error and its derivative, that of the command included: `pid.pid` takes that of the measurement alone.
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


@block
def allocation(y, v, m: Annotated[float, Param("m_0", "kg", low=1.0, help="mass that the control assumes",
                                               slider=(500.0, 2000.0))] = 1000.0,
               J: Annotated[float, Param("J_0", "kg m^2", low=1.0, help="inertia that the control assumes",
                                         slider=(100.0, 1000.0))] = 300.0,
               l_a: Annotated[float, Param("l_0", "m", low=0.1, help="arm that the control assumes", slider=(0.5, 5.0))] = 2.8,
               feedforward: Annotated[float, Param("g_0", "m/s^2", low=0.0, help="gravity that the thrust carries besides v",
                                                   slider=(0.0, 2.0))] = 0.0,
               guard: Annotated[bool, Param("guard extension", help="extension: bound 1/sin(theta); off: as printed")] = True,
               s_min: Annotated[float, Param("s_{min}", low=0.01, high=1.0,
                                             help="extension: least sin(theta) to divide by")] = 0.5
               ) -> (Param("u_a", "N"), Param("u_d", "N")):
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
        Extension: the bound s_min, and no thrust where it would point down. Off: 1/sin(theta) as it is.
    s_min : float
        Least sin(theta) to divide by.

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
