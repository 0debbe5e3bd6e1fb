r"""First-order sliding mode control, fixed gain: sigma' = xi - v, \\|xi\\| <= L < rho."""

from typing import Annotated

from ..core import Param, block

__all__ = ["quasi_smc", "sign", "sign_smc"]

RHO = Param(r"\rho", "[v]", low=0.0, help="gain, larger than the bound of the perturbation", slider=(0.0, 10.0))


def sign(s):
    """Sign of a number; 0 at 0."""
    return (s > 0.0)*1.0 - (s < 0.0)*1.0


@block
def sign_smc(sigma, rho: Annotated[float, RHO] = 1.0) -> Param("v"):
    r"""First-order sliding mode control.

    .. math:: v = \rho\,\mathrm{sign}(\sigma)

    Parameters
    ----------
    sigma : float
        Sliding variable.
    rho : float
        Gain [v]; the theorem asks for more than the bound L of the perturbation.

    Returns
    -------
    float
        v, of :math:`\dot\sigma = \xi - v`.

    Notes
    -----
    Reaches :math:`\sigma = 0` within :math:`|\sigma(0)|/(\rho - L)`. Sampled every tau it chatters: :math:`|\sigma|`
    stays within about tau (rho + L), and v switches every few samples. Behind an actuator it is a limit cycle.

    References
    ----------
    Paper eq (13), m = 1. V. I. Utkin, Sliding Modes in Control and Optimization, Springer, 1992.
    """
    return rho*sign(sigma)


@block
def quasi_smc(sigma, rho: Annotated[float, RHO] = 1.0,
              eps: Annotated[float, Param(r"\varepsilon", "[sigma]", low=1e-9, log=True, slider=(1e-3, 10.0),
                                          help="boundary layer: smaller is more accurate and less smooth")] = 0.1) -> Param("v"):
    r"""Continuous (quasi) sliding mode control, sigmoid.

    .. math:: v = \rho\,\frac{\sigma}{|\sigma| + \varepsilon}

    Parameters
    ----------
    sigma : float
        Sliding variable.
    rho : float
        Gain [v]; the theorem asks for more than the bound L of the perturbation. The paper's (70) writes it as rho + L.
    eps : float
        Width of the boundary layer [sigma].

    Returns
    -------
    float
        v, of :math:`\dot\sigma = \xi - v`.

    Notes
    -----
    No chattering, and no exact sliding either: a constant perturbation xi leaves
    :math:`\sigma = \varepsilon\,\xi/(\rho - |\xi|)`. Near :math:`\sigma = 0` it is a linear gain rho/eps, which the
    actuator bounds.

    References
    ----------
    Paper eqs (13), (70). J. A. Burton and A. S. I. Zinober, Int. J. Systems Science 17 (1986) 875.
    """
    return rho*sigma/(abs(sigma) + eps)
