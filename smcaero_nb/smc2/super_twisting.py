"""Super-twisting: second-order sliding mode control, continuous."""

import math
from typing import Annotated

from ..core import Param, block, exceeds
from ..core.assumptions import MARGIN
from ..core.card import Law
from ..core.signal import sign
from ..sources import BOIKO_2005, KODE, LEVANT_1993, SEEBER_2017, SHTESSEL_2012

__all__ = ["adaptive_super_twisting", "super_twisting"]

W = Param("w(0)", "[v]", help="integral term to start with", slider=(-1.0, 1.0))


def assumed(values, xi, dxi):
    """Say which assumption of the theorem fails: beta > L, lam^2 > beta + L."""
    lam, beta = values["lam"], values["beta"]
    if not lam*lam > beta + dxi/MARGIN:
        return (f"|xi'| reaches {dxi:.3g}, and then lam^2 > beta + |xi'| does not hold: "
                f"lam^2 = {lam*lam:.3g}, beta + |xi'| = {beta + dxi:.3g} [v]/s")
    return exceeds("beta", "|xi'|", rate=True)(values, xi, dxi)


#: First harmonic of sqrt(|sin|) sign(sin): 2 Gamma(5/4)/(sqrt(pi) Gamma(7/4)).
ROOT = 2.0*math.gamma(1.25)/(math.sqrt(math.pi)*math.gamma(1.75))


def described(values, a, omega):
    """Describing function: the root in phase, the integral of the relay a quarter period behind."""
    return values["lam"]*ROOT/math.sqrt(a) - 4.0j*values["beta"]/(math.pi*a*omega)


Root = Annotated[float,
                 Param(r"\lambda", "[v]/[sigma]^1/2", low=0.0,
                       help="1.5 sqrt(L), L the bound of |xi'|", slider=(0.0, 10.0))]
Integral = Annotated[float,
                     Param(r"\beta", "[v]/s", low=0.0, help="1.1 L, L the bound of |xi'|",
                           slider=(0.0, 20.0))]


@block(state=dict(w=(0.0, W)), output=Param("v"),
       card=Law(order=2, r=1, continuous=True, needs="the bound of |xi'|",
                guarantees="sigma = sigma' = 0 after a finite time", assumes=assumed,
                describing=described, source=(KODE, LEVANT_1993, SEEBER_2017, BOIKO_2005)))
def super_twisting(sigma, z, tau, lam: Root = 1.5, beta: Integral = 1.1):
    r"""Super-twisting control.

    .. math:: v = \lambda\,|\sigma|^{1/2}\,\mathrm{sign}(\sigma) + w, \qquad
        \dot w = \beta\,\mathrm{sign}(\sigma)

    Parameters
    ----------
    sigma : float
        Sliding variable.
    lam : float
        Gain of the root [v]/[sigma]^1/2; :math:`1.5\sqrt L`, L the bound of the perturbation's
        derivative, see `gains`.
    beta : float
        Gain of the integral [v]/s; 1.1 L, and larger than L in any case.

    Returns
    -------
    float
        v, of :math:`\dot\sigma = \xi - v`, continuous; the perturbation may have any size, but
        its derivative must be bounded.

    Notes
    -----
    Reaches :math:`\sigma = \dot\sigma = 0` in finite time; then w = xi. Without perturbation,
    :math:`\dot\sigma` at one zero of sigma is :math:`-\exp(-\pi\lambda/\sqrt{8\beta - \lambda^2})`
    times that at the zero before, and sigma has no second zero if :math:`\lambda^2 \ge 8\beta`.
    Sampled every tau, :math:`|\sigma|` stays within a multiple of L tau^2. An actuator's lag T
    turns it into a limit cycle: by its describing function, which is right to a few per cent, of
    the amplitude :math:`a = (4 T\beta/(1.113\,\pi\lambda))^2` and the frequency
    :math:`2\sqrt{\beta/(\pi a)}`.

    Erratum: the paper takes the gains from the bound of xi, but they need that of its derivative,
    of its (A4).

    References
    ----------
    Paper eq (21). A. Levant, Int. J. Control 58 (1993) 1247. The gains: R. Seeber and M. Horn,
    Automatica 84 (2017) 241. The limit cycle: I. Boiko and L. Fridman, IEEE Trans. Automatic
    Control 50 (2005) 1442.
    """
    w, = z
    s = sign(sigma)
    return lam*math.sqrt(abs(sigma))*s + w, (w + tau*beta*s,)


LAM_0 = Param(r"\lambda(0)", "[v]/[sigma]^1/2", low=0.0, help="gain to start with",
              slider=(0.0, 10.0))
Speed = Annotated[float,
                  Param(r"\gamma", "[lam]/s", low=0.0, log=True, help="speed of the adaptation",
                        slider=(1e-3, 100.0))]
Accepted = Annotated[float,
                     Param(r"\mu", "[sigma]", low=0.0, log=True, help="accepted size of sigma",
                           slider=(1e-4, 1.0))]
Least = Annotated[float,
                  Param(r"\lambda_m", "[lam]", low=0.0, help="minimum gain", slider=(0.0, 2.0))]
Ratio = Annotated[float,
                  Param(r"\varepsilon", "1/s", low=0.0, log=True, help="beta = eps lam",
                        slider=(1e-3, 10.0))]
Growth = Annotated[float,
                   Param(r"\eta", "[lam]/s", low=0.0, log=True, slider=(1e-3, 10.0),
                         help="growth below the minimum gain")]


@block(state=dict(lam=(1.0, LAM_0), w=(0.0, W)), output=Param("v"),
       card=Law(r=1, adaptive=True, continuous=True, needs="that |xi'| is bounded",
                guarantees="|sigma| of the size of mu after a finite time",
                source=(KODE, SHTESSEL_2012, LEVANT_1993)))
def adaptive_super_twisting(sigma, z, tau, gamma: Speed = 20.0, mu: Accepted = 1e-3,
                            lam_min: Least = 0.05, eps: Ratio = 1.0, eta: Growth = 0.5):
    r"""Super-twisting control with adaptive gains.

    .. math::

        v &= \lambda\,|\sigma|^{1/2}\,\mathrm{sign}(\sigma) + w, \qquad
        \dot w = \beta\,\mathrm{sign}(\sigma),
        \qquad \beta = \varepsilon\lambda \\
        \dot\lambda &= \gamma\,\mathrm{sign}(|\sigma| - \mu) \text{ if } \lambda > \lambda_m,
        \text{ else } \eta

    Parameters
    ----------
    sigma : float
        Sliding variable.
    gamma : float
        Speed of the adaptation [lam]/s; at least about ten times the bound of the perturbation's
        derivative.
    mu : float
        Accepted :math:`|\sigma|`: above it the gain grows, below it the gain falls; well above
        tau^2 times the level of the gain.
    lam_min : float
        Minimum gain.
    eps : float
        Ratio beta/lambda [1/s].
    eta : float
        Growth of a gain below `lam_min` [lam]/s.

    Returns
    -------
    float
        v, of :math:`\dot\sigma = \xi - v`, continuous; needs no bound of the perturbation's
        derivative.

    Notes
    -----
    The gain does not stay large: it falls until :math:`|\sigma|` reaches mu, which sigma then
    overshoots by a factor of two to twelve. Not an erratum: the paper's beta = eps lambda belongs
    to w' = beta sign(sigma), which is the literature's beta = 2 eps lambda with w' = (beta/2)
    sign(sigma).

    References
    ----------
    Paper eqs (21), (24). Y. Shtessel, M. Taleb and F. Plestan, Automatica 48 (2012) 759. A. Levant,
    Int. J. Control 58 (1993) 1247.
    """
    lam, w = z
    s = sign(sigma)
    rate = (gamma if abs(sigma) > mu else -gamma) if lam > lam_min else eta
    return lam*math.sqrt(abs(sigma))*s + w, (lam + tau*rate, w + tau*eps*lam*s)
