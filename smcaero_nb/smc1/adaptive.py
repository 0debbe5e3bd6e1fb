"""First-order sliding mode control, adaptive: the gain grows until sigma is small, or falls too."""

from dataclasses import replace
from typing import Annotated

from ..core import Param, block
from ..core.card import Law
from ..core.signal import norm, scaled, sign
from ..sources import HUANG_2008, KODE, PLESTAN_2010
from .relay import Layer

__all__ = ["adaptive_quasi_smc", "adaptive_quasi_unit_vector", "adaptive_smc",
           "adaptive_unit_vector", "plestan_smc"]

Gamma = Annotated[float,
                  Param(r"\gamma", "[v]/([sigma] s)", low=0.0, log=True,
                        help="speed of the adaptation", slider=(0.1, 1000.0))]
Delta = Annotated[float, Param(r"\delta", "[sigma]", low=0.0, log=True, slider=(1e-4, 1.0),
                               help="accepted size of sigma: the gain grows only above it")]
GAIN = dict(rho=(0.1,
                 Param(r"\rho(0)", "[v]", low=0.0, help="gain to start with", slider=(0.0, 10.0))))


def accepted(t, values):
    """Return the accepted size of sigma."""
    return values["delta"]


# Near delta the gain grows ever more slowly: sigma is at rest within a quarter more.
GROWING = Law(r=1, adaptive=True, needs="that |xi| is bounded", gain="rho", band=accepted,
              within=1.25,
              guarantees="|sigma| <= delta after a finite time", source=(KODE, HUANG_2008))


def grown(rho, size, tau, gamma, delta):
    """The next gain."""
    return rho + tau*gamma*size if size > delta else rho


@block(state=GAIN, output=Param("v"), card=GROWING)
def adaptive_smc(sigma, z, tau, gamma: Gamma = 10.0, delta: Delta = 0.02):
    r"""First-order sliding mode control with an adaptive gain.

    .. math::

        v = \rho\,\mathrm{sign}(\sigma), \qquad
        \dot\rho = \gamma\,|\sigma| \text{ if } |\sigma| > \delta, \text{ else } 0

    Parameters
    ----------
    sigma : float
        Sliding variable.
    gamma : float
        Speed of the adaptation [v]/([sigma] s).
    delta : float
        Accepted :math:`|\sigma|`: the gain stops growing once sigma stays within it.

    Returns
    -------
    float
        v, of :math:`\dot\sigma = \xi - v`; needs no bound of the perturbation.

    Notes
    -----
    The gain never falls: it keeps what the approach to :math:`\sigma = 0` took, about
    :math:`\sqrt\gamma\,|\sigma(0)|`, and the chattering that goes with it. Begin near
    :math:`\sigma = 0`, or use `plestan_smc` or `dual_layer_smc`. Sampled every tau, the relay moves
    sigma by up to tau (rho + L), so `delta` has to be larger than that: otherwise the gain grows
    without bound.

    With several inputs, paper eq (15), one such law a channel:
    ``channels(a=adaptive_smc, b=adaptive_smc.with_(gamma=9.0))``.

    References
    ----------
    Paper eqs (13), (15). Y.-J. Huang, T.-C. Kuo and S.-H. Chang, IEEE Trans. Syst. Man Cybern. B 38
    (2008) 534.
    """
    rho, = z
    return rho*sign(sigma), (grown(rho, abs(sigma), tau, gamma, delta),)


Least = Annotated[float,
                  Param(r"\mu", "[v]", low=1e-9, log=True, slider=(1e-3, 1.0),
                        help="minimum gain; a gain below it grows by as much in a second")]


@block(state=GAIN, output=Param("v"),
       card=replace(GROWING, needs="that |xi| is bounded, by an L that need not be known",
                    guarantees="|sigma| <= sqrt(delta^2 + L^2/gamma) after a finite time",
                    within=5.0,  # of delta: up to L = 2.2 [v] with the defaults
                    source=(PLESTAN_2010,)))
def plestan_smc(sigma, z, tau, gamma: Gamma = 500.0, delta: Delta = 0.02, mu: Least = 0.05):
    r"""First-order sliding mode control with a gain that grows and falls.

    .. math::

        v = \rho\,\mathrm{sign}(\sigma), \qquad
        \dot\rho = \gamma\,|\sigma|\,\mathrm{sign}(|\sigma| - \delta) \text{ if } \rho > \mu,
        \text{ else } \mu

    Parameters
    ----------
    sigma : float
        Sliding variable.
    gamma : float
        Speed of the adaptation [v]/([sigma] s).
    delta : float
        Accepted :math:`|\sigma|`: the gain grows above it and falls below it.
    mu : float
        Minimum gain [v], and the growth [v]/s of a gain below it.

    Returns
    -------
    float
        v, of :math:`\dot\sigma = \xi - v`; needs no bound of the perturbation.

    Notes
    -----
    The gain falls until it no longer holds the perturbation; then :math:`|\sigma|` grows beyond
    delta, and with it the gain. So sigma does not stay at 0: once within delta, it stays within
    :math:`\sqrt{\delta^2 + L^2/\gamma}`, L the bound of :math:`|\xi|`.

    On the approach the gain grows as that of `adaptive_smc`, but it comes down again: it falls at
    the rate gamma \|sigma\|, and while sigma slides \|sigma\| is what sampling leaves, about tau
    rho/4: a finer step makes the gain fall more slowly. Sampled every tau, the accepted size is 4
    tau rho where this is larger than delta, as its authors recommend: otherwise the chattering of a
    large gain would raise it without bound.

    References
    ----------
    Not in the paper. F. Plestan, Y. Shtessel, V. Bregeault and A. Poznyak, Int. J. Control 83
    (2010) 1907.
    """
    rho, = z
    size = abs(sigma)
    grows = size > max(delta, 4.0*tau*rho)
    rate = (gamma*size if grows else -gamma*size) if rho > mu else mu
    return rho*sign(sigma), (max(min(rho, mu), rho + tau*rate),)  # no step falls through mu


@block(state=GAIN, output=Param("v"), card=replace(GROWING, continuous=True))
def adaptive_quasi_smc(sigma, z, tau, gamma: Gamma = 10.0, delta: Delta = 0.02, eps: Layer = 0.01):
    r"""Continuous (quasi) sliding mode control with an adaptive gain.

    .. math::

        v = \rho\,\frac{\sigma}{|\sigma| + \varepsilon}, \qquad
        \dot\rho = \gamma\,|\sigma| \text{ if } |\sigma| > \delta, \text{ else } 0

    Parameters
    ----------
    sigma : float
        Sliding variable.
    gamma : float
        Speed of the adaptation [v]/([sigma] s).
    delta : float
        Accepted :math:`|\sigma|`: the gain stops growing once sigma stays within it.
    eps : float
        Width of the boundary layer [sigma].

    Returns
    -------
    float
        v, of :math:`\dot\sigma = \xi - v`, continuous; needs no bound of the perturbation.

    Notes
    -----
    Against a perturbation of bound L the gain stops near :math:`L (1 + \varepsilon/\delta)` at
    most, unless the approach took it higher: a wide layer with a narrow `delta` asks for a large
    gain. It never falls.

    With several inputs, one such law a channel, as for `adaptive_smc`.

    References
    ----------
    Paper eqs (13), (15) and the note below them. Y.-J. Huang, T.-C. Kuo and S.-H. Chang, IEEE
    Trans. Syst. Man Cybern. B 38 (2008) 534.
    """
    rho, = z
    size = abs(sigma)
    return rho*sigma/(size + eps), (grown(rho, size, tau, gamma, delta),)


@block(state=GAIN, output=Param("v"), card=replace(GROWING, channels=True))
def adaptive_unit_vector(sigma, z, tau, gamma: Gamma = 10.0, delta: Delta = 0.02):
    r"""Unit vector control of several inputs with an adaptive gain.

    .. math::

        v = \rho\,\frac{\sigma}{\|\sigma\|}, \qquad
        \dot\rho = \gamma\,\|\sigma\| \text{ if } \|\sigma\| > \delta, \text{ else } 0

    Parameters
    ----------
    sigma : tuple of float
        Sliding variables, as many as there are inputs; :math:`\|\sigma\|` is Euclidean.
    gamma : float
        Speed of the adaptation [v]/([sigma] s).
    delta : float
        Accepted :math:`\|\sigma\|`: the gain stops growing once sigma stays within it.

    Returns
    -------
    tuple of float
        v, of :math:`\dot\sigma = \xi - v`; needs no bound of the perturbation.

    Notes
    -----
    As `adaptive_smc`, with one gain for all inputs: the gain never falls, and `delta` has to be
    larger than tau (rho + L).

    References
    ----------
    Paper eqs (12), (14). Y.-J. Huang, T.-C. Kuo and S.-H. Chang, IEEE Trans. Syst. Man Cybern. B 38
    (2008) 534.
    """
    rho, = z
    size = norm(sigma)
    return scaled(sigma, rho, size), (grown(rho, size, tau, gamma, delta),)


@block(state=GAIN, output=Param("v"), card=replace(GROWING, channels=True, continuous=True))
def adaptive_quasi_unit_vector(sigma, z, tau, gamma: Gamma = 10.0, delta: Delta = 0.02,
                               eps: Layer = 0.01):
    r"""Continuous (quasi) unit vector control of several inputs with an adaptive gain.

    .. math::

        v = \rho\,\frac{\sigma}{\|\sigma\| + \varepsilon}, \qquad
        \dot\rho = \gamma\,\|\sigma\| \text{ if } \|\sigma\| > \delta, \text{ else } 0

    Parameters
    ----------
    sigma : tuple of float
        Sliding variables, as many as there are inputs; :math:`\|\sigma\|` is Euclidean.
    gamma : float
        Speed of the adaptation [v]/([sigma] s).
    delta : float
        Accepted :math:`\|\sigma\|`: the gain stops growing once sigma stays within it.
    eps : float
        Width of the boundary layer [sigma].

    Returns
    -------
    tuple of float
        v, of :math:`\dot\sigma = \xi - v`, continuous; needs no bound of the perturbation.

    Notes
    -----
    As `adaptive_quasi_smc`, with one gain for all inputs: it stops near
    :math:`L (1 + \varepsilon/\delta)` at most, L the bound of :math:`\|\xi\|`, unless the approach
    took it higher, and never falls.

    References
    ----------
    Paper eqs (12), (14) and the note below (15). Y.-J. Huang, T.-C. Kuo and S.-H. Chang, IEEE
    Trans. Syst. Man Cybern. B 38 (2008) 534.
    """
    rho, = z
    size = norm(sigma)
    return scaled(sigma, rho, size + eps), (grown(rho, size, tau, gamma, delta),)
