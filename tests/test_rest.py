"""Which loops count as sliding: gains other than 1, latency, feedthrough, tails, jumps."""

import math

import control
import numpy as np
import pytest

import smcaero_nb as smc
from smcaero_nb import ClosedLoop, applications, block, interop, simulate, smc1, smc2
from smcaero_nb.core import reaching_time
from smcaero_nb.core.assumptions import exceeds
from smcaero_nb.core.rows import evaluated


@block(state=dict(y=1.0))
def lag(x, u, d, a=1.0, b=1.0):
    return b*u + d - a*x[0],


@block
def level(x):
    return x[0]


@block
def command(t, size=1.5):
    return size


@block
def push(t, size=0.5, w=2.0):
    return size*math.sin(w*t)


@block
def limited(u, high=0.5):
    return max(-high, min(high, u))


LOOP = ClosedLoop(lag, output=level, reference=command, perturbation=push, law=smc1.sign_smc,
                  duration=10.0, dt=1e-3)
STUCK = LOOP.with_(law=smc1.quasi_smc, perturbation__size=0.0)  # 19 eps = 1.9 could hide it


def named(q):
    return getattr(q, "name", str(q))


# ---- loops that slide ----------------------------------------------------------------------------
@pytest.mark.parametrize("b", [3.0, 10.0, 100.0])
@pytest.mark.parametrize("law", [smc1.sign_smc, smc1.quasi_smc, smc1.saturation_smc,
                                 smc1.dual_layer_smc, smc2.super_twisting], ids=named)
def test_more_gain_than_one_is_not_a_perturbation(law, b):
    """sigma' = f - b v with b > 1 slides if |f| < b rho: the more, the better."""
    run = simulate(LOOP.with_(law=law, plant__b=b))
    assert run.metrics().reaching_time < 1.0 and run.doubts() == []


@pytest.mark.parametrize("record", [100, 500, 10000])
def test_how_many_rows_are_kept_does_not_decide_whether_a_loop_slides(record):
    run = simulate(LOOP.with_(plant__b=5.0, latency=1e-3), record=record)
    assert reaching_time(run)[0] < 1.0 and run.doubts() == []


def test_less_gain_than_the_perturbation_needs_is_not_sliding():
    run = simulate(LOOP.with_(plant__b=0.5))
    assert reaching_time(run) == [math.inf] and run.doubts()


@pytest.mark.parametrize("law", ["quasi_continuous", "nested"])
def test_the_lag_of_a_motor_is_not_a_perturbation_beyond_the_bound(law):
    """Its current follows the chattering voltage late; the voltage that is needed is its mean."""
    run = simulate(applications.dc_motor(law, "angle"))
    v, t = run.integral_v[len(run.t)//2:], run.t[len(run.t)//2:]
    needed = np.abs(v[40:] - v[:-40])/(t[40:] - t[:-40])
    assert needed.max() < run.loop.stages["law"].values["L"] and run.doubts() == []


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_a_latency_of_a_few_samples_is_not_a_perturbation(samples):
    run = simulate(LOOP.with_(latency=samples*1e-3))
    assert run.metrics().reaching_time < 1.0 and run.doubts() == []


def test_an_adaptive_gain_that_nears_its_accepted_size_slowly_is_at_rest():
    run = simulate(LOOP.with_(law=smc1.adaptive_quasi_smc))
    assert 0.0 < run.metrics().reaching_time < 1.0 and run.doubts() == []


@pytest.mark.parametrize("tail", [0.0, 1e-3, 0.9, 1.0])
def test_the_tail_that_is_asked_for_does_not_decide_whether_a_loop_slides(tail):
    good, bad = simulate(LOOP, tail=tail), simulate(LOOP.with_(law__rho=1.2), tail=tail)
    assert reaching_time(good) == reaching_time(simulate(LOOP)) and good.doubts() == []
    assert reaching_time(bad) == [math.inf] and bad.doubts()
    assert "nan" not in str(good.metrics())


@pytest.mark.parametrize("since", [5.0, 9.0, 9.9])
def test_a_stretch_of_a_run_is_not_judged_by_what_was_before(since):
    run = simulate(LOOP.with_(law=smc2.super_twisting), since=since)
    assert run.doubts() == [] and since <= reaching_time(run)[0] < since + 0.01


@pytest.mark.parametrize("period", [3.0, 6.3, 16.0])
def test_a_command_that_jumps_in_the_tail_does_not_end_sliding(period):
    @block
    def square(t, period=period):
        return 1.5 if t % period < 0.5*period else 1.2

    run = simulate(LOOP.with_(reference=square, law__rho=4.0))
    assert run.doubts() == [] and reaching_time(run)[0] < 10.0
    ended = simulate(LOOP.with_(reference=square, reference__period=20.0, law__rho=4.0))
    assert ended.doubts() == []  # it jumps at the very end
    weak = simulate(LOOP.with_(reference=square, law__rho=1.2))
    assert reaching_time(weak) == [math.inf] and weak.doubts()


def test_at_a_long_sampling_step_the_way_to_sigma_is_not_rest():
    run = simulate(LOOP, tau=0.05)
    assert 0.1 < reaching_time(run)[0] < 0.6  # 0.5 = sigma(0) at |sigma'| of 1 to 3


# ---- loops that do not ---------------------------------------------------------------------------
@pytest.mark.parametrize("latency", [0.05, 0.1, 0.5])
def test_a_limit_cycle_by_latency_is_not_sliding(latency):
    """Relay and lag: y_max = rho (1 - exp(-latency))."""
    run = simulate(LOOP.with_(latency=latency, plant__y=0.3, reference__size=0.0,
                              perturbation__size=0.0))
    assert run.tail_sigma == pytest.approx(2.0*(1.0 - math.exp(-latency)), rel=0.02)
    assert reaching_time(run) == [math.inf] and "does not come to rest" in run.doubts()[0]


@pytest.mark.parametrize("changes, word", [
    (dict(actuator=limited), "latched"),
    (dict(actuator=limited, plant__a=0.1, perturbation=command, perturbation__size=-0.7),
     "at the limit"),
    (dict(plant__b=0.0, plant__a=0.0), "v does not move sigma"),
    (dict(plant__b=-1.0, law__rho=1.0, reference__size=0.5), "the gain has the wrong sign"),
    (dict(plant__b=0.0, perturbation__size=0.5), "more than rho")], ids=range(5))
def test_the_wide_band_of_a_sigmoid_hides_no_failure(changes, word):
    run = simulate(STUCK.with_(**changes))
    assert run.tail_sigma < 1.9 + 5e-3 or word == "at the limit"
    assert reaching_time(run) == [math.inf] and word in "; ".join(run.doubts())


@pytest.mark.parametrize("law", [smc1.sign_smc, smc1.quasi_smc, smc2.super_twisting], ids=named)
def test_a_sigma_that_depends_on_u_does_not_slide_and_the_way_out_does(law):
    g = control.tf([1.0, 3.0, 1.0], [1.0, 3.0, 2.0])

    def loop(sys):
        plant = interop.from_control(sys)
        return ClosedLoop(plant, output=plant.y, reference=command, law=law, duration=20.0,
                          dt=1e-3).with_(reference__size=0.5)

    run = simulate(loop(g))
    assert reaching_time(run) == [math.inf] and "relative degree 0" in run.doubts()[0]
    lagged = simulate(loop(g*control.tf([1.0], [0.2, 1.0])))
    assert reaching_time(lagged)[0] < 10.0 and lagged.doubts() == []


def test_a_law_without_a_card_slides_on_the_sigma_that_it_sees():
    @block
    def alone(t):
        return math.sin(t)

    @block
    def relay(sigma):
        return 2.0 if sigma > 0.0 else -2.0

    assert simulate(LOOP.with_(law=alone)).metrics().reaching_time is None
    assert simulate(LOOP.with_(law=relay)).metrics().reaching_time < 1.0


def test_a_size_and_its_bound_are_told_apart():
    assert exceeds("L")(dict(L=2.0), 2.0043, 0.0) == "|xi| reaches 2.0043, more than L = 2 [v]"
    assert exceeds("L")(dict(L=2.0), 2.5678, 0.0) == "|xi| reaches 2.57, more than L = 2 [v]"


# ---- stages evaluated once more ------------------------------------------------------------------
def test_a_limit_in_a_chain_of_actuators_is_seen():
    """A block in series is not one beside: what the chain gives is what its last block gives."""
    half = block(lambda u: 0.5*u)
    limit = block(lambda u: max(-0.5, min(0.5, u)))
    loop = ClosedLoop(block(state=dict(y=0.0))(lambda x, u: (u - x[0],)),
                      output=block(lambda x: x[0]), reference=block(lambda t: 1.0),
                      law=smc.smc2.super_twisting, duration=10.0, dt=1e-2)
    for actuator in (limit, smc.chain(half=half, limit=limit), smc.chain(limit=limit, half=half)):
        said = simulate(loop.with_(actuator=actuator), jit=False).doubts()
        assert "u is at the limit of the actuator for 100 % of the tail" in said, actuator


def test_a_chain_of_surfaces_is_evaluated_on_the_true_error():
    line = block(lambda e: e[1] + 2.0*e[0])
    twice, plain = block(lambda e: 2.0*e), smc.chain(line=line, twice=block(lambda e: 1.0*e))
    angle = smc.differentiators.differentiator(1).with_(L=5.0)
    loop = smc.applications.double_integrator("sign_smc").with_(differentiator=angle)
    runs = [simulate(loop.with_(surface=s), 3.0, jit=False)
            for s in (line, plain, smc.chain(line=line, twice=twice))]
    np.testing.assert_array_equal(runs[1].true_sigma, runs[0].true_sigma)
    np.testing.assert_allclose(runs[2].true_sigma, 2.0*(
        runs[2].e[1] + 2.0*runs[2].e[0] if isinstance(runs[2].e, tuple)
        else np.gradient(runs[2].e, runs[2].t) + 2.0*runs[2].e), atol=1e-9)


def test_a_stage_is_evaluated_with_its_own_salt_and_sample():
    grain = block(lambda u, k, salt: u + float((k*2654435761 + salt) % 1000))
    loop = ClosedLoop(block(state=dict(y=0.0))(lambda x, u: (0.0*u,)), duration=1.0, dt=0.1,
                      law=block(lambda e: e), actuator=grain)
    for actuator in (grain, smc.chain(a=grain, b=grain)):
        run = simulate(loop.with_(actuator=actuator), jit=False)
        np.testing.assert_array_equal(evaluated(run, "actuator", {"u": run.v})[:-1], run.u[:-1])
