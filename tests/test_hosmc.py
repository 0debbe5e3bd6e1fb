"""Higher-order laws on their chains: static values, homogeneity, accuracy orders, settling,
scaling, errata, bad input."""

import itertools
import math

import numpy as np
import pytest

import smcaero_nb as smc
from smcaero_nb import Param, ParameterError, block, hosmc, simulate
from smcaero_nb.applications import chain, chain_output

LAWS = {"rational": hosmc.quasi_continuous,
        "levant2005": lambda r: hosmc.quasi_continuous(r, "levant2005"),
        "nested": hosmc.nested}
# of order 1 all are the relay
FIXED = [(family, r) for family in LAWS for r in range(1, 6) if r > 1 or family == "rational"]
POINT = (0.3, -0.2, 0.5, -0.4, 0.1)
COEFFICIENTS = {2: (1, 1), 3: (1, 1, 1), 4: (1, 2, 2, 1), 5: (1, 3, 5, 6, 1)}
FACTORS = {"levant2005": {2: (1,), 3: (1, 2), 4: (0.5, 1, 3), 5: (0.35, 0.8, 1.8, 5)},
           "nested": {2: (1,), 3: (1, 2), 4: (0.5, 1, 3), 5: (0.35, 0.8, 1.8, 8)}}


def sign(s):
    return (s > 0.0)*1.0 - (s < 0.0)*1.0


@block
def hostile(t, x, cosine=0.0, omega=1.3, constant=0.0, last=0.0, second=0.0, first=0.0, wave=0.0,
            wave_3=0.0):
    """|xi| <= 1 of several kinds: of time, or against a state."""
    return (cosine*math.cos(omega*t) + constant + last*sign(x[-1])
            + second*sign(x[min(1, len(x) - 1)]) + first*sign(x[0])
            + wave*math.sin(t) + wave_3*math.sin(3.0*t))


KINDS = [dict(cosine=1.0), dict(constant=1.0), dict(last=1.0), dict(second=1.0), dict(first=1.0)]
WAVE = dict(wave=1.0, wave_3=0.5)


def loop(law, start, kind):
    """A law on its chain, from the state `start`, with a perturbation of that kind; one compilation
    serves all of them."""
    return smc.ClosedLoop(chain(len(start)), output=chain_output, law=law,
                          perturbation=hostile).with_(
        **{f"plant__s{i}": v for i, v in enumerate(start)},
        **{f"perturbation__{n}": v for n, v in kind.items()})


def tail(law, start, kind, duration, tau, seconds):
    """Greatest |sigma^(i)| of the last seconds; the chain is integrated exactly up to order 4."""
    run = simulate(loop(law, start, kind), duration, tau, method="rk4", record=10,
                   tail=seconds/duration)
    return np.ravel(run.tail_peaks.e) if run.diverged_at is None else np.full(len(start), np.inf)


def size(s):
    """Sum of |sigma^(i)|^(1/(r-i))."""
    return sum(v**(1/(len(s) - i)) for i, v in enumerate(s))


def slopes(law, r, taus, duration, kind, starts=6):
    """Slope of each |sigma^(i)| over tau, both logarithmic: of several starts the geometric mean,
    as there are rare peaks."""
    starts = np.random.default_rng(1).uniform(-1.0, 1.0, (starts, r)).tolist()
    E = [np.mean([np.log(tail(law, s, kind, duration, tau, 10.0)) for s in starts], axis=0)
         for tau in taus]
    return np.polyfit(np.log(taus), E, 1)[0]


def at(family, s, **values):
    """Psi at a point."""
    return LAWS[family](len(s))(tuple(s) if len(s) > 1 else s[0], **dict(dict(alpha=1.0), **values))


# ---- the functions Psi ---------------------------------------------------------------------------
def test_static_values():
    for r, value in zip(range(2, 6),
                        (0.764705882353, 0.652273359971, 0.510115766630, 0.300525776043),
                        strict=True):
        assert at("rational", POINT[:r]) == pytest.approx(value, abs=1e-12)
    for r, value in zip(range(2, 6),
                        (0.465042219223, 0.529084009783, 0.310850481113, 0.217742048844),
                        strict=True):
        assert at("levant2005", POINT[:r]) == pytest.approx(value, abs=1e-12)
    assert [at("nested", POINT[:r]) for r in range(1, 6)] == [1.0]*5


def transcribed(family, s):
    """The equations as they are printed, with numpy's powers."""
    r, s = len(s), np.array(s)
    if family == "rational":
        p = np.array(COEFFICIENTS[r])*np.abs(s)**(r/(r - np.arange(r)))
        return np.sum(p*np.sign(s))/np.sum(p)
    psi, N, q = np.sign(s[0]), abs(s[0]), math.lcm(*range(1, r + 1))
    for i, b in enumerate(FACTORS[family][r], start=1):
        if family == "nested":
            psi = np.sign(s[i] + b*np.sum(np.abs(s[:i])**(q/(r - np.arange(i))))**((r - i)/q)*psi)
        else:
            a = b*N**((r - i)/(r - i + 1))
            psi, N = (s[i] + a*psi)/(abs(s[i]) + a), abs(s[i]) + a
    return psi


@pytest.mark.parametrize(("family", "r"), [q for q in FIXED if q[1] > 1])
def test_psi(family, r):
    rng = np.random.default_rng(r)
    for s in rng.uniform(-2.0, 2.0, (100, r)).tolist():
        psi = at(family, s)
        assert psi == pytest.approx(transcribed(family, s), abs=1e-12)
        assert abs(psi) <= 1.0
        assert at(family, [-v for v in s]) == -psi
        k = 10.0**rng.uniform(-2.0, 2.0)
        assert at(family, [v*k**(r - i) for i, v in enumerate(s)]) == pytest.approx(psi, abs=1e-12)


@pytest.mark.parametrize(("family", "r"), FIXED)
def test_psi_is_finite(family, r):
    assert at(family, (0.0,)*r) == 0.0
    for tiny in (5e-324, 1e-200, 1e-12, 1.0, 1e9):
        for i in range(r):
            s = [0.0]*r
            s[i] = tiny
            assert 0.0 <= at(family, s) <= 1.0
            s[0] = -tiny
            assert abs(at(family, s)) <= 1.0


# ---- on the chain --------------------------------------------------------------------------------
@pytest.mark.parametrize(("family", "r"), FIXED)
def test_accuracy_order(family, r):
    first, steps, amplitude, tolerance = {
        ("nested", 3): (2e-3, 5, 0.9, 0.15), ("nested", 4): (2e-3, 5, 0.5, 0.2),
        ("nested", 5): (2e-3, 4, 0.9, 0.6)
        }.get((family, r), (4e-3, 4, 0.5, 0.15))
    found = slopes(LAWS[family](r), r, [first/2**i for i in range(steps)], 40.0 if r > 3 else 30.0,
                   dict(cosine=amplitude))
    assert found == pytest.approx(np.arange(r, 0, -1), abs=tolerance)


@pytest.mark.parametrize(("family", "r"), FIXED)
def test_defaults_settle(family, r):
    law, tau = LAWS[family](r), 5e-4 if (family, r) == ("nested", 5) else 2e-3
    starts = np.random.default_rng(3).uniform(-1.0, 1.0, (8, r)).tolist()
    assert max(size(tail(law, s, kind, 40.0, tau, 3.0)) for s in starts for kind in KINDS) < 0.5


@pytest.mark.parametrize(("family", "r"), FIXED)
def test_scaling(family, r):
    """Powers of two scale exactly: four times the bound, four times sigma; twice the speed, half
    the time."""
    law, start = LAWS[family](r), POINT[:r]
    base = simulate(loop(law, start, dict(cosine=0.9)), 2.0, 1e-3, method="rk4")
    larger = simulate(loop(law.with_(L=4.0), [4.0*s for s in start], dict(cosine=3.6)), 2.0, 1e-3,
                      method="rk4")
    faster = simulate(loop(law.with_(lam=2.0), [s*2.0**i for i, s in enumerate(start)],
                           dict(cosine=0.9*2.0**r, omega=2.6)), 1.0,
                      5e-4, method="rk4")
    for i in range(r):
        s = getattr(base.x, f"s{i}")
        assert np.array_equal(getattr(larger.x, f"s{i}"), 4.0*s)
        assert np.array_equal(getattr(faster.x, f"s{i}"), 2.0**i*s)
    assert np.array_equal(larger.u, 4.0*base.u)
    assert np.array_equal(faster.u, 2.0**r*base.u)


def test_quasi_continuous_means_continuous_until_sigma_is_zero():
    start = (1.0, 0.0, 0.0)
    smooth, rough = (simulate(loop(law, start, dict(cosine=0.5)), 1.0, 1e-4, method="rk4",
                              record=10_000).u
                     for law in (hosmc.quasi_continuous(3), hosmc.nested(3)))
    assert np.abs(np.diff(smooth)).max() < 0.02
    assert np.abs(np.diff(rough)).max() == 16.0


@pytest.mark.parametrize("law", [*(LAWS[f](r) for f, r in FIXED),
                                 *(hosmc.adaptive_continuous(r) for r in range(2, 6))],
                         ids=lambda law: law.name)
def test_compiled_is_plain(law):
    r = law.r or 1
    q = loop(law, POINT[:r], dict(cosine=0.5, last=0.3, **WAVE))
    fast, plain = (simulate(q, 1.0, 1e-3, method="rk4", record=1000, jit=jit)
                   for jit in (True, False))
    states = [{**vars(run.x), **(vars(run.z.law) if law.states else {})} for run in (fast, plain)]
    assert all(np.array_equal(states[0][n], states[1][n]) for n in states[0])
    assert np.array_equal(fast.u, plain.u)
    assert fast.variation_u == plain.variation_u


# ---- adaptive continuous -------------------------------------------------------------------------
@pytest.mark.parametrize("r", range(2, 6))
def test_adaptive_continuous(r):
    law = hosmc.adaptive_continuous(r)
    for value in (1.0, 3.0, 10.0):
        for start in ([value] + [0.0]*(r - 1), [value]*r):
            assert size(tail(law, start, WAVE, 40.0, 1e-3, 3.0)) < 0.5
    rng = np.random.default_rng(r)
    for start in rng.uniform(-1.0, 1.0, (8, r)):
        for xi in (dict(), dict(constant=1.0), dict(constant=-1.0), dict(cosine=1.0),
                   dict(constant=0.5, cosine=0.5, omega=1.0)):
            assert size(tail(law, start.tolist(), xi, 40.0, 1e-3, 3.0)) < 0.5
    a = [1/(1 + (r + 1 - i)*(1/law.values["alpha_r"] - 1)) for i in range(1, r + 1)]
    found = slopes(law, r, (8e-4, 4e-4, 2e-4, 1e-4), 40.0, WAVE, 2)
    assert found[-1] == pytest.approx(2.0, abs=0.15)
    assert all(f >= 2*a[-1]/q - 0.15 for f, q in zip(found, a, strict=True))


def test_adaptive_powers_are_bhat_and_bernstein():
    for r in range(2, 6):
        a = [*(1/(1 + (r + 1 - i)*(1/0.75 - 1)) for i in range(1, r + 1)), 1.0]
        for i in range(1, r):
            assert a[i - 1] == pytest.approx(a[i]*a[i + 1]/(2*a[i + 1] - a[i]))
        law, s = hosmc.adaptive_continuous(r).with_(alpha_r=0.75), POINT[:r]
        gains = [law.values[f"gamma_{i + 1}"] for i in range(r)]
        z = (-s[-1], 0.0, 0.0, 0.2, 0.0)  # s = 0: only v_sigma is left
        v_sigma = sum(g*abs(x)**p*sign(x) for g, x, p in zip(gains, s, a[:-1], strict=True))
        assert law(s, z, 1e-3)[0] == pytest.approx(v_sigma)


def test_adaptive_against_transcription():
    """A literal transcription of (29)-(40) as corrected, with explicit numbers, over 300
    samples."""
    law = hosmc.adaptive_continuous(3)
    x, z, tau = np.array([1.0, -0.5, 0.3]), law.z0, 1e-3
    integral = w = v_eq = r = 0.0
    L = 0.2
    for k in range(300):
        v, z = law(tuple(x.tolist()), z, tau)
        v_sigma = np.array([27.0, 27.0, 9.0])@(np.sign(x)*np.abs(x)**np.array([0.5, 0.6, 0.75]))
        s = x[2] + integral
        delta, rho = L - abs(v_eq)/(0.8*1.1) - 0.2, 0.5 + r
        L_next = max(0.2, L - tau*rho*np.clip(delta/(0.05 + tau*rho), -1.0, 1.0))
        assert v == pytest.approx(v_sigma + (L_next - L)/tau/L*s
                                  + 2*math.sqrt(2.2*L)*math.sqrt(abs(s))*sign(s) + w, rel=1e-12)
        relay = 1.1*L*sign(s)
        integral, w = integral + tau*v_sigma, w + tau*relay
        v_eq += (1 - math.exp(-0.1))*(relay - v_eq)
        r += tau*4.0*abs(delta)*(abs(delta) > 0.05)
        L = L_next
        assert z == pytest.approx((integral, w, v_eq, L, r), rel=1e-9)
        x = x + tau*np.array([x[1], x[2], math.sin(k*tau) - v])


@pytest.mark.parametrize("r", range(2, 6))
def test_adaptive_sliders_refuse_nothing(r):
    law = hosmc.adaptive_continuous(r)
    ranges = {n: law.params[n].slider for n in law.params if n.startswith("gamma_")
              or n in ("alpha", "beta_0")}
    for corner in itertools.product(*ranges.values()):
        there = law.with_(**dict(zip(ranges, corner, strict=True))).values
        assert np.all(np.roots([1.0, *(there[f"gamma_{i}"] for i in range(r, 0, -1))]).real < 0.0)
        assert there["alpha"]*there["beta_0"] < 1.0


def test_adaptive_gain_comes_down_again():
    law = hosmc.adaptive_continuous(2)
    run = simulate(loop(law, (0.0, 0.0), dict(cosine=3.0, omega=2.0)), 15.0, 1e-4, method="rk4",
                   tail=0.2)
    high = run.z.law.L[-100:].mean()
    assert np.abs(run.v - run.d)[-300:].max() < 5e-3  # v has found xi
    end = dict(plant__s0=run.x.s0[-1], plant__s1=run.x.s1[-1],
               **{f"law__{n}": v[-1] for n, v in vars(run.z.law).items()},
               perturbation__cosine=0.3, perturbation__omega=1.0)
    after = simulate(loop(law, (0.0, 0.0), {}).with_(**{n: float(v) for n, v in end.items()}), 15.0,
                     1e-4, method="rk4")
    assert high > 4.0
    assert after.z.law.L[-100:].mean() < 0.15*high


def test_adaptive_start_on_the_surface():
    """With the integral set to minus the highest derivative s = 0 from the start, and the control
    needs less."""
    law = hosmc.adaptive_continuous(2)
    one, two = (simulate(loop(law.with_(integral=q), (1.0, 5.0), WAVE), 2.0, 1e-3, method="rk4")
                for q in (0.0, -5.0))
    s = two.x.s1 + two.z.law.integral
    assert np.abs(s).max() < 0.5
    assert two.max_u < 0.8*one.max_u


def test_adaptive_withstands_coarse_sampling():
    """Its step is implicit in L: with an explicit one these loops diverge, after 23 s and 51 s."""
    for tau in (8e-3, 4e-3):
        run = simulate(loop(hosmc.adaptive_continuous(3), (1.0, 0.0, 0.0), WAVE), 120.0, tau,
                       method="rk4")
        assert run.diverged_at is None
        assert run.tail_e < 1e-4
        assert run.z.law.L.max() < 20.0


def test_adaptive_needs_powers_near_one():
    s = tail(hosmc.adaptive_continuous(5).with_(alpha_r=0.75), [1.0, 0.0, 0.0, 0.0, 0.0], WAVE,
             40.0, 1e-3, 3.0)
    assert not size(s) < 0.5


# ---- errata --------------------------------------------------------------------------------------
@block
def with_coefficient(sigma, c=3.0, alpha=20.0):
    """The rational law of order 5 with any coefficient of the first derivative."""
    s0, s1, s2, s3, s4 = sigma
    p0, p1, p2 = abs(s0), c*abs(s1)**1.25, 5.0*abs(s2)**(5/3)
    p3, p4 = 6.0*abs(s3)**2.5, abs(s4)**5.0
    n = p0 + p1 + p2 + p3 + p4
    return alpha*(p0*sign(s0) + p1*sign(s1) + p2*sign(s2) + p3*sign(s3)
                  + p4*sign(s4))/n if n > 0.0 else 0.0


def test_printed_coefficient_of_27_does_not_converge():
    starts = np.random.default_rng(3).uniform(-1.0, 1.0, (8, 5)).tolist()
    settled = [sum(size(tail(law, s, kind, 40.0, 2e-3, 3.0)) < 0.5 for s in starts
                   for kind in KINDS)
               for law in (with_coefficient, with_coefficient.with_(c=6.0))]
    assert settled[0] == 40
    assert settled[1] < 20


@block(state=dict(integral=0.0, w=0.0))
def literal(sigma, z, tau, outer=1.0, inner=0.0, L: float = 3.0):
    """(29)-(34) with a fixed L; outer = -1: the signs of (29), inner = 1: the integrand of (32),
    both as printed."""
    integral, w = z
    v_sigma = sum_of_powers(sigma)
    s = sigma[2] + integral
    v_s = 2.0*math.sqrt(2.2*L)*math.sqrt(abs(s))*sign(s) + w
    return outer*(v_sigma + v_s), (integral + tau*(v_s if inner > 0.0 else v_sigma),
                                   w + tau*1.1*L*sign(s))


def sum_of_powers(s):
    return (8.0*abs(s[0])**0.51*sign(s[0]) + 12.0*abs(s[1])**0.6*sign(s[1])
            + 6.0*abs(s[2])**0.75*sign(s[2]))


def test_printed_signs_of_29_and_integrand_of_32_diverge():
    def run(law):
        return simulate(loop(law, (1.0, 0.0, 0.0), WAVE), 20.0, 2e-3, jit=False)

    assert run(literal).tail_e < 1e-5
    for wrong in (literal.with_(outer=-1.0), literal.with_(inner=1.0)):
        assert run(wrong).diverged_at is not None or run(wrong).tail_e > 100.0


# ---- relative degree raised by one ---------------------------------------------------------------
@block
def measured(x):
    return -x[0]


@block(state=dict(z0=1.0, z1=0.0, z2=0.0))
def differentiated(e, z, tau, L=18.0):
    """Levant's differentiator of order 2."""
    z0, z1, z2 = z
    a, s = abs(z0 - e), sign(z0 - e)
    return z, (z0 + tau*(z1 - 2.0*L**(1/3)*a**(2/3)*s) + tau*tau*z2/2.0,
               z1 + tau*(z2 - 2.12*L**(2/3)*a**(1/3)*s), z2 - tau*1.1*L*s)


def test_raised_relative_degree():
    """A law of order 3 on a plant of order 2: one order more of accuracy, and a continuous
    control."""
    q = smc.ClosedLoop(chain(2).with_(s0=1.0), output=measured, differentiator=differentiated,
                       law=hosmc.quasi_continuous(3),
                       allocation=hosmc.integrated, perturbation=hostile.with_(cosine=0.5))
    runs = [simulate(q, 25.0, tau/2, tau, method="rk4", tail=0.2)
            for tau in (4e-3, 2e-3, 1e-3, 5e-4)]
    E = [[np.abs(s[-400:]).max() for s in (run.x.s0, run.x.s1)] for run in runs]
    assert np.polyfit(np.log([4e-3, 2e-3, 1e-3, 5e-4]), np.log(E),
                      1)[0] == pytest.approx([3.0, 2.0], abs=0.15)
    direct = simulate(loop(hosmc.quasi_continuous(2), (1.0, 0.0), dict(cosine=0.5)), 25.0, 1e-3,
                      method="rk4", tail=0.2)
    assert runs[2].tail_variation_u < 0.01*direct.tail_variation_u
    assert np.abs(np.diff(runs[2].u)).max() < 0.2

    limited = simulate(q.with_(allocation__limit=0.2), 5.0, 1e-3, method="rk4")
    assert limited.max_u == 0.2
    for G0 in (2.0, -4.0):
        assert hosmc.integrated.with_(G0=G0)(3.0, (1.0,), 0.01) == (1.0/G0, (1.03,))
        assert hosmc.integrated.with_(G0=G0, limit=0.1)(3.0, (1.0,), 0.01)[1] == (0.1*abs(G0),)
    with pytest.raises(ParameterError, match="G0"):
        hosmc.integrated.with_(G0=0.0)


# ---- bad input -----------------------------------------------------------------------------------
@pytest.mark.parametrize(("make", "message"), [
    (lambda: hosmc.quasi_continuous(0),
     "r = 0 is not allowed; it must be a whole number from 1 to 5"),
    (lambda: hosmc.quasi_continuous(6), "from 1 to 5"),
    (lambda: hosmc.quasi_continuous(2.5), "whole number"),
    (lambda: hosmc.quasi_continuous(True), "r = True"), (lambda: hosmc.nested(6), "nested: r = 6"),
    (lambda: hosmc.adaptive_continuous(1), "from 2 to 5"),
    (lambda: hosmc.adaptive_continuous(6), "from 2 to 5"),
    (lambda: hosmc.quasi_continuous(3, "levant"),
     "family = 'levant' is not allowed; it must be one of 'rational', 'levant2005'"),
    (lambda: hosmc.quasi_continuous(3, family=None), "family = None"),
    (lambda: hosmc.quasi_continuous(3).with_(alpha=-1.0), "alpha = -1"),
    (lambda: hosmc.nested(3).with_(L=0.0), "L = 0"),
    (lambda: hosmc.nested(3).with_(lam=0.0), "lam = 0"),
    (lambda: hosmc.nested(3).with_(beta=1.0), "has no 'beta'"),
    (lambda: hosmc.adaptive_continuous(3).with_(gamma_1=1000.0), "Hurwitz"),
    (lambda: hosmc.adaptive_continuous(2).with_(gamma_2=0.0), "gamma_2 = 0"),
    (lambda: hosmc.adaptive_continuous(2).with_(alpha=0.95), "less than 1/beta_0 = 0.909"),
    (lambda: hosmc.adaptive_continuous(2).with_(beta_0=0.9), "beta_0 = 0.9"),
    (lambda: smc.lv.loop("hosm", "paper"),
     "it must be one of 'recommended', 'output_feedback', 'r3', 'raised'")])
def test_bad_input(make, message):
    with pytest.raises(ParameterError, match=message):
        make()


@pytest.mark.parametrize("law", [hosmc.quasi_continuous(3), hosmc.quasi_continuous(3, "levant2005"),
                                 hosmc.nested(3),
                                 hosmc.adaptive_continuous(3)], ids=lambda law: law.name)
@pytest.mark.parametrize("start", [(1.0, 0.0), (1.0, 0.0, 0.0, 0.0)])
def test_wrong_length_is_named(law, start):
    with pytest.raises(smc.BlockError, match=law.name):
        simulate(loop(law, start, {}), 1.0, 1e-3)


@pytest.mark.parametrize("law", [*(LAWS[f](r) for f in LAWS for r in range(1, 6)), hosmc.integrated,
                                 *(hosmc.adaptive_continuous(r) for r in range(2, 6))],
                         ids=lambda law: law.name)
def test_metadata(law):
    doc = law.__doc__
    for part in (".. math::", "Parameters\n", "Returns\n", "Notes\n", "References\n"):
        assert part in doc
    for name, meta in law.settable.items():
        assert isinstance(meta, Param)
        assert meta.help
        assert name in law.states or name in doc
        assert not meta.slider or meta.slider[0] <= law.values[name] <= meta.slider[1]
    if law.name.startswith("nested_5"):
        assert "xperimental" in doc
        assert "experimental" in law.params["alpha"].help
