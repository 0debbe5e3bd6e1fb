"""What surrounds the launch vehicle: command, perturbation, allocation, gimbal; eqs (66)-(72)."""

import math
from typing import Annotated

from ..core import Param, block
from ..core.card import Actuator, Allocation, Perturbation, Reference
from ..sources import KODE

__all__ = ["gimbal", "gimbal_to_control", "misalignment", "steps"]


@block(card=Reference(source=(KODE,)), output=Param(r"\theta_c", "rad"))
def steps(t, unit: Annotated[float, Param(
        "unit", "rad", slider=(0.0, 0.1),
        help="rad in one unit of the command; pi/180 means degrees")] = math.pi/180):
    r"""Command of steps at 2, 6 and 10 s.

    .. math::

        \theta_c = -1.2\cdot 1(t - 2) + 2.3\cdot 1(t - 6) - 1.2\cdot 1(t - 10) \ \text{deg}

    Parameters
    ----------
    t : float
        Time [s].
    unit : float
        rad in one unit of the command.

    Returns
    -------
    float
        Commanded pitch angle [rad].

    Notes
    -----
    The printed steps add up to -0.1 deg: the command does not end at zero.

    References
    ----------
    Paper eq (68).
    """
    c = 0.0
    if t >= 2.0:
        c -= 1.2
    if t >= 6.0:
        c += 2.3
    if t >= 10.0:
        c -= 1.2
    return c*unit


@block(card=Perturbation(source=(KODE,)), output=Param("f", "rad"))
def misalignment(
        t,
        f_0: Annotated[float, Param("f_0", "rad", slider=(-0.5, 0.5), help="constant part")] = 0.2,
        f_1: Annotated[float, Param("f_1", "rad", low=0.0, slider=(0.0, 0.5),
                                    help="amplitude")] = 0.1,
        omega: Annotated[float, Param(r"\omega_f", "rad/s", low=0.0, slider=(0.0, 1.0),
                                      help="frequency")] = 0.1):
    r"""Misalignment of the thrust vector, added to the command of the gimbal.

    .. math:: f = f_0 + f_1 \sin\omega_f t

    Parameters
    ----------
    t : float
        Time [s].
    f_0, f_1 : float
        Constant part and amplitude [rad].
    omega : float
        Frequency [rad/s].

    Returns
    -------
    float
        f [rad].

    Notes
    -----
    Its mean over 30 s is 0.266 rad, and any control that keeps the pitch bounded must spend about
    that much. Erratum: the paper's Table 3 shows less than half of it for every controller, so f
    was absent there or meant in degrees.

    References
    ----------
    Paper eq (72).
    """
    return f_0 + f_1*math.sin(omega*t)


@block(card=Allocation(source=(KODE,)), output=Param("u", "rad"))
def gimbal_to_control(v, G0: Annotated[float, Param(
        "G_0", "[v]/rad", high=-1e-6, slider=(-10.0, -0.1),
        help="nominal gain of u, negative like the plant's")] = -1.0):
    r"""Allocation: commanded gimbal angle from the law's output.

    .. math:: u = v/G_0

    Parameters
    ----------
    v : float
        Output of the law.
    G0 : float
        Nominal gain from u to the derivative of sigma, negative [v]/rad; -1 leaves the law's gains
        in rad.

    Returns
    -------
    float
        u [rad].

    Notes
    -----
    The gain of the plant is -l_g R/I = -0.75 1/s^2 for relative degree 2, and -0.75/tau_act for 3.

    Erratum: (66) prints u = +(k_p e + k_d e'). With the plant (62) every controller diverges with
    that sign.

    References
    ----------
    Paper eqs (66), (70).
    """
    return v/G0


@block(card=Actuator(), output=Param("u", "rad"),
       state=dict(beta_c=(0.0, Param(r"\beta_c", "rad", slider=(-0.5, 0.5),
                                     help="initial command"))))
def gimbal(u, z, tau,
           deflection: Annotated[float, Param(r"\beta_{max}", "rad", low=1e-3, slider=(0.05, 1.0),
                                              help="maximum deflection")] = 0.4,
           rate: Annotated[float, Param(r"\dot\beta_{max}", "rad/s", low=1e-3, slider=(0.05, 5.0),
                                        help="maximum rate")] = 1.0):
    r"""Actuator: gimbal command with limited deflection and rate.

    .. math:: |\beta_c| \le \beta_{max}, \qquad |\dot\beta_c| \le \dot\beta_{max}

    Parameters
    ----------
    u : float
        Wanted command [rad].
    deflection : float
        Maximum deflection [rad].
    rate : float
        Maximum rate [rad/s].

    Returns
    -------
    float
        Command that the servo receives [rad].

    Notes
    -----
    Not in the paper, whose scenario needs 0.3 rad (17 deg) against the misalignment alone; real
    gimbals reach 0.1 to 0.2 rad.
    """
    beta_c, = z
    wanted = max(-deflection, min(deflection, u))
    beta_c += max(-rate*tau, min(rate*tau, wanted - beta_c))
    return beta_c, (beta_c,)
