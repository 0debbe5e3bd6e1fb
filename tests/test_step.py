"""The integration step: exact steps of linear plants, and steps that are too long."""

import math

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
