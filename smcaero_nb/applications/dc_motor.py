"""DC motor with a disc on its shaft: angle and speed by armature voltage, against a load torque."""

import math
from functools import partial
from typing import Annotated

from .. import hosmc
from ..core import ClosedLoop, Param, block
from ..core.param import chosen
from ..smc1 import adaptive_smc, dual_layer_smc, quasi_smc, sign_smc
from ..smc2 import adaptive_super_twisting, adaptive_twisting, gains, super_twisting, twisting
from ..surface import itae
from .chain import fitted

__all__ = ["amplifier", "dc_motor", "load_torque", "motor", "shaft", "speed", "step", "voltage", "with_integral"]


@block(state=dict(theta=(0.0, Param(r"\theta", "rad", help="angle", slider=(-3.0, 3.0))),
                  omega=(0.0, Param(r"\omega", "rad/s", help="speed", slider=(-200.0, 200.0))),
                  current=(0.0, Param("i", "A", help="armature current"))))
def motor(x, u, d,
          R: Annotated[float, Param("R", "ohm", low=1e-3, help="terminal resistance", slider=(1.0, 20.0))] = 7.5,
          L: Annotated[float, Param("L", "H", low=1e-6, log=True, help="rotor inductance", slider=(1e-4, 1e-1))] = 1.15e-3,
          k: Annotated[float, Param("k", "N m/A", low=1e-6, help="torque and back-EMF constant", slider=(0.01, 0.1))] = 0.0422,
          J: Annotated[float, Param("J", "kg m^2", low=1e-9, log=True, help="inertia of rotor, hub and disc",
                                    slider=(2e-6, 1e-4))] = 1.83e-5,
          b: Annotated[float, Param("b", "N m s", low=0.0, help="viscous friction", slider=(0.0, 1e-4))] = 0.0):
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
        Terminal resistance [ohm], inductance [H], torque constant, which is the back-EMF constant [N m/A = V s/rad].
    J, b : float
        Inertia [kg m^2], viscous friction [N m s].

    Returns
    -------
    tuple of 3 float
        Derivative of the state.

    Notes
    -----
    The angle has relative degree 3, the speed 2; but the electrical time constant L/R is 0.15 ms, so that sampled every
    0.1 ms or more they behave as 2 and 1: the practical relative degree. The inductance is then an unmodelled actuator.

    The inertia is that of the rotor, 1.4e-6, the hub, 0.6e-6, and a disc of 0.053 kg and radius 0.0248 m, 1.63e-5 kg m^2.
    The source gives no viscous friction: 0.

    References
    ----------
    Quanser, Qube-Servo 3 User Manual, Table 2.2.
    """
    return x[1], (k*x[2] - b*x[1] - d)/J, (u - R*x[2] - k*x[1])/L


@block
def shaft(x) -> (Param(r"\theta", "rad"), Param(r"\omega", "rad/s")):
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


@block
def speed(x) -> Param(r"\omega", "rad/s"):
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


@block
def step(t, height: Annotated[float, Param("r_1", "[y]", help="where it steps to", slider=(-200.0, 200.0))] = 1.0,
         start: Annotated[float, Param("t_1", "s", low=0.0, help="when it steps", slider=(0.0, 1.0))] = 0.02
         ) -> Param("r", "[y]"):
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


@block
def load_torque(t, T_0: Annotated[float, Param("T_0", "N m", help="constant part", slider=(-0.02, 0.02))] = 0.004,
                T_1: Annotated[float, Param("T_1", "N m", low=0.0, help="amplitude", slider=(0.0, 0.02))] = 0.004,
                omega: Annotated[float, Param(r"\omega_T", "rad/s", low=0.0, help="frequency", slider=(0.0, 100.0))] = 20.0
                ) -> Param("T", "N m"):
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


@block(state=dict(integral=(0.0, Param(r"\int e", "[e] s", help="integral to start with"))))
def with_integral(e, z, tau):
    r"""Sliding variable that raises the relative degree from 1 to 2: the integral of the error, and the error.

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
    Not in the paper. The integral is to end at zero, so the error has to overshoot.
    """
    integral, = z
    return (integral, e), (integral + tau*e,)


@block
def voltage(v, G0: Annotated[float, Param("G_0", "[v]/V", low=1e-3, help="nominal gain k/(J R)", slider=(100.0, 1000.0))] = 307.5
            ) -> Param("u", "V"):
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


@block
def amplifier(u, limit: Annotated[float, Param("u_{max}", "V", low=0.1, help="greatest voltage", slider=(1.0, 24.0))] = 10.0
              ) -> Param("u", "V"):
    r"""Actuator: voltage within the limits of the amplifier.

    .. math:: |u| \le u_{max}

    Parameters
    ----------
    u : float
        Wanted voltage [V].
    limit : float
        Greatest voltage [V].

    Returns
    -------
    float
        Voltage at the motor [V].

    References
    ----------
    Quanser, Qube-Servo 3 User Manual, Table 2.2: recommended range 10 V, greatest 15 V.
    """
    return max(-limit, min(limit, u))


_surface = partial(itae, 2, 0.4, integral=False)  # e' + 25 e
_none = partial(itae, 1, integral=False)  # e
_super_twisting = super_twisting.with_(lam=150.0, beta=1.1e4)
_twisting = twisting.with_(**gains(2e4).twisting, v_M=3000.0)
_adaptive_super_twisting = adaptive_super_twisting.with_(gamma=1e4, mu=0.01, lam_min=10.0, eps=30.0, eta=1e3, lam=100.0)
_adaptive = hosmc.adaptive_continuous(2).with_(gamma_1=625.0, gamma_2=50.0, alpha_r=0.85, l_0=500.0, eps=300.0, r_0=2e5,
                                               gamma=0.0, delta_0=200.0, tau_f=2e-3, L=5e3)
_adaptive_smc = adaptive_smc.with_(gamma=2e4, delta=0.6, rho=100.0)
_dual_layer = dual_layer_smc.with_(eta=50.0, eps=300.0, delta_0=90.0, r_0=5e4, gamma=0.0, tau_f=2e-3, k=500.0)
_adaptive_twisting = adaptive_twisting.with_(gamma=1e6, mu=0.1, c=1e-6, v_M=3000.0, alpha_min=1e3, eta=1e5, alpha_1=2e4)
_quasi_continuous, _levant, _nested = hosmc.quasi_continuous(2), hosmc.quasi_continuous(2, "levant2005"), hosmc.nested(2)
#: {output: {law: stages}}; v is an angular acceleration, and 10 V are 3075 rad/s^2.
DC_MOTOR = {
    "angle": {
        "sign_smc": dict(surface=_surface(), law=sign_smc.with_(rho=2000.0)),
        "quasi_smc": dict(surface=_surface(), law=quasi_smc.with_(rho=2000.0, eps=0.5)),
        "adaptive_smc": dict(surface=_surface(), law=_adaptive_smc),
        "dual_layer_smc": dict(surface=_surface(), law=_dual_layer),
        "super_twisting": dict(surface=_surface(), law=_super_twisting),
        "twisting": dict(surface=_surface(derivative="difference"), law=_twisting),
        "adaptive_super_twisting": dict(surface=_surface(), law=_adaptive_super_twisting),
        "adaptive_twisting": dict(surface=_surface(derivative="difference"), law=_adaptive_twisting),
        "quasi_continuous": dict(law=_quasi_continuous.with_(L=800.0)),
        "levant2005": dict(law=_levant.with_(L=800.0)),
        "nested": dict(law=_nested.with_(L=750.0)),
        "adaptive_continuous": dict(law=_adaptive),
    },
    "speed": {
        "sign_smc": dict(law=sign_smc.with_(rho=2200.0)),
        "quasi_smc": dict(law=quasi_smc.with_(rho=2200.0, eps=0.5)),
        "adaptive_smc": dict(law=_adaptive_smc),
        "dual_layer_smc": dict(law=_dual_layer),
        "super_twisting": dict(law=super_twisting.with_(lam=210.0, beta=2.2e4)),
        "twisting": dict(surface=_none(derivative="difference"), law=_twisting),
        "adaptive_super_twisting": dict(law=_adaptive_super_twisting),
        "adaptive_twisting": dict(surface=_none(derivative="difference"), law=_adaptive_twisting),
        "quasi_continuous": dict(surface=with_integral, law=_quasi_continuous.with_(alpha=2.0, L=1500.0)),
        "levant2005": dict(surface=with_integral, law=_levant.with_(alpha=1.7, L=1700.0)),
        "nested": dict(surface=with_integral, law=_nested.with_(alpha=1.5, L=1700.0)),
        "adaptive_continuous": dict(surface=with_integral, law=_adaptive),
    },
}
HEIGHT = {"angle": 1.0, "speed": 80.0}


def dc_motor(law="super_twisting", output="angle"):
    r"""A laboratory motor with a disc, its voltage limited to 10 V, against a load of up to 40 % of its nominal torque.

    .. math:: \sigma = \dot e + 25\,e \text{ or } (e, \dot e) \text{ of the angle}, \quad
        \sigma = e \text{ or } \Big(\int e\,dt, e\Big) \text{ of the speed}, \qquad u = v/G_0, \quad |u| \le u_{max}

    Parameters
    ----------
    law : str or Block
        ``"sign_smc"``, ``"quasi_smc"``, ``"adaptive_smc"``, ``"dual_layer_smc"``, ``"super_twisting"``, ``"twisting"``,
        ``"adaptive_super_twisting"``, ``"adaptive_twisting"``, ``"quasi_continuous"``, ``"levant2005"``, ``"nested"`` or
        ``"adaptive_continuous"``; or a law of relative degree 1 or 2 of your own.
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
    The laws take the current to follow the voltage at once, so that the angle has relative degree 2 and the speed 1. It
    lags by 0.15 ms, about one sample, which is what the discontinuous laws chatter with.

    Angle: laws of relative degree 1 act on sigma = e' + 25 e. Speed: they act on e itself, and laws of relative degree 2 on
    the integral of e and e, whose overshoot is the price of not measuring the acceleration.

    References
    ----------
    Quanser, Qube-Servo 3 User Manual, Table 2.2. The sliding variable: paper eq (9).

    Examples
    --------
    >>> simulate(dc_motor("super_twisting")).tail_e < 1e-4
    True
    """
    chosen("dc_motor", "output", output, DC_MOTOR)
    stages = fitted("dc_motor", law, DC_MOTOR[output], *((_surface, None) if output == "angle" else (_none, with_integral)))
    return ClosedLoop(motor, output=shaft if output == "angle" else speed, reference=step.with_(height=HEIGHT[output]),
                      perturbation=load_torque, allocation=voltage, actuator=amplifier, duration=1.0, dt=1e-5, tau=1e-4,
                      name=f"{stages['law'].name}, motor's {output}", **stages)
