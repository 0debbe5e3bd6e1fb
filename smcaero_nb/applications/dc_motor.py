"""DC motor with a disc on its shaft: angle and speed by armature voltage, against a load torque."""

import math
from functools import partial
from typing import Annotated

from .. import hosmc
from ..core import Block, ClosedLoop, Param, block
from ..core.card import Actuator, Allocation, Output, Perturbation, Plant, Reference, Surface
from ..core.param import chosen
from ..core.scenario import Scenario
from ..smc1 import adaptive_smc, dual_layer_smc, quasi_smc, sign_smc
from ..smc2 import adaptive_super_twisting, adaptive_twisting, gains, super_twisting, twisting
from ..sources import KODE, QUANSER
from ..surface import itae

__all__ = ["SCENARIOS", "amplifier", "dc_motor", "load_torque", "motor", "shaft", "speed", "step",
           "voltage", "with_integral"]


@block(card=Plant(source=(QUANSER,)),
       state=dict(theta=(0.0, Param(r"\theta", "rad", slider=(-3.0, 3.0), help="angle")),
                  omega=(0.0, Param(r"\omega", "rad/s", slider=(-200.0, 200.0), help="speed")),
                  current=(0.0, Param("i", "A", help="armature current"))))
def motor(x, u, d,
          R: Annotated[float, Param("R", "ohm", low=1e-3, slider=(1.0, 20.0),
                                    help="terminal resistance")] = 7.5,
          L: Annotated[float, Param("L", "H", low=1e-6, log=True, slider=(1e-4, 1e-1),
                                    help="rotor inductance")] = 1.15e-3,
          k: Annotated[float, Param("k", "N m/A", low=1e-6, slider=(0.01, 0.1),
                                    help="torque and back-EMF constant")] = 0.0422,
          J: Annotated[float, Param("J", "kg m^2", low=1e-9, log=True, slider=(2e-6, 1e-4),
                                    help="inertia of rotor, hub and disc")] = 1.83e-5,
          b: Annotated[float, Param("b", "N m s", low=0.0, slider=(0.0, 1e-4),
                                    help="viscous friction")] = 0.0):
    r"""DC motor driven by its armature voltage.

    .. math::

        \dot\theta &= \omega, \qquad J\dot\omega = k\,i - b\,\omega - T \\
        L\,\frac{di}{dt} &= u - R\,i - k\,\omega

    Parameters
    ----------
    x : tuple of 3 float
        Angle, speed, armature current [rad, rad/s, A].
    u, d : float
        Armature voltage [V], load torque T [N m].
    R, L, k : float
        Terminal resistance [ohm], inductance [H], torque and back-EMF constant [N m/A = V s/rad].
    J, b : float
        Inertia [kg m^2], viscous friction [N m s].

    Returns
    -------
    tuple of 3 float
        Derivative of the state.

    Notes
    -----
    The angle has relative degree 3, the speed 2; but the electrical time constant L/R is 0.15 ms,
    so that, sampled every 0.1 ms or more, they behave like 2 and 1: the practical relative degree.
    The inductance is then an unmodelled actuator.

    The inertia is that of the rotor, 1.4e-6, the hub, 0.6e-6, and a disc of 0.053 kg and radius
    0.0248 m, 1.63e-5 kg m^2. The source gives no viscous friction: 0.

    References
    ----------
    Quanser, Qube-Servo 3 User Manual, Table 2.2.
    """
    return x[1], (k*x[2] - b*x[1] - d)/J, (u - R*x[2] - k*x[1])/L


@block(card=Output(), output=(Param(r"\theta", "rad"), Param(r"\omega", "rad/s")))
def shaft(x):
    r"""Angle and speed of the shaft.

    .. math:: y = (\theta, \omega)

    Parameters
    ----------
    x : tuple of 3 float
        State of `motor`.

    Returns
    -------
    tuple of 2 float
        [rad], [rad/s].

    Notes
    -----
    Not in the paper.
    """
    return x[0], x[1]


@block(card=Output(), output=Param(r"\omega", "rad/s"))
def speed(x):
    r"""Speed of the shaft.

    .. math:: y = \omega

    Parameters
    ----------
    x : tuple of 3 float
        State of `motor`.

    Returns
    -------
    float
        [rad/s].

    Notes
    -----
    Not in the paper.
    """
    return x[1]


@block(card=Reference(), output=Param("r", "[y]"))
def step(t,
         height: Annotated[float, Param("r_1", "[y]", slider=(-200.0, 200.0),
                                        help="value after the step")] = 1.0,
         start: Annotated[float, Param("t_1", "s", low=0.0, slider=(0.0, 1.0),
                                       help="time of the step")] = 0.02):
    r"""Command: a step.

    .. math:: r = r_1 \text{ for } t \ge t_1, \text{ else } 0

    Parameters
    ----------
    t : float
        Time [s].
    height : float
        Value after the step [rad] or [rad/s].
    start : float
        Time of the step [s].

    Returns
    -------
    float
        Command.

    Notes
    -----
    Not in the paper.
    """
    return height if t >= start else 0.0


@block(card=Perturbation(), output=Param("T", "N m"))
def load_torque(t,
                T_0: Annotated[float, Param("T_0", "N m", slider=(-0.02, 0.02),
                                            help="constant part")] = 0.004,
                T_1: Annotated[float, Param("T_1", "N m", low=0.0, slider=(0.0, 0.02),
                                            help="amplitude")] = 0.004,
                omega: Annotated[float, Param(r"\omega_T", "rad/s", low=0.0, slider=(0.0, 100.0),
                                              help="frequency")] = 20.0):
    r"""Load torque.

    .. math:: T = T_0 + T_1\sin\omega_T t

    Parameters
    ----------
    t : float
        Time [s].
    T_0, T_1 : float
        Constant part and amplitude [N m]; the motor's nominal torque is 0.0204 N m.
    omega : float
        Frequency [rad/s].

    Returns
    -------
    float
        T [N m].

    Notes
    -----
    Not in the paper.
    """
    return T_0 + T_1*math.sin(omega*t)


@block(card=Surface(),
       state=dict(integral=(0.0, Param(r"\int e", "[e] s", help="initial integral"))))
def with_integral(e, z, tau):
    r"""Sliding variable that raises the relative degree from 1 to 2: integral of the error, error.

    .. math:: (\sigma, \dot\sigma) = \Big(\int e\,dt, e\Big)

    Parameters
    ----------
    e : float
        Error.

    Returns
    -------
    tuple of 2 float
        sigma and its derivative, for a law of relative degree 2.

    Notes
    -----
    Not in the paper. The integral has to end at zero, so the error overshoots.
    """
    integral, = z
    return (integral, e), (integral + tau*e,)


@block(card=Allocation(source=(KODE,)), output=Param("u", "V"))
def voltage(v, G0: Annotated[float, Param("G_0", "[v]/V", low=1e-3, slider=(100.0, 1000.0),
                                          help="nominal gain k/(J R)")] = 307.5):
    r"""Allocation: armature voltage from the law's output.

    .. math:: u = v/G_0, \qquad G_0 = k/(J R)

    Parameters
    ----------
    v : float
        Output of the law: an angular acceleration [rad/s^2].
    G0 : float
        Nominal gain [rad/s^2/V].

    Returns
    -------
    float
        u [V].

    References
    ----------
    Paper eq (26).
    """
    return v/G0


@block(card=Actuator(source=(QUANSER,)), output=Param("u", "V"))
def amplifier(u, limit: Annotated[float, Param("u_{max}", "V", low=0.1, slider=(1.0, 24.0),
                                               help="maximum voltage")] = 10.0):
    r"""Actuator: voltage within the limits of the amplifier.

    .. math:: |u| \le u_{max}

    Parameters
    ----------
    u : float
        Wanted voltage [V].
    limit : float
        Maximum voltage [V].

    Returns
    -------
    float
        Voltage at the motor [V].

    References
    ----------
    Quanser, Qube-Servo 3 User Manual, Table 2.2: recommended range 10 V, maximum 15 V.
    """
    return max(-limit, min(limit, u))


_surface = partial(itae, 2, 0.4, integral=False)  # e' + 25 e
_angle = dict(  # v is an angular acceleration, and 10 V are 3075 rad/s^2
    sign_smc=sign_smc.with_(rho=2000.0), quasi_smc=quasi_smc.with_(rho=2000.0, eps=0.5),
    adaptive_smc=adaptive_smc.with_(gamma=2e4, delta=0.6, rho=100.0),
    dual_layer_smc=dual_layer_smc.with_(eta=50.0, eps=300.0, delta_0=90.0, r_0=5e4, gamma=0.0,
                                        tau_f=2e-3, k=500.0),
    super_twisting=super_twisting.with_(lam=150.0, beta=1.1e4),
    twisting=twisting.with_(**gains(2e4).twisting, v_M=3000.0),
    adaptive_super_twisting=adaptive_super_twisting.with_(gamma=1e4, mu=0.01, lam_min=10.0,
                                                          eps=30.0, eta=1e3, lam=100.0),
    adaptive_twisting=adaptive_twisting.with_(gamma=1e6, mu=0.1, c=1e-6, v_M=3000.0, alpha_min=1e3,
                                              eta=1e5, alpha_1=2e4),
    quasi_continuous=hosmc.quasi_continuous(2).with_(L=800.0),
    levant2005=hosmc.quasi_continuous(2, "levant2005").with_(L=800.0),
    nested=hosmc.nested(2).with_(L=750.0),
    adaptive_continuous=hosmc.adaptive_continuous(2).with_(
        gamma_1=625.0, gamma_2=50.0, alpha_r=0.85, l_0=500.0, eps=300.0, r_0=2e5, gamma=0.0,
        delta_0=200.0, tau_f=2e-3, L=5e3))
_speed = dict(
    _angle, sign_smc=sign_smc.with_(rho=2200.0), quasi_smc=quasi_smc.with_(rho=2200.0, eps=0.5),
    super_twisting=super_twisting.with_(lam=210.0, beta=2.2e4),
    quasi_continuous=hosmc.quasi_continuous(2).with_(alpha=2.0, L=1500.0),
    levant2005=hosmc.quasi_continuous(2, "levant2005").with_(alpha=2.0, L=1450.0),
    nested=hosmc.nested(2).with_(alpha=1.6, L=1600.0))


def _scenario(what, output, height, laws, around):
    task = ClosedLoop(motor, output=output, reference=step.with_(height=height),
                      perturbation=load_torque, allocation=voltage, actuator=amplifier,
                      duration=1.0, dt=1e-5, tau=1e-4, name=f"motor's {what}")
    return Scenario("dc_motor", task, around=around,
                    designs={(name, "recommended"): dict(law=law) for name, law in laws.items()},
                    sources=("Quanser, Qube-Servo 3 User Manual, Table 2.2.",))


#: {output: scenario}: laws of relative degree 1 act on e' + 25 e of the angle, on e of the speed.
SCENARIOS = {
    "angle": _scenario("angle", shaft, 1.0, _angle, {
        None: dict(surface=_surface()), 1: dict(surface=_surface(derivative="difference")), 2: {}}),
    "speed": _scenario("speed", speed, 80.0, _speed, {
        None: {}, 1: dict(surface=itae(1, integral=False, derivative="difference")),
        2: dict(surface=with_integral)}),
}


def dc_motor(law: str | Block = "super_twisting", output: str = "angle") -> ClosedLoop:
    r"""A laboratory motor with a disc, at most 10 V, loaded with up to 40 % of its nominal torque.

    .. math::

        \sigma = \dot e + 25\,e \text{ or } (e, \dot e) \text{ of the angle}, \quad
        \sigma = e \text{ or } \Big(\int e\,dt, e\Big) \text{ of the speed}, \qquad
        u = v/G_0, \quad |u| \le u_{max}

    Parameters
    ----------
    law : str or Block
        ``"sign_smc"``, ``"quasi_smc"``, ``"adaptive_smc"``, ``"dual_layer_smc"``,
        ``"super_twisting"``, ``"twisting"``, ``"adaptive_super_twisting"``,
        ``"adaptive_twisting"``, ``"quasi_continuous"``, ``"levant2005"``, ``"nested"`` or
        ``"adaptive_continuous"``; or your own law of relative degree 1 or 2.
    output : str
        ``"angle"``: a step of 1 rad; ``"speed"``: a step to 80 rad/s.

    Returns
    -------
    ClosedLoop
        With duration 1 s, tau 1e-4 s and dt 1e-5 s.

    Raises
    ------
    ParameterError
        An unknown law or output, or a law for another relative degree.

    Notes
    -----
    The laws assume that the current follows the voltage at once, so that the angle has relative
    degree 2 and the speed 1. It lags by 0.15 ms, about one sample: so discontinuous laws chatter.

    Angle: laws of relative degree 1 act on sigma = e' + 25 e. Speed: they act on e itself, and laws
    of relative degree 2 on the integral of e and e; not measuring the acceleration costs overshoot.

    References
    ----------
    Quanser, Qube-Servo 3 User Manual, Table 2.2. The sliding variable: paper eq (9).

    Examples
    --------
    >>> simulate(dc_motor("super_twisting")).tail_e < 1e-4
    True
    """
    return SCENARIOS[chosen("dc_motor", "output", output, SCENARIOS)].loop(law)
