"""The perturbed chain of integrators, sigma^(r) = xi - v: exactly what the theorems assume."""

import math
from typing import Annotated

from ..core import Block, ClosedLoop, Param, ParameterError, block
from ..core.block import wanted
from ..core.card import Output, Perturbation, Plant
from ..core.family import family
from ..core.param import relative_degree, switch
from ..core.signal import generated, leaves, text
from ..hosmc import integrated
from ..sources import KODE
from ..surface import differenced

__all__ = ["chain", "chain_output", "chain_perturbation", "perturbed_chain"]


def _minus(s):
    return "return " + (text(s, (f"-s{q}" for q in leaves(s))) if len(s) > 1 else "-s[0]")


minus = generated("s", _minus)


@family(card=Plant(source=(KODE,)))
def chain(r: int) -> Block:
    r"""Plant: a chain of r integrators, driven at its end.

    .. math:: \dot s_0 = s_1, \quad ..., \quad \dot s_{r-1} = \xi - v

    Parameters
    ----------
    r : int
        Number of integrators, 1 to 6.

    Returns
    -------
    Block
        A plant with the states s0 = sigma, s1 = sigma', ..., all 0 at the start unless set.

    Raises
    ------
    ParameterError
        A number that is not allowed.

    Notes
    -----
    Euler steps keep the order of a law's accuracy, but not the size of the error;
    ``simulate(..., method="rk4")`` integrates the chain exactly up to r = 4.

    References
    ----------
    Paper eq (26).
    """
    r = relative_degree("chain", r, 6)
    symbols = [r"\sigma", r"\dot\sigma", r"\ddot\sigma",
               *(rf"\sigma^{{({i})}}" for i in range(3, 6))]

    @block(state={f"s{i}": (0.0, Param(symbols[i], f"[v] s^{r - i}", slider=(-10.0, 10.0)))
                  for i in range(r)})
    def integrators(x, u, d):
        r"""Chain of integrators.

        .. math:: \dot s_0 = s_1, \quad ..., \quad \dot s_{r-1} = \xi - v

        Parameters
        ----------
        x : tuple of float
            sigma and its derivatives.
        u, d : float
            v and the perturbation xi.

        Returns
        -------
        tuple of float
            Derivative of the state.

        References
        ----------
        Paper eq (26).
        """
        return (*x[1:], d - u)

    return integrators


@block(card=Output(source=(KODE,)))
def chain_output(x):
    r"""Output of the chain, with the sign that makes the error sigma.

    .. math:: y = -(\sigma, \dot\sigma, ...), \qquad e = 0 - y

    Parameters
    ----------
    x : tuple of float
        State of `chain`.

    Returns
    -------
    float or tuple of float
        y; a number where r = 1.

    References
    ----------
    Paper eq (26).
    """
    return minus(x)


@block(card=Perturbation(source=(KODE,)), output=Param(r"\xi", "[v]"))
def chain_perturbation(t,
                       xi_0: Annotated[float, Param(r"\xi_0", "[v]", slider=(-2.0, 2.0),
                                                    help="constant part")] = 0.0,
                       xi_1: Annotated[float, Param(r"\xi_1", "[v]", low=0.0, slider=(0.0, 10.0),
                                                    help="amplitude")] = 0.8,
                       omega: Annotated[float, Param(r"\omega", "rad/s", low=0.0,
                                                     slider=(0.0, 100.0), help="frequency")] = 1.2):
    r"""Perturbation of the chain.

    .. math:: \xi = \xi_0 + \xi_1\cos\omega t

    Parameters
    ----------
    t : float
        Time [s].
    xi_0, xi_1 : float
        Constant part and amplitude [v].
    omega : float
        Frequency [rad/s].

    Returns
    -------
    float
        xi [v]; its bound is \|xi_0\| + xi_1, that of its derivative omega xi_1.

    References
    ----------
    The xi of paper eq (26).
    """
    return xi_0 + xi_1*math.cos(omega*t)


def perturbed_chain(law: Block, r: int, raised: bool = False) -> ClosedLoop:
    r"""A law on its chain, from sigma = 1, all derivatives 0.

    .. math::

        \sigma^{(r)} = \xi - v, \qquad \text{or, raised,} \qquad
        \sigma^{(r)} = \xi - u, \quad \dot u = v

    Parameters
    ----------
    law : Block
        A law for relative degree `r`; it sees (sigma, ..., sigma^(r-1)), or the number sigma where
        r = 1. Twisting sees (sigma, sigma'), with sigma' as a difference from the previous sample.
    r : int
        Number of integrators, 1 to 6.
    raised : bool
        Let a law for relative degree r + 1 act on the derivative of the control, which is then
        continuous: `hosmc.integrated` follows it, and `surface.differenced` precedes it, which adds
        the derivative of sigma that the law needs.

    Returns
    -------
    ClosedLoop
        With duration 20 s, 40 s from r = 4 on, tau 1e-3 s and dt 2.5e-4 s; its error e is sigma.

    Raises
    ------
    ParameterError
        A number of integrators that is not allowed, or a law for another relative degree.
    BlockError
        A law that is not a block, such as the name of one.

    References
    ----------
    Paper eq (26). A. Levant, Int. J. Control 58 (1993) 1247, for the raised relative degree.

    Examples
    --------
    >>> simulate(perturbed_chain(smc.hosmc.quasi_continuous(3), 3)).tail_e < 1e-6
    True
    """
    law = wanted("perturbed_chain: law", law)
    r = relative_degree("perturbed_chain", r, 6)
    raised = switch("perturbed_chain", "raised", raised)
    if law.r not in (None, r + raised):
        raise ParameterError(f"perturbed_chain: r = {r}{', raised,'*raised} is not allowed; "
                             f"{law.name} is for relative degree {law.r}")
    surface = differenced(r) if raised or law.r == 1 else None
    return ClosedLoop(chain(r).with_(s0=1.0), output=chain_output, surface=surface, law=law,
                      perturbation=chain_perturbation, allocation=integrated if raised else None,
                      duration=20.0 if r < 4 else 40.0, dt=2.5e-4, tau=1e-3,
                      name=f"{law.name}, chain of {r}" + ", raised"*raised)
