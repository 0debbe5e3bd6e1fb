"""Unit vector control of several inputs, fixed gain: sigma' = xi - v, norm of xi <= L < rho."""

from dataclasses import replace

from ..core import Param, block, exceeds
from ..core.signal import norm, scaled
from ..sources import BURTON_1986, GUTMAN_1979, KODE, UTKIN_1992
from .relay import LAYERED, RELAY, Layer, Rho

__all__ = ["quasi_unit_vector", "unit_vector"]


@block(output=Param("v"),
       card=replace(RELAY, channels=True, assumes=exceeds("rho", "||xi||"),
                    source=(KODE, GUTMAN_1979, UTKIN_1992)))
def unit_vector(sigma, rho: Rho = 2.0):
    r"""Unit vector sliding mode control of several inputs.

    .. math:: v = \rho\,\frac{\sigma}{\|\sigma\|}, \qquad v = 0 \text{ at } \sigma = 0

    Parameters
    ----------
    sigma : tuple of float
        Sliding variables, as many as there are inputs; :math:`\|\sigma\|` is Euclidean.
    rho : float
        Gain [v]; the theorem asks for more than the bound L of :math:`\|\xi\|`.

    Returns
    -------
    tuple of float
        v, of :math:`\dot\sigma = \xi - v`.

    Notes
    -----
    All components reach 0 at the same time, within :math:`\|\sigma(0)\|/(\rho - L)`; without
    perturbation on a straight line. Sampled every tau it chatters: :math:`\|\sigma\|` stays within
    about tau (rho + L). With one input it is `sign_smc`.

    Behind `decoupling`, an input matrix G other than the known G0 adds (I - G G0^-1) v to xi. With
    that matrix at most gamma < 1 in norm, the gain has to exceed L/(1 - gamma). Erratum: eq (12)
    asks for rho > L only, but the xi of eq (10) then contains v, and its bound the gain itself; see
    `decoupling` for the condition on G.

    References
    ----------
    Paper eq (12). S. Gutman, IEEE Trans. Automatic Control 24 (1979) 437. V. I. Utkin, Sliding
    Modes in Control and Optimization, Springer, 1992.
    """
    return scaled(sigma, rho, norm(sigma))


@block(output=Param("v"),
       card=replace(LAYERED, channels=True, assumes=exceeds("rho", "||xi||"),
                    source=(KODE, BURTON_1986)))
def quasi_unit_vector(sigma, rho: Rho = 2.0, eps: Layer = 0.1):
    r"""Continuous (quasi) unit vector control of several inputs, sigmoid.

    .. math:: v = \rho\,\frac{\sigma}{\|\sigma\| + \varepsilon}

    Parameters
    ----------
    sigma : tuple of float
        Sliding variables, as many as there are inputs; :math:`\|\sigma\|` is Euclidean.
    rho : float
        Gain [v]; the theorem asks for more than the bound L of :math:`\|\xi\|`.
    eps : float
        Width of the boundary layer [sigma].

    Returns
    -------
    tuple of float
        v, of :math:`\dot\sigma = \xi - v`.

    Notes
    -----
    No chattering, and no exact sliding either: a constant perturbation xi leaves
    :math:`\sigma = \varepsilon\,\xi/(\rho - \|\xi\|)`. Near :math:`\sigma = 0` it is a linear gain
    rho/eps.

    References
    ----------
    Paper eqs (12), (13). J. A. Burton and A. S. I. Zinober, Int. J. Systems Science 17 (1986) 875.
    """
    return scaled(sigma, rho, norm(sigma) + eps)
