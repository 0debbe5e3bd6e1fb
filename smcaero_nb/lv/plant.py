"""Launch vehicle in pitch, ascent: paper eqs (60)-(65), with the units put right; its command, perturbation, gimbal."""

import math
from typing import Annotated

from ..core import Param, block

__all__ = ["gimbal", "gimbal_to_control", "launcher", "launcher_with_drift", "misalignment", "pitch", "pitch_and_acceleration",
           "steps"]

Inertia = Annotated[float, Param("I", "kg m^2", low=1e3, help="pitch inertia (1e8 slug ft^2)", slider=(5e7, 3e8))]
NormalForce = Annotated[float, Param(r"C_{N\alpha}", "1/rad", low=0.0, help="normal force coefficient", slider=(0.0, 20.0))]
Pressure = Annotated[float, Param(r"\bar q", "Pa", low=0.0, help="dynamic pressure (1000 psf)", slider=(0.0, 1e5))]
Area = Annotated[float, Param("S", "m^2", low=0.0, help="reference area (100 ft^2)", slider=(0.0, 20.0))]
ArmAir = Annotated[float, Param("l_a", "m", help="centre of pressure ahead of the centre of mass (50 ft)",
                                slider=(-30.0, 30.0))]
ArmGimbal = Annotated[float, Param("l_g", "m", low=0.0, help="gimbal behind the centre of mass (75 ft)", slider=(1.0, 40.0))]
Thrust = Annotated[float, Param("R", "N", low=0.0, help="vectored thrust (1e6 lbf)", slider=(0.0, 1e7))]
EngineMoment = Annotated[float, Param("S_n", "kg m", low=0.0, help="first moment of the engine about the gimbal (100 slug ft)",
                                      slider=(0.0, 5e3))]
EngineInertia = Annotated[float, Param("I_n", "kg m^2", low=0.0, help="second moment of the engine (1000 slug ft^2)",
                                       slider=(0.0, 1e4))]
ModeGimbal = Annotated[float, Param(r"\phi_g", "kg^-1/2", help="mode shape at the gimbal", slider=(-1e-3, 1e-3))]
SlopeGimbal = Annotated[float, Param(r"\psi_g", "kg^-1/2/m", help="mode slope at the gimbal", slider=(-1e-3, 1e-3))]
SlopeSensor = Annotated[float, Param(r"\psi_s", "kg^-1/2/m", help="mode slope at the sensor", slider=(-1e-3, 1e-3))]
BendingFrequency = Annotated[float, Param(r"\omega_b", "rad/s", low=0.1, help="bending mode", slider=(2.0, 50.0))]
BendingDamping = Annotated[float, Param(r"\zeta_b", "1", low=0.0, help="damping of the bending mode", slider=(0.0, 0.1))]
ServoLag = Annotated[float, Param(r"\tau_a", "s", low=1e-3, help="lag of the hydraulic servo", slider=(0.01, 1.0))]
EngineFrequency = Annotated[float, Param(r"\omega_e", "rad/s", low=0.1, help="engine pendulum with the servo loop closed",
                                         slider=(2.0, 60.0))]
EngineDamping = Annotated[float, Param(r"\zeta_e", "1", low=0.0, help="damping of the engine pendulum", slider=(0.0, 2.0))]
Coupling = Annotated[bool, Param("coupling", help="inertia of the swinging engine acts on the vehicle (tail wags dog)")]
Bending = Annotated[bool, Param("bending", help="the sensor sees the first bending mode")]
LateralMass = Annotated[float, Param("M", "kg", low=1.0, help="vehicle mass", slider=(5e4, 5e5))]
Speed = Annotated[float, Param("V", "m/s", low=1.0, help="speed relative to the Earth (1500 ft/s)", slider=(100.0, 2000.0))]
AxialAcceleration = Annotated[float, Param(r"\bar g", "m/s^2", low=0.0, help="mean axial acceleration (60 ft/s^2)",
                                           slider=(0.0, 40.0))]

STATES = dict(
    servo=(0.0, Param("x_1", "rad", help="servo position")),
    beta=(0.0, Param(r"\beta", "rad", help="gimbal angle")),
    dbeta=(0.0, Param(r"\dot\beta", "rad/s", help="gimbal rate")),
    theta=(0.0, Param(r"\theta_r", "rad", help="pitch of the rigid body", slider=(-0.2, 0.2))),
    dtheta=(0.0, Param(r"\dot\theta_r", "rad/s", help="pitch rate of the rigid body", slider=(-0.2, 0.2))),
    eta=(0.0, Param(r"\eta", "rad", help="bending at the sensor")),
    deta=(0.0, Param(r"\dot\eta", "rad/s", help="bending rate at the sensor")))


def motion(x, u, d, angle, I, C_Na, qbar, S, l_a, l_g, R, S_n, I_n, phi_g, psi_g, psi_s, omega_b, zeta_b, tau_act, omega_e,
           zeta_e, coupling, bending):
    """Derivatives of the seven states, `angle` being the angle of attack."""
    servo, beta, dbeta, _, dtheta, eta, deta = x
    ddbeta = omega_e*omega_e*(servo - beta) - 2.0*zeta_e*omega_e*dbeta
    reaction = ddbeta if coupling else 0.0
    ddtheta = (C_Na*qbar*S*l_a/I)*angle - (l_g*R/I)*beta - ((l_g*S_n + I_n)/I)*reaction
    force = (psi_s*(S_n*phi_g - I_n*psi_g))*reaction + (psi_s*R*phi_g)*beta if bending else 0.0
    ddeta = force - 2.0*zeta_b*omega_b*deta - omega_b*omega_b*eta
    return (u + d - servo)/tau_act, dbeta, ddbeta, dtheta, ddtheta, deta, ddeta


@block(state=STATES)
def launcher(x, u, d, I: Inertia = 1.35582e8, C_Na: NormalForce = 8.0, qbar: Pressure = 47880.3, S: Area = 9.2903,
             l_a: ArmAir = 15.24, l_g: ArmGimbal = 22.86, R: Thrust = 4.44822e6, S_n: EngineMoment = 444.82,
             I_n: EngineInertia = 1355.8, phi_g: ModeGimbal = -1.3088e-4, psi_g: SlopeGimbal = 8.588e-5,
             psi_s: SlopeSensor = 8.588e-5, omega_b: BendingFrequency = 12.5, zeta_b: BendingDamping = 0.005,
             tau_act: ServoLag = 0.2, omega_e: EngineFrequency = 12.0, zeta_e: EngineDamping = 0.5,
             coupling: Coupling = True, bending: Bending = True):
    r"""Launch vehicle, short-period pitch dynamics with servo, engine pendulum and one bending mode.

    .. math::

        \tau_a \dot x_1 &= u + d - x_1, \qquad \ddot\beta = \omega_e^2 (x_1 - \beta) - 2\zeta_e\omega_e\dot\beta \\
        I\ddot\theta_r &= C_{N\alpha}\bar q S l_a\,\theta_r - l_g R\,\beta - (l_g S_n + I_n)\,\ddot\beta \\
        \ddot\eta &= \psi_s\left[(S_n\phi_g - I_n\psi_g)\,\ddot\beta + R\phi_g\,\beta\right]
        - 2\zeta_b\omega_b\dot\eta - \omega_b^2\eta, \qquad \theta = \theta_r + \eta

    Parameters
    ----------
    x : tuple of 7 float
        servo, gimbal angle beta and rate, rigid pitch theta_r and rate, bending eta and rate at the sensor [rad, rad/s].
    u, d : float
        Commanded gimbal angle and its perturbation [rad].
    I, C_Na, qbar, S, l_a, l_g, R, S_n, I_n, phi_g, psi_g, psi_s, omega_b, zeta_b, tau_act, omega_e, zeta_e : float
        Vehicle [SI].
    coupling, bending : bool
        Effects that can be switched off.

    Returns
    -------
    tuple of 7 float
        Derivative of the state.

    Notes
    -----
    The angle of attack is theta (no drift): see `launcher_with_drift`. The gain of u is negative. With the coupling the
    relative degree is 3, and 5 without.

    Erratum: the paper's set mixes units. q is in kgf/m^2 and R in kgf, so both need the factor 9.80665; S_n = 135.58
    should be 444.8 kg m, S = 9.2 should be 9.29 m^2, and the mode shapes stayed in US units. The default here is the US
    set behind the paper's eq (7), I = 1e8 slug ft^2 and so on, converted as a whole.

    References
    ----------
    Paper eqs (60), (62)-(65).
    """
    return motion(x, u, d, x[3], I, C_Na, qbar, S, l_a, l_g, R, S_n, I_n, phi_g, psi_g, psi_s, omega_b, zeta_b, tau_act,
                  omega_e, zeta_e, coupling, bending)


@block(state={**STATES, "dz": (0.0, Param(r"\dot z", "m/s", help="drift velocity", slider=(-50.0, 50.0)))})
def launcher_with_drift(x, u, d, I: Inertia = 1.35582e8, C_Na: NormalForce = 8.0, qbar: Pressure = 47880.3, S: Area = 9.2903,
                        l_a: ArmAir = 15.24, l_g: ArmGimbal = 22.86, R: Thrust = 4.44822e6, S_n: EngineMoment = 444.82,
                        I_n: EngineInertia = 1355.8, phi_g: ModeGimbal = -1.3088e-4, psi_g: SlopeGimbal = 8.588e-5,
                        psi_s: SlopeSensor = 8.588e-5, omega_b: BendingFrequency = 12.5, zeta_b: BendingDamping = 0.005,
                        tau_act: ServoLag = 0.2, omega_e: EngineFrequency = 12.0, zeta_e: EngineDamping = 0.5,
                        coupling: Coupling = True, bending: Bending = True,
                        M: LateralMass = 2.189e5, V: Speed = 457.2, gbar: AxialAcceleration = 18.29):
    r"""Launch vehicle in pitch and drift: `launcher` with the angle of attack :math:`\theta_r - \dot z/V`.

    .. math:: M\ddot z = M\bar g\,\theta_r + C_{N\alpha}\bar q S\,(\theta_r - \dot z/V) + R\,\beta + S_n\,\ddot\beta

    Parameters
    ----------
    x : tuple of 8 float
        As `launcher`, then the drift velocity dz/dt [m/s].
    u, d : float
        Commanded gimbal angle and its perturbation [rad].
    I, C_Na, qbar, S, l_a, l_g, R, S_n, I_n, phi_g, psi_g, psi_s, omega_b, zeta_b, tau_act, omega_e, zeta_e : float
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
    The paper states this drift in (61) and then ignores it: over 30 s at a constant gimbal bias the vehicle drifts, and
    the angle of attack with it.

    References
    ----------
    Paper eqs (60), (61).
    """
    angle = x[3] - x[7]/V
    rates = motion(x[:7], u, d, angle, I, C_Na, qbar, S, l_a, l_g, R, S_n, I_n, phi_g, psi_g, psi_s, omega_b, zeta_b, tau_act,
                   omega_e, zeta_e, coupling, bending)
    reaction = rates[2] if coupling else 0.0
    return (*rates, gbar*x[3] + (C_Na*qbar*S/M)*angle + (R/M)*x[1] + (S_n/M)*reaction)


LIMITED = Param(r"\theta", "rad", low=-10.0, high=10.0)
RATE = Param(r"\dot\theta", "rad/s")


@block
def pitch(x) -> (LIMITED, RATE):
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


@block
def pitch_and_acceleration(x, I: Inertia = 1.35582e8, C_Na: NormalForce = 8.0, qbar: Pressure = 47880.3, S: Area = 9.2903,
                           l_a: ArmAir = 15.24, l_g: ArmGimbal = 22.86, R: Thrust = 4.44822e6, S_n: EngineMoment = 444.82,
                           I_n: EngineInertia = 1355.8, phi_g: ModeGimbal = -1.3088e-4, psi_g: SlopeGimbal = 8.588e-5,
                           psi_s: SlopeSensor = 8.588e-5, omega_b: BendingFrequency = 12.5, zeta_b: BendingDamping = 0.005,
                           tau_act: ServoLag = 0.2, omega_e: EngineFrequency = 12.0, zeta_e: EngineDamping = 0.5,
                           coupling: Coupling = True, bending: Bending = True
                           ) -> (LIMITED, RATE, Param(r"\ddot\theta", "rad/s^2")):
    r"""Pitch angle, rate and acceleration at the sensor of `launcher`, exact: for designs with relative degree 3.

    .. math:: y = (\theta, \dot\theta, \ddot\theta), \qquad \theta = \theta_r + \eta

    Parameters
    ----------
    x : tuple of 7 float
        State of `launcher`.
    I, C_Na, qbar, S, l_a, l_g, R, S_n, I_n, phi_g, psi_g, psi_s, omega_b, zeta_b, tau_act, omega_e, zeta_e : float
        As in `launcher`. In a loop they follow the plant's.
    coupling, bending : bool
        Likewise.

    Returns
    -------
    tuple of 3 float
        [rad], [rad/s], [rad/s^2].

    Notes
    -----
    No sensor measures the acceleration free of noise; a differentiator in its place is the honest design.

    References
    ----------
    Paper eqs (62)-(65).
    """
    rates = motion(x, 0.0, 0.0, x[3], I, C_Na, qbar, S, l_a, l_g, R, S_n, I_n, phi_g, psi_g, psi_s, omega_b, zeta_b, tau_act,
                   omega_e, zeta_e, coupling, bending)
    return x[3] + x[5], x[4] + x[6], rates[4] + rates[6]


@block
def steps(t, unit: Annotated[float, Param("unit", "rad", help="rad in one unit of the command: pi/180, it is in degrees",
                                          slider=(0.0, 0.1))] = math.pi/180) -> Param(r"\theta_c", "rad"):
    r"""Command of steps at 2, 6 and 10 s.

    .. math:: \theta_c = -1.2\cdot 1(t - 2) + 2.3\cdot 1(t - 6) - 1.2\cdot 1(t - 10) \ \text{deg}

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


@block
def misalignment(t, f_0: Annotated[float, Param("f_0", "rad", help="constant part", slider=(-0.5, 0.5))] = 0.2,
                 f_1: Annotated[float, Param("f_1", "rad", low=0.0, help="amplitude", slider=(0.0, 0.5))] = 0.1,
                 omega: Annotated[float, Param(r"\omega_f", "rad/s", low=0.0, help="frequency", slider=(0.0, 1.0))] = 0.1
                 ) -> Param("f", "rad"):
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
    Its mean over 30 s is 0.266 rad, and any control that keeps the pitch bounded must spend about that much. Erratum:
    the paper's Table 3 shows less than half of it for every controller, so f was absent there or meant in degrees.

    References
    ----------
    Paper eq (72).
    """
    return f_0 + f_1*math.sin(omega*t)


@block
def gimbal_to_control(v, G0: Annotated[float, Param("G_0", "[v]/rad", high=-1e-6, slider=(-10.0, -0.1),
                                                    help="nominal gain of u, negative as the plant's is")] = -1.0
                      ) -> Param("u", "rad"):
    r"""Allocation: commanded gimbal angle from the law's output.

    .. math:: u = v/G_0

    Parameters
    ----------
    v : float
        Output of the law.
    G0 : float
        Nominal gain from u to the derivative of sigma, negative [v]/rad; -1 leaves the law's gains in rad.

    Returns
    -------
    float
        u [rad].

    Notes
    -----
    The gain of the plant is -l_g R/I = -0.75 1/s^2 for relative degree 2, and -0.75/tau_act for 3.

    Erratum: (66) prints u = +(k_p e + k_d e'). With the plant (62) every controller diverges with that sign.

    References
    ----------
    Paper eqs (66), (70).
    """
    return v/G0


@block(state=dict(beta_c=(0.0, Param(r"\beta_c", "rad", help="command to start with", slider=(-0.5, 0.5)))))
def gimbal(u, z, tau,
           deflection: Annotated[float, Param(r"\beta_{max}", "rad", low=1e-3, help="greatest deflection",
                                              slider=(0.05, 1.0))] = 0.4,
           rate: Annotated[float, Param(r"\dot\beta_{max}", "rad/s", low=1e-3, help="greatest rate", slider=(0.05, 5.0))] = 1.0
           ) -> Param("u", "rad"):
    r"""Actuator: gimbal command with limited deflection and rate.

    .. math:: |\beta_c| \le \beta_{max}, \qquad |\dot\beta_c| \le \dot\beta_{max}

    Parameters
    ----------
    u : float
        Wanted command [rad].
    deflection : float
        Greatest deflection [rad].
    rate : float
        Greatest rate [rad/s].

    Returns
    -------
    float
        Command that the servo gets [rad].

    Notes
    -----
    Not in the paper, whose scenario needs 0.3 rad (17 deg) against the misalignment alone; real gimbals reach 0.1 to
    0.2 rad.
    """
    beta_c, = z
    wanted = max(-deflection, min(deflection, u))
    beta_c += max(-rate*tau, min(rate*tau, wanted - beta_c))
    return beta_c, (beta_c,)
