"""Resource Prospector Lander in its vertical plane and its commands: eqs (46), (47), (55), (56)."""

import math
from typing import Annotated

from ..core import Param, block
from ..core.card import Output, Part, Perturbation, Plant, Reference, Stop
from ..sources import KODE

__all__ = ["altitude", "attitude_and_altitude", "command", "governed_command", "lander",
           "left_right", "perturbations"]

Gravity = Annotated[float, Param("g_m", "m/s^2", low=0.0, slider=(0.0, 4.0),
                                 help="gravity of the Moon")]
Mass = Annotated[float, Param("m", "kg", low=1.0, slider=(500.0, 2000.0),
                              help="mass; the control assumes 1000 kg")]
Inertia = Annotated[float, Param("J_{yy}", "kg m^2", low=1.0, slider=(100.0, 1000.0),
                                 help="pitch inertia; the control assumes 300 kg m^2")]
Arm = Annotated[float, Param("l_a", "m", low=0.0, slider=(0.5, 5.0),
                             help="arm of the attitude thrusters; the control assumes 2.8 m")]
Offset = Annotated[float, Param(
    r"\epsilon_d", "m", slider=(-0.03, 0.03),
    help="offset of the centre of mass from the axis of the descent thrust")]
Share = Annotated[float, Param(r"\eta_a", "1", low=0.0, high=2.0,
                               help="effectiveness of the attitude thrusters: 1 as designed")]
Stuck = Annotated[float, Param("u_s", "N", slider=(-15.0, 15.0),
                               help="thrust of an attitude thruster stuck on")]
Left = Annotated[int, Param("n_l", low=0, high=6,
                            help="number of the six descent thrusters on the left that work")]
Right = Annotated[int, Param("n_r", low=0, high=6,
                             help="number of the six descent thrusters on the right that work")]
ArmDescent = Annotated[float, Param(
    "l_d", "m", low=0.0, slider=(0.0, 0.1),
    help="arm of the descent thrusters, which matters if more work on one side")]


@block(card=Part(source=(KODE,)), output=(Param("u_l", "N"), Param("u_r", "N")))
def left_right(u):
    r"""Allocate the descent thrust to the two sides of the lander.

    .. math:: u_{d\,left} = u_{d\,right} = u_d/2

    Parameters
    ----------
    u : float
        Descent thrust u_d [N].

    Returns
    -------
    tuple of 2 float
        Thrust of the left and of the right side [N].

    References
    ----------
    Paper eq (47).
    """
    return 0.5*u, 0.5*u


def upright(values):
    """The condition that the lander starts with its thrust pointing up."""
    if math.sin(values["theta"]) <= 1e-9:  # pi in float64 is a little less
        return (f"theta = {values['theta']:g} rad is not allowed at the start; sin(theta) must be "
                f"larger than 0, as from 0 to {math.pi:.4g} rad, pi/2 being upright, or the thrust "
                f"pushes the lander down")


@block(card=Plant(source=(KODE,)), check=upright, state=dict(
    theta=(1.6, Param(r"\theta(0)", "rad", slider=(0.5, 2.6),
                      help="initial pitch; pi/2 is upright")),
    dtheta=(0.1, Param(r"\dot\theta(0)", "rad/s", slider=(-0.5, 0.5), help="initial pitch rate")),
    altitude=(6500.0, Param("x(0)", "m", slider=(5000.0, 7000.0), help="initial altitude")),
    velocity=(-10.0, Param(r"\dot x(0)", "m/s", slider=(-50.0, 50.0),
                           help="initial vertical velocity"))))
def lander(x, u, d, m: Mass = 1000.0, J: Inertia = 300.0, l_a: Arm = 2.8, g_m: Gravity = 1.6,
           offset: Offset = 0.0, effectiveness: Share = 1.0, stuck: Stuck = 0.0, left: Left = 6,
           right: Right = 6, l_d: ArmDescent = 0.0):
    r"""Lander in powered descent: pitch and altitude.

    .. math::

        J_{yy}\ddot\theta &= l_a (\eta_a u_a + u_s) + (\epsilon_d - l_d)\,u_l
        + (\epsilon_d + l_d)\,u_r + J_{yy}\varphi_a \\
        m\ddot x &= \sin\theta\,(\eta_a u_a + u_s + u_l + u_r) - m g_m + m\varphi_d, \qquad
        u_l = \tfrac{n_l}{6}\tfrac{u_d}{2}, \quad u_r = \tfrac{n_r}{6}\tfrac{u_d}{2}

    Parameters
    ----------
    x : tuple of 4 float
        Pitch, pitch rate, altitude, vertical velocity [rad, rad/s, m, m/s].
    u : tuple of 2 float
        Attitude and descent thrust u_a, u_d [N].
    d : tuple of 2 float
        Perturbations [rad/s^2, m/s^2].
    m, J, l_a, g_m : float
        Mass [kg], pitch inertia [kg m^2], arm of the attitude thrusters [m], gravity [m/s^2].
    offset : float
        Offset of the centre of mass from the axis of the descent thrust, which then turns the
        lander [m].
    effectiveness : float
        Share of the commanded attitude thrust that is delivered [1].
    stuck : float
        Attitude thruster that fires all the time [N].
    left, right : int
        Descent thrusters that work, of six on each side.
    l_d : float
        Arm of the descent thrusters [m]; the paper gives none, and 0 leaves out the torque of
        unequal sides.

    Returns
    -------
    tuple of 4 float
        Derivative of the state.

    Raises
    ------
    ParameterError
        An initial pitch at which the thrust does not point up, sin(theta) <= 0.

    Notes
    -----
    Attitude: 15 N give 0.14 rad/s^2. With an arm of 1 m the torque of a single descent thruster,
    233 N, would be five times what the attitude thrusters can hold.

    Errata: the paper gives J_yy in kg m/s^2 and phi_d in rad/s^2; they are kg m^2 and m/s^2. Its B
    has no failures: offset, effectiveness, stuck, left, right and l_d are this kit's.

    References
    ----------
    Paper eqs (46), (47).
    """
    attitude = effectiveness*u[0] + stuck
    half_l, half_r = left_right(u[1])
    u_l, u_r = left*half_l/6.0, right*half_r/6.0
    return (x[1], (l_a*attitude + (offset - l_d)*u_l + (offset + l_d)*u_r)/J + d[0],
            x[3], math.sin(x[0])*(attitude + u_l + u_r)/m - g_m + d[1])


@block(card=Output(source=(KODE,)),
       output=((Param(r"\theta", "rad"), Param(r"\dot\theta", "rad/s")),
               (Param("x", "m", low=-1e6, high=1e6), Param(r"\dot x", "m/s"))))
def attitude_and_altitude(x):
    r"""Attitude and altitude, each with its rate.

    .. math:: y = \big((\theta, \dot\theta), (x, \dot x)\big)

    Parameters
    ----------
    x : tuple of 4 float
        State of `lander`.

    Returns
    -------
    tuple of two tuples of 2 float
        [rad, rad/s], [m, m/s]. The vector relative degree is (2, 2).

    References
    ----------
    Paper eq (46).
    """
    return (x[0], x[1]), (x[2], x[3])


@block(card=Stop(), output=Param("x", "m"))
def altitude(x):
    r"""Remaining altitude, for the stage `stop`: the run ends at touchdown.

    .. math:: x \le 0

    Parameters
    ----------
    x : tuple of 4 float
        State of `lander`.

    Returns
    -------
    float
        Altitude [m].

    Notes
    -----
    Not in the paper, which flies on to T = 240 s.
    """
    return x[2]


Printed = Annotated[bool, Param(
    "printed", help="coefficients as the paper rounds them: a crash, even if followed exactly")]


@block(card=Reference(source=(KODE,)))
def command(t, printed: Printed = False):
    r"""Commands: upright, and a cubic descent from 6000 m at -10 m/s to rest on the ground.

    .. math:: \theta_c = \frac{\pi}{2}, \qquad x_c = a t^3 + b t^2 - 10 t + 6000, \qquad T = 240

    Parameters
    ----------
    t : float
        Time [s].
    printed : bool
        Take the paper's a = 6.9e-4, b = -0.23 instead of a = 1/1440, b = -11/48.

    Returns
    -------
    tuple of two tuples of 2 float
        Pitch and its rate [rad, rad/s], altitude and vertical velocity [m, m/s].

    Notes
    -----
    Erratum: the printed coefficients are those of the exact cubic rounded to two digits. They reach
    the ground after 221.4 s at -10.4 m/s, and are 109 m below it at T.

    References
    ----------
    Paper eq (55).
    """
    a, b = (6.9e-4, -0.23) if printed else (1.0/1440.0, -11.0/48.0)
    return (0.5*math.pi, 0.0), (((a*t + b)*t - 10.0)*t + 6000.0, (3.0*a*t + 2.0*b)*t - 10.0)


@block(card=Reference(source=(KODE,)))
def governed_command(t, printed: Printed = False,
                     T_r: Annotated[float, Param(
                         "T_r", "s", low=1.0, slider=(10.0, 120.0),
                         help="extension: time to blend into the descent")] = 60.0,
                     start: Annotated[float, Param(
                         "x_0", "m", slider=(5000.0, 7000.0),
                         help="extension: altitude to blend in from")] = 6500.0,
                     governed: Annotated[bool, Param(
                         "governor extension",
                         help="extension: blend in; off: `command`")] = True):
    r"""Extension, command governor: `command`, blended in from the altitude at the start.

    .. math::

        r_x = x_c + (x_0 - 6000)\,(1 - 10 s^3 + 15 s^4 - 6 s^5), \qquad s = \min(t/T_r, 1)

    Parameters
    ----------
    t : float
        Time [s].
    printed : bool
        As in `command`.
    T_r : float
        Time of the blend [s].
    start : float
        Altitude at t = 0 [m].
    governed : bool
        Off: `command` as it is.

    Returns
    -------
    tuple of two tuples of 2 float
        As `command`.

    Notes
    -----
    Not in the paper: an extension. From 500 m away the sliding variable (49) asks for 2000 m/s^2;
    with this command it starts near 0, if x_0 is where the lander starts: it does not follow
    ``plant__altitude``, and an x_0 100 m below or 300 m above the lander leads to a crash. The
    error e is then the distance from the governed command.
    """
    pitch, (x, v) = command(t, printed)
    s, height = min(t/T_r, 1.0), start - 6000.0 if governed else 0.0
    return pitch, (x + height*(1.0 - s*s*s*(10.0 - 15.0*s + 6.0*s*s)),
                   v - 30.0*height*s*s*(1.0 - s)*(1.0 - s)/T_r)


@block(card=Perturbation(source=(KODE,)),
       output=(Param(r"\varphi_a", "rad/s^2"), Param(r"\varphi_d", "m/s^2")))
def perturbations(t,
                  phi_a: Annotated[float, Param(r"\varphi_a", "rad/s^2", low=0.0, slider=(0.0, 0.2),
                                                help="amplitude, attitude")] = 0.06,
                  phi_d: Annotated[float, Param(r"\varphi_d", "m/s^2", low=0.0, slider=(0.0, 2.0),
                                                help="amplitude, descent")] = 0.5,
                  omega: Annotated[float, Param(r"\omega_\varphi", "rad/s", low=0.0,
                                                slider=(0.0, 2.0), help="frequency")] = 0.2):
    r"""Perturbations of pitch and altitude.

    .. math:: \varphi_a = 0.06\sin 0.2t, \qquad \varphi_d = 0.5\sin 0.2t

    Parameters
    ----------
    t : float
        Time [s].
    phi_a, phi_d : float
        Amplitudes [rad/s^2, m/s^2].
    omega : float
        Frequency [rad/s].

    Returns
    -------
    tuple of 2 float
        [rad/s^2, m/s^2].

    References
    ----------
    Paper eq (56).
    """
    wave = math.sin(omega*t)
    return phi_a*wave, phi_d*wave
