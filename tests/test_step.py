"""The integration step: exact steps of linear plants, and steps that are too long."""

import math
import re

import control
import numpy as np
import pytest

import smcaero_nb as smc
from smcaero_nb import ClosedLoop, ParameterError, block, interop, simulate
from smcaero_nb.core import program, writer
from smcaero_nb.core.exact import constants
from smcaero_nb.core.program import methods

one = block(lambda t: 1.0)


@block
def tone(t, w=1000.0):
    return math.sin(w*t)


@block
def swing(t, x):
    return 0.1*math.sin(3.0*t) - 0.2*x[0]


@block(state=dict(n=0.0))
def stairs(t, z, tau):
    return 0.1*z[0], (z[0] + 1.0,)


def cavity(w=1000.0, Q=1000.0, K=0.1):
    return interop.from_control(control.tf([K*w*w], [1.0, w/Q, w*w], name="cavity"))


def driven(plant, law=one, **stages):
    return ClosedLoop(plant, output=plant.y, law=law, **stages)


# ---- exact steps ---------------------------------------------------------------------------------
@pytest.mark.parametrize("dt", [2e-4, 1e-4])
def test_a_resonance_has_its_amplitude_with_default_settings(dt):
    run = simulate(driven(cavity(), tone), 10.0, dt, record=20000)
    right = 0.1*1000.0*(1.0 - math.exp(-1000.0*10.0/2000.0))
    assert np.abs(run.y[run.t > 9.9]).max() == pytest.approx(right, rel=5e-3)


LINEAR = {
    "stiff": control.tf([1.0], np.poly([-1.0, -1e3, -1e6])),
    "Q = 1e5": control.tf([1.0], [1.0, 1e-5, 1.0]),
    "unstable": control.tf([1.0, -1.0], [1.0, 0.2, -1.0]),
    "integrators": control.tf([1.0], [1.0, 0.0, 0.0, 0.0]),
    "feedthrough": control.tf([2.0, 1.0, 3.0], [1.0, 0.8, 2.0]),
    "launch vehicle": smc.lv.transfer_function(),
}


@pytest.mark.parametrize("name", LINEAR)
@pytest.mark.parametrize("dt", [0.5, 0.01])
def test_a_step_response_is_exact_at_any_step(name, dt):
    sys = LINEAR[name]
    plant = interop.from_control(sys)
    run = simulate(driven(plant), 5.0, dt, jit=False)
    wanted = control.forced_response(sys, run.t, np.ones_like(run.t)).outputs
    after = slice(1, None)  # a sample measures y under the control of the sample before
    assert run.y[after] == pytest.approx(wanted[after], rel=1e-7, abs=1e-9)


def test_a_held_perturbation_is_exact_too():
    plant = interop.from_control(control.tf([1.0], [1.0, 0.3, 900.0]))
    coarse, fine = (simulate(driven(plant, perturbation=stairs), 2.0, dt, 0.1, jit=False)
                    for dt in (0.1, 0.01))
    assert coarse.y == pytest.approx(fine.y[::10], abs=1e-12)


def test_a_perturbation_that_moves_costs_an_error_of_second_order():
    loop = driven(interop.from_control(control.tf([4.0], [1.0, 0.3, 90.0])), perturbation=swing)
    y = [simulate(loop, 2.0, dt, record=10).y[-1] for dt in (4e-2, 2e-2, 1e-2)]
    right = simulate(loop, 2.0, 1e-4, method="rk4", record=10).y[-1]
    ratios = [(a - right)/(b - right) for a, b in zip(y, y[1:], strict=False)]
    assert all(3.5 < q < 4.5 for q in ratios)


@pytest.mark.parametrize("perturbation", [None, swing, stairs])
def test_compiled_plain_and_stepped_runs_with_exact_steps_agree_to_the_last_bit(perturbation):
    loop, n, dt, m = driven(cavity(30.0, 100.0), tone, perturbation=perturbation), 60, 0.01, 3
    fast, plain = (simulate(loop, n*dt, dt, m*dt, record=n, jit=jit) for jit in (True, False))
    np.testing.assert_array_equal(fast.x.x0, plain.x.x0)
    p = writer.written(loop, "exact", m*dt, m)
    names = p.functions(loop)
    exec(program.step(p), names)
    P = [*(float(v) for q in loop.p.values() for v in q), *constants(p, loop, dt)]
    x, z = loop.start()
    state = tuple((p.state | x | z).values())
    for k in range(n):
        assert dict(zip(p.state, state, strict=True))["x_0"] == fast.x.x0[k]
        state = names["step"](k, state, P, np.array([]), dt, m*dt, m)


def test_the_step_is_no_constant_of_the_compiled_loop():
    from smcaero_nb.core.build import built

    loop = driven(cavity())
    assert built(loop, "exact", 1e-3, 1, 0, True)[0] is built(loop, "exact", 2e-3, 1, 0, True)[0]


def test_methods_lists_the_default_first():
    own = block(state=dict(x=0.0))(lambda x, u: (u,))
    assert methods(driven(cavity())) == ("exact", "euler", "midpoint", "rk4")
    assert methods(ClosedLoop(own)) == ("euler", "midpoint", "rk4")
    a, b = (simulate(driven(cavity()), 0.1, 1e-3, method=q, jit=False) for q in (None, "exact"))
    np.testing.assert_array_equal(a.y, b.y)


def test_exact_is_refused_for_other_plants_in_words():
    own = block(state=dict(x=0.0))(lambda x, u: (u,))
    with pytest.raises(ParameterError, match="'exact' is not allowed.*from_control.*must be euler"):
        simulate(ClosedLoop(own, law=one), 1.0, 0.1, method="exact")


# ---- steps that are too long ---------------------------------------------------------------------
@block(state=dict(a=0.0, b=0.0))
def mode(x, u, d, a0=900.0, a1=0.3):
    """A mode, free or driven; two lags where a1^2 > 4 a0."""
    return x[1], u + d - a0*x[0] - a1*x[1]


@block(state=dict(x0=0.0, x1=0.0, x2=0.0, x3=0.0))
def fourth(x, u, d, a0=1.0, a1=1.0, a2=1.0, a3=1.0):
    return x[1], x[2], x[3], u + d - a0*x[0] - a1*x[1] - a2*x[2] - a3*x[3]


@block
def square(t, period=1.0):
    return 1.0 if t % period < 0.5*period else -1.0


@block
def sine(t, w=1.0, high=1.0):
    return high*math.sin(w*t)


@block
def nothing(t):
    return 0.0


FREE, DRIVEN = ClosedLoop(mode, law=nothing), ClosedLoop(mode, law=sine)
#: (loop, duration, dt, method, word): nobody tuned the judge to them
WRONG = {
    "bending mode": (FREE.with_(plant__a=0.01), 20.0, 1e-3, "euler", "grows at"),
    "undamped": (FREE.with_(plant__a=1.0, plant__a0=25.0, plant__a1=0.0), 60.0, 2e-3, "euler",
                 "grows at"),
    "damped half as it should": (FREE.with_(plant__a=1.0, plant__a0=400.0, plant__a1=1.6), 5.0,
                                 2e-3, "euler", "decays at 0.4"),
    "resonance, Euler": (DRIVEN.with_(plant__a0=1e6, plant__a1=10.0, law__w=1e3), 2.0, 5e-6,
                         "euler", "decays at 2.5"),
    "resonance, as strong as the damping": (
        DRIVEN.with_(plant__a0=1e4, plant__a1=0.1, law__w=100.0), 60.0, 1e-5, "euler",
        "keeps its amplitude"),
    "resonance, out of tune": (DRIVEN.with_(plant__a0=1e4, plant__a1=0.1, law__w=100.0), 60.0,
                               1e-3, "midpoint", "decays at 0.0377"),
    "swings for long, rk4": (FREE.with_(plant__a=1.0, plant__a0=100.0, plant__a1=0.0), 400.0, 0.1,
                             "rk4", "decays at"),
    "stiff": (ClosedLoop(mode, law=square).with_(plant__a0=5e3, plant__a1=5001.0), 2.0, 1e-3,
              "euler", "because of it"),
    "stiff, rk4": (ClosedLoop(mode, law=square).with_(plant__a0=5e3, plant__a1=5001.0), 2.0, 1e-3,
                   "rk4", "because of it"),
    "rings from step to step": (ClosedLoop(mode, law=square).with_(plant__a0=1.9e3,
                                                                   plant__a1=1901.0), 2.0, 1e-3,
                                "euler", "changes its sign at every step"),
    "falls too slowly": (FREE.with_(plant__a=1.0, plant__b=0.0, plant__a0=-900.0, plant__a1=0.0),
                         0.5, 0.02, "euler", "grows at 23.5"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_step_that_is_too_long_is_said_with_a_way_out_that_passes(name):
    loop, duration, dt, method, word = WRONG[name]
    said, = simulate(loop, duration, dt, method=method).doubts()
    assert said.startswith(f"{method} with dt = {dt:g} s does not follow the plant's mode of")
    assert word in said and "would do" in said
    dts = re.findall(r" dt = (\S+) s (?:or|would)", said)
    others = re.findall(r"'(\w+)'", said)
    assert dts or others
    for dt_, method_ in [*((float(q), method) for q in dts), *((dt, q) for q in others)]:
        assert not simulate(loop, duration, dt_, method=method_).doubts()


def with_poles(poles, **more):
    """A loop of four poles, with a relay that does not look."""
    a = np.real(np.poly(poles))[:0:-1]
    loop = ClosedLoop(fourth, law=square, **more)
    return loop.with_(**{f"plant__a{i}": float(q) for i, q in enumerate(a)})


@pytest.mark.parametrize("method", ["euler", "midpoint", "rk4"])
def test_stable_plants_with_a_step_that_fits_raise_nothing(method):
    rng = np.random.default_rng(3)
    for _ in range(50):
        poles = []
        for _ in range(2):
            w, zeta = 10.0**rng.uniform(-0.5, 1.5), 10.0**rng.uniform(-1.5, 0.3)
            poles += np.roots([1.0, 2.0*zeta*w, w*w]).tolist()
        # the damping of every mode to 2 %, and a tenth of the fastest time constant
        dt = min(0.1/max(map(abs, poles)), *(0.04*abs(p.real)/abs(p)**2 for p in poles))
        run = simulate(with_poles(poles), 4.0, dt, method=method)
        assert not run.doubts()


def test_long_dead_modes_integrators_and_unstable_modes_that_are_followed_raise_nothing():
    servo = with_poles([-0.3, -1.0, -100.0, -150.0])
    chain = with_poles([0.0, 0.0, 0.0, 0.0])
    unstable = with_poles([1.0, -1.0, 0.2 + 0.5j, 0.2 - 0.5j])
    for loop, duration, dt in ((servo, 20.0, 1e-3), (servo, 20.0, 4e-3), (chain, 100.0, 1e-2),
                               (unstable, 20.0, 1e-3)):
        assert not simulate(loop, duration, dt).doubts()


def test_a_swing_that_the_control_holds_raises_nothing():
    held = ClosedLoop(mode, reference=sine, law=smc.smc1.sign_smc.with_(rho=150.0), surface=block(
        lambda e: 5.0*e[0] + e[1]), output=block(lambda x: (x[0], x[1])))
    held = held.with_(plant__a0=100.0, plant__a1=0.0)
    assert not simulate(held, 20.0, 1e-3).doubts()


def test_a_switch_or_dry_friction_in_the_plant_is_no_mode():
    @block(state=dict(a=1.5, b=1.0))
    def pair(x):
        above = x[0] > x[1]
        return (-2.0 if above else 2.0), (1.5 if above else -3.0)

    @block(state=dict(x=0.0, v=0.0))
    def friction(x, u):
        return x[1], u - (0.5 if x[1] > 0.0 else -0.5) - x[1]*abs(x[1])

    for loop in (ClosedLoop(pair), ClosedLoop(friction, law=square)):
        assert not simulate(loop, 2.0, 1e-3, jit=False).doubts()


def test_a_perturbation_that_follows_the_state_belongs_to_the_plant():
    spring = block(lambda x: -900.0*x[0] - 0.3*x[1])
    loop = FREE.with_(plant__a=0.01, plant__a0=0.0, plant__a1=0.0, perturbation=spring)
    said, = simulate(loop, 20.0, 1e-3).doubts()
    assert "mode of 30 rad/s (damping ratio 0.005)" in said
    assert not simulate(loop, 20.0, 1e-3, method="midpoint").doubts()


@pytest.mark.parametrize("loop", [smc.lv.loop("pd"), smc.rpl.loop("pid"),
                                  smc.applications.dc_motor("super_twisting")],
                         ids=["lv", "rpl", "motor"])
def test_what_the_step_is_judged_by_costs_little(loop):
    from time import perf_counter

    from smcaero_nb.core.growth import step_doubts

    run = simulate(loop)
    costs = []
    for _ in range(20):
        began = perf_counter()
        step_doubts(run)
        costs.append(perf_counter() - began)
    assert min(costs) < 3e-3  # 0.5 ms on a quiet machine


# ---- a relative degree above those of the kit ----------------------------------------------------
@pytest.mark.parametrize("make, high", [
    (lambda: smc.surface.polynomial((1.0,)*7, integral=False), 6),
    (lambda: smc.surface.itae(8, 10.0), 6), (lambda: smc.hosmc.quasi_continuous(8), 5),
    (lambda: smc.differentiators.observer(8), 6),
    (lambda: smc.applications.perturbed_chain(smc.smc1.sign_smc, 8), 6)])
def test_a_relative_degree_that_is_too_high_is_refused_with_the_way_on(make, high):
    with pytest.raises(ParameterError, match=f"r = 8 is not allowed.*from 1 to {high}.*prd.sweep.*"
                                             "as a block.*np.poly"):
        make()


def test_the_way_on_slides_at_relative_degree_eight():
    c = tuple(np.poly([-2.0]*7).tolist())
    plant = block(lambda x, u, d: (*x[1:], u + d), state={f"x{i}": 0.5*(i == 0) for i in range(8)})

    @block
    def sigma(e):
        return (c[0]*e[7] + c[1]*e[6] + c[2]*e[5] + c[3]*e[4] + c[4]*e[3] + c[5]*e[2] + c[6]*e[1]
                + c[7]*e[0])

    loop = ClosedLoop(plant, surface=sigma, law=smc.smc1.sign_smc.with_(rho=500.0))
    run = simulate(loop, 20.0, 1e-3)
    assert not run.doubts() and run.tail_sigma < 1.0 and np.abs(run.x.x0[-1]) < 1e-4


@pytest.mark.parametrize("loop", [
    *(smc.lv.loop(law, p) for law, presets in smc.lv.PRESETS.items() for p in presets),
    *(smc.rpl.loop(law, p) for law, presets in smc.rpl.PRESETS.items() for p in presets),
    *map(smc.applications.double_integrator, ("super_twisting", "twisting", "nested")),
    *(smc.applications.dc_motor("super_twisting", y) for y in ("angle", "speed")),
    smc.applications.perturbed_chain(smc.hosmc.quasi_continuous(4), 4)], ids=repr)
def test_no_preset_has_a_step_that_is_too_long_or_a_zero_that_grows(loop):
    from smcaero_nb.core.growth import step_doubts
    from smcaero_nb.core.zeros import zero_doubts

    run = simulate(loop)
    assert step_doubts(run) == zero_doubts(run) == []


def test_a_chattering_control_that_all_rows_see_from_one_side_is_not_taken_for_a_free_swing():
    @block(state=dict(q=0.5, w=0.0))
    def pendulum(x, u, d):
        return x[1], u - 9.81*math.sin(x[0])

    held = ClosedLoop(pendulum, output=block(lambda x: (x[0], x[1])), surface=block(
        lambda e: e[1] + 2.0*e[0]), law=smc.smc1.sign_smc.with_(rho=30.0))
    assert not simulate(held, 60.0, 2e-3).doubts()
    free = held.with_(law=smc.smc1.sign_smc.with_(rho=0.0))
    assert "keeps its amplitude" in simulate(free, 60.0, 2e-3).doubts()[0]


@pytest.mark.parametrize("law", ["pd", "super_twisting"])
def test_a_bending_mode_beside_a_loop_that_does_well_is_seen(law):
    @block(state=dict(theta=0.0, dtheta=0.0, eta=0.0, deta=0.0))
    def vehicle(x, u, d):
        return x[1], u + d, x[3], u - 900.0*x[2] - 0.3*x[3]

    gains = dict(pd=block(lambda sigma: 2.0*sigma), super_twisting=smc.smc2.super_twisting)
    loop = ClosedLoop(vehicle, output=block(lambda x: (x[0], x[1])), law=gains[law],
                      reference=block(lambda t: 0.5), surface=block(lambda e: e[1] + 2.0*e[0]))
    right = np.abs(simulate(loop, 20.0, 1e-3, method="rk4").x.eta[-400:]).max()
    for dt, error in ((1e-3, 1e3), (1e-4, 2.0)):
        run = simulate(loop, 20.0, dt)
        said = [q for q in run.doubts() if "mode of 30 rad/s (damping ratio 0.005)" in q]
        assert said and np.abs(run.x.eta[-400:]).max() > error*right


def test_a_run_that_diverges_for_another_reason_is_not_laid_on_the_step():
    @block(state=dict(a=0.01, b=0.0, c=1.0))
    def plant(x, u, d):
        return x[1], u - 900.0*x[0] - 0.3*x[1], 30.0*x[2]

    run = simulate(ClosedLoop(plant, law=nothing), 20.0, 1e-3)
    assert run.ended == "diverged" and all("because of it" not in q for q in run.doubts())


@block(state=dict(p=2.0, v=0.0))
def van_der_pol(x, u, d, mu=500.0):
    return x[1], mu*(1.0 - x[0]**2)*x[1] - x[0] + u


@block(state=dict(p=1.0, v=0.0))
def hardening(x, u, d, k=1000.0):
    return x[1], -k*x[0]**3 - 0.01*x[1] + u


@pytest.mark.parametrize("plant, dt", [(van_der_pol, 1e-2), (hardening, 4e-3)], ids=repr)
def test_a_nonlinear_plant_that_blew_up_by_its_step_has_a_way_out_that_works(plant, dt):
    """The later rows of such a run are of a state without bounds, which no step would follow."""
    loop = ClosedLoop(plant, law=nothing, duration=5.0)
    run = simulate(loop, dt=dt)
    said, = run.doubts()
    assert "the run diverged because of it; dt = " in said
    longest = float(re.search(r"dt = (\S+) s(?: or method = .*)? would do", said)[1])
    assert dt/1e4 < longest < dt and simulate(loop, dt=longest).doubts() == []
    assert np.abs(simulate(loop, dt=longest).x.p).max() < 1.1*plant.values["p"]


def test_a_plant_that_escapes_in_finite_time_is_not_laid_on_the_step():
    @block(state=dict(y=3.0))
    def cubic(x, u, d):
        return x[0]**3 + u,

    run = simulate(ClosedLoop(cubic, output=block(lambda x: x[0]), law=smc.smc1.sign_smc), 5.0,
                   1e-3)
    assert run.ended == "diverged" and not any("euler" in q for q in run.doubts())


def test_a_run_of_a_single_row_that_diverged_by_its_step_says_so():
    stiff = DRIVEN.with_(plant__a0=1e6, plant__a1=1e5)
    run = simulate(stiff, 2.0, 1e-3, record=1)
    assert len(run.t) <= 2 and "because of it" in run.doubts()[0]


@block(state=dict(a=0.0, b=0.0, c=0.0, e=0.0))
def two_modes(x, u, d, w1=1.0, z1=0.1, w2=10.0, z2=0.1, n=0.0):
    """The second mode rings beside a larger motion that the first, slower one forces on it."""
    return (x[1], u - w1*w1*x[0] - 2.0*z1*w1*x[1] - n*x[0]**3,
            x[3], w2*w2*(u + x[0] - x[2]) - 2.0*z2*w2*x[3])


@pytest.mark.parametrize("w1, z1, w2, z2, n", [
    (7.56, 0.0112, 21.2, 0.0043, 0.0), (3.28, 0.0349, 12.9, 0.0032, 0.0),
    (3.28, 0.0349, 12.9, 0.0032, 1.0), (1.49, 0.2, 40.0, 0.01, 0.0), (1.0, 0.02, 25.0, 0.01, 0.3)])
def test_a_mode_that_rings_beside_a_larger_motion_is_seen(w1, z1, w2, z2, n):
    """Euler's growth w^2 dt/2 is about as large as the damping z w, or larger."""
    loop = ClosedLoop(two_modes.with_(w1=w1, z1=z1, w2=w2, z2=z2, n=n, a=0.9, c=0.9),
                      law=sine.with_(w=0.9), duration=20.0, dt=1e-3)
    assert any("euler with dt = 0.001 s" in q for q in simulate(loop).doubts())
    assert simulate(loop, method="rk4").doubts() == []
    still = loop.with_(plant__z1=0.7, plant__z2=0.7)
    assert simulate(still, dt=1e-4).doubts() == []
