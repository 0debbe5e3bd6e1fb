"""The lander's sliding variable: extensions that ask only for what weak thrusters can give."""

import math
from typing import Annotated

from ..core import Param, block
from ..core.card import Part, Surface
from ..core.signal import first
from ..sources import KODE

__all__ = ["braking", "braking_surface", "conditional_integral"]

Slope = Annotated[float, Param("c_0", "1/s", low=0.0, slider=(0.0, 10.0),
                               help="coefficient of the error")]
IntegralGain = Annotated[float, Param("c_{-1}", "1/s^2", low=0.0, slider=(0.0, 40.0),
                                      help="coefficient of the integral")]
Limited = Annotated[bool, Param(
    "braking extension", help="extension: ask only for speed that can be braked away; off: linear")]
Brake = Annotated[float, Param("a_b", "[e]/s^2", low=1e-6, log=True, slider=(1e-3, 10.0),
                               help="extension: maximum braking that sigma = 0 asks for")]
Conditional = Annotated[bool, Param(
    "conditional extension",
    help="extension: integrate only near e = 0, and reset elsewhere; off: always integrate")]
Near = Annotated[float, Param("e_I", "[e]", low=0.0, log=True, slider=(1e-4, 10.0),
                              help="extension: integrate where |e| is smaller than this")]
Most = Annotated[float, Param("w_{max}", "[sigma]", low=0.0, slider=(0.0, 1.0),
                              help="extension: limit of the integral term")]
TERM = dict(w=(0.0, Param("w(0)", "[sigma]", slider=(-0.1, 0.1), help="initial integral term")))


@block(card=Part(), output=Param("f(e)", "[sigma]"))
def braking(e, c_0: Slope = 7.0, a_b: Brake = 0.05):
    r"""Extension: speed at which an error may be left to brake in time, linear near 0.

    .. math::

        f(e) = c_0 e \text{ if } |e| \le e_L = a_b/c_0^2, \text{ else }
        \mathrm{sign}(e)\sqrt{2 a_b (|e| - e_L/2)}

    Parameters
    ----------
    e : float
        Error.
    c_0 : float
        Slope at e = 0 [1/s].
    a_b : float
        Maximum deceleration along e' = -f(e) [e]/s^2.

    Returns
    -------
    float
        f(e), with a continuous derivative; :math:`|f f'| \le a_b`.

    Notes
    -----
    Not in the paper: an extension. The linear :math:`\sigma = \dot e + c_0 e` asks for a
    deceleration :math:`c_0^2 |e|`: 1.4 rad/s^2 in attitude, where 0.14 is available, and 3920 m/s^2
    in altitude, where 1.2 is.
    """
    size = abs(e)
    e_L = a_b/(c_0*c_0) if c_0 > 0.0 else math.inf
    return c_0*e if size <= e_L else math.copysign(math.sqrt(2.0*a_b*(size - 0.5*e_L)), e)


@block(card=Part(), state=TERM, output=Param("w", "[sigma]"))
def conditional_integral(e, z, tau, c_int: IntegralGain = 25.0, e_I: Near = 0.003,
                         w_max: Most = 0.0063):
    r"""Extension: integral term that counts near e = 0 only, and is reset outside.

    .. math:: \dot w = c_{-1}\,e \text{ if } |e| < e_I, \text{ else } w = 0; \qquad |w| \le w_{max}

    Parameters
    ----------
    e : float or tuple of float
        Error; of a tuple the first.
    c_int : float
        Gain [1/s^2].
    e_I : float
        Size of the error below which it integrates [e].
    w_max : float
        Limit of the term [sigma].

    Returns
    -------
    float
        w.

    Notes
    -----
    Not in the paper: an extension. It has to reset: a frozen integral would bias the altitude by
    50 m.
    """
    w, e = z[0], first(e)
    return w, (max(-w_max, min(w_max, w + tau*c_int*e)) if abs(e) < e_I else 0.0,)


@block(card=Surface(source=(KODE,)), state=TERM, output=Param(r"\sigma"))
def braking_surface(e, z, tau, c_0: Slope = 7.0, c_int: IntegralGain = 25.0,
                    limited: Limited = True, a_b: Brake = 0.05, conditional: Conditional = True,
                    e_I: Near = 0.003, w_max: Most = 0.0063):
    r"""Sliding variable for thrusters that are weak for the errors they meet.

    .. math:: \sigma = \dot e + f(e) + w

    with `braking` as f and `conditional_integral` as w; with both switched off it is
    :math:`\dot e + c_0 e + c_{-1}\int e\,dt`.

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
    With both off it is (48), (49), and the lander tumbles. The design rests on the relative degree:
    with e = r - y both channels are sigma' = xi - v.

    References
    ----------
    Paper eqs (9), (48), (49); `braking` and `conditional_integral` are extensions.
    """
    near, most = (e_I, w_max) if conditional else (math.inf, math.inf)
    w, (ahead,) = conditional_integral(e, z, tau, c_int, near, most)
    return e[1] + (braking(e[0], c_0, a_b) if limited else c_0*e[0]) + w, (ahead,)
