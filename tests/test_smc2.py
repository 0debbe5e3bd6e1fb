"""Second-order laws: exact convergence, accuracy, adaptation, conditions on gains, transcriptions,
bad input."""

import inspect
import math

import numpy as np
import pytest
from chain import STARTS, TWO, WAVES, loop, sigma_of, slope, tail, transcribed
from hypothesis import given
from hypothesis import strategies as st

from smcaero_nb import BlockError, Param, ParameterError, block, simulate, smc2, surface
from smcaero_nb.smc2 import (
    adaptive_super_twisting,
    adaptive_twisting,
    gains,
    super_twisting,
    twisting,
)

LAWS = [super_twisting, adaptive_super_twisting, twisting, adaptive_twisting]
FOR_TWO = gains(2.5)  # |xi'| <= 2.5 for the perturbation TWO


def each(argument, laws):
    return pytest.mark.parametrize(argument, laws, ids=[v.name for v in laws])


# ---- exact convergence without perturbation ------------------------------------------------------
def crossings(run, velocity):
    """Times at which sigma is 0, and |sigma'| there, by interpolation between samples; `velocity`
    is -v."""
    sigma = sigma_of(run)
    k = np.flatnonzero(sigma[:-1]*sigma[1:] < 0.0)
    share = sigma[k]/(sigma[k] - sigma[k + 1])
    return run.t[k] + share*(run.t[k + 1] - run.t[k]), abs(velocity[k]
                                                           + share*(velocity[k + 1] - velocity[k]))


@pytest.mark.parametrize(("lam", "beta"), [(0.5, 1.1), (1.0, 2.0), (0.3, 4.0)])
def test_super_twisting_converges_at_its_exact_ratio(lam, beta):
    """With x = |sigma|^1/2 and ds = dt/x the law is linear: x' = -(lam x + w)/2, w' = beta x for
    sigma > 0.

    Half a turn of its eigenvalues -lam/4 +- i omega, omega^2 = beta/2 - lam^2/16, leads from one
    zero of sigma to the next and shrinks w, which is -sigma' there, by exp(-pi lam/(4 omega)); w
    itself changes at the rate beta.
    """
    ratio = math.exp(-math.pi*lam/math.sqrt(8*beta - lam*lam))
    run = simulate(loop(super_twisting.with_(lam=lam, beta=beta, w=-1.0), 0.0), 4.0, 2e-5,
                   record=200_000)
    times, speeds = crossings(run, run.z.law.w)
    speeds, times = np.append(1.0, speeds[:4]), np.append(0.0, times[:4])
    assert speeds[1:]/speeds[:-1] == pytest.approx(ratio, rel=5e-3)
    assert np.diff(times) == pytest.approx(speeds[:-1]*(1 + ratio)/beta, rel=5e-3)
    end = (1 + ratio)/(1 - ratio)/beta  # the sum of these times
    assert abs(run.sigma[run.t > 1.01*end]).max() < 1e-6 < abs(run.sigma[(run.t < 0.9*end)
                                                                         & (run.t > 0.8*end)]).max()


@pytest.mark.parametrize(("lam", "beta"), [(4.0, 2.0), (5.0, 1.1)])
def test_super_twisting_does_not_turn_where_its_eigenvalues_are_real(lam, beta):
    assert lam*lam >= 8*beta
    run = simulate(loop(super_twisting.with_(lam=lam, beta=beta, w=-1.0), 0.0), 4.0, 1e-4,
                   record=40_000)
    assert run.sigma.min() > -1e-6 and run.sigma.max() > 1e-3 and run.tail_sigma < 1e-6


@pytest.mark.parametrize(("a", "b"), [(2.4, 1.2), (5.0, 1.0)])
def test_twisting_converges_at_its_exact_ratio(a, b):
    """Parabolas: sigma'' = -(a + b) up to the summit, -(a - b) down to the next zero."""
    ratio = math.sqrt((a - b)/(a + b))
    law = twisting.with_(alpha_1=a, alpha_2=b, L=0.5, v=-1.0, v_M=10.0)
    run = simulate(loop(law, 0.0), 4.0, 2e-5, record=200_000)
    times, speeds = crossings(run, -run.v)
    speeds, times = np.append(1.0, speeds[:4]), np.append(0.0, times[:4])
    assert speeds[1:]/speeds[:-1] == pytest.approx(ratio, rel=5e-3)
    assert np.diff(times) == pytest.approx(speeds[:-1]*(1/(a + b) + 1/math.sqrt(a*a - b*b)),
                                           rel=5e-3)


def test_at_the_end_the_integral_is_the_perturbation():
    run = simulate(loop(super_twisting.with_(**FOR_TWO.super_twisting), **TWO), 20.0, 1e-4)
    assert abs(run.z.law.w[run.t > 10.0] - run.d[run.t > 10.0]).max() < 5e-3
    run = simulate(loop(twisting.with_(**FOR_TWO.twisting), **TWO), 20.0, 1e-4)
    assert abs(run.v[run.t > 10.0] - run.d[run.t > 10.0]).max() < 5e-3


# ---- accuracy ------------------------------------------------------------------------------------
@pytest.mark.parametrize("law", [super_twisting.with_(**FOR_TWO.super_twisting),
                                 twisting.with_(**FOR_TWO.twisting)],
                         ids=lambda law: law.name)
def test_accuracy_is_of_second_order(law):
    assert slope(law, [2e-3, 1e-3, 5e-4, 2.5e-4], **TWO) == pytest.approx(2.0, abs=0.15)


# ---- adaptation and limits -----------------------------------------------------------------------
def test_super_twisting_takes_a_perturbation_of_any_size_and_twisting_one_within_its_limit():
    ramp = dict(a=40.0, w=0.02)  # 40 sin(0.02 t): |xi'| <= 0.8
    assert simulate(loop(super_twisting, **ramp), 80.0, 1e-3).tail_sigma < 1e-4
    wide, narrow = (simulate(loop(twisting.with_(v_M=m), **ramp), 80.0, 1e-3, record=4000)
                    for m in (50.0, 3.0))
    assert wide.tail_sigma < 1e-4 and narrow.tail_sigma > 10.0
    assert abs(narrow.v).max() <= 3.0 + 1e-3*(2.4 + 1.2)


def test_the_control_of_twisting_is_continuous():
    run = simulate(loop(twisting, **WAVES[4]), 10.0, 1e-3, record=10_000)
    assert abs(np.diff(run.v)).max() <= 1e-3*(2.4 + 1.2)*(1 + 1e-9)


@pytest.mark.parametrize(("gamma", "sigma", "peak"), [(100.0, 0.032, 84.0), (20.0, 0.041, 33.0)])
def test_adaptive_twisting_as_studied(gamma, sigma, peak):
    """Tail |sigma| and greatest gain of a study of its own: h = 1e-4 s, 40 s, mu = 1e-3, c =
    0.1."""
    law = adaptive_twisting.with_(gamma=gamma, mu=1e-3, c=0.1)
    run = simulate(loop(law, **TWO), 40.0, 1e-4, record=4000)
    alpha, late = run.z.law.alpha_1, run.t > 32.0
    assert 0.5*sigma < run.tail_sigma < 1.3*sigma
    assert 0.8*peak < alpha.max() < 1.2*peak and alpha[late].max() < 0.5*peak
    assert alpha.min() > 0.1 - 1.001e-4*gamma  # below the least gain it grows again
    assert np.all(abs(run.v[late] - run.d[late]) < 1.0)


def test_the_gain_of_adaptive_twisting_follows_the_perturbation_down():
    run = simulate(loop(adaptive_twisting, a=2.0, w=2.0, change=20.0, then=0.2), 40.0, 1e-3,
                   record=4000)
    alpha = run.z.law.alpha_1
    assert alpha[run.t > 32.0].mean() < 0.5*alpha[(run.t > 10.0) & (run.t < 20.0)].mean()


def test_the_gain_of_adaptive_twisting_runs_away_where_a_sample_moves_v_beyond_mu():
    law = adaptive_twisting.with_(gamma=100.0, mu=1e-3, c=0.1)
    coarse, fine = (simulate(loop(law, 3.0, **TWO), 20.0, h).z.law.alpha_1 for h in (2e-3, 2e-4))
    assert coarse[-1] > 1500.0 and fine[-400:].max() < 50.0


# ---- defaults ------------------------------------------------------------------------------------
@each("law", LAWS)
def test_defaults_settle(law):
    ends = [tail(simulate(loop(law, s, **xi), 20.0, 1e-3, tail=3/20)) for s in STARTS
            for xi in WAVES]
    assert max(ends) < 0.5


# ---- gains and conditions ------------------------------------------------------------------------
@given(st.floats(1e-6, 1e6))
def test_gains_satisfy_the_conditions(L):
    stw, tw = gains(L)
    assert stw == dict(lam=1.5*math.sqrt(L), beta=1.1*L)
    a, b = tw["alpha_1"], tw["alpha_2"]
    assert a + b - L > a - b + L and a - b > L  # (23) as printed
    assert (twisting.with_(**tw).values["L"] == L
            and super_twisting.with_(**stw).values["beta"] == 1.1*L)


@pytest.mark.parametrize("L", [0.0, -1.0, math.nan, math.inf, "1", None])
def test_gains_of_no_bound_are_refused(L):
    with pytest.raises(ParameterError, match="gains: L = "):
        gains(L)


@given(st.floats(0, 10), st.floats(0, 10), st.floats(0, 5))
def test_twisting_takes_exactly_the_pairs_that_satisfy_its_condition(a, b, L):
    changes = dict(alpha_1=a, alpha_2=b, L=L)
    if b > L and a - b > L:
        assert twisting.with_(**changes).values["alpha_1"] == a
    else:
        with pytest.raises(ParameterError, match=r"^twisting: .* does not hold: .* L = "):
            twisting.with_(**changes)


def test_the_message_says_which_inequality():
    with pytest.raises(ParameterError) as why:
        twisting.with_(alpha_1=2.0)
    assert (str(why.value)
            == ("twisting: alpha_1 - alpha_2 > L does not hold: alpha_1 - alpha_2 = 2 - 1.2 = 0.8, "
                "L = 1 [v]/s"))
    with pytest.raises(ParameterError) as why:
        loop(twisting).with_(law__alpha_2=1.0)
    assert str(why.value) == ("twisting: alpha_1 + alpha_2 - L > alpha_1 - alpha_2 + L, that is "
                              "alpha_2 > L, does not hold: "
                              "alpha_2 = 1, L = 1 [v]/s")
    assert loop(twisting).with_(law__alpha_1=9.0, law__alpha_2=4.0,
                                law__L=3.0).stages["law"].values["L"] == 3.0


# ---- conditions on several values, in general ----------------------------------------------------
def ordered(values):
    return (None if values["low"] < values["high"]
            else f"low < high does not hold: {values['low']:g}, {values['high']:g}")


def test_a_block_may_check_its_values_together():
    @block(state=dict(high=1.0), check=ordered)
    def between(sigma, z, tau, low=0.0, gain=1.0):
        return gain*sigma, z

    assert between.with_(low=3.0, high=4.0).values == dict(low=3.0, gain=1.0, high=4.0)
    assert between.with_(gain=2.0).check is ordered
    for changes in (dict(low=1.0), dict(high=-1.0), dict(low=5.0, high=4.0)):
        with pytest.raises(ParameterError, match="^between: low < high does not hold: "):
            between.with_(**changes)
    with pytest.raises(ParameterError, match="low = nan is not allowed"):  # each by itself first
        between.with_(low=math.nan)
    with pytest.raises(ParameterError, match="^backwards: low < high does not hold: 2, 1"):
        @block(check=ordered)
        def backwards(sigma, low=2.0, high=1.0):
            return low + high

    seen = []

    # what it does to its dict is its own affair
    @block(check=lambda values: seen.append(values.pop("k")))
    def curious(sigma, k=1.0):
        return k*sigma

    assert curious.with_(k=2.0).values == dict(k=2.0) and seen == [1.0, 2.0]


@pytest.mark.parametrize(("c", "integral", "changes"), [
    ((1.75, 1.5625), True, dict(c_0=-1.0)), ((1.75, 1.5625), True, dict(c_int=0.0)),
    ((2.0,), False, dict(c_0=0.0)),
    ((3.0, 3.0, 1.0), True, dict(c_int=9.5)), ((3.0, 3.0, 1.0), True, dict(c_1=0.1, c_0=0.1))])
def test_a_sliding_variable_stays_hurwitz(c, integral, changes):
    line = surface.polynomial(c, integral)
    with pytest.raises(ParameterError,
                       match="^polynomial: c = .* must be Hurwitz, but it has the roots"):
        line.with_(**changes)
    with pytest.raises(ParameterError, match="must be Hurwitz"):
        surface.polynomial([{**line.values, **changes}[n] for n in line.params], integral)


def test_a_sliding_variable_may_change_by_several_coefficients_at_once():
    line = surface.polynomial((3.0, 3.0, 1.0)).with_(c_1=30.0, c_0=300.0, c_int=1000.0,
                                                     integral=0.5)
    assert line.values == dict(c_1=30.0, c_0=300.0, c_int=1000.0, integral=0.5)


# ---- transcriptions ------------------------------------------------------------------------------
def stw(s, w, h):
    return 1.5*np.sqrt(np.abs(s))*np.sign(s) + w, w + h*1.1*np.sign(s)


def astw(s, memory, h):
    lam, w = memory
    v = lam*np.sqrt(np.abs(s))*np.sign(s) + w
    return v, (lam + h*(20.0*np.sign(np.abs(s) - 1e-3) if lam > 0.05 else 0.5),
               w + h*1.0*lam*np.sign(s))


def tw(s, memory, h):
    v, last = memory
    ds = (s - last)/h
    v = v + h*(-v if np.abs(v) >= 1.1 else 2.4*np.sign(s) + 1.2*np.sign(ds))
    return v, (v, s)


def atw(s, memory, h):
    a, v, last = memory
    ds = (s - last)/h
    v = v + h*(-v if np.abs(v) >= 6.0 else a*np.sign(s) + 0.5*a*np.sign(ds))
    return v, (a + h*(20.0*np.sign(s**2 + 0.02*ds**2 - 1e-4) if a >= 0.1 else 1.0), v, s)


LITERAL = {super_twisting: (stw, 0.0), adaptive_super_twisting: (astw, (1.0, 0.0)),
           twisting.with_(v_M=1.1): (tw, (0.0, 0.4)), adaptive_twisting: (atw, (1.0, 0.0, 0.4))}


@each("law", LITERAL)
def test_each_law_is_its_transcription(law):
    n, h = 200, 2e-2
    sigma, v = transcribed(*LITERAL[law], n, h, 0.4, a=0.8, b=0.2)
    run = simulate(loop(law, 0.4, a=0.8, b=0.2), n*h, h, record=n)
    assert sigma_of(run)[:-1] == pytest.approx(sigma, rel=1e-12, abs=1e-12)
    assert run.v[:-1] == pytest.approx(v, rel=1e-12, abs=1e-12)
    assert np.sum(np.diff(np.sign(sigma)) != 0) > 2
    assert law.name != "twisting" or abs(v).max() > 1.1  # the limit too


# ---- what every law has in common ----------------------------------------------------------------
@each("law", LAWS)
def test_compiled_plain_and_mirrored_runs_agree_to_the_bit(law):
    xi = dict(c=0.3, a=0.8, b=0.4)
    mirrored = loop(law, -0.4, **{k: -v for k, v in xi.items()})
    compiled, plain, other = (simulate(q, 1.0, 1e-3, record=1000, jit=j) for q, j in (
        (loop(law, 0.4, **xi), True), (loop(law, 0.4, **xi), False), (mirrored, True)))
    assert np.array_equal(compiled.sigma, plain.sigma) and np.array_equal(compiled.v, plain.v)
    assert (np.array_equal(compiled.sigma, -np.array(other.sigma))
            and np.array_equal(compiled.v, -other.v))
    for n, values in vars(compiled.z.law).items():
        assert np.array_equal(values, getattr(plain.z.law, n))


@each("law", LAWS)
def test_every_law_is_finite_at_zero_and_complete_in_its_metadata(law):
    assert law((0.0, 0.0) if law in LAWS[2:] else 0.0, law.z0, 1e-3)[0] == 0.0
    assert isinstance(law.output, Param)
    for name, meta in law.settable.items():
        assert meta.symbol and meta.unit and meta.help, name
        low, high = meta.slider
        assert meta.low <= low < high <= meta.high and (low > 0.0 or not meta.log)
    doc = inspect.cleandoc(law.__doc__)
    assert (".. math::" in doc
            and all(f"\n{s}\n---" in doc for s in ("Parameters", "Returns", "Notes", "References")))
    assert all(n in doc.split("\nReturns\n")[0] for n in law.params)


@pytest.mark.parametrize(("law", "changes", "words"), [
    (super_twisting, dict(lam=-1.0), r"lam = -1 \[v\]/\[sigma\]\^1/2 is not allowed"),
    (super_twisting, dict(beta=-1), r"beta = -1 \[v\]/s"),
    (twisting, dict(v_M=0.0), r"v_M = 0 \[v\]"),
    (twisting, dict(alpha_1=-1.0), "alpha_1 = -1"), (twisting, dict(L=-1.0), "L = -1"),
    (adaptive_twisting, dict(gamma=-1.0), "gamma = -1"),
    (adaptive_twisting, dict(alpha_1=-1.0), "alpha_1 = -1"),
    (adaptive_twisting, dict(c=math.inf), "c = inf"),
    (adaptive_super_twisting, dict(lam_min=-1.0), "lam_min = -1")])
def test_bad_gains_are_refused(law, changes, words):
    with pytest.raises(ParameterError, match=words):
        law.with_(**changes)


@each("law", [twisting, adaptive_twisting])
def test_twisting_without_the_derivative_is_an_error_that_names_it(law):
    with pytest.raises(BlockError,
                       match=f"law '{law.name}' fails at t = 0.*It was given sigma = 1 .a number"):
        simulate(loop(law).with_(surface=None), 1.0, 0.1)


@each("law", [super_twisting, adaptive_super_twisting])
def test_super_twisting_of_a_vector_is_an_error_that_names_it(law):
    with pytest.raises(BlockError, match=f"law '{law.name}' fails at t = 0"):
        simulate(loop(law).with_(surface=loop(twisting).stages["surface"]), 1.0, 0.1)


def test_the_library_offers_what_it_lists():
    for name in smc2.__all__:
        assert len(getattr(smc2, name).__doc__) > 500
