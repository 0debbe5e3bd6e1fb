r"""First-order sliding mode control, fixed gain: sigma' = xi - v, \|xi\| <= L < rho."""

import math
from dataclasses import replace
from typing import Annotated

from ..core import Param, block, exceeds
from ..core.card import Law
from ..core.signal import sign
from ..sources import BURTON_1986, EDWARDS_1998, KODE, SLOTINE_1991, UTKIN_1992

__all__ = ["quasi_smc", "saturation_smc", "sign_smc", "tanh_smc"]

Rho = Annotated[float, Param(r"\rho", "[v]", low=0.0, slider=(0.0, 10.0),
                             help="gain, larger than the bound of the perturbation")]
Layer = Annotated[float, Param(r"\varepsilon", "[sigma]", low=1e-9, log=True, slider=(1e-4, 10.0),
                               help="boundary layer: smaller is more accurate and less smooth")]
RELAY = Law(order=1, r=1, needs="the bound of |xi|", guarantees="sigma = 0 after a finite time",
            assumes=exceeds("rho"))
LAYERED = replace(RELAY, order=None, continuous=True,
                  guarantees="sigma within a boundary layer after a finite time")


def relayed(values, a, omega):
    """Describing function of the relay."""
    return 4.0*values["rho"]/(math.pi*a)


def saturated(values, a, omega):
    """Describing function of the saturation."""
    q = min(values["eps"]/a, 1.0)
    return 2.0*values["rho"]/(math.pi*values["eps"])*(math.asin(q) + q*math.sqrt(1.0 - q*q))


def sigmoid(values, a, omega):
    r"""Describing function of the sigmoid: of sin^2/(sin + q) = sin - q + q^2/(sin + q)."""
    q = values["eps"]/a
    w = math.sqrt(abs(1.0 - q*q))
    rest = 2.0 if w == 0.0 else 2.0/w*(math.acosh(1.0/q) if q < 1.0 else math.acos(1.0/q))
    return 2.0*values["rho"]/(math.pi*a)*(2.0 - math.pi*q + q*q*rest)


@block(output=Param("v"), card=replace(RELAY, describing=relayed, source=(KODE, UTKIN_1992)))
def sign_smc(sigma, rho: Rho = 2.0):
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
    Reaches :math:`\sigma = 0` within :math:`|\sigma(0)|/(\rho - L)`. Sampled every tau it chatters:
    :math:`|\sigma|` stays within about tau (rho + L), and v switches every few samples. Behind an
    actuator it ends in a limit cycle.

    With several inputs, R = diag(rho_i) is one such law a channel:
    ``channels(a=sign_smc.with_(rho=2.0), b=sign_smc.with_(rho=3.0))``, each rho_i larger than the
    bound of its own xi_i. Erratum: the paper's text calls these bounds Lipschitz constants; they
    bound xi itself, as its (A2) says.

    References
    ----------
    Paper eq (13). V. I. Utkin, Sliding Modes in Control and Optimization, Springer, 1992.
    """
    return rho*sign(sigma)


@block(output=Param("v"), card=replace(LAYERED, describing=sigmoid, source=(KODE, BURTON_1986)))
def quasi_smc(sigma, rho: Rho = 2.0, eps: Layer = 0.1):
    r"""Continuous (quasi) sliding mode control, sigmoid.

    .. math:: v = \rho\,\frac{\sigma}{|\sigma| + \varepsilon}

    Parameters
    ----------
    sigma : float
        Sliding variable.
    rho : float
        Gain [v]; the theorem asks for more than the bound L of the perturbation. The paper's (70)
        writes it as rho + L.
    eps : float
        Width of the boundary layer [sigma].

    Returns
    -------
    float
        v, of :math:`\dot\sigma = \xi - v`.

    Notes
    -----
    No chattering, and no exact sliding either: a constant perturbation xi leaves
    :math:`\sigma = \varepsilon\,\xi/(\rho - |\xi|)`. Near :math:`\sigma = 0` it acts as a linear
    gain rho/eps, which the actuator and the sampling limit: below eps = tau rho/2 it chatters like
    the relay.

    With several inputs, one such law a channel, as for `sign_smc`.

    References
    ----------
    Paper eqs (13), (70). J. A. Burton and A. S. I. Zinober, Int. J. Systems Science 17 (1986) 875.
    """
    return rho*sigma/(abs(sigma) + eps)


@block(output=Param("v"), card=replace(LAYERED, describing=saturated, source=(SLOTINE_1991,)))
def saturation_smc(sigma, rho: Rho = 2.0, eps: Layer = 0.1):
    r"""Continuous (quasi) sliding mode control, saturation.

    .. math:: v = \rho\,\mathrm{sat}(\sigma/\varepsilon), \qquad
        \mathrm{sat}(q) = \max(-1, \min(1, q))

    Parameters
    ----------
    sigma : float
        Sliding variable.
    rho : float
        Gain [v]; the theorem asks for more than the bound L of the perturbation.
    eps : float
        Half the width of the boundary layer [sigma].

    Returns
    -------
    float
        v, of :math:`\dot\sigma = \xi - v`.

    Notes
    -----
    Outside the layer it is the relay, so it enters the layer within
    :math:`(|\sigma(0)| - \varepsilon)/(\rho - L)`; inside it is linear, and a constant perturbation
    xi leaves :math:`\sigma = \varepsilon\,\xi/\rho`. Below eps = tau rho/2 it chatters like the
    relay.

    References
    ----------
    The usual alternative to the sigmoid of paper eq (13). J.-J. E. Slotine and W. Li, Applied
    Nonlinear Control, Prentice Hall, 1991, section 7.2.
    """
    q = sigma/eps
    return rho*(1.0 if q > 1.0 else -1.0 if q < -1.0 else q)


@block(output=Param("v"), card=replace(LAYERED, source=(EDWARDS_1998,)))
def tanh_smc(sigma, rho: Rho = 2.0, eps: Layer = 0.1):
    r"""Continuous (quasi) sliding mode control, hyperbolic tangent.

    .. math:: v = \rho\,\tanh(\sigma/\varepsilon)

    Parameters
    ----------
    sigma : float
        Sliding variable.
    rho : float
        Gain [v]; the theorem asks for more than the bound L of the perturbation.
    eps : float
        Width of the boundary layer [sigma].

    Returns
    -------
    float
        v, of :math:`\dot\sigma = \xi - v`.

    Notes
    -----
    Smooth to every order. A constant perturbation xi leaves
    :math:`\sigma = \varepsilon\,\mathrm{artanh}(\xi/\rho)`. Below eps = tau rho/2 it chatters like
    the relay.

    References
    ----------
    The usual alternative to the sigmoid of paper eq (13). C. Edwards and S. K. Spurgeon, Sliding
    Mode Control: Theory and Applications, Taylor and Francis, 1998.
    """
    return rho*math.tanh(sigma/eps)
