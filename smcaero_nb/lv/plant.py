"""Launch vehicle in pitch, ascent: paper eqs (60)-(65), with the units put right; its outputs."""

from typing import Annotated

from ..core import Param, block
from ..core.card import Output, Plant
from ..sources import KODE

__all__ = ["launcher", "launcher_with_drift", "pitch", "pitch_and_acceleration"]

Inertia = Annotated[float, Param("I", "kg m^2", low=1e3, slider=(5e7, 3e8),
                                 help="pitch inertia (1e8 slug ft^2)")]
NormalForce = Annotated[float, Param(r"C_{N\alpha}", "1/rad", low=0.0, slider=(0.0, 20.0),
                                     help="normal force coefficient")]
Pressure = Annotated[float, Param(r"\bar q", "Pa", low=0.0, slider=(0.0, 1e5),
                                  help="dynamic pressure (1000 psf)")]
Area = Annotated[float, Param("S", "m^2", low=0.0, slider=(0.0, 20.0),
                              help="reference area (100 ft^2)")]
ArmAir = Annotated[float, Param("l_a", "m", slider=(-30.0, 30.0),
                                help="centre of pressure ahead of the centre of mass (50 ft)")]
ArmGimbal = Annotated[float, Param("l_g", "m", low=0.0, slider=(1.0, 40.0),
                                   help="gimbal behind the centre of mass (75 ft)")]
Thrust = Annotated[float, Param("R", "N", low=0.0, slider=(0.0, 1e7),
                                help="vectored thrust (1e6 lbf)")]
EngineMoment = Annotated[float, Param(
    "S_n", "kg m", low=0.0, slider=(0.0, 5e3),
    help="first moment of the engine about the gimbal (100 slug ft)")]
EngineInertia = Annotated[float, Param("I_n", "kg m^2", low=0.0, slider=(0.0, 1e4),
                                       help="second moment of the engine (1000 slug ft^2)")]
ModeGimbal = Annotated[float, Param(r"\phi_g", "kg^-1/2", slider=(-1e-3, 1e-3),
                                    help="mode shape at the gimbal")]
SlopeGimbal = Annotated[float, Param(r"\psi_g", "kg^-1/2/m", slider=(-1e-3, 1e-3),
                                     help="mode slope at the gimbal")]
SlopeSensor = Annotated[float, Param(r"\psi_s", "kg^-1/2/m", slider=(-1e-3, 1e-3),
                                     help="mode slope at the sensor")]
BendingFrequency = Annotated[float, Param(r"\omega_b", "rad/s", low=0.1, slider=(2.0, 50.0),
                                          help="frequency of the bending mode")]
BendingDamping = Annotated[float, Param(r"\zeta_b", "1", low=0.0, slider=(0.0, 0.1),
                                        help="damping of the bending mode")]
ServoLag = Annotated[float, Param(r"\tau_a", "s", low=1e-3, slider=(0.01, 1.0),
                                  help="lag of the hydraulic servo")]
EngineFrequency = Annotated[float, Param(
    r"\omega_e", "rad/s", low=0.1, slider=(2.0, 60.0),
    help="frequency of the engine pendulum with the servo loop closed")]
EngineDamping = Annotated[float, Param(r"\zeta_e", "1", low=0.0, slider=(0.0, 2.0),
                                       help="damping of the engine pendulum")]
Coupling = Annotated[bool, Param(
    "coupling", help="inertia of the swinging engine acts on the vehicle (tail wags dog)")]
Bending = Annotated[bool, Param("bending", help="the sensor sees the first bending mode")]
LateralMass = Annotated[float, Param("M", "kg", low=1.0, slider=(5e4, 5e5), help="vehicle mass")]
Speed = Annotated[float, Param("V", "m/s", low=1.0, slider=(100.0, 2000.0),
                               help="speed relative to the Earth (1500 ft/s)")]
AxialAcceleration = Annotated[float, Param(r"\bar g", "m/s^2", low=0.0, slider=(0.0, 40.0),
                                           help="mean axial acceleration (60 ft/s^2)")]

STATES = dict(
    servo=(0.0, Param("x_1", "rad", help="servo position")),
    beta=(0.0, Param(r"\beta", "rad", help="gimbal angle")),
    dbeta=(0.0, Param(r"\dot\beta", "rad/s", help="gimbal rate")),
    theta=(0.0, Param(r"\theta_r", "rad", slider=(-0.2, 0.2), help="pitch of the rigid body")),
    dtheta=(0.0, Param(r"\dot\theta_r", "rad/s", slider=(-0.2, 0.2),
                       help="pitch rate of the rigid body")),
    eta=(0.0, Param(r"\eta", "rad", help="bending at the sensor")),
    deta=(0.0, Param(r"\dot\eta", "rad/s", help="bending rate at the sensor")))
PITCH = Param(r"\theta", "rad", low=-10.0, high=10.0)
RATE = Param(r"\dot\theta", "rad/s")
ACCELERATION = Param(r"\ddot\theta", "rad/s^2")


def motion(x, u, d, angle, I, C_Na, qbar, S, l_a, l_g, R, S_n, I_n, phi_g, psi_g, psi_s, omega_b,
           zeta_b, tau_act, omega_e, zeta_e, coupling, bending):
    """Return the derivatives of the seven states, `angle` being the angle of attack."""
    servo, beta, dbeta, _, dtheta, eta, deta = x
    ddbeta = omega_e*omega_e*(servo - beta) - 2.0*zeta_e*omega_e*dbeta
    reaction = ddbeta if coupling else 0.0
    ddtheta = (C_Na*qbar*S*l_a/I)*angle - (l_g*R/I)*beta - ((l_g*S_n + I_n)/I)*reaction
    force = (psi_s*(S_n*phi_g - I_n*psi_g))*reaction + (psi_s*R*phi_g)*beta if bending else 0.0
    ddeta = force - 2.0*zeta_b*omega_b*deta - omega_b*omega_b*eta
    return (u + d - servo)/tau_act, dbeta, ddbeta, dtheta, ddtheta, deta, ddeta


@block(card=Plant(source=(KODE,)), state=STATES)
def launcher(x, u, d, I: Inertia = 1.35582e8, C_Na: NormalForce = 8.0, qbar: Pressure = 47880.3,
             S: Area = 9.2903, l_a: ArmAir = 15.24, l_g: ArmGimbal = 22.86, R: Thrust = 4.44822e6,
             S_n: EngineMoment = 444.82, I_n: EngineInertia = 1355.8,
             phi_g: ModeGimbal = -1.3088e-4, psi_g: SlopeGimbal = 8.588e-5,
             psi_s: SlopeSensor = 8.588e-5, omega_b: BendingFrequency = 12.5,
             zeta_b: BendingDamping = 0.005, tau_act: ServoLag = 0.2,
             omega_e: EngineFrequency = 12.0, zeta_e: EngineDamping = 0.5,
             coupling: Coupling = True, bending: Bending = True):
    r"""Launch vehicle, short-period pitch dynamics with servo, engine pendulum and a bending mode.

    .. math::

        \tau_a \dot x_1 &= u + d - x_1, \qquad
        \ddot\beta = \omega_e^2 (x_1 - \beta) - 2\zeta_e\omega_e\dot\beta \\
        I\ddot\theta_r &= C_{N\alpha}\bar q S l_a\,\theta_r - l_g R\,\beta
        - (l_g S_n + I_n)\,\ddot\beta \\
        \ddot\eta &= \psi_s\left[(S_n\phi_g - I_n\psi_g)\,\ddot\beta + R\phi_g\,\beta\right]
        - 2\zeta_b\omega_b\dot\eta - \omega_b^2\eta, \qquad \theta = \theta_r + \eta

    Parameters
    ----------
    x : tuple of 7 float
        Servo, gimbal angle beta and rate, rigid pitch theta_r and rate, bending eta and rate at
        the sensor [rad, rad/s].
    u, d : float
        Commanded gimbal angle and its perturbation [rad].
    I, C_Na, qbar, S, l_a, l_g, R, S_n, I_n, phi_g, psi_g, psi_s : float
        Vehicle [SI].
    omega_b, zeta_b, tau_act, omega_e, zeta_e : float
        Bending mode, servo, engine [SI].
    coupling, bending : bool
        Effects that can be switched off.

    Returns
    -------
    tuple of 7 float
        Derivative of the state.

    Notes
    -----
    The angle of attack is theta (no drift): see `launcher_with_drift`. The gain of u is negative.
    The relative degree is 3 with the coupling, and 5 without it.

    Erratum: the paper's set mixes units. q is in kgf/m^2 and R in kgf, so both need the factor
    9.80665; S_n = 135.58 should be 444.8 kg m, S = 9.2 should be 9.29 m^2, and the mode shapes
    stayed in US units. The default here is the US set behind the paper's eq (7),
    I = 1e8 slug ft^2 and so on, converted as a whole.

    References
    ----------
    Paper eqs (60), (62)-(65).
    """
    return motion(x, u, d, x[3], I, C_Na, qbar, S, l_a, l_g, R, S_n, I_n, phi_g, psi_g, psi_s,
                  omega_b, zeta_b, tau_act, omega_e, zeta_e, coupling, bending)


@block(card=Plant(source=(KODE,)),
       state={**STATES, "dz": (0.0, Param(r"\dot z", "m/s", slider=(-50.0, 50.0),
                                          help="drift velocity"))})
def launcher_with_drift(
        x, u, d, I: Inertia = 1.35582e8, C_Na: NormalForce = 8.0, qbar: Pressure = 47880.3,
        S: Area = 9.2903, l_a: ArmAir = 15.24, l_g: ArmGimbal = 22.86, R: Thrust = 4.44822e6,
        S_n: EngineMoment = 444.82, I_n: EngineInertia = 1355.8, phi_g: ModeGimbal = -1.3088e-4,
        psi_g: SlopeGimbal = 8.588e-5, psi_s: SlopeSensor = 8.588e-5,
        omega_b: BendingFrequency = 12.5, zeta_b: BendingDamping = 0.005, tau_act: ServoLag = 0.2,
        omega_e: EngineFrequency = 12.0, zeta_e: EngineDamping = 0.5, coupling: Coupling = True,
        bending: Bending = True, M: LateralMass = 2.189e5, V: Speed = 457.2,
        gbar: AxialAcceleration = 18.29):
    r"""Launch vehicle in pitch and drift: `launcher`, whose angle of attack the drift changes.

    .. math::

        M\ddot z = M\bar g\,\theta_r + C_{N\alpha}\bar q S\,\alpha + R\,\beta + S_n\,\ddot\beta,
        \qquad \alpha = \theta_r - \dot z/V

    Parameters
    ----------
    x : tuple of 8 float
        As in `launcher`, then the drift velocity dz/dt [m/s].
    u, d : float
        Commanded gimbal angle and its perturbation [rad].
    I, C_Na, qbar, S, l_a, l_g, R, S_n, I_n, phi_g, psi_g, psi_s : float
        As in `launcher`.
    omega_b, zeta_b, tau_act, omega_e, zeta_e : float
        As in `launcher`.
    coupling, bending : bool
        As in `launcher`.
    M, V, gbar : float
        Mass [kg], speed [m/s], mean axial acceleration [m/s^2].

    Returns
    -------
    tuple of 8 float
        Derivative of the state.

    Notes
    -----
    The paper states this drift in (61) and then ignores it: over 30 s at a constant gimbal bias
    the vehicle drifts, and the angle of attack with it.

    References
    ----------
    Paper eqs (60), (61).
    """
    angle = x[3] - x[7]/V
    rates = motion(x[:7], u, d, angle, I, C_Na, qbar, S, l_a, l_g, R, S_n, I_n, phi_g, psi_g, psi_s,
                   omega_b, zeta_b, tau_act, omega_e, zeta_e, coupling, bending)
    reaction = rates[2] if coupling else 0.0
    return (*rates, gbar*x[3] + (C_Na*qbar*S/M)*angle + (R/M)*x[1] + (S_n/M)*reaction)


@block(card=Output(source=(KODE,)), output=(PITCH, RATE))
def pitch(x):
    r"""Pitch angle and rate at the sensor.

    .. math:: y = (\theta, \dot\theta), \qquad \theta = \theta_r + \eta

    Parameters
    ----------
    x : tuple of float
        State of `launcher` or `launcher_with_drift`.

    Returns
    -------
    tuple of 2 float
        [rad], [rad/s].

    Notes
    -----
    A run in which \|theta\| exceeds 10 rad has diverged.

    References
    ----------
    Paper eq (65).
    """
    return x[3] + x[5], x[4] + x[6]


@block(card=Output(source=(KODE,)), output=(PITCH, RATE, ACCELERATION))
def pitch_and_acceleration(
        x, I: Inertia = 1.35582e8, C_Na: NormalForce = 8.0, qbar: Pressure = 47880.3,
        S: Area = 9.2903, l_a: ArmAir = 15.24, l_g: ArmGimbal = 22.86, R: Thrust = 4.44822e6,
        S_n: EngineMoment = 444.82, I_n: EngineInertia = 1355.8, phi_g: ModeGimbal = -1.3088e-4,
        psi_g: SlopeGimbal = 8.588e-5, psi_s: SlopeSensor = 8.588e-5,
        omega_b: BendingFrequency = 12.5, zeta_b: BendingDamping = 0.005, tau_act: ServoLag = 0.2,
        omega_e: EngineFrequency = 12.0, zeta_e: EngineDamping = 0.5, coupling: Coupling = True,
        bending: Bending = True):
    r"""Exact pitch angle, rate and acceleration of `launcher`: for designs of relative degree 3.

    .. math:: y = (\theta, \dot\theta, \ddot\theta), \qquad \theta = \theta_r + \eta

    Parameters
    ----------
    x : tuple of 7 float
        State of `launcher`.
    I, C_Na, qbar, S, l_a, l_g, R, S_n, I_n, phi_g, psi_g, psi_s : float
        As in `launcher`. In a loop they follow the plant's.
    omega_b, zeta_b, tau_act, omega_e, zeta_e : float
        Likewise.
    coupling, bending : bool
        Likewise.

    Returns
    -------
    tuple of 3 float
        [rad], [rad/s], [rad/s^2].

    Notes
    -----
    No sensor measures the acceleration free of noise; a differentiator in its place is the honest
    design.

    References
    ----------
    Paper eqs (62)-(65).
    """
    rates = motion(x, 0.0, 0.0, x[3], I, C_Na, qbar, S, l_a, l_g, R, S_n, I_n, phi_g, psi_g, psi_s,
                   omega_b, zeta_b, tau_act, omega_e, zeta_e, coupling, bending)
    return x[3] + x[5], x[4] + x[6], rates[4] + rates[6]
