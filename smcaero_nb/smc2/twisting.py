"""Twisting: second-order sliding mode control of sigma and its derivative, integrated."""

import math
from collections import namedtuple
from typing import Annotated

from ..core import Param, block, exceeds
from ..core.card import Law
from ..core.param import positive
from ..core.signal import sign
from ..sources import KODE, LEVANT_1993, SHTESSEL_2017

__all__ = ["Gains", "adaptive_twisting", "gains", "twisting"]

Limit = Annotated[float,
                  Param("v_M", "[v]", low=1e-9,
                        help="limit of |v|, larger than the bound of the perturbation",
                        slider=(0.1, 20.0))]
V = Param("v(0)", "[v]", help="control to start with", slider=(-1.0, 1.0))
Gains = namedtuple("Gains", "super_twisting twisting")
Gains.__doc__ = """Parameters of `super_twisting` and `twisting`, for ``with_``; made by `gains`."""


def twisted(sigma, v, tau, alpha_1, alpha_2, v_M):
    """The next v, from (sigma, sigma')."""
    s, ds = sigma
    rate = alpha_1*sign(s) + alpha_2*sign(ds)
    return v + tau*(rate if abs(v) < v_M else -v)


def converges(values):
    """Condition (23)."""
    a, b, bound = (values[n] for n in ("alpha_1", "alpha_2", "L"))
    if not b > bound:
        return ("alpha_1 + alpha_2 - L > alpha_1 - alpha_2 + L, that is alpha_2 > L, does not "
                f"hold: alpha_2 = {b:g}, L = {bound:g} [v]/s")
    if not a - b > bound:
        return ("alpha_1 - alpha_2 > L does not hold: alpha_1 - alpha_2 = "
                f"{a:g} - {b:g} = {a - b:g}, L = {bound:g} [v]/s")


def assumed(values, xi, dxi):
    """Say which assumption of the theorem fails."""
    return exceeds("L", "|xi'|", rate=True)(values, xi, dxi) or exceeds("v_M")(values, xi, dxi)


def described(values, a, omega):
    """Describing function within v_M: two relays, a quarter period apart, integrated."""
    return 4.0/(math.pi*a*omega)*(values["alpha_2"] - 1.0j*values["alpha_1"])


Alpha1 = Annotated[float,
                   Param(r"\alpha_1", "[v]/s", low=0.0, help="gain of sign(sigma)",
                         slider=(0.0, 20.0))]
Alpha2 = Annotated[float,
                   Param(r"\alpha_2", "[v]/s", low=0.0, help="gain of sign(sigma')",
                         slider=(0.0, 20.0))]
Bound = Annotated[float,
                  Param("L", "[v]/s", low=0.0,
                        help="bound of |xi'| that the gains are checked against",
                        slider=(0.0, 10.0))]


@block(state=dict(v=(0.0, V)), output=Param("v"), check=converges,
       card=Law(order=2, r=1, sees="derivatives", continuous=True,
                needs="the bounds of |xi| and |xi'|",
                guarantees="sigma = sigma' = 0 after a finite time", assumes=assumed,
                describing=described, source=(KODE, LEVANT_1993)))
def twisting(sigma, z, tau, alpha_1: Alpha1 = 2.4, alpha_2: Alpha2 = 1.2, v_M: Limit = 3.0,
             L: Bound = 1.0):
    r"""Twisting control, integrated: continuous.

    .. math::

        \dot v = \alpha_1\,\mathrm{sign}(\sigma) + \alpha_2\,\mathrm{sign}(\dot\sigma)
        \text{ if } |v| < v_M,
        \text{ else } -v

    Parameters
    ----------
    sigma : tuple of float
        Sliding variable and its derivative, as from ``surface.itae(..., derivative=True)``.
    alpha_1, alpha_2 : float
        Gains [v]/s with :math:`\alpha_2 > L` and :math:`\alpha_1 - \alpha_2 > L`; anything else is
        refused. See `gains`.
    v_M : float
        Limit of :math:`|v|` [v], larger than the bound of the perturbation itself.
    L : float
        Bound of the perturbation's derivative [v]/s; the law does not use it, the check of the
        gains does.

    Returns
    -------
    float
        v, of :math:`\dot\sigma = \xi - v`, continuous.

    Notes
    -----
    Reaches :math:`\sigma = \dot\sigma = 0` in finite time. Without perturbation,
    :math:`|\dot\sigma|` at one zero of sigma is
    :math:`\sqrt{(\alpha_1 - \alpha_2)/(\alpha_1 + \alpha_2)}` times that at the zero before.
    Sampled every tau, :math:`|\sigma|` stays within a multiple of tau^2, and :math:`|v|` within v_M
    + tau (alpha_1 + alpha_2).

    sigma' contains the control, so an output block cannot give it: it takes a differentiator of
    order 1, whose bound of the second derivative is at least L + alpha_1 + alpha_2. Only its
    sign matters, but noise in it costs the order of accuracy. The v of a sample already contains
    its own step. While :math:`|v| \ge v_M`, v decays as exp(-t).

    Errata: (22) calls the limit v_m, the text below it v_M. The first inequality of (23),
    :math:`\alpha_1 + \alpha_2 - L > \alpha_1 - \alpha_2 + L`, says no more than
    :math:`\alpha_2 > L`.

    References
    ----------
    Paper eqs (22), (23). A. Levant, Int. J. Control 58 (1993) 1247.
    """
    v = twisted(sigma, z[0], tau, alpha_1, alpha_2, v_M)
    return v, (v,)


ALPHA_1_0 = Param(r"\alpha_1(0)", "[v]/s", low=0.0, help="gain to start with", slider=(0.0, 20.0))
Speed = Annotated[float,
                  Param(r"\gamma_1", "[v]/s^2", low=0.0, log=True, help="speed of the adaptation",
                        slider=(1.0, 1000.0))]
Accepted = Annotated[float,
                     Param(r"\mu_1", "[sigma]^2", low=0.0, log=True, help="accepted size of V",
                           slider=(1e-6, 1.0))]
Least = Annotated[float,
                  Param(r"\alpha_{1,min}", "[v]/s", low=0.0, slider=(0.0, 2.0),
                        help="minimum gain")]
Growth = Annotated[float,
                   Param(r"\eta_1", "[v]/s^2", low=0.0, log=True,
                         help="growth below the minimum gain", slider=(0.01, 10.0))]
Weight = Annotated[float,
                   Param("c", "s^2", low=0.0, log=True, help="weight of sigma'^2 in V",
                         slider=(0.001, 1.0))]


@block(state=dict(alpha_1=(1.0, ALPHA_1_0), v=(0.0, V)), output=Param("v"),
       card=Law(r=1, sees="derivatives", adaptive=True, continuous=True,
                needs="the bound of |xi|, and that |xi'| is bounded",
                guarantees="|sigma| of the size of sqrt(mu) after a finite time",
                assumes=exceeds("v_M"), source=(KODE, SHTESSEL_2017, LEVANT_1993)))
def adaptive_twisting(sigma, z, tau, gamma: Speed = 20.0, mu: Accepted = 1e-4,
                      alpha_min: Least = 0.1, eta: Growth = 1.0, c: Weight = 0.02,
                      v_M: Limit = 6.0):
    r"""Twisting control with adaptive gains, integrated: continuous.

    .. math::

        \dot v &= \alpha_1\,\mathrm{sign}(\sigma) + \alpha_2\,\mathrm{sign}(\dot\sigma)
        \text{ if } |v| < v_M,
        \text{ else } -v, \qquad \alpha_2 = \alpha_1/2 \\
        \dot\alpha_1 &= \gamma_1\,\mathrm{sign}(V - \mu_1) \text{ if } \alpha_1 \ge \alpha_{1,min},
        \text{ else } \eta_1,
        \qquad V = \sigma^2 + c\,\dot\sigma^2

    Parameters
    ----------
    sigma : tuple of float
        Sliding variable and its derivative, as from ``surface.itae(..., derivative=True)``.
    gamma : float
        Speed of the adaptation [v]/s^2; at least about ten times the bound of the perturbation's
        derivative.
    mu : float
        Accepted V [sigma]^2: above it the gain grows, below it the gain falls.
    alpha_min : float
        Minimum gain [v]/s.
    eta : float
        Growth of a gain below `alpha_min` [v]/s^2.
    c : float
        Weight of :math:`\dot\sigma^2` in V [s^2].
    v_M : float
        Limit of :math:`|v|` [v], larger than the bound of the perturbation itself.

    Returns
    -------
    float
        v, of :math:`\dot\sigma = \xi - v`, continuous; needs no bound of the perturbation's
        derivative.

    Notes
    -----
    The gain does not stay large, and sigma does not stay at 0: it moves within about
    :math:`\sqrt{\mu_1}`. On the way there the gain can be large for a short time. Sampled every
    tau, sigma' moves in steps of up to 1.5 tau alpha_1, so mu has to be larger than
    :math:`c\,(1.5\,\tau\alpha_1)^2` at that time: otherwise the gain grows without bound. sigma'
    takes a differentiator, as for `twisting`, whose bound covers the largest gain.

    References
    ----------
    Paper eqs (22), (25). Y. Shtessel, J. Moreno and L. Fridman, Automatica 75 (2017) 229. A.
    Levant, Int. J. Control 58 (1993) 1247.
    """
    alpha_1, v = z
    s, ds = sigma
    v = twisted(sigma, v, tau, alpha_1, 0.5*alpha_1, v_M)
    rate = (gamma if s*s + c*ds*ds > mu else -gamma) if alpha_1 >= alpha_min else eta
    return v, (alpha_1 + tau*rate, v)


def gains(L: float) -> Gains:
    r"""Gains of super-twisting and twisting from the bound of the perturbation's derivative.

    .. math:: \lambda = 1.5\sqrt L, \quad \beta = 1.1 L; \qquad
        \alpha_1 = 2.4 L, \quad \alpha_2 = 1.2 L

    Parameters
    ----------
    L : float
        Bound of :math:`|\dot\xi|` [v]/s, larger than 0.

    Returns
    -------
    Gains
        Named tuple of `super_twisting`, a dict of lam and beta, and `twisting`, a dict of alpha_1,
        alpha_2 and L.

    Raises
    ------
    ParameterError
        L is not a positive finite number.

    Notes
    -----
    The paper gives the first pair. For the second it gives inequalities only, (23): this choice
    meets each with a fifth of L to spare, :math:`\alpha_2 = \alpha_1 - \alpha_2 = 1.2 L`.

    References
    ----------
    Paper eqs (21), (23). A. Levant, Int. J. Control 58 (1993) 1247.

    Examples
    --------
    >>> gains(4.0).super_twisting
    {'lam': 3.0, 'beta': 4.4}
    >>> law = twisting.with_(**gains(4.0).twisting)
    """
    L = positive("gains", "L", L, "[v]/s")
    return Gains(dict(lam=1.5*math.sqrt(L), beta=1.1*L), dict(alpha_1=2.4*L, alpha_2=1.2*L, L=L))
