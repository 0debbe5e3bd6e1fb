"""Super-twisting: second-order sliding mode control, continuous."""

import math
from typing import Annotated

from ..core import Param, block

__all__ = ["adaptive_super_twisting"]


@block(state=dict(lam=(1.0, Param(r"\lambda(0)", "[v]/[sigma]^1/2", low=0.0, help="gain to start with", slider=(0.0, 10.0))),
                  w=(0.0, Param("w(0)", "[v]", help="integral term to start with", slider=(-1.0, 1.0)))))
def adaptive_super_twisting(
        sigma, z, tau,
        gamma: Annotated[float, Param(r"\gamma", "[lam]/s", low=0.0, log=True, help="speed of the adaptation",
                                      slider=(1e-3, 100.0))] = 20.0,
        mu: Annotated[float, Param(r"\mu", "[sigma]", low=0.0, log=True, help="accepted size of sigma",
                                   slider=(1e-4, 1.0))] = 1e-3,
        lam_min: Annotated[float, Param(r"\lambda_m", "[lam]", low=0.0, help="least gain", slider=(0.0, 2.0))] = 0.05,
        eps: Annotated[float, Param(r"\varepsilon", "1/s", low=0.0, log=True, help="beta = eps lam", slider=(1e-3, 10.0))] = 1.0,
        eta: Annotated[float, Param(r"\eta", "[lam]/s", low=0.0, log=True, help="growth below the least gain",
                                    slider=(1e-3, 10.0))] = 0.5) -> Param("v"):
    r"""Super-twisting control with adaptive gains.

    .. math::

        v &= \lambda\,|\sigma|^{1/2}\,\mathrm{sign}(\sigma) + w, \qquad \dot w = \beta\,\mathrm{sign}(\sigma),
        \qquad \beta = \varepsilon\lambda \\
        \dot\lambda &= \gamma\,\mathrm{sign}(|\sigma| - \mu) \text{ if } \lambda > \lambda_m, \text{ else } \eta

    Parameters
    ----------
    sigma : float
        Sliding variable.
    gamma : float
        Speed of the adaptation [lam]/s; about ten times the bound of the perturbation's derivative or more.
    mu : float
        Accepted :math:`|\sigma|`: above it the gain grows, below it the gain falls; well above
        tau^2 times the level of the gain.
    lam_min : float
        Least gain.
    eps : float
        Ratio beta/lambda [1/s].
    eta : float
        Growth of a gain below `lam_min` [lam]/s.

    Returns
    -------
    float
        v, of :math:`\dot\sigma = \xi - v`, continuous; needs no bound of the perturbation's derivative.

    Notes
    -----
    The gain does not stay large: it falls until :math:`|\sigma|` reaches mu, which sigma then overshoots by a factor of
    two to twelve. Erratum: none; the paper's beta = eps lambda belongs to w' = beta sign(sigma), which is the
    literature's beta = 2 eps lambda with w' = (beta/2) sign(sigma).

    References
    ----------
    Paper eqs (21), (24). Y. Shtessel, M. Taleb and F. Plestan, Automatica 48 (2012) 759. A. Levant, Int. J. Control 58
    (1993) 1247.
    """
    lam, w = z
    s = (sigma > 0.0)*1.0 - (sigma < 0.0)*1.0
    rate = (gamma if abs(sigma) > mu else -gamma) if lam > lam_min else eta
    return lam*math.sqrt(abs(sigma))*s + w, (lam + tau*rate, w + tau*eps*lam*s)
