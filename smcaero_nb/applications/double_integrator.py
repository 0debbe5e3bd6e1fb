"""Double integrator with a matched perturbation: a mass that is pushed."""

import math
from functools import partial
from typing import Annotated

from .. import hosmc
from ..core import Block, ClosedLoop, Param, block
from ..core.card import Output, Perturbation, Plant
from ..core.scenario import Scenario
from ..smc1 import adaptive_smc, dual_layer_smc, quasi_smc, sign_smc
from ..smc2 import adaptive_super_twisting, adaptive_twisting, gains, super_twisting, twisting
from ..sources import SHTESSEL_2014
from ..surface import itae

__all__ = ["SCENARIO", "double_integrator", "mass", "position", "push"]


@block(card=Plant(source=(SHTESSEL_2014,)),
       state=dict(s=(1.0, Param("s(0)", "m", slider=(-5.0, 5.0), help="initial position")),
                  v=(0.0, Param(r"\dot s(0)", "m/s", slider=(-5.0, 5.0),
                                help="initial velocity"))))
def mass(x, u, d, m: Annotated[float, Param("m", "kg", low=1e-3, slider=(0.1, 10.0),
                                            help="mass; the laws assume 1 kg")] = 1.0):
    r"""Mass moved by a force.

    .. math:: m\,\ddot s = u + d

    Parameters
    ----------
    x : tuple of 2 float
        Position and velocity [m, m/s].
    u, d : float
        Control and perturbation, both forces [N].
    m : float
        Mass [kg].

    Returns
    -------
    tuple of 2 float
        Derivative of the state.

    Notes
    -----
    Not in the paper. With e = -s the laws meet :math:`\ddot e = \xi - u`, in which an error of the
    mass counts as perturbation.
    """
    return x[1], (u + d)/m


@block(card=Output(), output=(Param("s", "m"), Param(r"\dot s", "m/s")))
def position(x):
    r"""Position and velocity.

    .. math:: y = (s, \dot s)

    Parameters
    ----------
    x : tuple of 2 float
        State of `mass`.

    Returns
    -------
    tuple of 2 float
        [m], [m/s].

    Notes
    -----
    Not in the paper.
    """
    return x[0], x[1]


@block(card=Perturbation(), output=Param("d", "N"))
def push(t,
         d_0: Annotated[float, Param("d_0", "N", slider=(-2.0, 2.0), help="constant part")] = 0.2,
         d_1: Annotated[float, Param("d_1", "N", low=0.0, slider=(0.0, 2.0),
                                     help="amplitude")] = 0.5,
         omega: Annotated[float, Param(r"\omega", "rad/s", low=0.0, slider=(0.0, 20.0),
                                       help="frequency")] = 2.0):
    r"""Force that perturbs the mass.

    .. math:: d = d_0 + d_1\sin\omega t

    Parameters
    ----------
    t : float
        Time [s].
    d_0, d_1 : float
        Constant part and amplitude [N].
    omega : float
        Frequency [rad/s].

    Returns
    -------
    float
        d [N].

    Notes
    -----
    Not in the paper.
    """
    return d_0 + d_1*math.sin(omega*t)


_surface = partial(itae, 2, 4.0, integral=False)  # e' + 2.5 e
_laws = dict(
    sign_smc=sign_smc.with_(rho=3.0), quasi_smc=quasi_smc.with_(rho=3.0, eps=0.05),
    adaptive_smc=adaptive_smc, dual_layer_smc=dual_layer_smc,
    super_twisting=super_twisting.with_(lam=3.0, beta=4.4),
    twisting=twisting.with_(**gains(20.0).twisting, v_M=6.0),
    adaptive_super_twisting=adaptive_super_twisting, adaptive_twisting=adaptive_twisting,
    quasi_continuous=hosmc.quasi_continuous(2), levant2005=hosmc.quasi_continuous(2, "levant2005"),
    nested=hosmc.nested(2), adaptive_continuous=hosmc.adaptive_continuous(2))
#: Laws of relative degree 1 act on a sliding variable, those of relative degree 2 on (e, e').
SCENARIO = Scenario(
    "double_integrator",
    ClosedLoop(mass, output=position, perturbation=push, duration=8.0, dt=1e-4, tau=1e-3,
               name="double integrator"),
    designs={(name, "recommended"): dict(law=law) for name, law in _laws.items()},
    around={None: dict(surface=_surface()), 1: dict(surface=_surface(derivative="difference")),
            2: {}},
    sources=("Y. Shtessel, C. Edwards, L. Fridman and A. Levant, Sliding Mode Control and "
             "Observation, Birkhauser, 2014, chapter 1.",))


def double_integrator(law: str | Block = "super_twisting") -> ClosedLoop:
    r"""A mass of 1 kg, brought to rest at 0 from 1 m away, against a force of up to 0.7 N.

    .. math::

        m\,\ddot s = u + d, \qquad \sigma = \dot e + 2.5\,e \text{ or } (e, \dot e), \qquad u = v

    Parameters
    ----------
    law : str or Block
        ``"sign_smc"``, ``"quasi_smc"``, ``"adaptive_smc"``, ``"dual_layer_smc"``,
        ``"super_twisting"``, ``"twisting"``, ``"adaptive_super_twisting"``,
        ``"adaptive_twisting"``, ``"quasi_continuous"``, ``"levant2005"``, ``"nested"`` or
        ``"adaptive_continuous"``; or your own law of relative degree 1 or 2.

    Returns
    -------
    ClosedLoop
        With duration 8 s, tau 1e-3 s and dt 1e-4 s.

    Raises
    ------
    ParameterError
        An unknown law, or one for another relative degree.

    Notes
    -----
    A first- or second-order law makes sigma = e' + 2.5 e zero, and e then decays exponentially; a
    law of relative degree 2 brings e and e' to zero in finite time, without a surface.

    References
    ----------
    The textbook example of sliding mode control: Y. Shtessel, C. Edwards, L. Fridman and A.
    Levant, Sliding Mode Control and Observation, Birkhauser, 2014, chapter 1. The sliding variable:
    paper eq (9).

    Examples
    --------
    >>> simulate(double_integrator("quasi_continuous")).tail_e < 1e-4
    True
    """
    return SCENARIO.loop(law)
