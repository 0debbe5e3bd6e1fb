"""First-order sliding mode control, dual-layer: the gain follows the perturbation up and down."""

import math
from dataclasses import replace
from typing import Annotated

from ..core import Block, Param, block
from ..core.card import Law
from ..core.family import family
from ..core.signal import filtered, norm, scaled, sign
from ..sources import EDWARDS_2014, KODE
from .relay import LAYERED, Layer

__all__ = ["dual_layer_quasi_smc", "dual_layer_smc", "dual_layer_unit_vector"]

Eta = Annotated[float,
                Param(r"\eta", "[v]", low=0.0, help="gain beyond the adapted k", slider=(0.0, 1.0))]
Alpha = Annotated[float, Param(r"\alpha", low=0.01, high=0.999, slider=(0.5, 0.99),
                               help="safety factor: k is held above v_eq/alpha")]
Eps = Annotated[float,
                Param(r"\epsilon", "[v]", low=1e-9, help="safety margin of k", slider=(0.01, 1.0))]
R0 = Annotated[float,
               Param("r_0", "[v]/s", low=1e-9, help="minimum speed of k", slider=(0.01, 5.0))]
Gamma = Annotated[float,
                  Param(r"\gamma", "1/s^2", low=0.0, log=True, help="growth of the speed of k",
                        slider=(0.01, 100.0))]
Delta0 = Annotated[float,
                   Param(r"\delta_0", "[v]", low=0.0, slider=(0.001, 0.5),
                         help="accepted error of k, less than half the margin: within it r stays")]
Filter = Annotated[float, Param(r"\tau_f", "s", low=1e-9, log=True, slider=(1e-3, 1.0),
                                help="lag of the filter that finds v_eq, well above tau")]
LAYERS = dict(k=(0.1, Param("k(0)", "[v]", low=0.0, help="gain to start with", slider=(0.0, 5.0))),
              r=(0.0,
                 Param("r(0)", "[v]/s", low=0.0,
                       help="speed of k beyond r_0 to start with: 0 resets it",
                       slider=(0.0, 10.0))))
V_EQ = Param(r"\bar v_{eq}(0)", "[v]", help="equivalent control to start with", slider=(-2.0, 2.0))

FOLLOWING = Law(order=1, r=1, adaptive=True,
                needs="that |xi'| is bounded, and gamma large enough for its bound",
                guarantees="sigma = 0 after a finite time", source=(KODE, EDWARDS_2014))
VECTOR = replace(FOLLOWING, channels=True)


def within(values):
    """The condition on two of the parameters."""
    if not values["delta_0"] < values["eps"]/2:
        return (f"delta_0 < eps/2 does not hold: delta_0 = {values['delta_0']:g}, eps/2 = "
                f"{values['eps']/2:g} [v]; the accepted error of k must lie within its margin")


def adapted(k, r, v_eq, tau, alpha, eps, r_0, gamma, delta_0):
    """The next k and r, from the size of the equivalent control."""
    delta = k - v_eq/alpha - eps
    k -= tau*(r_0 + r)*sign(delta)
    return k if k > 0.0 else 0.0, r + tau*gamma*abs(delta) if abs(delta) > delta_0 else r


@block(state={**LAYERS, "v_eq": (0.0, V_EQ)}, output=Param("v"), check=within, card=FOLLOWING)
def dual_layer_smc(sigma, z, tau, eta: Eta = 0.05, alpha: Alpha = 0.9, eps: Eps = 0.2,
                   r_0: R0 = 0.5, gamma: Gamma = 5.0, delta_0: Delta0 = 0.05, tau_f: Filter = 0.01):
    r"""First-order sliding mode control with dual-layer adaptation of the gain.

    .. math::

        v &= (k + \eta)\,\mathrm{sign}(\sigma), \qquad \tau_f \dot{\bar v}_{eq} = v - \bar v_{eq} \\
        \delta &= k - |\bar v_{eq}|/\alpha - \epsilon, \qquad
        \dot k = -(r_0 + r)\,\mathrm{sign}(\delta), \quad k \ge 0 \\
        \dot r &= \gamma\,|\delta| \text{ if } |\delta| > \delta_0, \text{ else } 0

    Parameters
    ----------
    sigma : float
        Sliding variable.
    eta : float
        Gain beyond k [v].
    alpha : float
        Safety factor, between 0 and 1: k is led to v_eq/alpha + eps.
    eps : float
        Safety margin of k [v].
    r_0 : float
        Minimum speed of k [v]/s.
    gamma : float
        Growth of the speed of k [1/s^2].
    delta_0 : float
        Accepted error of k [v], less than eps/2.
    tau_f : float
        Time constant of the filter that finds v_eq [s]: many sampling steps, but short compared
        with the perturbation's changes.

    Returns
    -------
    float
        v, of :math:`\dot\sigma = \xi - v`; needs no bound of the perturbation.

    Notes
    -----
    While sigma slides, the filtered v is the perturbation, so the gain comes down again when the
    perturbation drops. The speed r never falls within a run; the next run starts from the initial
    state r(0) again. Sampled every tau, |sigma| stays within about tau (k + eta + L).

    Erratum: nothing in (18) keeps k from falling below 0; here it is held at 0 or above. eps and
    eta must be larger than 0: without them k can reach 0 while v_eq is 0, and stays there however
    large sigma becomes.

    The gain follows xi, so it is the speed of xi that it has to match: the sufficient condition of
    the source is eps^2/4 > delta_0^2 + (q L_1/alpha)^2/gamma with \|xi'\| <= L_1 and a factor q >
    1, and contains delta_0 < eps/2. A bound of \|xi''\| is not enough: under xi = 10 (t - 5), from
    t = 5 s on, \|sigma\| reaches 10.1 with the defaults, before the gain has caught up. The
    condition is sufficient only: the defaults meet it for L_1 < 0.17, and slide where \|xi'\| is
    ten times as large. In `hosmc.adaptive_continuous` the gain follows xi', and there it is
    \|xi''\| that counts.

    References
    ----------
    Paper eqs (16)-(20), m = 1. C. Edwards and Y. Shtessel, American Control Conf., 2014.
    """
    k, r, v_eq = z
    v = (k + eta)*sign(sigma)
    v_eq += (1.0 - math.exp(-tau/tau_f))*(v - v_eq)
    k, r = adapted(k, r, abs(v_eq), tau, alpha, eps, r_0, gamma, delta_0)
    return v, (k, r, v_eq)


@block(state={**LAYERS, "v_eq": (0.0, V_EQ)}, output=Param("v"), check=within,
       card=replace(FOLLOWING, order=None, continuous=True, guarantees=LAYERED.guarantees))
def dual_layer_quasi_smc(sigma, z, tau, eta: Eta = 0.05, alpha: Alpha = 0.9, eps: Eps = 0.2,
                         r_0: R0 = 0.5, gamma: Gamma = 5.0, delta_0: Delta0 = 0.05,
                         tau_f: Filter = 0.01, width: Layer = 0.01):
    r"""Continuous (quasi) sliding mode control with dual-layer adaptation of the gain.

    .. math::

        v &= (k + \eta)\,\frac{\sigma}{|\sigma| + \varepsilon_0}, \qquad
        \tau_f \dot{\bar v}_{eq} = v - \bar v_{eq} \\
        \delta &= k - |\bar v_{eq}|/\alpha - \epsilon, \qquad
        \dot k = -(r_0 + r)\,\mathrm{sign}(\delta), \quad k \ge 0 \\
        \dot r &= \gamma\,|\delta| \text{ if } |\delta| > \delta_0, \text{ else } 0

    Parameters
    ----------
    sigma : float
        Sliding variable.
    eta : float
        Gain beyond k [v].
    alpha : float
        Safety factor, between 0 and 1: k is led to v_eq/alpha + eps.
    eps : float
        Safety margin of k [v].
    r_0 : float
        Minimum speed of k [v]/s.
    gamma : float
        Growth of the speed of k [1/s^2].
    delta_0 : float
        Accepted error of k [v], less than eps/2.
    tau_f : float
        Time constant of the filter that finds v_eq [s].
    width : float
        Width of the boundary layer, eps_0 of the equation [sigma].

    Returns
    -------
    float
        v, of :math:`\dot\sigma = \xi - v`, continuous; needs no bound of the perturbation.

    Notes
    -----
    As `dual_layer_smc`, its errata included, without the chattering. Against a constant
    perturbation xi the gain goes to k = |xi|/alpha + eps, which leaves
    :math:`|\sigma| = \varepsilon_0 |\xi|/(k + \eta - |\xi|)`, less than
    :math:`\varepsilon_0 |\xi|/(\epsilon + \eta)`.

    References
    ----------
    Paper eqs (16)-(20), m = 1, and its Fig. 9. C. Edwards and Y. Shtessel, American Control Conf.,
    2014.
    """
    k, r, v_eq = z
    v = (k + eta)*sigma/(abs(sigma) + width)
    v_eq += (1.0 - math.exp(-tau/tau_f))*(v - v_eq)
    k, r = adapted(k, r, abs(v_eq), tau, alpha, eps, r_0, gamma, delta_0)
    return v, (k, r, v_eq)


@family(card=VECTOR)
def dual_layer_unit_vector(m: int = 2) -> Block:
    r"""Unit vector control of m inputs with dual-layer adaptation of the gain.

    .. math::

        v &= (k + \eta)\,\frac{\sigma}{\|\sigma\|}, \qquad
        \tau_f \dot{\bar v}_{eq} = v - \bar v_{eq} \\
        \delta &= k - \|\bar v_{eq}\|/\alpha - \epsilon, \qquad
        \dot k = -(r_0 + r)\,\mathrm{sign}(\delta), \quad k \ge 0 \\
        \dot r &= \gamma\,|\delta| \text{ if } |\delta| > \delta_0, \text{ else } 0

    Parameters
    ----------
    m : int
        Number of inputs and of sliding variables, 2 to 8; with one it is `dual_layer_smc`.

    Returns
    -------
    Block
        A law for `ClosedLoop` that takes the whole tuple sigma and gives the tuple v of
        :math:`\dot\sigma = \xi - v`. Its parameters `eta`, `alpha`, `eps`, `r_0`, `gamma`,
        `delta_0`, `tau_f` are those of `dual_layer_smc`.

    Raises
    ------
    ParameterError
        m out of range.

    Notes
    -----
    As `dual_layer_smc`, its errata included, with one gain for all inputs; the filter has m states,
    v_eq_1 to v_eq_m.

    References
    ----------
    Paper eqs (16)-(20). C. Edwards and Y. Shtessel, American Control Conf., 2014.
    """
    m = Param(low=2, high=8).check("dual_layer_unit_vector", "m", m, int)

    def law(sigma, z, tau, eta: Eta = 0.05, alpha: Alpha = 0.9, eps: Eps = 0.2, r_0: R0 = 0.5,
            gamma: Gamma = 5.0, delta_0: Delta0 = 0.05, tau_f: Filter = 0.01):
        size = norm(sigma)
        v = scaled(sigma, z[0] + eta, size)
        v_eq = filtered(z[2:], v, 1.0 - math.exp(-tau/tau_f))
        return v, adapted(z[0], z[1], norm(v_eq), tau, alpha, eps, r_0, gamma, delta_0) + v_eq

    law.__name__, law.__doc__ = "dual_layer_unit_vector", dual_layer_unit_vector.__doc__
    filters = {f"v_eq_{i + 1}": (0.0, V_EQ) for i in range(m)}
    return block(law, state={**LAYERS, **filters}, output=Param("v"), check=within)
