"""Laws against their theorems and against literal transcriptions, on sigma' = xi - v."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import smcaero_nb as smc
from smcaero_nb import ClosedLoop, Param, block, simulate
from smcaero_nb.pid import pd, pid
from smcaero_nb.smc1 import quasi_smc, sign_smc
from smcaero_nb.smc2 import adaptive_super_twisting

rng = np.random.default_rng(2024)


@block(state=dict(sigma=1.0))
def sliding_motion(u, d):
    return (d - u,)


@block
def itself(x):
    return -x[0]


@block
def two_waves(t, a=1.0, b=0.5):
    """|xi| <= a + b, |xi'| <= a + 3 b."""
    return a*math.sin(t) + b*math.sin(3.0*t)


@block
def constant(t, level=0.7):
    return level


motion = ClosedLoop(sliding_motion, output=itself, perturbation=two_waves)
at_rest = motion.with_(perturbation__a=0.0, perturbation__b=0.0)


# ---- PD and PID ----------------------------------------------------------------------------------
@block(state=dict(y=0.0, dy=0.0))
def mass(x, u, d):
    return x[1], u + d


@block
def both(x):
    return x[0], x[1]


@block
def step(t, size=2.0):
    return size if t >= 1.0 else 0.0


@block
def moving_step(t, size=2.0):
    """A step that comes with its derivative, as a command generator may give it."""
    return (size if t >= 1.0 else 0.0), 1e6


def test_pd_is_its_formula():
    for e, de, k_p, k_d in rng.normal(size=(20, 4)):
        assert pd.with_(k_p=abs(k_p), k_d=abs(k_d))((e, de)) == abs(k_p)*e + abs(k_d)*de


def test_under_pd_a_constant_perturbation_leaves_a_constant_error_and_pid_removes_it():
    loop = ClosedLoop(mass, output=both, perturbation=constant, law=pd.with_(k_p=4.0, k_d=4.0))
    run = simulate(loop, 20.0, 1e-2, jit=False)
    assert run.e[0][-1] == pytest.approx(-0.7/4.0, rel=1e-9)
    run = simulate(loop.with_(law=pid.with_(k_p=4.0, k_d=4.0, k_i=1.0)), 60.0, 1e-2, jit=False)
    assert abs(run.e[0][-1]) < 1e-6
    # k_i times it is what holds the perturbation
    assert run.z.law.integral[-1] == pytest.approx(-0.7, abs=1e-5)


def test_pid_is_its_formula_sampled():
    law = pid.with_(k_p=1.5, k_i=0.4, k_d=0.8)
    total, tau = 0.3, 0.01
    for r, y, dy in rng.normal(size=(20, 3)):
        v, (total_next,) = law(r, (y, dy), (total,), tau)
        assert v == pytest.approx(1.5*(r - y) + 0.4*total - 0.8*dy, rel=1e-14)
        assert total_next == pytest.approx(total + tau*(r - y), rel=1e-14)
        total = total_next


@pytest.mark.parametrize("reference", [step, moving_step])
def test_a_step_of_the_reference_gives_pid_no_kick(reference):
    loop = ClosedLoop(mass, reference=reference, output=both,
                      law=pid.with_(k_p=3.0, k_i=0.5, k_d=2.0))
    run = simulate(loop, 2.0, 1e-3, record=2000, jit=False)
    assert run.u[999] == 0.0
    # k_p times the step: neither the derivative nor the integral adds to it
    assert run.u[1000] == 3.0*2.0 == run.max_u


# ---- first order ---------------------------------------------------------------------------------
@given(st.floats(-1e100, 1e100), st.floats(0, 1e3), st.floats(1e-6, 1e3))
def test_signs_and_bounds(sigma, rho, eps):
    assert sign_smc.with_(rho=rho)(sigma) == rho*np.sign(sigma)
    v = quasi_smc.with_(rho=rho, eps=eps)(sigma)
    assert abs(v) <= rho*(1 + 1e-15) and v*sigma >= 0.0


def test_sign_smc_reaches_zero_exactly_when_the_theorem_says():
    run = simulate(at_rest.with_(law=sign_smc.with_(rho=0.5)), 4.0, 1/64, record=256, jit=False)
    reached = np.flatnonzero(run.sigma == 0.0)[0]
    assert run.t[reached] == 1.0/0.5  # |sigma(0)|/rho, exact in binary
    assert np.all(run.sigma[reached:] == 0.0) and np.all(run.u[reached:] == 0.0)
    assert np.all(np.diff(run.sigma[:reached + 1]) == -0.5/64)


@pytest.mark.parametrize("seed", range(6))
def test_sign_smc_reaches_in_time_and_then_stays_within_its_bound(seed):
    local = np.random.default_rng(seed)
    start, rho, a, b = local.uniform((-3, 2, 0.1, 0.1), (3, 4, 1.0, 0.6))
    L, tau = a + b, 1e-3*local.integers(1, 9)
    loop = motion.with_(law=sign_smc.with_(rho=rho), plant__sigma=start, perturbation__a=a,
                        perturbation__b=b)
    run = simulate(loop, 6.0, 1e-3, tau=tau, record=6000, jit=False)
    late = run.t >= abs(start)/(rho - L) + tau
    assert late.any()
    assert abs(run.x.sigma[late]).max() <= tau*(rho + L) + 1e-12
    # nor is it still: sampled sliding chatters
    assert abs(run.x.sigma[late]).max() > 0.1*tau*(rho - L)


def test_the_accuracy_of_sign_smc_is_proportional_to_the_sampling_step():
    tails = [simulate(motion.with_(law=sign_smc.with_(rho=2.0)), 5.0, tau, jit=False).tail_sigma
             for tau in (4e-3, 2e-3, 1e-3)]
    assert np.log2(np.divide(tails[:-1], tails[1:])) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("xi", [0.7, -0.7, 0.2])
@pytest.mark.parametrize(("rho", "eps"), [(2.0, 0.01), (1.0, 0.1)])
def test_quasi_smc_settles_exactly_where_the_theorem_says(xi, rho, eps):
    """5.38e-3 for eps = 0.01, xi = 0.7, rho = 2, in a study of its own."""
    loop = motion.with_(perturbation=constant, perturbation__level=xi,
                        law=quasi_smc.with_(rho=rho, eps=eps))
    # thirty time constants
    run = simulate(loop, 4.0 + 30.0*rho*eps/(rho - abs(xi))**2, 2e-3, jit=False)
    assert run.sigma[-1] == pytest.approx(eps*xi/(rho - abs(xi)), rel=1e-9)
    assert run.v[-1] == pytest.approx(xi, rel=1e-9)  # the equivalent control
    if (xi, rho, eps) == (0.7, 2.0, 0.01):
        assert run.sigma[-1] == pytest.approx(5.38e-3, abs=5e-6)


def test_quasi_smc_does_not_chatter_and_tends_to_the_relay():
    loop = motion.with_(law=quasi_smc.with_(rho=2.0, eps=0.05))
    smooth, rough = (simulate(motion.with_(law=law), 8.0, 1e-3, jit=False).metrics()
                     for law in (loop.stages["law"],
                                   sign_smc.with_(rho=2.0)))
    assert smooth.turns_u < 2.0 < 300.0 < rough.turns_u
    assert smooth.variation_u < 4.0 < rough.variation_u
    for sigma in (-2.0, 0.3, 1e-3):
        assert (quasi_smc.with_(rho=2.0, eps=1e-9)(sigma)
                == pytest.approx(sign_smc.with_(rho=2.0)(sigma), rel=2e-6))


# ---- second order --------------------------------------------------------------------------------
def super_twisting_by_hand(n, h, gamma, mu, lam_min, eps, eta, lam, sigma):
    """The adaptive law transcribed literally, on sigma' = xi - v."""
    w, rows = 0.0, []
    for k in range(n):
        t = k*h
        s = np.sign(sigma)
        v = lam*np.sqrt(abs(sigma))*s + w
        w, lam = w + h*eps*lam*s, lam + h*(gamma*np.sign(abs(sigma) - mu) if lam > lam_min else eta)
        rows.append((sigma, v, lam, w))  # a row holds the states as the sample leaves them
        sigma = sigma + h*(1.0*np.sin(t) + 0.5*np.sin(3.0*t) - v)
    return np.array(rows).T


@pytest.mark.parametrize("jit", [True, False])
def test_adaptive_super_twisting_is_its_transcription(jit):
    n, h = 2000, 2e-3
    gains = dict(gamma=20.0, mu=0.01, lam_min=0.05, eps=1.0, eta=0.5)
    by_hand = super_twisting_by_hand(n, h, **gains, lam=1.0, sigma=1.0)
    run = simulate(motion.with_(law=adaptive_super_twisting.with_(**gains)), n*h, h, record=n,
                   jit=jit)
    for mine, theirs in zip((run.sigma, run.v, run.z.law.lam, run.z.law.w), by_hand, strict=True):
        # later a last bit may turn a switching round
        assert np.allclose(mine[:300], theirs[:300], rtol=1e-11, atol=1e-13)
    assert np.mean(abs(run.sigma[:-1] - by_hand[0])) < 1e-3


def test_one_step_of_adaptive_super_twisting_in_each_of_its_modes():
    law = adaptive_super_twisting.with_(gamma=2.0, mu=0.5, lam_min=0.3, eps=0.7, eta=0.1)
    for sigma, lam, rate in ((1.0, 1.0, 2.0), (0.2, 1.0, -2.0), (-1.0, 1.0, 2.0), (-1.0, 0.3, 0.1),
                             (0.2, 0.1, 0.1)):
        v, (lam_next, w_next) = law(sigma, (lam, 0.4), 0.01)
        assert v == pytest.approx(lam*math.sqrt(abs(sigma))*np.sign(sigma) + 0.4, rel=1e-14)
        assert lam_next == pytest.approx(lam + 0.01*rate, rel=1e-14)
        assert w_next == pytest.approx(0.4 + 0.01*0.7*lam*np.sign(sigma), rel=1e-14)
    assert law(0.0, (1.0, 0.4), 0.01)[0] == 0.4  # sign 0 = 0


#: gamma, and the tail |sigma| of a study of its own (h = 1e-4 s, 40 s, mu = 1e-3).
@pytest.mark.parametrize(("gamma", "tail"), [(20.0, 4.8e-3), (50.0, 2.5e-3)])
def test_adaptive_super_twisting_needs_no_bound_and_lets_its_gain_fall(gamma, tail):
    law = adaptive_super_twisting.with_(gamma=gamma, mu=1e-3, eps=1.0, eta=0.5, lam_min=0.05,
                                        lam=1.0)
    run = simulate(motion.with_(law=law), 40.0, 1e-4, record=4000)
    assert 1e-3 < run.tail_sigma < 1.5*tail  # it overshoots mu, by a factor of two to twelve
    lam = run.z.law.lam
    late = run.t > 32.0
    assert lam.min() > 0.05 - 1.001*gamma*1e-4 and lam[0] == 1.0 + gamma*1e-4
    assert lam[late].max() < 0.7*lam.max() and lam[late].min() < 0.5
    # v is the perturbation, which the law does not know
    assert np.max(abs(run.v[late] - run.d[late])) < 0.3


def test_a_smaller_perturbation_lets_the_gain_fall_further():
    law = adaptive_super_twisting.with_(gamma=20.0)
    levels = [simulate(motion.with_(law=law, perturbation__a=a, perturbation__b=a/2), 40.0,
                       1e-4).z.law.lam[-400:].mean()
              for a in (2.0, 1.0, 0.2)]
    assert levels == sorted(levels, reverse=True)


def test_super_twisting_is_continuous():
    """From sample to sample v moves by no more than the change of its parts allows: no relay is in
    it."""
    tau = 1e-3
    run = simulate(motion.with_(law=adaptive_super_twisting), 4.0, tau, record=4000)
    sigma, lam = run.sigma, np.append(1.0, run.z.law.lam[:-1])  # the gain that each sample used
    bound = (lam[1:]*np.sqrt(2*abs(np.diff(sigma))) + tau*1.0*lam[:-1]
             + np.abs(np.diff(lam))*np.sqrt(abs(sigma[:-1])))
    assert np.ptp(run.v) > 1.0
    assert np.all(abs(np.diff(run.v)) <= bound + 1e-9)


# ---- what every law has in common ----------------------------------------------------------------
LAWS = [pd, pid, sign_smc, quasi_smc, adaptive_super_twisting]


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_every_law_is_odd_finite_at_zero_and_complete_in_its_metadata(law):
    signals = dict(sigma=0.3, e=(0.3, -0.2), r=0.5, y=(0.2, 0.1), tau=0.01,
                   z=tuple(0.5 for _ in law.states))
    flipped = {k: v if k == "tau" else -v if isinstance(v, float) else tuple(-q for q in v)
               for k, v in signals.items()}
    if law is adaptive_super_twisting:
        flipped["z"] = (0.5, -0.5)  # the gain is not mirrored
    nil = {k: v if k == "tau" else 0.0 if isinstance(v, float) else tuple(0.0 for _ in v)
           for k, v in signals.items()}
    there, back, zero = (law(*(s[n] for n in law.signals)) for s in (signals, flipped, nil))
    if law.states:
        there, back, zero = there[0], back[0], zero[0]
    assert there == -back != 0.0 and zero == 0.0
    for name, meta in law.settable.items():
        assert meta.symbol and meta.unit and meta.help, name
        low, high = meta.slider or (meta.low, meta.high)
        assert math.isfinite(low) and math.isfinite(high) and low < high
        assert meta.low <= low and high <= meta.high and (low > 0 or not meta.log)
    assert isinstance(law.output, Param)


def test_the_libraries_offer_what_they_list():
    for module in (smc.smc1, smc.smc2, smc.pid, smc.surface):
        for name in module.__all__:
            assert getattr(module, name).__doc__
