"""The perturbation as the law meets it, and what is said where it exceeds the law's bound."""

import math

import numpy as np
import pytest
from chain import loop_of_two, signs

import smcaero_nb as smc
from smcaero_nb import ClosedLoop, applications, block, hosmc, simulate, smc1, smc2
from smcaero_nb.applications import perturbed_chain

LAWS = [(smc1.sign_smc, 1), (smc1.quasi_smc, 1), (smc2.super_twisting, 1), (smc2.twisting, 1),
        (smc1.dual_layer_smc, 1),
        (hosmc.quasi_continuous(2), 2), (hosmc.nested(3), 3), (hosmc.adaptive_continuous(4), 4)]


@pytest.mark.parametrize(("law", "r"), LAWS, ids=lambda q: getattr(q, "name", q))
@pytest.mark.parametrize("steps", (1, 4))
def test_the_perturbation_is_found_from_sigma_and_v(law, r, steps):
    """On the chain sigma^(r) = xi - v, so xi is the mean of the plant's own perturbation since the
    row before."""
    run = simulate(perturbed_chain(law, r), 6.0, 1e-3, steps*1e-3, record=600)
    xi_1, omega = 0.8, 1.2
    sample = np.floor(run.t/(steps*1e-3) + 1e-6)*steps*1e-3
    was = sample[np.maximum(np.searchsorted(sample, sample - 1e-9) - 1, 0)]
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = xi_1*(np.sin(omega*sample) - np.sin(omega*was))/(omega*(sample - was))
    # the sum of Euler steps is its integral to dt
    assert run.xi[2:] == pytest.approx(mean[2:], abs=2e-3)
    assert run.xi[0] == run.xi[1]


def test_mean_and_integral_of_v():
    run = simulate(perturbed_chain(smc2.super_twisting, 1), 5.0, 1e-3, 1e-3, record=10**9,
                   jit=False)
    assert run.integral_v == pytest.approx(np.append(0.0, np.cumsum(run.v[:-1])*1e-3), abs=1e-12)
    assert run.mean_v == pytest.approx(np.abs(run.v).mean(), rel=1e-12)
    assert simulate(smc.lv.loop("quasi_smc"), 3.0, 1e-3).mean_v > 0.0


def test_several_inputs_and_channels():
    G0 = ((2.0, 1.0), (0.5, 1.0))
    for law in (smc1.unit_vector, signs()):
        run = simulate(loop_of_two(law, G=G0, G0=G0, a=0.7, b=0.4), 5.0, 1e-3)
        assert len(run.xi) == 2
        for xi, d in zip(run.xi, run.d, strict=True):
            assert xi == pytest.approx(d, abs=0.01)


def test_no_perturbation_where_there_is_none_to_find():
    @block
    def of_another_shape(sigma):
        return (sigma, 2.0*sigma, 0.0)

    @block
    def first(v):
        return v[0]

    loop = perturbed_chain(smc1.sign_smc, 1)
    assert simulate(loop.with_(law=of_another_shape, allocation=first), 0.1, jit=False).xi is None
    idle = ClosedLoop(applications.chain(1), output=applications.chain_output,
                      allocation=first_of_nothing)
    assert (simulate(idle, 0.1, 1e-3, jit=False).xi is None
            and simulate(idle, 0.1, 1e-3, jit=False).doubts() == [])


@block
def first_of_nothing(t):
    return 0.0


# ---- conditions ----------------------------------------------------------------------------------
@pytest.mark.parametrize(("law", "r", "bad", "said"), [
    (smc1.sign_smc, 1, dict(perturbation__xi_1=2.5), "|xi| reaches 2.5, more than rho = 2 [v]"),
    (smc1.quasi_smc, 1, dict(law__rho=0.5), "|xi| reaches 0.8, more than rho = 0.5 [v]"),
    (smc1.saturation_smc, 1, dict(law__rho=0.5), "|xi| reaches 0.8, more than rho = 0.5 [v]"),
    (smc1.tanh_smc, 1, dict(law__rho=0.5), "|xi| reaches 0.8, more than rho = 0.5 [v]"),
    (smc2.super_twisting, 1, dict(perturbation__omega=3.0),
     "|xi'| reaches 2.39, and then lam^2 > beta + |xi'| does not hold"),
    (smc2.super_twisting, 1, dict(law__lam=4.0, law__beta=0.5),
     "|xi'| reaches 0.96, more than beta = 0.5 [v]/s"),
    (smc2.twisting, 1, dict(perturbation__omega=3.0),
     "|xi'| reaches 2.39, more than min(alpha_2, alpha_1 - alpha_2) = 1.2 [v]/s"),
    (smc2.twisting, 1, dict(law__v_M=0.7), "|xi| reaches 0.8, more than v_M = 0.7 [v]"),
    (smc2.adaptive_twisting, 1, dict(law__v_M=0.7), "|xi| reaches 0.8, more than v_M = 0.7 [v]"),
    (hosmc.quasi_continuous(3), 3, dict(perturbation__xi_1=1.5),
     "|xi| reaches 1.5, more than L = 1 [v]"),
    (hosmc.nested(2), 2, dict(law__L=0.5), "|xi| reaches 0.8, more than L = 0.5 [v]"),
    (hosmc.quasi_continuous(3), 3, dict(law__lam=0.3),
     "|xi| reaches 0.8, more than L lambda^3 = 0.027 [v]"),
    (hosmc.quasi_continuous(3), 3, dict(law__alpha=0.5),
     "|xi| reaches 0.8, more than the greatest |v|, alpha L = 0.5 [v]"),
    (hosmc.quasi_continuous(3), 3, dict(law__lam=2.0, perturbation__xi_1=9.0),
     "more than L lambda^3 = 8 [v]")])
def test_a_perturbation_beyond_the_bound_is_named(law, r, bad, said):
    loop = perturbed_chain(law, r)
    assert simulate(loop, record=1000).doubts() == []
    (why,) = simulate(loop.with_(**bad), record=1000).doubts()
    assert said in why


def test_a_faster_law_bears_more():
    loop = perturbed_chain(hosmc.quasi_continuous(3), 3).with_(law__lam=2.0, perturbation__xi_1=5.0)
    run = simulate(loop, record=1000)
    assert run.doubts() == [] and run.tail_sigma < 1e-6


def test_doubts_of_channels_and_several_inputs():
    (why,) = simulate(loop_of_two(smc1.unit_vector.with_(rho=1.0), a=0.9, b=0.9), 10.0,
                      1e-3).doubts()
    assert "||xi|| reaches 1.2" in why
    (why,) = simulate(loop_of_two(signs(rho=1.0), a=1.5, b=0.5), 10.0, 1e-3).doubts()
    assert why.startswith("a: |xi| reaches 1.5, more than rho = 1")


def test_a_command_that_jumps_is_no_perturbation():
    run = simulate(applications.dc_motor("super_twisting"), record=1000)
    assert np.abs(run.xi).max() > 1e4 and run.doubts() == []
    late = applications.dc_motor("quasi_smc").with_(reference__start=0.7)
    assert simulate(late, record=1000).doubts() == []


def test_a_short_run_says_nothing():
    loop = perturbed_chain(smc1.sign_smc, 1).with_(perturbation__xi_1=5.0)
    assert simulate(loop, 4e-3, 1e-3, 1e-3).doubts() == []
    assert simulate(loop, 1.0, 1e-3, 1e-3, record=3).doubts() == []


def test_a_law_of_your_own_declares_what_its_theorem_assumes():
    def small(values, xi, dxi):
        return f"xi = {xi:.2g}" if xi > values["k"] else None

    @block(card=smc.card.Law(assumes=small))
    def own(sigma, k=0.5):
        return k*math.copysign(1.0, sigma)

    run = simulate(perturbed_chain(own, 1), record=1000)
    why, = run.doubts()
    assert why.startswith("xi = 0.8; sigma does not come to rest")


def test_an_input_matrix_that_comes_near_to_singular_is_named():
    def regular(y):
        return (2.0, 0.1*y[1][0]), (0.0, 1.0)

    def nearly(y):
        return (2.0, 1.0), (2.0, 1.0 + 1e-6*(1.0 + y[0][0]*y[0][0]))

    loop = loop_of_two(smc1.unit_vector, a=0.5)
    assert simulate(loop.with_(allocation=smc1.decoupling(regular)), 1.0, 1e-2,
                    jit=False).doubts() == []
    why = simulate(loop.with_(allocation=smc1.decoupling(nearly)), 1.0, 1e-2, jit=False).doubts()
    assert why[0].startswith("G0(y) comes near to singular (condition number ")
