"""Figures of merit: exact values on runs that can be worked out by hand."""

import math

import control
import numpy as np
import pytest

import smcaero_nb as smc
from smcaero_nb import ClosedLoop, Metrics, block, simulate
from smcaero_nb.core import reaching_time


@block(state=dict(s=1.0))
def falls(u):
    return (-u,)


@block
def itself(x):
    return x[0]


@block
def minus(x):
    return -x[0]


@block
def triangle(t):
    """1, 0, -1, 0, 1, ... one step of 1/8 s each."""
    k = round(t*8) % 4
    return 1.0 - k if k < 2 else k - 3.0


def test_means_and_chattering_of_a_wave_that_is_known():
    run = simulate(ClosedLoop(falls, output=minus, allocation=triangle), 4.0, 1/8, tail=0.5,
                   record=32, jit=False)
    assert list(run.u[:5]) == [1.0, 0.0, -1.0, 0.0, 1.0]
    m = run.metrics()
    assert m.J_u == 0.5 and m.max_u == 1.0
    assert m.J_e == np.abs(run.e[:-1]).mean()
    assert run.variation_u == 33.0  # 32 steps of one, and the first from rest
    assert run.tail_variation_u == 17.0 and m.variation_u == 17.0/2.0
    assert run.tail_turns_u == 8.0 and m.turns_u == 4.0  # twice a period of 1/2 s
    assert m.tail_e == np.abs(run.e[16:]).max() and m.diverged_at is None


def test_reaching_time_of_a_relay_is_exact_to_a_row():
    loop = ClosedLoop(falls, output=minus, law=smc.smc1.sign_smc.with_(rho=0.5))
    run = simulate(loop, 4.0, 1/64, record=256, jit=False)
    # 1 - t/2 <= 1/4 from 1.5 on; a row covers what came before it
    assert reaching_time(run, band=0.25) == [1.5 + 1/64]
    assert (run.tail_sigma == 0.0
            and reaching_time(run) == [2.0 + 1/64] == [run.metrics().reaching_time])
    assert reaching_time(run, band=2.0) == [0.0]
    assert reaching_time(simulate(loop, 1.0, 1/64, jit=False), band=0.25) == [math.inf]


def test_reaching_time_is_the_same_from_either_side_and_begins_where_sampling_allows():
    loop = ClosedLoop(falls, output=minus, law=smc.smc1.sign_smc.with_(rho=0.7))
    down, up = (simulate(loop.with_(plant__s=s), 4.0, 1/64, record=256, jit=False)
                for s in (1.0, -1.0))
    assert down.tail_sigma == up.tail_sigma > 0.0
    for band in (0.5, 2*up.tail_sigma):
        assert reaching_time(down, band) == reaching_time(up, band)
    near = 5*0.7/64 + 1e-5  # what sigma moves in five samples, and what counts as zero
    assert reaching_time(up) == reaching_time(up, near) == reaching_time(down)
    assert reaching_time(up, 0.999*up.tail_sigma) == [math.inf]


def test_a_band_is_judged_on_every_step_not_on_the_rows():
    @block(state=dict(k=0.0))
    def spikes(e, z):
        """Zero at every even step."""
        return e*(z[0] % 2.0), (z[0] + 1.0,)

    run = simulate(ClosedLoop(falls, output=minus, surface=spikes, allocation=triangle), 4.0, 1/8,
                   record=16, jit=False)
    assert np.all(run.sigma[:-1] == 0.0)
    assert reaching_time(run, band=0.1) == [math.inf]


def test_a_reference_that_is_met_from_the_start():
    run = simulate(ClosedLoop(falls, reference=one, output=itself, law=smc.smc1.sign_smc), 1.0, 0.1,
                   jit=False)
    m = run.metrics()
    assert m == Metrics(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, None, rms_e=0.0, iae=0.0, ise=0.0,
                        energy_u=0.0)


@block
def one(t):
    return 1.0


def test_rows_text_and_table_say_the_same():
    m = Metrics(0.5, (1.0, 2.0), 3.0, 0.25, 0.125, math.inf, 12345.678, 4.0, None)
    assert m.rows() == [("J_e", "0.5", ""), ("J_u", "1, 2", ""), ("max_u", "3", ""),
                        ("tail_e", "0.25", ""),
                        ("tail_sigma", "0.125", ""), ("reaching_time", "not reached", "s"),
                        ("variation_u", "1.235e+04", "1/s"),
                        ("turns_u", "4", "1/s")]
    assert str(m) == ("J_e = 0.5   J_u = 1, 2   max_u = 3   tail_e = 0.25   tail_sigma = 0.125   "
                      "reaching_time = not reached   "
                      "variation_u = 1.235e+04 1/s   turns_u = 4 1/s")
    table = m._repr_html_()
    assert table.count("<th>") == table.count("<td>") == 8
    assert "<th>reaching_time [s]</th>" in table and "<td>1.235e+04</td>" in table
    assert "diverged_at = 2.5 s" in str(Metrics(0.5, 1.0, 3.0, 0.25, 0.125, math.inf, 1.0, 4.0,
                                                2.5))


def test_usual_figures_stand_in_a_second_row():
    m = Metrics(0.5, 1.0, 3.0, 0.25, 0.125, None, 1.0, 4.0, None, settling_time=math.inf,
                rise_time=0.5, overshoot=(0.0, 12.5), rms_e=0.1, iae=2.0, ise=1.5, energy_u=3.0)
    first, second = str(m).split("turns_u = 4 1/s   ")
    assert first.endswith("variation_u = 1 1/s   ") and "reaching_time" not in first
    assert second == ("settling_time = not settled   rise_time = 0.5 s   overshoot = 0, 12.5 %   "
                      "rms_e = 0.1   iae = 2 s   ise = 1.5 s   energy_u = 3 s")
    table = m._repr_html_()
    assert table.count("<tr>") == 4 and table.index("J_e") < table.index("settling_time")
    mixed = Metrics(0.5, 1.0, 3.0, 0.25, 0.125, (None, 2.0), 1.0, 4.0, None)
    assert ("reaching_time", "no sliding, 2", "s") in mixed.rows()


# ---- usual figures -------------------------------------------------------------------------------
@block
def through(r):
    """The reference itself as control."""
    return r


@pytest.mark.parametrize("system", [
    control.tf([1.0], [1.0, 1.0]), control.tf([4.0], [1.0, 1.2, 4.0]),
    control.tf([1.0], [1.0, 2.0, 1.0]), control.tf([9.0], [1.0, 0.9, 9.0]),
    control.tf([6.0], [1.0, 6.0, 11.0, 6.0])], ids=str)
@pytest.mark.parametrize("size", [1.0, -2.0])
def test_figures_of_a_step_are_those_of_python_control(system, size):
    plant = smc.interop.from_control(system)
    loop = ClosedLoop(plant, output=plant.y, reference=one if size == 1.0 else minus_two,
                      law=through)
    run = simulate(loop, 20.0, 1e-3, record=20000, method="rk4", jit=False)
    m, info = run.metrics(), control.step_info(run.y, run.t, yfinal=size)
    assert m.settling_time == pytest.approx(info["SettlingTime"], abs=2e-3)
    assert m.rise_time == pytest.approx(info["RiseTime"], abs=2e-3)
    assert m.overshoot == pytest.approx(info["Overshoot"], abs=1e-6)


@block
def minus_two(t):
    return -2.0


@block
def stairs(t):
    return 1.0 if t < 2.0 else 3.0


def test_a_step_is_the_last_one_of_the_reference():
    """x' = u - x, u = r: from 1 - e^-2 at 2 s towards 3."""
    @block(state=dict(x=0.0))
    def lag(x, u):
        return (u - x[0],)

    run = simulate(ClosedLoop(lag, output=itself, reference=stairs, law=through), 10.0, 1e-3,
                   record=10000, jit=False)
    m = run.metrics()
    assert m.settling_time == pytest.approx(math.log(50.0), abs=3e-3)
    assert m.rise_time == pytest.approx(math.log(9.0), abs=3e-3) and m.overshoot == 0.0


def test_a_reference_that_does_not_stay_makes_no_step():
    @block
    def wave(t):
        return math.sin(t)

    m = simulate(ClosedLoop(falls, output=itself, reference=wave, law=smc.smc1.sign_smc), 1.0, 0.01,
                 jit=False).metrics()
    assert (m.settling_time, m.rise_time, m.overshoot) == (None, None, None)
    assert "settling_time" not in str(m)


def test_integrals_are_those_of_an_exponential():
    """e = exp(-t) from x' = -x: int |e| = 1, int e^2 = int u^2 = 1/2."""
    @block(state=dict(x=1.0))
    def decay(x, u):
        return (u,)

    @block
    def proportional(e):
        return e

    run = simulate(ClosedLoop(decay, output=itself, law=proportional), 20.0, 1e-3, jit=False,
                   record=20000)
    m = run.metrics()
    assert m.iae == pytest.approx(1.0, rel=2e-3) and m.ise == pytest.approx(0.5, rel=2e-3)
    assert m.rms_e == pytest.approx(math.sqrt(0.5/20.0), rel=2e-3)
    assert m.energy_u == pytest.approx(0.5, rel=2e-3) and m.limit_time is None


def test_time_at_the_limit_of_the_actuator():
    """x' = u from 3 with |u| <= 1 and u = -2 x: at the limit while x > 1/2, 2.5 s."""
    @block
    def twice(e):
        return 2.0*e

    @block
    def limited(u, high=1.0):
        return max(-high, min(high, u))

    loop = ClosedLoop(rises.with_(s=3.0), output=itself, law=twice, actuator=limited)
    run = simulate(loop, 10.0, 1e-2, jit=False)
    assert run.metrics().limit_time == pytest.approx(2.5, abs=0.2)
    assert simulate(loop.with_(actuator__high=10.0), 10.0, 1e-2,
                    jit=False).metrics().limit_time == 0.0


@block(state=dict(s=1.0))
def rises(u):
    return (u,)
