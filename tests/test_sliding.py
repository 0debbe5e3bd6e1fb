"""Whether a run slides: reaching times of all laws, and what is said of those that do not."""

import math

import numpy as np
import pytest
from designs import DESIGNS, judged, settled

from smcaero_nb import ClosedLoop, block, channels, hosmc, lv, simulate, smc1, smc2
from smcaero_nb.applications import double_integrator, perturbed_chain
from smcaero_nb.core import reaching_time
from smcaero_nb.differentiators import differentiator
from smcaero_nb.smc2 import gains


def named(q):
    """The name of a law in that of its test."""
    return getattr(q, "name", q)


# ---- laws that slide -----------------------------------------------------------------------------
@pytest.mark.parametrize(("law", "r"), [q[:2] for q in DESIGNS], ids=named)
def test_every_law_reaches_sliding_at_every_step_with_and_without_perturbation(law, r):
    """Some adaptive laws accept less than what sampling every 10 ms makes of sigma: their gains
    grow for ever there."""
    for tau in (1e-2, 2.5e-3):
        for run in settled(law, r, tau, jit=False):
            judged(law, run)


@pytest.mark.parametrize(("law", "r"), [
    (smc1.sign_smc, 1), (smc2.super_twisting, 1), (hosmc.nested(3), 3)],
    ids=named)
def test_and_at_small_steps(law, r):
    for tau in (1e-3, 1e-4):
        for run in settled(law, r, tau):
            judged(law, run)


def test_a_reaching_time_is_that_of_the_theory():
    for rho in (1.0, 2.0, 4.0):
        law = smc1.sign_smc.with_(rho=rho)
        run = simulate(perturbed_chain(law, 1).with_(perturbation=None, plant__s0=3.0), 8.0,
                       jit=False, record=8000, dt=1e-3, tau=1e-3)
        assert run.metrics().reaching_time == pytest.approx(3.0/rho, abs=5e-3)


def test_the_smallest_reaching_time_is_never_a_failure():
    base = ClosedLoop(lag, output=level, reference=command, law=smc1.sign_smc, perturbation=push,
                      duration=10.0, dt=1e-3)
    runs = {size: simulate(base.with_(perturbation__size=size)) for size in (0.5, 3.0, 5.0, -4.0)}
    times = {size: run.metrics().reaching_time for size, run in runs.items()}
    assert min(times, key=times.get) == 0.5 and math.isfinite(times[0.5])
    assert times[5.0] == times[-4.0] == math.inf
    assert not any(math.isnan(v) for v in times.values())


@pytest.mark.parametrize("law", ["pd", "pid"])
def test_laws_without_sliding_have_no_reaching_time(law):
    run = simulate(lv.loop(law), 3.0, 1e-4)  # at 1 ms Euler does not follow the bending mode
    assert run.metrics().reaching_time is None and reaching_time(run) == [None]
    assert "reaching_time" not in str(run.metrics())
    assert not any("sigma" in q or "xi" in q for q in run.doubts())
    assert reaching_time(run, band=1e9) == [0.0]


# ---- loops that do not ---------------------------------------------------------------------------
@block(state=dict(y=0.0))
def lag(x, u, d, a=1.0, b=1.0):
    return -a*x[0] + b*u + d,


@block(state=dict(y=0.0, dy=0.0))
def mass(x, u, d, b=1.0):
    return x[1], b*u + d


@block
def level(x):
    return x[0]


@block
def both(x):
    return x[0], x[1]


@block
def command(t, size=1.0):
    return size


@block
def push(t, size=-4.0):
    return size


@block
def limited(u, high=0.5):
    return max(-high, min(high, u))


@block(state=dict(y=0.0))
def slow(u, z, tau, T=0.1):
    """An actuator of first order."""
    y = z[0] + (1.0 - math.exp(-tau/T))*(u - z[0])
    return y, (y,)


@block(state=dict(last=0.0))
def with_rate(e, z, tau):
    return (e, (e - z[0])/tau), (e,)


RELAYS = (smc1.sign_smc, smc1.saturation_smc, smc1.tanh_smc, smc1.quasi_smc.with_(eps=1e-3),
          hosmc.quasi_continuous(1).with_(L=1.5, alpha=1.4))
GROWING = (smc1.adaptive_smc, smc1.adaptive_quasi_smc, smc2.adaptive_super_twisting)


def first(law, **stages):
    """The law on a plant of first order, 2000 samples."""
    return ClosedLoop(lag, output=level, reference=command, law=law, duration=10.0, dt=5e-3,
                      **stages)


def second(law, **stages):
    return ClosedLoop(mass.with_(y=1.0), output=both, law=law, duration=20.0, dt=5e-3, **stages)


def lost(loop, *words):
    """The run has no reaching time, and a doubt with these words."""
    run = simulate(loop, jit=False)
    m, said = run.metrics(), "\n".join(run.doubts())
    assert m.reaching_time == math.inf and "reaching_time = not reached" in str(m)
    assert "<td>not reached</td>" in m._repr_html_()
    for word in words:
        assert word in said, said


@pytest.mark.parametrize("law", RELAYS, ids=named)
def test_a_constant_sigma_is_not_sliding(law):
    lost(first(law, perturbation=push), "stands still", "latched")


@pytest.mark.parametrize("law", RELAYS, ids=named)
def test_a_growing_sigma_is_not_sliding(law):
    lost(first(law, perturbation=push).with_(plant__a=0.0), "more than", "does not come to rest")


@pytest.mark.parametrize("law", (*RELAYS[:3], *GROWING, smc2.super_twisting), ids=named)
def test_an_actuator_at_its_limit_is_named(law):
    lost(first(law, actuator=limited), "u is at the limit of the actuator for 100 % of the tail")


@pytest.mark.parametrize("law", (*RELAYS[:2], *GROWING, smc2.super_twisting), ids=named)
def test_the_wrong_sign_of_the_gain_is_named(law):
    lost(first(law).with_(plant__b=-1.0, plant__a=0.1), "the gain has the wrong sign")


@pytest.mark.parametrize("law", GROWING, ids=named)
def test_a_gain_that_grows_for_ever_is_named(law):
    lost(first(law, actuator=limited), "still grows at the end")


@pytest.mark.parametrize("law", (smc1.adaptive_smc, smc1.adaptive_quasi_smc), ids=named)
def test_a_gain_that_noise_drives_is_named(law):
    """rho' = gamma |sigma| where |sigma| > delta: noise larger than delta drives it for ever."""
    @block
    def noisy(t, x, eps=0.1):
        q = math.sin(12345.678*t + 1.0)*43758.5453
        return x[0] + eps*2.0*(q - math.floor(q) - 0.5)

    loop = first(law).with_(output=noisy)
    assert "rho still grows" in "".join(simulate(loop, jit=False).doubts())
    assert simulate(loop.with_(law__delta=0.3), jit=False).doubts() == []


@pytest.mark.parametrize(("law", "T"), [
    (hosmc.quasi_continuous(2), 0.1), (hosmc.quasi_continuous(2, "levant2005"), 0.2),
    (hosmc.nested(2), 0.1), (hosmc.nested(2), 0.3), (hosmc.quasi_continuous(2).with_(L=3.0), 0.2)],
    ids=named)
def test_a_limit_cycle_behind_a_slow_actuator_is_not_sliding(law, T):
    lost(second(law, actuator=slow.with_(T=T)), "swings within")


@pytest.mark.parametrize("T", (0.1, 0.2, 0.4))
def test_super_twisting_behind_a_slow_actuator_is_a_limit_cycle(T):
    law = smc2.super_twisting.with_(lam=3.0, beta=4.0)
    lost(first(law, actuator=slow.with_(T=T)).with_(plant__a=0.0), "swings within")
    if T > 0.3:
        return  # twisting is lost there
    twisting = smc2.twisting.with_(**gains(1.0).twisting)
    lost(first(twisting, surface=with_rate, actuator=slow.with_(T=T)).with_(plant__a=0.0),
         "swings within")


def test_channels_are_judged_one_by_one():
    @block(state=dict(a=1.0, b=1.0))
    def two(x, u, d):
        return -u[0], 4.0 - u[1]

    @block
    def negative(x):
        return (-x[0],), (-x[1],)

    run = simulate(ClosedLoop(two, output=negative, duration=5.0, dt=5e-3, law=channels(
        a=smc1.sign_smc, b=smc1.sign_smc)), jit=False)
    good, bad = run.metrics().reaching_time
    assert good == pytest.approx(0.5, abs=0.05) and bad == math.inf
    assert [q.partition(":")[0] for q in run.doubts()] == ["b"]


def test_a_run_that_still_approaches_has_not_reached_but_raises_no_doubt():
    run = simulate(first(smc1.sign_smc.with_(rho=1.1)).with_(plant__a=0.0, reference__size=20.0),
                   jit=False)
    assert run.metrics().reaching_time == math.inf and run.doubts() == []


# ---- conditions of laws --------------------------------------------------------------------------
@pytest.mark.parametrize(("law", "r", "alpha", "word"), [
    (hosmc.quasi_continuous(2), 2, 1.9, "less than 2,"),
    (hosmc.quasi_continuous(3), 3, 4.5, "less than 5,"),
    (hosmc.quasi_continuous(4), 4, 10.0, "less than 12,"),
    (hosmc.quasi_continuous(2, "levant2005"), 2, 1.7, "less than 2,"),
    (hosmc.quasi_continuous(3, "levant2005"), 3, 7.0, "less than 9,"),
    (hosmc.nested(3), 3, 4.0, "less than 5,"), (hosmc.nested(4), 4, 10.0, "less than 13,"),
    (hosmc.nested(2), 2, 1.5, "alpha > 1 + b^2/2"), (hosmc.nested(2), 2, 1.2, "alpha > 1 + b^2/2")],
    ids=named)
def test_a_gain_that_did_not_settle_in_every_trial_is_named(law, r, alpha, word):
    run = simulate(perturbed_chain(law, r).with_(law__alpha=alpha, perturbation__xi_1=0.3), 5.0,
                   2e-3, 2e-3, jit=False)
    assert word in run.doubts()[0]


@block
def worst(t, x, size=1.0, last=1.0):
    """The bound, with the sign of the first or the last derivative."""
    q = x[-1] if last else x[0]
    return size*(1.0 if q > 0.0 else -1.0 if q < 0.0 else 0.0)


@pytest.mark.parametrize(("law", "low", "least"), [
    (hosmc.quasi_continuous(2), 1.2, 2.0), (hosmc.nested(2), 1.1, 1.6)], ids=named)
def test_below_it_some_trial_does_not_settle_and_above_it_all_do(law, low, least):
    base = perturbed_chain(law, 2).with_(perturbation=worst)
    rng = np.random.default_rng(5)
    starts = rng.normal(size=(8, 2))*(9.0, 3.0)

    def failures(alpha):
        runs = (simulate(base.with_(law__alpha=alpha, perturbation__last=last, plant__s0=s,
                                    plant__s1=ds), 60.0, 1e-3, 1e-3, tail=0.1, record=400)
                for s, ds in starts.tolist() for last in (0.0, 1.0))
        return sum(abs(run.tail_sigma) > 0.1 for run in runs)

    assert failures(low) > 0 and failures(least) == 0


def test_on_its_inner_surface_nested_needs_alpha_larger_than_one_and_a_half():
    """There s_1 = -|s_0|^(1/2) sign(s_0), so that s_1' = sign(s_0)/2: with xi = 1 the relay has to
    give more than 3/2 to hold it."""
    on = dict(plant__s0=4.0, plant__s1=-2.0, perturbation=None)
    base = perturbed_chain(hosmc.nested(2), 2).with_(**on)
    away = {}
    for alpha in (1.4, 1.6):
        loop = base.with_(law__alpha=alpha, perturbation=worst)
        run = simulate(loop, 2.0, 1e-4, 1e-4, record=10**6, jit=False)
        s, ds = run.sigma
        held = s > 0.1
        away[alpha] = np.abs(ds + np.sqrt(np.abs(s)))[held].max()
    assert away[1.6] < 1e-3 < 0.05 < away[1.4]


def test_twisting_is_judged_by_its_gains_and_not_by_the_bound_that_was_declared():
    loop = perturbed_chain(smc2.twisting, 1).with_(perturbation__omega=3.0)  # |xi'| = 2.4
    strong = loop.with_(law__alpha_1=10.0, law__alpha_2=5.0)
    assert simulate(strong).doubts() == [] and strong.stages["law"].values["L"] == 1.0
    for alpha_1, alpha_2 in ((4.4, 2.2), (7.0, 2.2), (5.0, 2.8), (3.0, 1.5), (10.0, 1.1)):
        why, = simulate(loop.with_(law__alpha_1=alpha_1, law__alpha_2=alpha_2)).doubts()
        assert f"min(alpha_2, alpha_1 - alpha_2) = {min(alpha_2, alpha_1 - alpha_2):g}" in why


@pytest.mark.parametrize(("r_0", "omega"), [(0.4, 1.0), (0.4, 2.0), (0.5, 1.5), (0.6, 2.0),
                                            (0.8, 4.0)])
def test_a_dual_layer_gain_that_cannot_follow_is_named(r_0, omega):
    loop = perturbed_chain(smc1.dual_layer_smc, 1).with_(
        perturbation__omega=omega, perturbation__xi_1=3.0, law__gamma=0.0, law__r_0=r_0)
    run = simulate(loop, dt=1e-3, jit=False)
    assert "|xi'| reaches" in run.doubts()[0] and "more than k can follow" in run.doubts()[0]
    assert run.metrics().reaching_time == math.inf


@pytest.mark.parametrize(("r", "r_0", "omega"), [(2, 0.2, 5.0), (2, 0.5, 10.0), (2, 1.0, 20.0),
                                                 (3, 0.2, 5.0), (3, 0.5, 10.0)])
def test_an_adaptive_continuous_gain_that_cannot_follow_is_named(r, r_0, omega):
    loop = perturbed_chain(hosmc.adaptive_continuous(r), r).with_(
        perturbation__omega=omega, perturbation__xi_1=5.0, law__gamma=0.0, law__r_0=r_0,
        law__L=omega)
    said, = simulate(loop, dt=1e-3, jit=False).doubts()
    assert "|xi''| reaches" in said and f"alpha beta_0 (r_0 + r) = {0.88*r_0:.3g} [v]/s^2" in said


# ---- xi where sigma is estimated -----------------------------------------------------------------
@block
def alone(x):
    return -x[0]


@pytest.mark.parametrize(("law", "r", "off"), [
    (hosmc.quasi_continuous(2), 2, 0.05), (hosmc.nested(2), 2, 0.05),
    (hosmc.quasi_continuous(3), 3, 0.06), (hosmc.nested(3), 3, 0.07),
    (hosmc.quasi_continuous(4), 4, 0.12)], ids=named)
def test_in_output_feedback_xi_is_the_perturbation_and_not_the_chatter_of_the_estimate(law, r, off):
    loop = perturbed_chain(law, r).with_(
        output=alone, differentiator=differentiator(r - 1).with_(L=1.0 + law.values["alpha"]))
    run = simulate(loop, dt=1e-3, jit=False)
    inside = slice(len(run.t)//2, -40)  # at the ends it is held
    assert np.abs(run.xi[inside]).max() == pytest.approx(0.8, abs=off)
    assert np.sqrt(np.mean((run.xi - run.d)[inside]**2)) < off and run.doubts() == []


def test_in_output_feedback_a_perturbation_beyond_the_bound_is_named():
    for size in (1.5, 2.0, 2.5, 3.0, 5.0):
        loop = perturbed_chain(hosmc.quasi_continuous(2), 2).with_(
            output=alone, differentiator=differentiator(1).with_(L=6.0), perturbation__xi_1=size)
        assert "more than L = 1 [v]" in simulate(loop).doubts()[0]


def test_a_sensor_with_noise_adds_nothing_to_xi():
    @block
    def noisy(y, k, eps=1e-3):
        q = math.sin(12.9898*k + 78.233)*43758.5453
        noise = eps*2.0*(q - math.floor(q) - 0.5)
        return y[0] + noise, y[1] + 20.0*noise

    for law in ("sign_smc", "quasi_smc", "super_twisting", "quasi_continuous"):
        run = simulate(double_integrator(law).with_(sensor=noisy), dt=1e-3, jit=False)
        half = len(run.t)//2
        assert np.abs(run.xi[half:]).max() == pytest.approx(0.7, abs=0.03) and run.doubts() == []


def test_the_surface_of_the_true_error_is_found_row_by_row_where_it_branches():
    @block
    def bent(e, c=2.5):
        return e[1] + (c*e[0] if abs(e[0]) < 10.0 else 0.0)

    @block
    def place(x):
        return x[0]

    loop = double_integrator("quasi_smc").with_(
        surface=bent, output=place, differentiator=differentiator(1).with_(L=20.0))
    measured = loop.with_(differentiator=None, output=both)
    run, plain = (simulate(q, dt=1e-3, jit=False) for q in (loop, measured))
    half = slice(len(run.t)//2, -40)
    assert run.xi[half] == pytest.approx(plain.xi[half], abs=0.05)
    assert run.true_sigma[half] == pytest.approx(plain.sigma[half], abs=0.02)


def test_without_xi_the_reason_is_said():
    loop = perturbed_chain(hosmc.quasi_continuous(2), 2).with_(
        output=alone, differentiator=differentiator(1).with_(L=6.0))
    run = simulate(loop, record=14)
    assert run.xi is None and run.no_xi == (
        "the run has fewer than 20 rows, too few to differentiate the error")
    assert run.doubts()[0].startswith("xi is not known: the run has fewer than 20 rows")
    assert simulate(loop, record=400).no_xi == ""
