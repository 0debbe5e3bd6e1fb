"""The perturbed chain, the double integrator and the DC motor: their physics, and every preset."""

import math

import numpy as np
import pytest

import smcaero_nb as smc
from smcaero_nb import BlockError, ParameterError, applications, block, hosmc, simulate
from smcaero_nb.applications.dc_motor import SCENARIOS, amplifier, motor, with_integral
from smcaero_nb.applications.double_integrator import SCENARIO

FIRST = ("sign_smc", "quasi_smc", "adaptive_smc", "dual_layer_smc", "super_twisting", "twisting",
         "adaptive_super_twisting", "adaptive_twisting")
SECOND = ("quasi_continuous", "levant2005", "nested", "adaptive_continuous")


# ---- the chain -----------------------------------------------------------------------------------
@pytest.mark.parametrize("r", range(1, 7))
def test_chain(r):
    plant = applications.chain(r)
    x = tuple(float(i + 1) for i in range(r))
    assert plant(x, 2.0, 0.5) == (*x[1:], -1.5)
    assert list(plant.states) == [f"s{i}" for i in range(r)]
    y = applications.chain_output(x)
    assert y == (tuple(-v for v in x) if r > 1 else -1.0)


def test_chain_is_integrated_exactly():
    """With rk4 and no control sigma is the polynomial of its initial values and perturbation."""
    q = smc.ClosedLoop(applications.chain(4), output=applications.chain_output, allocation=idle,
                       perturbation=applications.chain_perturbation.with_(xi_0=0.7, xi_1=0.0))
    x = (0.3, -0.2, 0.5, -0.4)
    start = {f"plant__s{i}": v for i, v in enumerate(x)}
    run = simulate(q.with_(**start), 2.0, 0.25, method="rk4", jit=False)
    t = run.t
    assert run.x.s0 == pytest.approx(0.3 - 0.2*t + 0.5*t**2/2 - 0.4*t**3/6 + 0.7*t**4/24, abs=1e-14)
    assert run.e[0] == pytest.approx(run.x.s0)  # the error is sigma


@block
def idle(t):
    return 0.0


def test_perturbed_chain():
    q = applications.perturbed_chain(hosmc.quasi_continuous(2), 2)
    run = simulate(q, 5.0, 1e-3, method="rk4", jit=False)
    assert (q.duration, q.dt, q.tau) == (20.0, 2.5e-4, 1e-3)
    assert run.tail_e < 1e-5
    assert np.array_equal(run.sigma[0], run.e_hat[0])
    assert run.d[0] == 0.8
    relay = applications.perturbed_chain(smc.smc1.sign_smc, 1)
    assert isinstance(simulate(relay, 0.1, jit=False).sigma, np.ndarray)


# ---- double integrator ---------------------------------------------------------------------------
@pytest.mark.parametrize("law", SCENARIO.presets)
def test_double_integrator(law):
    q = applications.double_integrator(law)
    assert (q.duration, q.dt, q.tau) == (8.0, 1e-4, 1e-3)
    run = simulate(q, dt=1e-3, tau=1e-3, method="rk4", jit=False)
    assert run.diverged_at is None
    assert run.e[0][0] == -1.0
    assert np.abs(run.d).max() <= 0.7 + 1e-12
    limit = {"sign_smc": 1e-3, "quasi_smc": 0.01, "adaptive_smc": 2e-3, "dual_layer_smc": 2e-3,
             "adaptive_twisting": 0.01, "levant2005": 2e-5, "super_twisting": 5e-6,
             "twisting": 2e-6, "adaptive_super_twisting": 0.01, "quasi_continuous": 2e-5,
             "nested": 2e-5, "adaptive_continuous": 1e-7}[law]
    assert run.tail_e < limit
    assert run.tail_peaks.e[1] < (0.02 if law != "adaptive_continuous" else 1e-4)


def test_double_integrator_is_finite_in_time_under_higher_order():
    """On e' + 2.5 e = 0 the error decays exponentially; with relative degree 2 it ends by 3 s."""
    first, second = (simulate(applications.double_integrator(law), 4.0, 1e-3, 1e-3, method="rk4",
                              record=4000, jit=False)
                     for law in ("super_twisting", "quasi_continuous"))
    late = first.t > 2.2
    e = np.abs(first.e[0][late])
    assert np.polyfit(first.t[late], np.log(e), 1)[0] == pytest.approx(-2.5, rel=0.03)
    assert np.abs(second.e[0][second.t > 3.0]).max() < 2e-5


def test_double_integrator_with_another_mass():
    q = applications.double_integrator("super_twisting").with_(plant__m=1.3)
    run = simulate(q, dt=1e-3, tau=1e-3, method="rk4", jit=False)
    assert run.tail_e < 1e-4


# ---- DC motor ------------------------------------------------------------------------------------
def test_motor_physics():
    p = motor.values
    rotor, hub, disc = 1.4e-6, 0.6e-6, 0.5*0.053*0.0248**2
    assert p["J"] == pytest.approx(rotor + hub + disc, rel=2e-3)
    G0 = applications.dc_motor().stages["allocation"].values["G0"]
    assert G0 == pytest.approx(p["k"]/(p["J"]*p["R"]), rel=1e-3)

    free = 10.0/p["k"]  # speed without load: the back-EMF is the voltage
    assert motor((0.0, free, 0.0), 10.0, 0.0) == pytest.approx((free, 0.0, 0.0), abs=1e-9)
    stall = 10.0/p["R"]  # current at rest, and the load that it holds
    assert motor((0.0, 0.0, stall), 10.0, p["k"]*stall) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)

    x, u, T = (0.3, 40.0, 0.5), 6.0, 0.004
    _, domega, di = motor.with_(b=1e-5)(x, u, T)
    lost, stored = p["R"]*x[2]**2 + 1e-5*x[1]**2, p["J"]*x[1]*domega + p["L"]*x[2]*di
    assert u*x[2] == pytest.approx(lost + T*x[1] + stored)  # power in = losses + load + storage


def test_motor_step_response():
    """Two real poles: the exact step response of the speed."""
    q = smc.ClosedLoop(motor, allocation=two_volts)
    run = simulate(q, 0.3, 2e-5, 1e-3, method="rk4", record=300, jit=False)
    p = motor.values
    s = np.roots([p["L"]*p["J"], p["R"]*p["J"], p["k"]**2])
    exact = 2.0/p["k"]*(1.0 + (s[1]*np.exp(s[0]*run.t) - s[0]*np.exp(s[1]*run.t))/(s[0] - s[1]))
    assert run.x.omega == pytest.approx(exact, abs=1e-6)


@block
def two_volts(t):
    return 2.0


@pytest.mark.parametrize("output", SCENARIOS)
@pytest.mark.parametrize("law", FIRST + SECOND)
def test_dc_motor(law, output):
    q = applications.dc_motor(law, output)
    assert (q.duration, q.dt, q.tau) == (1.0, 1e-5, 1e-4)
    run = simulate(q, 0.8, 1e-4, 1e-4, method="rk4", jit=False)
    assert run.diverged_at is None
    assert run.max_u <= 10.0
    e = np.ravel(run.tail_e)[0]
    limits = {"angle": {"sign_smc": 3e-3, "quasi_smc": 6e-3, "adaptive_smc": 3e-3,
                        "dual_layer_smc": 3e-3, "adaptive_twisting": 0.03, "levant2005": 5e-4,
                        "super_twisting": 5e-5, "twisting": 1e-4, "adaptive_super_twisting": 2e-3,
                        "quasi_continuous": 5e-4, "nested": 5e-4, "adaptive_continuous": 1e-5},
              "speed": {"sign_smc": 1.0, "quasi_smc": 1.2, "adaptive_smc": 1.0,
                        "dual_layer_smc": 1.0, "adaptive_twisting": 2.0, "levant2005": 1.5,
                        "super_twisting": 0.02, "twisting": 0.03, "adaptive_super_twisting": 0.2,
                        "quasi_continuous": 1.5, "nested": 1.5, "adaptive_continuous": 0.02}}
    assert e < limits[output][law]


def test_dc_motor_as_documented():
    run = simulate(applications.dc_motor("super_twisting"))
    assert run.tail_e == pytest.approx(1.1e-5, rel=0.3)
    torque = motor.values["k"]*run.x.current
    late = run.t > 0.5  # it holds the shaft against the load
    assert np.mean((torque - run.d)[late]) == pytest.approx(0.0, abs=1e-4)
    relay = applications.dc_motor("sign_smc")
    chattering = simulate(relay, 1.0, 1e-4, 1e-4, method="rk4", jit=False)
    assert run.tail_variation_u < 0.01*chattering.tail_variation_u
    assert applications.dc_motor("sign_smc", "speed").metadata("e").unit == "rad/s"


def test_saturation():
    assert [amplifier(u) for u in (-20.0, -3.0, 10.5)] == [-10.0, -3.0, 10.0]
    weak = applications.dc_motor("super_twisting").with_(actuator__limit=0.5)
    run = simulate(weak, 0.3, 1e-4, 1e-4, method="rk4", jit=False)
    assert run.max_u == 0.5


def test_with_integral():
    assert with_integral(2.0, (0.3,), 0.1) == ((0.3, 2.0), (0.5,))


@pytest.mark.parametrize("law", (
    smc.smc1.tanh_smc, smc.smc1.adaptive_quasi_smc, smc.smc1.dual_layer_smc,
    smc.smc2.twisting.with_(**smc.smc2.gains(20.0).twisting, v_M=6.0), smc.smc2.adaptive_twisting,
    hosmc.quasi_continuous(2, "levant2005")), ids=lambda b: b.name)
def test_any_law_gets_what_it_needs(law):
    loop = applications.double_integrator(law)
    assert (loop.stages["surface"] is None) == (law.r == 2)
    run = simulate(loop)
    assert run.diverged_at is None and run.tail_e < 0.02
    if law.r == 1:  # sigma' from the sample before: half a sample behind
        _, ds = run.sigma
        exact = -run.d - run.u + 2.5*run.e[1]
        assert np.abs(ds - exact)[run.t > 0.01].max() < 0.1*np.abs(exact).max()


# ---- bad input -----------------------------------------------------------------------------------
@pytest.mark.parametrize(("make", "message"), [
    (lambda: applications.chain(0), "chain: r = 0"), (lambda: applications.chain(7), "from 1 to 6"),
    (lambda: applications.chain(1.5), "whole number"),
    (lambda: applications.double_integrator("pid"),
     "double_integrator: law = 'pid' is not allowed; it must be a law \\(a block\\), or one of "
     "sign_smc"),
    (lambda: applications.dc_motor("pid"), "dc_motor: law = 'pid'"),
    (lambda: applications.double_integrator(7.0), "it must be a law .a block., or one of"),
    (lambda: applications.double_integrator(hosmc.nested(3)),
     "nested_3 is for relative degree 3; it must be 1"),
    (lambda: applications.perturbed_chain(hosmc.nested(3), 2),
     "r = 2 is not allowed; nested_3 is for relative degree 3"),
    (lambda: applications.dc_motor(output="torque"),
     "output = 'torque' is not allowed; it must be one of 'angle', 'speed'"),
    (lambda: applications.dc_motor().with_(plant__R=-1.0), "R = -1"),
    (lambda: motor.with_(J=0.0), "J = 0"),
    (lambda: applications.double_integrator().with_(plant__m=math.nan), "m = nan")])
def test_bad_input(make, message):
    with pytest.raises(ParameterError, match=message):
        make()


def test_a_law_of_another_order_is_named():
    loop = applications.dc_motor("quasi_continuous").with_(law=hosmc.quasi_continuous(3))
    with pytest.raises(BlockError, match="quasi_continuous_3"):
        simulate(loop, 0.01)
