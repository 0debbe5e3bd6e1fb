"""Practical relative degree: the paper's case, plants of every kind, noise, records."""

import io
import math
import tempfile
from collections import Counter

import control
import numpy as np
import pytest
from published import HIGH_FREQUENCY_GAIN, LANDER_PRD, PRD
from scipy.linalg import expm

import smcaero_nb as smc
from smcaero_nb import BlockError, ParameterError, block, lv, prd
from smcaero_nb.applications.dc_motor import motor, shaft, speed
from smcaero_nb.applications.double_integrator import mass, position

N = 200  # samples in a window, where nothing else is said
T = np.arange(-250, 270)/N


def lags(k):
    """1/(s + 1)^k."""
    return control.tf([1.0], np.poly(-np.ones(k)))


def response(num, den, t, u=None, euler=False):
    """Output of a strictly proper system from rest at the times t, for a unit step or u."""
    n = len(den) - 1
    M = np.zeros((n + 1, n + 1))
    M[:n - 1, 1:n] = np.eye(n - 1)
    M[n - 1, :n], M[n - 1, n] = -np.asarray(den[:0:-1])/den[0], 1.0/den[0]
    h = t[1] - t[0]
    E = np.eye(n + 1) + M*h if euler else expm(M*h)
    c, x, y = np.zeros(n), np.zeros(n), np.zeros(len(t))
    c[:len(num)] = num[::-1]
    for k, v in enumerate((t > -1e-9)*1.0 if u is None else u):
        y[k] = c @ x
        x = E[:n, :n] @ x + E[:n, n]*v
    return y


def noisy(y, noise, seed=0):
    """With white noise, relative to the maximum response in the window."""
    return y + noise*np.abs(y[:501]).max()*np.random.default_rng(seed).standard_normal(len(y))


# ---- the paper's case ----------------------------------------------------------------------------
def eq_7():
    sys = lv.transfer_function()
    return sys.num[0][0], sys.den[0][0]


def test_it_prints_the_papers_sentence(capsys):
    print(prd.identify(lv.transfer_function()))
    assert capsys.readouterr().out == "The experimentally determined PRD is equal to 5\n"


def test_eq_7_with_the_papers_settings():
    """Step at 1 s, 10^4 Euler steps of 10^-4 s, alpha = 0.1."""
    t = np.arange(2*10**4)*1e-4
    result = prd.identify((t, response(*eq_7(), t, t >= 1.0 - 1e-9, euler=True), 1.0, 1.0),
                          window=0.02, alpha=0.1)
    assert result.prd == PRD.value and result.confirmed
    assert str(result) == f"The experimentally determined PRD is equal to {PRD.value}"


@pytest.mark.parametrize("window", [0.005, 0.01, 0.02])
def test_eq_7_with_the_input_of_eq_8(window):
    t = np.arange(22000)*1e-4
    u = -17.5*(t >= 1.0 - 1e-9) + 35.0*(t >= 1.3 - 1e-9) - 35.0*(t >= 1.85 - 1e-9)
    record = prd.Record(t, response(*eq_7(), t, u), 1.0, -17.5, until=1.3)
    result = prd.identify(record, window=window)
    assert result.prd == PRD.value and result.confirmed
    assert result.gain == pytest.approx(HIGH_FREQUENCY_GAIN.value, rel=0.01)
    assert result.t[-1] < 1.3
    assert prd.identify(record).prd == 5  # the window left to it


def test_the_design_value_is_that_of_a_longer_time_scale():
    swept = prd.sweep(lv.transfer_function(), (0.02, 0.3, 0.6))
    assert swept.prd == (5, 3, 2)
    assert str(swept).split("\n")[1].split() == ["0.02", "5", "yes"]


def test_the_whole_launch_vehicle_at_several_time_scales():
    swept = prd.sweep(lv.launcher, (0.002, 0.005, 0.02, 0.05, 0.1, 0.3, 0.6), output=lv.pitch)
    assert swept.prd == (3, 3, 5, 4, 4, 3, 2)
    assert [q.analyser.prd for q in swept.results] == list(swept.prd)
    # up to 5 ms the relative degree proper, by the coupling; then no time scale stands apart,
    # gimbal and servo being in between,
    # and the slope goes from 3 to over 4: at 0.1 s it passes the 4 of the analyser
    assert [q.confirmed for q in swept.results] == [True, True, False, False, True, False, False]
    without = prd.identify(lv.launcher.with_(coupling=False), output=lv.pitch, window=0.002)
    assert without.prd == 5 and without.confirmed


# ---- plants --------------------------------------------------------------------------------------
@pytest.mark.parametrize("k", range(1, 6))
def test_lags_in_series(k):
    result = prd.identify(lags(k))
    assert result.prd == k and result.confirmed and result.gain == pytest.approx(1.0, rel=0.01)
    assert result.analyser.jumps[k - 1] >= 0.9 > max([0.0, *result.analyser.jumps[:k - 1]])
    assert 0.8 < result.analyser.bends[k - 1] < 1.3  # y^(k-1) changes its slope at once
    assert all(q < 0.4 for q in result.analyser.bends[:k - 1])
    assert result.power.slope == pytest.approx(k, abs=0.05)


@pytest.mark.parametrize("order", range(1, 6))
def test_a_state_space_and_its_transfer_function_are_alike(order):
    sys = control.tf([2.0, 1.0], np.poly(-np.arange(1.0, order + 2.0)))
    a, b = prd.identify(sys), prd.identify(control.ss(sys))
    assert a.prd == b.prd == order and np.allclose(a.y, b.y, rtol=1e-6, atol=1e-20)


def test_blocks_and_systems_of_python_control_give_the_same():
    a, b = prd.identify(lags(3)), prd.identify(smc.interop.from_control(lags(3)))
    assert a.prd == b.prd == 3 and a.y == pytest.approx(b.y, rel=1e-9, abs=1e-18)


@pytest.mark.parametrize("sys", [control.tf([1.0, 2.0], [1.0, 3.0]),
                                 control.tf([-5.0, 1.0, 4.0], [1.0, 0.2, 7.0])])
def test_blocks_with_a_feedthrough_have_relative_degree_0_as_their_systems(sys):
    a, b = prd.identify(sys), prd.identify(smc.interop.from_control(sys))
    for result in (a, b):
        assert result.prd is None
        assert "relative degree 0" in result.analyser.reason
        assert "relative degree 0" in result.power.reason
    after = b.t > b.step_time + 1e-9
    # at the step itself y is still that of the input before
    assert b.y[after] == pytest.approx(a.y[after], rel=1e-6)


def test_a_feedthrough_from_one_input_of_two():
    sys = control.ss(-np.eye(2), np.eye(2), np.eye(2), [[0.0, 0.0], [0.0, 2.0]])
    a, b = prd.identify(sys), prd.identify(smc.interop.from_control(sys))
    for found in (a, b):
        assert [[q.prd for q in row] for row in found.results] == [[1, None], [None, None]]
    assert a.prd == b.prd == (1, None) and "relative degree 0" in b.results[1][1].analyser.reason


def test_double_integrator_and_a_sliding_variable_of_it():
    result = prd.identify(mass, output=position)
    assert result.prd == 2 and result.confirmed and result.gain == pytest.approx(1.0, rel=1e-3)
    assert prd.identify(mass).prd == 2  # without an output: the first state
    sigma = prd.identify(mass, output=position,
                         surface=smc.surface.polynomial((2.0,), integral=False))
    # of e = -y
    assert sigma.prd == 1 and sigma.confirmed and sigma.gain == pytest.approx(-1.0, rel=1e-2)


def test_a_loop_gives_its_sliding_variable_whatever_its_law():
    loop = smc.applications.double_integrator("super_twisting")
    result = prd.identify(loop)
    assert result.prd == 1 and result.confirmed


def test_dc_motor_with_and_without_inductance():
    """Its electrical time constant is 0.15 ms."""
    assert [prd.identify(motor, output=q, window=1e-5).prd for q in (shaft, speed)] == [3, 2]
    assert [prd.identify(motor, output=q, window=5e-3).prd for q in (shaft, speed)] == [2, 1]
    k, J, R = (motor.values[n] for n in ("k", "J", "R"))
    without = control.tf([k/R], [J, k*k/R, 0.0])
    for window in (1e-5, 5e-3):
        result = prd.identify(without, window=window)
        assert result.prd == 2 and result.confirmed


@block(state=dict(angle=(0.5, smc.Param()), rate=(0.0, smc.Param()), torque=(0.0, smc.Param())))
def pendulum(x, u, d):
    return x[1], x[2]*(1.0 + x[0]*x[0]) - 9.81*math.sin(x[0]), 4.0*(math.tanh(u) - x[2])


def test_a_nonlinear_plant_that_moves_by_itself():
    result = prd.identify(pendulum, amplitude=2.0)  # it starts inclined, and swings
    assert result.prd == 3 and result.confirmed
    assert result.gain*2.0 == pytest.approx(4.0*math.tanh(2.0)*1.25, rel=0.01)
    assert abs(result.y[0]) == 0.0  # its unforced motion is taken off


def test_a_nonlinear_system_of_python_control():
    def rates(t, x, u, p):
        return [x[1], x[2]*(1.0 + x[0]**2) - 9.81*np.sin(x[0]), 4.0*(np.tanh(u[0]) - x[2])]

    sys = control.nlsys(rates, lambda t, x, u, p: x[0], inputs=1, outputs=1, states=3,
                        name="pendulum")
    result = prd.identify(sys, amplitude=2.0, x0=(0.5, 0.0, 0.0))
    wanted = prd.identify(pendulum, amplitude=2.0)
    assert result.prd == 3 and result.confirmed
    assert result.y == pytest.approx(wanted.y, rel=1e-6, abs=1e-12)
    assert prd.identify(sys).prd == 3


# ---- several inputs and outputs ------------------------------------------------------------------
def test_vector_relative_degree_of_two_coupled_axes():
    """Two accelerations, each from its own thrusters, and a little from the other's."""
    A = np.diag([1.0, 0.0, 1.0], 1)
    B = np.array([[0.0, 0.0], [2.0, 0.1], [0.0, 0.0], [0.1, -0.5]])
    result = prd.identify(control.ss(A, B, [[1.0, 0, 0, 0], [0, 0, 1.0, 0]], np.zeros((2, 2))))
    assert result.prd == (2, 2) and result.confirmed
    assert str(result) == "The experimentally determined vector PRD is equal to [2, 2]"
    assert [[q.gain for q in row]
            for row in result.results] == [pytest.approx(row, rel=1e-3)
                                           for row in B[[1, 3]].tolist()]
    assert result.results[1][0].name.endswith("input 1 to output 2")
    assert "input 1 to output 2" in result.explain()


def test_a_vector_relative_degree_needs_a_regular_matrix_of_gains():
    """y1 = u1/s, y2 = u1/s + u2/s^2: both outputs feel u1 first, so no control decouples them."""
    result = prd.identify(control.tf([[[1.0], [0.0]], [[1.0], [1.0]]],
                                     [[[1.0, 0.0], [1.0]], [[1.0, 0.0], [1.0, 0.0, 0.0]]]))
    assert result.prd == (1, 1) and not result.confirmed and "gains is singular" in str(result)


@pytest.mark.parametrize("plant, window, noise", [
    (control.tf([1.0], [1.0, 0.0, -1.0]), 5.0, 1e-3),
    (smc.lv.transfer_function(), 0.6, 1e-3), (smc.lv.transfer_function(), 10.0, 1e-4),
    (control.tf([1.0], np.polymul([1.0, 0.02, 1.0], [1.0, 0.0, 0.0])), 8.0, 0.0),
    (control.tf([1.0, 0.5], [1.0, -2.2, -1.75]), 1.0, 0.0)])
def test_a_slope_that_passes_a_whole_number_is_no_answer(plant, window, noise):
    """Beyond the plant's time constants the slope passes whole numbers without staying at one."""
    assert prd.identify(plant, window=window, noise=noise).prd is None


@pytest.mark.parametrize("alpha", [0.01, 0.05, 0.15])
def test_no_ramp_passes_as_a_step(alpha):
    for r in range(1, 6):
        assert prd.identify(control.tf([1.0], [1.0] + [0.0]*r), alpha=alpha).prd == r


def test_the_lander():
    result = prd.identify(smc.rpl.lander, output=smc.rpl.attitude_and_altitude)
    assert result.prd == LANDER_PRD.value and result.confirmed
    assert str(result) == "The experimentally determined vector PRD is equal to [2, 2]"
    assert [[q.prd for q in row] for row in result.results] == [[2, None], [2, 2]]
    assert result.results[1][1].gain == pytest.approx(math.sin(1.6)/1000.0, rel=1e-3)


@block(state={n: (0.0, smc.Param()) for n in ("a", "da", "b")})
def axes(x, u, d):
    return x[1], u[0] - math.sin(x[0]), 3.0*u[1] - x[2]


@block
def both(x):
    return (x[0], x[1]), (x[2],)


def test_vector_relative_degree_of_a_block():
    result = prd.identify(axes, output=both)
    assert result.prd == (2, 1) and result.confirmed
    assert [[q.prd for q in row] for row in result.results] == [[2, None], [None, 1]]
    assert "does not respond" in result.results[0][1].reason


def test_a_flat_output_is_one_output_and_its_derivative_however_many_inputs_there_are():
    found = prd.identify(axes, output=block(lambda x: (x[0], x[1])))
    assert found.prd == (2,) and [[q.prd for q in row] for row in found.results] == [[2, None]]
    assert prd.identify(axes).prd == (2, 1, 1)  # without an output, each state is one


@pytest.mark.parametrize("sys", [
    control.tf([[[1.0]], [[1.0]]], [[[1.0, 1.0]], [[1.0, 2.0, 1.0]]]),
    control.nlsys(lambda t, x, u, p: [x[1], -x[0] + u[0]], lambda t, x, u, p: [x[1], x[0]],
                  inputs=1, outputs=2, states=2)], ids=["linear", "not linear"])
def test_both_outputs_of_a_plant_with_one_input_are_identified(sys):
    linear = isinstance(sys, control.TransferFunction)
    for source in (sys, smc.interop.from_control(sys)) if linear else (sys,):
        assert prd.identify(source).prd == (1, 2)


def test_a_sweep_of_a_block_with_several_outputs_is_that_of_its_system():
    sys = control.tf([[[1.0], [0.5]], [[0.2], [1.0]]],
                     [[[1.0, 1.0], [1.0, 2.0]], [[1.0, 1.5], [1.0, 3.0, 1.0]]])
    wanted = prd.sweep(sys, (0.02, 0.1))
    found = prd.sweep(smc.interop.from_control(sys), (0.02, 0.1))
    assert found.prd == wanted.prd and str(found) == str(wanted)


def test_an_output_that_nothing_acts_on_has_no_relative_degree():
    result = prd.identify(control.ss(-np.eye(2), [[1.0], [0.0]], np.eye(2), np.zeros((2, 1))))
    assert result.prd == (1, None) and not result.confirmed


# ---- 200 generated plants ------------------------------------------------------------------------
def generated(count, seed, slow=0.01, fast=0.2):
    """(r, numerator, denominator): r = 1..5, 0 to 3 zeros; 1 root in 5 is unstable.

    Poles and zeros are `slow` to `fast` per window.
    """
    rng = np.random.default_rng(seed)

    def roots(n):
        made = []
        while len(made) < n:
            w, side = math.exp(rng.uniform(math.log(slow),
                                           math.log(fast))), 1.0 if rng.random() < 0.2 else -1.0
            zeta = rng.uniform(0.05, 0.95)
            pair = n - len(made) > 1 and rng.random() < 0.4
            made += [w*complex(side*zeta, q*math.sqrt(1.0 - zeta*zeta))
                     for q in (1, -1)] if pair else [side*w]
        return np.atleast_1d(np.poly(made)).real

    return [(k % 5 + 1, roots(m := rng.integers(0, 4)), roots(k % 5 + 1 + m)) for k in range(count)]


@pytest.fixture(scope="module")
def plants():
    """(r, response) of 200 plants."""
    return [(r, response(num, den, T)) for r, num, den in generated(200, 1)]


def scored(plants, noise, capsys):
    """How many answers are what, at the window 1."""
    score = Counter()
    for i, (r, y) in enumerate(plants):
        result = prd.identify((T, noisy(y, noise, i), 0.0, 1.0), window=1.0)
        score["correct"] += result.prd == r
        score["unresolved"] += result.prd is None
        score["wrong"] += result.prd not in (r, None)
        score["confirmed"] += result.confirmed and result.prd == r
        score["confirmed, wrong"] += result.confirmed and result.prd != r
        score["slope"] += result.power.prd == r
    with capsys.disabled():
        print(f"\n  noise {noise:g}: {dict(score)}", end="")
    return score


@pytest.mark.parametrize("noise", [0.0, 1e-9, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2])
def test_two_hundred_plants(plants, noise, capsys):
    score = scored(plants, noise, capsys)
    assert score["confirmed, wrong"] == 0
    assert score["wrong"] <= 0.01*len(plants)
    if noise == 0.0:
        assert score["correct"] >= 0.97*len(plants)
    if noise <= 1e-3:
        assert score["slope"] >= 0.9*len(plants)


@pytest.mark.parametrize("noise", [0.0, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2])
def test_two_hundred_faster_plants(noise, capsys):
    """Poles and zeros of 0.03 to 0.5 per window: the analyser alone often finds too few."""
    score = scored([(r, response(num, den, T)) for r, num, den in generated(200, 5, 0.03, 0.5)],
                   noise, capsys)
    assert score["wrong"] == 0
    if noise <= 1e-3:
        assert score["correct"] >= 0.9*200 and score["slope"] >= 0.97*200
    if noise == 0.0:
        assert score["correct"] == 200 and score["confirmed"] >= 0.8*200


def test_plants_about_as_fast_as_the_window(capsys):
    """Poles and zeros of 0.1 to 1 per window."""
    score = scored([(r, response(num, den, T)) for r, num, den in generated(200, 7, 0.1, 1.0)], 0.0,
                   capsys)
    assert score["confirmed, wrong"] == 0 and score["correct"] >= 0.9*200
    assert score["wrong"] <= 0.03*200


def test_the_window_left_to_it_is_not_taken_in_by_a_slope_on_its_way():
    """In noise only late motion is seen, whose slope passes whole numbers.

    Four of these can look confirmed, and wrong.
    """
    t = np.arange(-400, 1000)*0.01
    for i, (r, num, den) in enumerate(generated(60, 23, 0.1, 1.0)):
        y = response(num, den, t)
        y += 1e-2*np.abs(y).max()*np.random.default_rng(i).standard_normal(len(y))
        assert prd.identify((t, y, 0.0, 1.0)).prd in (r, None)


def test_the_window_left_to_it_gives_a_confirmed_answer_or_none():
    """Dynamics from slower to as fast as the record: what cannot be told is not told."""
    t, score = np.arange(-400, 1000)*0.01, Counter()
    for i, (r, num, den) in enumerate(generated(20, 3)):
        y = response(num, den, t)
        for noise in (0.0, 1e-4, 1e-2):
            hiss = noise*np.abs(y).max()*np.random.default_rng(i).standard_normal(len(y))
            result = prd.identify((t, y + hiss, 0.0, 1.0))
            assert result.prd in (r, None) and result.confirmed == (result.prd is not None)
            score[noise] += result.confirmed
    assert score[0.0] >= 18


# ---- noise and thin evidence ---------------------------------------------------------------------
@pytest.mark.parametrize("noise", [1e-6, 1e-5, 1e-4, 1e-3, 1e-2])
@pytest.mark.parametrize("k", range(1, 6))
def test_noise_never_makes_it_wrong_and_sure(k, noise):
    y = response([1.0], np.poly(-0.05*np.ones(k)), T)
    for seed in range(10):
        result = prd.identify((T, noisy(y, noise, seed), 0.0, 1.0), window=1.0)
        assert result.prd == k or not result.confirmed
        assert result.noise_floor == pytest.approx(noise, rel=0.3)


def uneven(y, rng):
    return T + np.r_[0.0, rng.uniform(-0.09, 0.09, len(T) - 2), 0.0]/N, y


def outliers(y, rng):
    return T, y + 0.3*np.isin(np.arange(len(T)), rng.integers(0, len(T), 5))


FAULTS = {
    "hum": lambda y, rng: (T, y + 1e-2*np.sin(3.0*T + rng.uniform(0, 6))),
    "loud hum": lambda y, rng: (T, y + 0.1*np.sin(20.0*T + rng.uniform(0, 6))),
    "drift": lambda y, rng: (T, y + 0.05*T),
    "rounded to 1/100 of the response": lambda y, rng: (T, np.round(y, 2)),
    "three digits": lambda y, rng: (T, np.array([float(f"{v:.3g}") for v in y])),
    "the step came 10 samples later": lambda y, rng: (T, np.r_[np.zeros(10), y[:-10]]),
    "the step came 10 samples before": lambda y, rng: (T, np.r_[y[10:], y[-10:]]),
    "uneven times": uneven,
    "outliers": outliers,
    "random walk": lambda y, rng: (T, y + 1e-3*np.cumsum(rng.standard_normal(len(T)))),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_of_logs_never_make_it_wrong_and_sure(plants, fault):
    for i, (r, y) in enumerate(plants[::4]):
        t, y = FAULTS[fault](y/np.abs(y[:501]).max(), np.random.default_rng(i))
        result = prd.identify((t, y, 0.0, 1.0), window=1.0)
        assert result.prd in (r, None) or not result.confirmed


def test_without_evidence_there_is_no_answer_but_a_reason():
    hiss = np.random.default_rng(0).standard_normal(len(T))
    result = prd.identify((T, hiss, 0.0, 1.0), window=1.0)
    assert result.prd is None and not result.confirmed
    assert "stands out of the noise" in result.reason
    assert str(result).startswith("The PRD is unresolved: ") and "no answer" in result.explain()
    assert math.isnan(result.gain)


def test_a_coarse_log_is_noise_even_where_it_is_silent():
    """Rounded to 1e-3 it is constant before the step; its fifth derivative is made of rounding."""
    y = response([1.0], np.poly(-0.05*np.ones(5)), T)
    y = np.round(y/y[500], 3)
    assert np.ptp(y[:250]) == 0.0
    result = prd.identify((T, y, 0.0, 1.0), window=1.0)
    assert result.analyser.prd is None
    assert result.noise_floor == pytest.approx(1e-3/math.sqrt(12), rel=0.5)
    assert result.prd in (5, None)


def test_a_plant_that_is_not_at_rest_is_refused_an_answer():
    y = response([1.0], [1.0, 0.0, 0.0], T) + 0.2*(T - T[0])
    result = prd.identify((T, y, 0.0, 1.0), window=1.0)
    assert result.prd is None and "not at rest" in result.reason
    # an offset is no motion
    still = prd.identify((T, response([1.0], [1.0, 0.0, 0.0], T) + 5.0, 0.0, 1.0), window=1.0)
    assert still.prd == 2 and still.confirmed


@pytest.mark.parametrize("sys", [control.tf([1.0, 2.0], [1.0, 3.0]), control.tf([2.0], [1.0]),
                                 control.tf([1.0], [1e-5, 1.0])])
def test_an_output_that_steps_itself_has_relative_degree_0(sys):
    result = prd.identify(sys)
    assert result.prd is None and "relative degree 0" in result.analyser.reason
    assert "relative degree 0" in result.power.reason


def test_orders_above_five_are_not_named():
    result = prd.identify(lags(6))
    assert result.prd is None and "above 5" in result.reason


def test_a_time_constant_of_the_size_of_the_window_is_not_confirmed():
    result = prd.identify(control.tf([1.0], [1.0, 1.0, 0.0]), window=2.5)
    assert (result.analyser.prd, result.power.prd, result.confirmed) == (1, 2, False)
    assert prd.identify(control.tf([1.0], [1.0, 1.0, 0.0]), window=0.1).confirmed


def test_records_of_any_unit_are_alike():
    y = response([1.0], np.poly(-0.1*np.ones(3)), T)
    plain = prd.identify((T, y, 0.0, 1.0), window=1.0)
    scaled = prd.identify((3.0 + 1e-6*T, 1e9*y + 4.0, 3.0, -2.0), window=1e-6)
    assert scaled.prd == plain.prd == 3 and scaled.confirmed
    assert scaled.gain == pytest.approx(plain.gain*1e9*1e18/-2.0, rel=1e-2)
    assert scaled.analyser.jump_times[2] == pytest.approx(3.0 + 1e-6*plain.analyser.jump_times[2],
                                                          abs=1e-7)


def test_responses_of_any_size_are_alike():
    y = response([1.0], np.poly(-0.1*np.ones(3)), T)
    for size in (1e-290, 1e298):
        result = prd.identify((T, size*y, 0.0, 1.0), window=1.0)
        assert result.prd == 3 and result.confirmed and result.gain == pytest.approx(size, rel=0.01)


def test_derivatives_take_the_mean_step_of_uneven_times():
    """y = t^2, whose first two samples are 5 % further apart than the others: z_2 = 2, not 1.8."""
    t = T.copy()
    t[1:-1] += 0.05/N
    result = prd.identify((t, t.clip(0.0)**2, 0.0, 1.0), window=1.0)
    assert result.analyser.derivatives[1, -200:].mean() == pytest.approx(2.0, rel=0.02)


def test_the_result_keeps_what_a_plot_needs():
    result = prd.identify(lags(2))
    assert result.analyser.derivatives.shape == (5, len(result.t))
    assert result.t.shape == result.y.shape
    assert len(result.analyser.jump_times) == 5
    assert result.t[0] <= result.analyser.jump_times[1] <= result.t[-1]
    late = result.t > 0.01
    exact = np.exp(-result.t[late])*(1.0 - result.t[late])
    assert result.analyser.derivatives[1, late] == pytest.approx(exact, rel=0.06)


# ---- CSV -----------------------------------------------------------------------------------------
def write(path, text):
    path = path/"log.csv"
    path.write_text(text, encoding="utf-8")
    return path


def lines(head, sep=",", point=".", scale=1.0, rows=600):
    """A log of a double integrator, stepped by 2 at 0.2 s."""
    t = np.arange(rows)*1e-3
    y = np.where(t > 0.2, (t - 0.2)**2, 0.0)
    body = [sep.join(f"{v:.9g}".replace(".", point)
                     for v in (a*scale, b, 1.0 + 2.0*(a > 0.2 - 1e-9)))
            for a, b in zip(t, y, strict=True)]
    return "\n".join([head, *body]) + "\n"


@pytest.mark.parametrize("head, sep, point, scale, said", [
    ("time [s],theta [rad],u [V]", ",", ".", 1.0,
     "delimiter comma; t = 'time' [s], y = 'theta' [rad], u = 'u' [V]"),
    ("t (ms);y;u", ";", ",", 1e3, "delimiter semicolon; t = 't' [ms], y = 'y' [?], u = 'u' [?]"),
    ("t\ty\tinput", "\t", ".", 1.0, "delimiter tab"),
    ("t y u", " ", ".", 1.0, "delimiter blank"),
    ("t [ms] theta [rad / s] u(V)", " ", ".", 1e3,
     "delimiter blank; t = 't' [ms], y = 'theta' [rad/s], u = 'u' [V]"),
])
def test_csv_in_many_forms(tmp_path, head, sep, point, scale, said):
    record = prd.read_csv(write(tmp_path, lines("# a log\n" + head, sep, point, scale)))
    assert said in str(record) and "600 rows, 3 columns" in str(record)
    assert "step of 2 at 0.2 s" in str(record)
    result = prd.identify(record, window=0.2)
    assert result.prd == 2 and result.gain == pytest.approx(1.0, rel=0.01)
    assert result.name == "log"


def test_csv_columns_by_name_and_a_second_step(tmp_path):
    t = np.arange(600)*1e-3
    u = (t > 0.2 - 1e-9)*1.0 - (t > 0.4 - 1e-9)*1.0
    y = np.where(t > 0.2, t - 0.2, 0.0)
    rows = [f"{i},{b:.9g},{a:.9g},{c:g}" for i, (a, b, c) in enumerate(zip(t, y, u, strict=True))]
    path = write(tmp_path, "\n".join(["row,y,t,u", *rows]))
    record = prd.read_csv(path, t="t", y="y", u="u")
    assert (record.step_time, record.amplitude,
            record.until) == (pytest.approx(0.2), 1.0, pytest.approx(0.4))
    assert prd.identify(record, window=0.1).prd == 1
    assert prd.read_csv(path, t="t", y="y", step_time=0.2, amplitude=3.0).amplitude == 3.0
    with pytest.raises(ParameterError, match="4 columns .row, y, t, u.: say which"):
        prd.read_csv(path)
    with pytest.raises(ParameterError, match="y = 'speed' does not exist; the columns are row, y, "
                                             "t, u"):
        prd.read_csv(path, t="t", y="speed")
    with pytest.raises(ParameterError, match="no column of the input: give step_time"):
        prd.read_csv(path, t="t", y="y")


def broken(row, new):
    """The log with one of its lines replaced."""
    text = lines("t,y,u").split("\n")
    text[row - 1] = new
    return "\n".join(text)


@pytest.mark.parametrize("text, said", [
    (broken(17, "0.015,abc,1"),
     r"log.csv, line 17: column 2 \('y'\): 'abc' is not a finite number"),
    (broken(17, "0.015,nan,1"), r"line 17: column 2 \('y'\): 'nan' is not a finite number"),
    (broken(17, "0.015,,1"), r"line 17: column 2 \('y'\): '' is not a finite number"),
    (broken(17, "0.015,0"), "line 17: 2 columns, but 3 names"),
    (broken(17, "0.013,0,1"), r"line 17: column 1 \('t'\): 0.013 after 0.014; times must increase"),
    (broken(1, "0.5,0,1"), "line 1: the first line must hold the names"),
    (broken(1, "t [fortnight],y,u"),
     r"unit of time \[fortnight\] is not known; it must be one of s, "),
    ("", "a line of names and lines of numbers are needed"),
    ("t\n1\n2\n", "only one column"),
    ("t,y,u\n" + "".join(f"{k},0,1\n" for k in range(200)), "the input 'u' never steps"),
])
def test_a_bad_csv_is_named_by_line_and_column(tmp_path, text, said):
    with pytest.raises(ParameterError, match=said):
        prd.read_csv(write(tmp_path, text))


def test_a_csv_that_is_not_there(tmp_path):
    with pytest.raises(ParameterError, match="none.csv: cannot be read"):
        prd.read_csv(tmp_path/"none.csv")
    for content, said in ((b"\xff\xfe\x00", "cannot be read"),
                          (b"\x89PNG\r\n\x1a\n\x00\x00", "only one column"),
                          (b"", "a line of names and lines of numbers are needed")):
        (tmp_path/"log.csv").write_bytes(content)
        with pytest.raises(ParameterError, match=said):
            prd.read_csv(tmp_path/"log.csv")


@pytest.mark.parametrize("code", ["utf-8", "utf-8-sig", "utf-16", "latin-1", "cp1252"])
def test_csv_in_many_codes(tmp_path, code):
    (tmp_path/"log.csv").write_bytes(("sep=;\r\n"
                                      + lines("t [µs];Höhe [m];u", ";", scale=1e6)).encode(code))
    record = prd.read_csv(tmp_path/"log.csv", t="t", y="Höhe")
    assert "t = 't' [µs], y = 'Höhe' [m], u = 'u' [?]; step of 2 at 0.2 s" in str(record)
    result = prd.identify(record, window=0.2)
    assert result.prd == 2 and result.gain == pytest.approx(1.0, rel=0.01)


def logged(u, **given):
    t = np.arange(600)*1e-3
    rows = (f"{a:.4f},{(a - 0.2)**2*(a > 0.2):.8f},{b:.6f}" for a, b in zip(t, u(t), strict=True))
    return prd.read_csv(io.StringIO("t,y,u\n" + "\n".join(rows)), **given)


def test_edges_of_a_measured_input():
    rng = np.random.default_rng(0)
    noisy = logged(lambda t: 2.0*(t >= 0.2) + 1e-3*rng.standard_normal(600))
    assert noisy.step_time == pytest.approx(0.2)
    assert noisy.amplitude == pytest.approx(2.0, abs=1e-3) and noisy.until == 0.599
    ramp = logged(lambda t: np.clip((t - 0.1985)/0.003, 0.0, 1.0))  # an edge of three samples
    assert (ramp.step_time, ramp.amplitude, ramp.until) == (pytest.approx(0.199), 1.0, 0.599)
    assert logged(lambda t: 1.0*(t >= 0.2) - 1.0*(t >= 0.4)).until == 0.4
    assert logged(lambda t: 1.0*(t >= 0.2), step_time=0.1995).amplitude == 1.0
    with pytest.raises(ParameterError, match="'u' does not step at step_time = 0.1 s, but at 0.2 "
                                             "s; give the amplitude"):
        logged(lambda t: 1.0*(t >= 0.2), step_time=0.1)
    said = ("'u' never steps: from sample to sample it changes by less than 5% of its range, or "
            "than 8 times its median change")
    for still in (np.clip((np.arange(600)*1e-3 - 0.2)/0.3, 0.0, 1.0),
                  1.0 + 1e-4*rng.standard_normal(600)):
        with pytest.raises(ParameterError, match=said):
            logged(lambda t, u=still: u)


def test_an_input_in_noise_or_with_a_spike():
    for seed in range(20):
        hiss = 0.02*np.random.default_rng(seed).standard_normal(600)
        record = logged(lambda t, d=hiss: 1.0*(t >= 0.2) - 1.0*(t >= 0.4) + d)
        assert (record.step_time, record.until) == (0.2, 0.4)
        assert record.amplitude == pytest.approx(1.0, abs=0.02)
    spike = 3.0*(np.arange(600) == 100) + 1e-3*np.random.default_rng(0).standard_normal(600)
    for given in ({}, dict(amplitude=1.0), dict(step_time=0.1)):
        with pytest.raises(ParameterError, match="'u' changes at 0.1 s, but not to stay: its "
                                                 "medians .* less than 5%"):
            logged(lambda t: 1.0*(t >= 0.2) + spike, **given)
    assert logged(lambda t: 1.0*(t >= 0.2) + spike,
                  step_time=0.2).amplitude == pytest.approx(1.0, abs=1e-3)


def test_three_columns_and_what_they_serve_for(tmp_path):
    path = write(tmp_path, lines("a,b,c"))
    assert str(prd.read_csv(path, t="a", y="b")) == str(prd.read_csv(path))
    assert prd.read_csv(path, t="a", y="b").amplitude == 2.0
    for given, said in ((dict(y="a"), "y = 'a' is already used as t"),
                        (dict(y="b", u="b"), "u = 'b' is already used as y"),
                        (dict(t="a", y="a"),
                         "y = 'a' is already used as t; each needs its own column")):
        with pytest.raises(ParameterError, match=said):
            prd.read_csv(path, **given)
    with pytest.raises(ParameterError, match="f = 'a' is already used as t"):
        smc.differentiators.read_csv(path, f="a")


def test_a_record_in_nanoseconds(tmp_path):
    probe = prd.experiment(prd.read_csv(write(tmp_path, lines("t [ns],y,u"))))
    assert probe().result.prd == 2 and probe().result.time_scale < 1e-6
    assert probe.with_(found=False, window=1e-10)().result.prd == 2


def test_a_record_of_names_for_numbers_is_refused():
    for given in (dict(name=5), dict(about=None)):
        with pytest.raises(ParameterError, match="is not allowed; it must be text"):
            prd.Record(T, Y, 0.0, **given)


@pytest.mark.parametrize("call, said", [
    (lambda: prd.read_csv(None),
     "prd.read_csv: path = None is not allowed; it must be a path or an open file"),
    (lambda: prd.read_csv(3), "path = 3 is not allowed"),
    (lambda: prd.read_csv("a\0b.csv"), "cannot be read: embedded null byte"),
    (lambda: logged(lambda t: 1.0*(t >= 0.2), step_time="a"),
     "prd.read_csv: step_time = 'a' is not allowed"),
    (lambda: logged(lambda t: 1.0*(t >= 0.2), amplitude="a"),
     "prd.read_csv: amplitude = 'a' is not allowed"),
    (lambda: prd.Record(T, T, 0.0, until="x"),
     "prd.Record: until = 'x' is not allowed; it must be a finite number, in s"),
    (lambda: prd.Record(T, T, 0.0, until=math.nan), "until = nan s is not allowed"),
    (lambda: prd.sweep(lags(1), [0.1, [0.2]]), r"windows = \[0.2\] is not allowed"),
    (lambda: prd.identify(control.nlsys(lambda t, x, u, p: -x + u, None, inputs=1, states=1),
                          x0="a"), "x0 holds text"),
])
def test_what_is_no_number_or_no_file_is_refused(call, said):
    with pytest.raises(ParameterError, match=said):
        call()


def test_a_file_without_a_name():
    with tempfile.TemporaryFile() as file:  # its name is a number
        file.write(lines("t,y,u").encode())
        file.seek(0)
        assert prd.read_csv(file).name == "file"


def test_a_column_needs_a_name_of_its_own(tmp_path):
    with pytest.raises(ParameterError, match="line 1: y = .y. names 2 columns"):
        prd.read_csv(write(tmp_path, lines("t,y,y")))


# ---- what is refused -----------------------------------------------------------------------------
Y = np.maximum(T, 0.0)


def changed(a, k, v):
    a = a.copy()
    a[k] = v
    return a


@pytest.mark.parametrize("source, said", [
    ((changed(T, 100, T[98]), Y, 0.0, 1.0),
     r"t\[100\] = -0.76 s is not allowed after -0.755 s; times must increase"),
    ((changed(T, 100, np.nan), Y, 0.0, 1.0),
     r"t\[100\] = nan is not allowed, the first of 1 samples"),
    ((T, changed(Y, 7, np.inf), 0.0, 1.0), r"y\[7\] = inf at t = -1.215 s is not allowed"),
    ((T, Y[:-1], 0.0, 1.0), r"they have the shapes \(520,\) and \(519,\)"),
    ((T, np.array([Y, Y]), 0.0, 1.0), r"they have the shapes \(520,\) and \(2, 520\)"),
    ((T, "abc", 0.0, 1.0), "y holds text; turn it into numbers first"),
    ((np.delete(T, 300), np.delete(Y, 300), 0.0, 1.0), "evenly spaced"),
    ((T, Y, 5.0, 1.0),
     "step_time = 5 s is not allowed; it must be inside the record, -1.25 to 1.345 s"),
    ((T, Y, -2.0, 1.0), "must be inside the record"),
    ((T, Y, -1.2, 1.0), "leaves 10 samples before the step; at least 20"),
    ((T, Y, 1.3, 1.0), "leaves 10 samples after the step; at least 53"),
    ((T, Y, 0.0, 0.0), r"amplitude = 0 \[u\] is not allowed"),
    ((T, Y, "now", 1.0), "step_time = 'now' s? ?is not allowed"),
    ((T[:30], Y[:30], 0.0, 1.0), "t has 30 values"),
    ((T, Y), r"it must be \(t, y, step_time, amplitude\)"),
    (3.0, "source = 3 is not allowed"),
    (control.tf([1.0], [1.0, 0.5], 0.1), "prd.identify: sys is discrete-time.*before control.c2d"),
    (control.frd(control.tf([1.0], [1.0, 1.0]), np.logspace(-1, 1, 20)),
     "prd.identify: sys = FrequencyResponseData is not allowed.*fit a transfer function"),
    (control.tf([1.0, 0.0, 0.0], [1.0, 1.0]), "improper"),
    (control.nlsys(lambda t, x, u, p: -x, None, inputs=1, states=1, dt=0.1, name="sampled"),
     "no inputs or is discrete-time"),
])
def test_bad_sources_are_named(source, said):
    with pytest.raises(ParameterError, match=said):
        prd.identify(source)


@pytest.mark.parametrize("settings, said", [
    (dict(window=0.0), "window = 0 s is not allowed; it must be larger than 0 s"),
    (dict(window=0.1),
     r"window = 0.1 s is not allowed; for record it must be from 0.2 s \(40 samples\) to 1.068 s"),
    (dict(window=2.0), "to 1.068 s"),
    (dict(alpha=0.9), "alpha = 0.9 is not allowed; it must be a finite number from 0.01 to 0.15"),
])
def test_bad_settings_are_named(settings, said):
    with pytest.raises(ParameterError, match=said):
        prd.identify((T, Y, 0.0, 1.0), **settings)


@pytest.mark.parametrize("window", np.geomspace(0.01, 30.0, 12))
def test_an_unstable_plant_has_its_relative_degree_or_none(window):
    """y = 1/((s + 1)(s - 2)): beyond its time constant all derivatives grow alike, none steps."""
    assert prd.identify(control.tf([1.0], [1.0, -1.0, -2.0]),
                        window=window).prd in ((2,) if window < 0.2 else (2, None))


@pytest.mark.parametrize("after", [*range(53, 60), 80, 106, 110])
def test_the_shortest_records_are_told_what_is_wrong_with_them(after):
    """Who gave no window is not told that a window is not allowed."""
    for offset in (0.0, 0.5):
        t = (np.arange(40 + after) - 40 + offset)*1e-3
        result = prd.identify((t, t.clip(0.0)**2, 0.0, 1.0))
        assert result.prd == 2 or "only one window fits" in result.reason
        assert prd.identify((t, t.clip(0.0)**2, 0.0, 1.0), window=0.04).prd == 2
    assert (result.prd == 2) == (after >= 106)
    with pytest.raises(ParameterError, match="leaves 52 samples after the step; at least 53"):
        prd.Record(T[:302], T[:302], 0.0)


def test_noise_is_added_seeded_and_heard():
    results = [prd.identify(lags(2), noise=1e-3) for _ in range(2)]
    assert np.array_equal(results[0].y, results[1].y) and results[0].prd == 2
    assert results[0].noise_floor == pytest.approx(1e-3, rel=0.3)
    with pytest.raises(ParameterError, match="noise = 2 is not allowed"):
        prd.identify(lags(2), noise=2.0)


def test_an_experiment_is_an_identification_with_a_sweep():
    e = prd.experiment(lv.transfer_function())
    assert list(e.params) == ["window", "amplitude", "alpha", "noise"] and not e.signals
    probe = e.with_(window=0.3)()
    assert (probe.result.prd, str(probe)) == (3,
                                              str(prd.identify(lv.transfer_function(), window=0.3)))
    assert probe.sweep.windows[0] == 1e-3 and set(probe.sweep.prd) >= {5, 3, 2}
    # the analyser alone says 4
    assert prd.sweep(lv.transfer_function(), (0.0562, 0.1)).prd == (5, 5)
    record = prd.experiment(tuple(q for q in (T, T.clip(0.0)**2, 0.0, 1.0)))
    assert record().result.prd == 2 and record().result.confirmed and set(record().sweep.prd) == {2}
    assert record.with_(found=False, window=0.5)().result.time_scale == 0.5
    with pytest.raises(ParameterError, match="window = 9 s is not allowed"):
        record.with_(found=False, window=9.0)()
    assert prd.experiment(runaway)().sweep.windows[-1] < 1.0  # it diverges in longer ones


@block(state=dict(a=0.0))
def runaway(x, u, d):
    return (50.0*x[0] + u + d,)


@block(state=dict(a=0.0))
def undefined(x, u, d):
    return (math.nan*x[0] + u + d,)


def test_stiff_models_are_stepped_finely_enough():
    """The motor's current settles in 1 ms: seen from 1 s it is gone, and the speed has settled."""
    lag = prd.identify(control.tf([1.0], np.polymul([1.0, 1.0], [1e-4, 1.0])), window=0.2)
    fast = control.nlsys(lambda t, x, u, p: np.array([-x[0] + x[1], -1e4*(x[1] - u[0])]), lambda t,
                         x, u, p: x[:1], inputs=1,
                         outputs=1, states=2)
    assert prd.identify(fast, window=0.2).prd == lag.prd == 1
    assert prd.identify(fast, window=0.2).y == pytest.approx(lag.y, abs=1e-6)
    p = motor.values
    exact = control.tf([p["k"]], [p["J"]*p["L"], p["J"]*p["R"], p["k"]**2])
    for window in (1e-4, 0.1):
        stepped, wanted = prd.identify(motor, output=speed,
                                       window=window), prd.identify(exact, window=window)
        assert stepped.y == pytest.approx(wanted.y, abs=1e-6*abs(wanted.y).max())
    assert prd.identify(motor, output=speed, window=1e-5).prd == 2


def test_bad_settings_of_models_are_named():
    with pytest.raises(ParameterError, match=r"amplitude = 0 \[u\] is not allowed"):
        prd.identify(lags(1), amplitude=0.0)
    with pytest.raises(ParameterError, match=r"x0 has the shape \(2,\)"):
        prd.identify(control.nlsys(lambda t, x, u, p: -x + u, None, inputs=1, states=1),
                     x0=(1.0, 2.0))
    with pytest.raises(ParameterError, match="runaway diverges .* s after the step; take a shorter "
                                             "window"):
        prd.identify(runaway, window=1.0)
    with pytest.raises(ParameterError, match="unstable diverges 7.15 s after the step; take a "
                                             "shorter window"):
        prd.identify(control.tf([1.0], [1.0, -100.0], name="unstable"), window=10.0)
    with pytest.raises(ParameterError, match="undefined does not stay finite even before the step"):
        prd.identify(undefined)
    for m in (1, 2):
        with pytest.raises(BlockError, match="'broken' cannot be evaluated at its initial state: "
                                             "ZeroDivisionError"):
            prd.identify(control.nlsys(lambda t, x, u, p: [1/0], None, inputs=m, states=1,
                                       name="broken"))
    with pytest.raises(ParameterError, match="window = 100 s is not allowed for motor, .* it must "
                                             "be at most"):
        prd.identify(motor.with_(L=1e-6), output=speed, window=100.0)
    with pytest.raises(ParameterError, match="window = 100 s is not allowed for fast, whose "
                                             "fastest time constant is 0.001 s"):
        prd.identify(control.nlsys(lambda t, x, u, p: -1e3*x + u, None, inputs=1, states=1,
                                   name="fast"), window=100.0)
    with pytest.raises(BlockError, match="could not be evaluated"):
        prd.identify(block(state=dict(a=(0.0, smc.Param())))(lambda x, u, d: (x[5],)))
    with pytest.raises(ParameterError, match="output and surface are for a plant block or a loop"):
        prd.identify(lags(1), output=speed)
    with pytest.raises(ParameterError, match="windows = -1 s is not allowed"):
        prd.sweep(lags(1), (-1.0,))
