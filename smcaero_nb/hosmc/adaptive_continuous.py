"""Adaptive continuous higher-order sliding mode control: homogeneous, plus super-twisting."""

import math
from dataclasses import replace
from typing import Annotated

import numpy as np

from ..core import Block, Param, block
from ..core.card import Law
from ..core.family import family, written
from ..core.signal import sign
from ..sources import BHAT_2005, EDWARDS_2016, KODE
from .homogeneous import order, power

__all__ = ["adaptive_continuous"]

STATE = dict(
    integral=(0.0, Param(r"\int v_\sigma", "[v] s", slider=(-10.0, 10.0),
                         help="minus the highest derivative at t = 0: no reaching of s = 0")),
    w=(0.0, Param("w(0)", "[v]", slider=(-10.0, 10.0),
                  help="integral of the super-twisting part to start with")),
    v_eq=(0.0, Param(r"\bar v_{eq}(0)", "[v]/s", slider=(-10.0, 10.0),
                     help="filtered equivalent control to start with")),
    L=(0.2, Param("L(0)", "[v]/s", low=1e-6, log=True, slider=(1e-3, 10.0),
                  help="gain to start with")),
    r=(0.0, Param("r(0)", "[v]/s^2", low=0.0, slider=(0.0, 10.0),
                  help="rate of L beyond r_0 to start with")))
SETTINGS = dict(
    l_0=(0.2, Param("l_0", "[v]/s", low=1e-6, log=True, help="minimum L", slider=(1e-3, 10.0))),
    beta_0=(1.1, Param(r"\beta_0", "1", low=1.001, help="beta = beta_0 L", slider=(1.001, 1.2))),
    alpha=(0.8, Param(r"\alpha", "1", low=0.01, high=1.0, slider=(0.1, 0.83),
                      help="safety factor, less than 1/beta_0")),
    eps=(0.2, Param(r"\varepsilon", "[v]/s", low=0.0, help="safety margin of L",
                    slider=(0.0, 1.0))),
    r_0=(0.5, Param("r_0", "[v]/s^2", low=0.0, help="minimum rate of L", slider=(0.0, 10.0))),
    gamma=(4.0, Param(r"\gamma", "1/s^2", low=0.0, help="growth of the rate of L",
                      slider=(0.0, 20.0))),
    delta_0=(0.05, Param(r"\delta_0", "[v]/s", low=1e-6, log=True, slider=(1e-3, 1.0),
                         help="accepted error of L")),
    tau_f=(0.01, Param(r"\tau_f", "s", low=1e-6, log=True, slider=(1e-3, 10.0),
                       help="filter of the equivalent control")))
#: r: alpha_r, omega of gamma_i from (p + omega)^r
DEFAULTS = {2: (0.75, 3.0), 3: (0.75, 3.0), 4: (0.85, 1.5), 5: (0.85, 3.0)}
#: r: factor up and down in which all gamma_i together stay Hurwitz
SPAN = {2: 10.0, 3: 2.0, 4: 1.5, 5: 1.3}
DERIVATIVES = (r"\sigma", r"\dot\sigma", r"\ddot\sigma", r"\sigma^{(3)}", r"\sigma^{(4)}")


def continuous(v_sigma, last, z, tau, l_0, beta_0, alpha, eps, r_0, gamma, delta_0, tau_f):
    """v_sigma + v_s, and the next state; the step of L is implicit in L."""
    integral, w, v_eq, L, r = z
    s = last + integral
    delta, rho = L - abs(v_eq)/(alpha*beta_0) - eps, r_0 + r
    L_next = max(l_0, L - tau*rho*max(-1.0, min(1.0, delta/(delta_0 + tau*rho))))
    lam, beta = 2.0*math.sqrt(2.0*beta_0*L), beta_0*L
    v_s = (L_next - L)/tau/L*s + lam*math.sqrt(abs(s))*sign(s) + w
    growth = gamma*abs(delta) if abs(delta) > delta_0 else 0.0
    return v_sigma + v_s, (integral + tau*v_sigma, w + tau*beta*sign(s),
                           v_eq + (1.0 - math.exp(-tau/tau_f))*(beta*sign(s) - v_eq), L_next,
                           r + tau*growth)


def unfit(values):
    """Say which condition of the law its values break."""
    gains = [v for n, v in values.items() if n.startswith("gamma_")]
    roots = np.roots([1.0, *gains[::-1]])
    if any(roots.real >= 0.0):
        return ("the polynomial p^r + gamma_r p^(r-1) + ... + gamma_1 must be Hurwitz, but it has "
                "the roots " + ", ".join(f"{q:.3g}" for q in roots))
    if not values["alpha"]*values["beta_0"] < 1.0:
        return (f"alpha = {values['alpha']:g} is not allowed; it must be less than 1/beta_0 = "
                f"{1.0/values['beta_0']:g}")
    return None


DOC = r"""Adaptive continuous sliding mode control, relative degree {r}.

    .. math::

        v &= v_\sigma + v_s, \qquad v_\sigma = {equation}, \qquad
        1/\alpha_i = 1 + ({r} + 1 - i)(1/\alpha_{r} - 1) \\
        v_s &= \frac{{\dot L}}{{L}}s + \lambda|s|^{{1/2}}\mathrm{{sign}}(s) + w, \qquad
        \dot w = \beta\,\mathrm{{sign}}(s),
        \qquad s = \sigma^{{({last})}} + \int v_\sigma\,dt, \qquad \beta = \beta_0 L, \qquad
        \lambda = 2\sqrt{{2\beta_0 L}} \\
        \dot L &= -\rho\,\mathrm{{sat}}(\delta/\delta_0), \quad L \ge l_0, \qquad
        \delta = L - |\bar v_{{eq}}|/(\alpha\beta_0)
        - \varepsilon, \qquad
        \tau_f\,\dot{{\bar v}}_{{eq}} = \beta\,\mathrm{{sign}}(s) - \bar v_{{eq}} \\
        \rho &= r_0 + r, \qquad
        \dot r = \gamma|\delta| \text{{ if }} |\delta| > \delta_0, \text{{ else }} 0

    with :math:`\lfloor x\rceil^a = |x|^a\,\mathrm{{sign}}(x)`.

    Parameters
    ----------
    sigma : tuple of {r} float
        Sliding variable and its derivatives up to the order {last}.
    {gains} : float
        Gains [1]; :math:`p^{r} + \gamma_{r} p^{last} + ... + \gamma_1` must be Hurwitz. Default:
        :math:`(p + {w0:g})^{r}`.
    alpha_r : float
        :math:`\alpha_{r}` [1], power of the highest derivative: less than 1 converges in finite
        time.
    l_0 : float
        Minimum L [v]/s.
    beta_0 : float
        :math:`\beta/L` [1], larger than 1.
    alpha : float
        Safety factor [1], less than 1/beta_0.
    eps : float
        Safety margin of L [v]/s, larger than 0 where l_0 is small.
    r_0 : float
        Minimum rate of L [v]/s^2.
    gamma : float
        Growth of the rate of L [1/s^2]; 0 keeps it at r_0.
    delta_0 : float
        Accepted error of L [v]/s.
    tau_f : float
        Time constant of the filter of the equivalent control [s]: ten times tau or more, and longer
        than the period of the limit cycle that an actuator causes.

    Returns
    -------
    float
        v, of :math:`\sigma^{{({r})}} = \xi - v`, continuous; needs no bound of :math:`\xi` or of
        its derivative.

    Notes
    -----
    L follows the size of :math:`\dot\xi`, up and down; r never falls. Sampled every tau, sigma^(i)
    is of the order :math:`\tau^{{2\alpha_{r}/\alpha_{{i+1}}}}` or better, :math:`\tau^2` for i =
    {last}. With the state `integral` set to minus the initial :math:`\sigma^{{({last})}}` it starts
    on s = 0. Behind a slow actuator take smaller gains, alpha_r nearer to 1 and a longer tau_f.

    Erratum: see `adaptive_continuous`.

    References
    ----------
    Paper eqs (29)-(40). C. Edwards and Y. Shtessel, Automatica 65 (2016) 183.
    """


ADAPTIVE = Law(sees="derivatives", adaptive=True, continuous=True,
               needs="that |xi'| and |xi''| are bounded",
               guarantees="sigma and its derivatives are 0 after a finite time",
               source=(KODE, EDWARDS_2016, BHAT_2005))


@family(card=ADAPTIVE)
def adaptive_continuous(r: int) -> Block:
    r"""Adaptive continuous higher-order sliding mode control: homogeneous, plus super-twisting.

    .. math:: v = v_\sigma(\sigma, \dot\sigma, ..., \sigma^{(r-1)}) + v_s, \qquad \dot s = \xi - v_s

    Parameters
    ----------
    r : int
        Relative degree, 2 to 5.

    Returns
    -------
    Block
        A law of the tuple (sigma, sigma', ..., sigma^(r-1)); its docstring has the equations and
        its parameters.

    Raises
    ------
    ParameterError
        An order that does not exist.

    Notes
    -----
    :math:`v_\sigma` alone brings the unperturbed chain to zero in finite time; :math:`v_s` finds
    the perturbation and cancels it. Its gain L follows a filtered equivalent control (dual layer),
    so that no bound has to be known.

    Admissible: a Hurwitz polynomial of the gains, alpha < 1/beta_0, and alpha_r near 1. How near
    depends on the gains: of order 5, the default gains need 0.85, and with 0.75 diverge. The powers
    :math:`\alpha_i` follow from :math:`1/\alpha_i = 1 + (r + 1 - i)(1/\alpha_r - 1)`, which is Bhat
    and Bernstein's recursion solved.

    The rate of L is sat(delta/delta_0), not sign(delta), and its step is implicit. With sign(delta)
    the term L'/L s makes the control chatter: on the launch vehicle it varies by 436 rad in each
    second instead of 0.1. Explicit steps of either, with the ripple of a filter too fast for tau,
    let r grow until L overshoots in every step and the loop diverges (here after 50 s with tau = 4
    ms and the defaults); the implicit step has no such limit.

    Errata: the minus signs of (29) belong to sigma^(r) = xi + v; with the paper's (26) it is v =
    v_sigma + v_s. In (30) the gains are gamma_1, gamma_2, gamma_3. In (32), s = sigma^(r-1) + int
    v_sigma, not int v_s. (37) lacks - eps, which (38) needs. With (29) or (32) as printed the loop
    diverges.

    References
    ----------
    Paper eqs (29)-(40). C. Edwards and Y. Shtessel, Automatica 65 (2016) 183. S. P. Bhat and D. S.
    Bernstein, Math. Control Signals Systems 17 (2005) 101.
    """
    r = order("adaptive_continuous", r, 2, 5)
    alpha_r, w0 = DEFAULTS[r]
    names: dict = dict(power=power, continuous=continuous, __name__=__name__)
    arguments = []
    for i in range(r):
        gain = math.comb(r, i)*w0**(r - i)
        names[f"G{i + 1}"] = Annotated[float,
                                       Param(rf"\gamma_{i + 1}", "1", low=1e-6, log=True,
                                             help="gain of sigma" + "'"*i,
                                             slider=(gain/SPAN[r], gain*SPAN[r]))]
        arguments.append(f"gamma_{i + 1}: G{i + 1} = {gain!r}")
    power_r = Param(rf"\alpha_{r}", "1", low=0.5, high=0.99, slider=(0.6, 0.99),
                    help="power of the highest derivative")
    for n, (v, meta) in dict(alpha_r=(alpha_r, power_r), **SETTINGS).items():
        names[f"A_{n}"] = Annotated[float, meta]
        arguments.append(f"{n}: A_{n} = {v!r}")
    parts = [f"s{i}" for i in range(r)]
    v_sigma = " + ".join(f"gamma_{i + 1}*power({s}, 1.0/(1.0 + {r - i}.0*q))"
                         for i, s in enumerate(parts))
    body = [f"{', '.join(parts)} = sigma", "q = 1.0/alpha_r - 1.0", f"v_sigma = {v_sigma}",
            f"return continuous(v_sigma, {parts[-1]}, z, tau, {', '.join(SETTINGS)})"]
    powers = (rf"\gamma_{i + 1}\lfloor {s}\rceil^{{\alpha_{i + 1}}}"
              for i, s in enumerate(DERIVATIVES[:r]))
    doc = DOC.format(r=r, last=r - 1, w0=w0, equation=" + ".join(powers),
                     gains=", ".join(f"gamma_{i + 1}" for i in range(r)))
    f = written(f"adaptive_continuous_{r}", f"sigma, z, tau, {', '.join(arguments)}",
                "\n".join(body), names, doc)
    return block(f, state=STATE, output=Param("v"), check=unfit,
                 card=replace(ADAPTIVE, order=r + 1, r=r))
