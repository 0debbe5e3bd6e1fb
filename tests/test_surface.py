"""Sliding variables: the paper's designs, ITAE polynomials and their settling, derivatives,
sampling, integral sliding mode."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial
from published import ITAE, SLIDING_VARIABLES
from scipy.linalg import expm

import smcaero_nb as smc
from smcaero_nb import BlockError, Buffer, ClosedLoop, ParameterError, block, simulate
from smcaero_nb.surface import TABLES, coefficients, integral_sliding, itae, polynomial

DEGREES = [(table, p) for table, polynomials in TABLES.items() for p in polynomials]


@pytest.mark.parametrize("row", SLIDING_VARIABLES, ids=lambda row: row.source)
def test_the_designs_of_the_paper(row):
    assert coefficients(*row.case) == pytest.approx(row.value, rel=row.tolerance)


@pytest.mark.parametrize("row", ITAE, ids=lambda row: f"degree {row.case}")
def test_the_classical_table_is_the_published_one(row):
    assert (1, *TABLES["classical"][row.case]) == row.value
    r = row.case  # with the integral the degree is r; at w = 1 the coefficients are the table's
    assert coefficients(r, 10.0) == row.value[1:]


@pytest.mark.parametrize(("table", "p"), DEGREES)
def test_all_polynomials_are_hurwitz(table, p):
    assert len(TABLES[table][p]) == p
    assert max(np.roots([1.0, *TABLES[table][p]]).real) < -0.1


def error_of_step_response(c, t):
    """Error 1 - y(t) of y = 1/(s^p + ...) with unit gain and zero initial derivatives, exact."""
    p = len(c)
    A = np.eye(p, k=1)
    A[-1] = -np.array(c[::-1])
    E, x, e = expm(A*(t[1] - t[0])), np.eye(p)[0], []
    for _ in t:
        e.append(x[0])
        x = E@x
    return np.array(e)


def error_on_the_surface(c, r, integral, t):
    """e while sigma = 0, exact: e(0) = 1, its integral and derivatives 0 but the highest, which
    sigma = 0 determines."""
    A = np.eye(len(c), k=1)
    A[-1] = -np.array(c[::-1])
    E, x, e = expm(A*(t[1] - t[0])), np.eye(len(c))[int(integral and r > 1)], []
    for _ in t:
        e.append(x[int(integral and r > 1)])
        x = E@x
    return np.array(e)


DESIGNS = [(table, r, integral) for table, p in DEGREES for integral in (False, True)
           if (r := p + 1 - integral) <= 6]


@pytest.mark.parametrize(("table", "r", "integral"), DESIGNS)
def test_on_sigma_0_the_error_settles_in_the_time_asked_for(table, r, integral):
    """With the integral and r = 4, 5, 6 it took 2.03, 1.77, 1.69 times that."""
    t = np.arange(0.0, 40.0, 1e-3)
    c = coefficients(r, 3.0, integral, table, "settling")
    e = error_on_the_surface(c, r, integral, t)
    assert t[np.flatnonzero(abs(e) > 0.02)[-1]] == pytest.approx(3.0, rel=5e-3)


#: r: settling time over t_s, and overshoot [%], without the integral and with it, as `itae` says.
SAID = {2: (0.39, 0, 0.49, 21), 3: (0.60, 5, 0.70, 46), 4: (0.75, 2, 0.91, 62),
        5: (0.45, 2, 1.18, 75), 6: (0.67, 2, 1.32, 98)}


@pytest.mark.parametrize("r", SAID)
def test_the_rule_of_the_paper_settles_and_overshoots_as_the_docstring_says(r):
    t = np.arange(0.0, 20.0, 1e-3)
    for integral, share, over in zip((False, True), SAID[r][::2], SAID[r][1::2], strict=True):
        e = error_on_the_surface(coefficients(r, 8.0, integral), r, integral, t)
        assert t[np.flatnonzero(abs(e) > 0.02)[-1]]/8.0 == pytest.approx(share, abs=0.006)
        assert -100.0*e.min() == pytest.approx(over, abs=0.5)
        said = f"settles to 2 % in {share:.2g} `settling_time`"
        assert said in itae(r, 8.0, integral).__doc__ and f"{over}" in itae.__doc__
        assert np.sum(e)*1e-3 == pytest.approx(0.0, abs=2e-3) or not integral
    for column in zip(*SAID.values(), strict=True):
        words = ", ".join(f"{v:.2f}" if isinstance(v, float) else f"{v}" for v in column)
        assert words in " ".join(itae.__doc__.split())


@pytest.mark.parametrize("r", [2, 3, 4, 5])
def test_begun_on_sigma_0_the_error_overshoots_no_more_than_without_the_integral(r):
    c = coefficients(r, 8.0)
    start = itae(r, 8.0).with_(integral=-c[-2]/c[-1])
    assert start((1.0, *(0.0,)*(r - 1)), start.z0, 0.01)[0] == pytest.approx(0.0, abs=1e-12)
    e = error_of_step_response(c, np.arange(0.0, 20.0, 1e-3))
    assert -100.0*e.min() < 5.0 and (r > 3 or -100.0*e.min() < 0.25*SAID[r][3])


@pytest.mark.parametrize("p", TABLES["optimal"])
def test_optimal_has_less_itae_than_classical_and_than_its_neighbours(p):
    t = np.arange(0.0, 40.0, 5e-3)

    def cost(c):
        return np.sum(t*abs(error_of_step_response(c, t)))*5e-3

    best = cost(TABLES["optimal"][p])
    if p > 1:
        assert best < cost(TABLES["classical"][p])
    for i in range(p - 1):  # the last coefficient is 1 by the scale of time
        for factor in (0.98, 1.02):
            c = list(TABLES["optimal"][p])
            c[i] *= factor
            assert cost(c) > best*(1 - 1e-6)


def test_itae_of_degree_five():
    """Published study: 6.320 against 7.154."""
    t = np.arange(0.0, 60.0, 1e-3)
    cost = {table: np.sum(t*abs(error_of_step_response(TABLES[table][5], t)))*1e-3
            for table in TABLES}
    assert (cost["optimal"] == pytest.approx(6.320, abs=5e-3)
            and cost["classical"] == pytest.approx(7.154, abs=5e-3))


@given(r=st.integers(1, 6), settling_time=st.floats(0.01, 1000), integral=st.booleans(),
       rule=st.sampled_from(["paper", "settling"]))
def test_time_scales(r, settling_time, integral, rule):
    c, unit = (coefficients(r, t, integral, rule=rule) for t in (settling_time, 1.0))
    assert len(c) == r - 1 + integral
    for k, (a, b) in enumerate(zip(c, unit, strict=True)):
        assert a == pytest.approx(b/settling_time**(k + 1), rel=1e-12)


CASES = [(r, integral) for r in range(1, 6) for integral in (False, True)]


@pytest.mark.parametrize("make", ["itae", "polynomial"])
@pytest.mark.parametrize(("r", "integral"), CASES)
def test_sigma_is_the_literal_formula(r, integral, make):
    rng = np.random.default_rng(r)
    c = coefficients(r, 3.0, integral)
    surface = itae(r, 3.0, integral) if make == "itae" else polynomial(c, integral)
    assert surface.signals == (("e", "z", "tau") if integral else ("e",))
    e, total, tau = tuple(rng.normal(size=r)), rng.normal(), 0.01
    e_or_float = e[0] if r == 1 else e
    literal = e[r - 1] + sum(a*e[r - 2 - k]
                             for k, a in enumerate(c[:r - 1])) + (c[-1]*total if integral else 0.0)
    got = surface(e_or_float, (total,), tau) if integral else surface(e_or_float)
    if integral:
        got, (after,) = got
        assert after == total + tau*e[0]
    assert got == pytest.approx(literal, rel=1e-12)
    if r == 1:  # a float or a tuple of one
        assert surface(e, (total,), tau) if integral else surface(e) == surface(e_or_float)


@pytest.mark.parametrize(("r", "integral"), CASES)
def test_the_derivative_is_that_of_sigma_along_a_smooth_error(r, integral):
    rng = np.random.default_rng(10*r)
    e = Polynomial(rng.normal(size=7))
    E = e.integ()
    surface = itae(r, 4.0, integral, derivative=True)
    plain = itae(r, 4.0, integral)

    def at(t, block, count):
        args = tuple(e.deriv(i)(t) if i else e(t) for i in range(count)),
        return block(*args, (E(t),), 0.01)[0] if integral else block(*args)

    for t in (0.3, 1.1, 2.0):
        sigma, rate = at(t, surface, r + 1)
        assert sigma == at(t, plain, r)
        h = 1e-5
        measured = (at(t + h, plain, r) - at(t - h, plain, r))/(2*h)
        assert rate == pytest.approx(measured, rel=1e-6, abs=1e-6)


def test_settling_time_is_a_parameter_and_the_integral_a_state():
    surface = itae(2, 8.0)
    assert list(surface.settable) == ["settling_time", "integral"]
    e = (0.3, -0.1)
    for t_s in (2.0, 5.0, 8.0):
        c0, ci = coefficients(2, t_s)
        assert surface.with_(settling_time=t_s)(e, (0.5,),
                                                0.0)[0] == pytest.approx(e[1] + c0*e[0] + ci*0.5,
                                                                         rel=1e-12)
    assert surface.with_(integral=0.2).z0 == (0.2,)
    assert list(polynomial((1.75, 1.56)).params) == ["c_0", "c_int"]
    assert list(polynomial((3.0, 3.0, 1.0)).params) == ["c_1", "c_0", "c_int"]
    assert list(polynomial((3.0, 3.0, 1.0), integral=False).params) == ["c_2", "c_1", "c_0"]
    assert itae(1, 1.0, integral=False).params == {}


def test_settling_times_from_numpy_are_numbers():
    for t_s in np.linspace(2.0, 8.0, 3):
        assert itae(2, t_s).values["settling_time"] == t_s
    assert polynomial(np.array([1.75, 1.5625])).values == dict(c_0=1.75, c_int=1.5625, integral=0.0)
    assert itae(np.int64(3), 5).values["settling_time"] == 5.0


@pytest.mark.parametrize(("arguments", "words"), [
    (dict(r=0), ["r = 0 is not allowed", "a whole number from 1 to 6"]),
    (dict(r=7), ["r = 7"]), (dict(r=2.5), ["r = 2.5"]), (dict(r=True), ["r = True"]),
    (dict(settling_time=0.0), ["settling_time = 0 s is not allowed", "at least 1e-06 s"]),
    (dict(settling_time=-8), ["settling_time = -8 s"]),
    (dict(settling_time=math.nan), ["settling_time = nan s"]),
    (dict(settling_time=math.inf), ["settling_time = inf s"]),
    (dict(settling_time="8"), ["settling_time = '8'"]),
    (dict(integral=1), ["integral = 1 is not allowed", "True or False"]),
    (dict(table="best"), ["table = 'best'", "'classical' up to 6, 'optimal' up to 5"]),
    (dict(r=6, table="optimal"), ["no polynomial of degree 6", "'optimal' up to 5"]),
    (dict(rule="slow"), ["rule = 'slow' is not allowed", "'paper'", "'settling'"])])
@pytest.mark.parametrize("make", [coefficients, itae])
def test_bad_designs_are_refused(make, arguments, words):
    with pytest.raises(ParameterError) as why:
        make(**{"r": 2, "settling_time": 8.0, **arguments})
    for word in words:
        assert word in str(why.value)


@pytest.mark.parametrize("c", [(-1.0, 1.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0, 2.0),
                               (1.0, 1.0, 1.0)])
def test_a_polynomial_that_is_not_hurwitz_is_refused(c):
    with pytest.raises(ParameterError) as why:
        polynomial(c)
    assert ("must be Hurwitz" in str(why.value) and "has the roots" in str(why.value)
            and str(c) in str(why.value))
    assert max(np.roots([1.0, *c]).real) > -1e-9


@given(st.lists(st.floats(0.1, 5.0), min_size=1, max_size=5))
def test_a_polynomial_with_roots_in_the_left_half_plane_is_taken(roots):
    c = np.poly([-q for q in roots])[1:]
    if max(np.roots([1.0, *c]).real) < 0:  # numerically so: multiple roots scatter
        assert list(polynomial(c).values.values())[:-1] == list(c)


def test_sigma_needs_as_many_derivatives_as_the_relative_degree():
    with pytest.raises(BlockError, match="surface 'itae' fails at t = 0"):
        simulate(ClosedLoop(chain, output=lambda_output, surface=itae(3, 1.0)), 1.0, 0.1)


@block(state=dict(a=1.0, b=0.0))
def chain(x, u, d):
    return x[1], d - u


@block
def lambda_output(x):
    return x[0], x[1]


@pytest.mark.parametrize("rule", ["paper", "settling"])
def test_on_the_sliding_surface_the_error_settles_as_designed(rule):
    """A double integrator held on sigma = 0 by the equivalent control, from e = 1, e' = -c_0."""
    t_s = 4.0
    c0, ci = coefficients(2, t_s, rule=rule)

    @block
    def equivalent(e):
        return -(c0*e[1] + ci*e[0])  # e'' that keeps sigma' = 0

    @block
    def shown(x):
        return -x[0], -x[1]

    @block(state=dict(a=1.0, b=-c0))
    def double(x, u):
        return x[1], u

    run = simulate(ClosedLoop(double, output=shown, surface=itae(2, t_s, rule=rule),
                              law=equivalent), 12.0, 1e-3, method="rk4",
                   record=12000, jit=False)
    last = run.t[np.flatnonzero(abs(run.e[0]) > 0.02)[-1]]
    assert last == pytest.approx(t_s if rule == "settling" else 0.4882*t_s, rel=0.01)
    assert max(abs(run.sigma)) < 5e-3*c0 and min(run.e[0]) == pytest.approx(-0.21, abs=0.005)


@pytest.mark.parametrize("block", [itae(2, 8.0), itae(3, 8.0, integral=False),
                                   polynomial((1.0, 1.0))])
def test_surfaces_explain_themselves(block):
    assert r".. math:: \sigma = " in block.__doc__ and "Paper eq (9)" in block.__doc__
    assert smc.surface.itae.__doc__ and block.output.symbol == r"\sigma"
    assert [m.symbol for m in itae(2, 8.0, derivative=True).output] == [r"\sigma", r"\dot\sigma"]


# ---- one derivative more -------------------------------------------------------------------------
@pytest.mark.parametrize("r", (1, 2, 4))
def test_differenced(r):
    block = smc.surface.differenced(r)
    e = 0.3 if r == 1 else tuple(0.1*(i + 1) for i in range(r))
    last = e if r == 1 else e[-1]
    out, z = block(e, (0.0, 0.0), 0.5)
    # not known before the start
    assert out == ((e, 0.0) if r == 1 else (*e, 0.0)) and z == (last, 1.0)
    out, _ = block(e, (last - 0.2, 1.0), 0.5)
    assert out[-1] == pytest.approx(0.4)
    # a value of 0 counts like any other
    assert block(e, (0.0, 1.0), 0.5)[0][-1] == pytest.approx(2.0*last)


def test_truncated():
    assert smc.surface.truncated(1)((0.1, 0.2)) == smc.surface.truncated(1)(0.1) == 0.1
    assert smc.surface.truncated(3)((0.1, 0.2, 0.3, 0.4)) == (0.1, 0.2, 0.3)


def test_what_does_not_matter_is_checked_all_the_same():
    for call in (lambda: smc.surface.itae(1, integral=False, table="nonsense"),
                 lambda: smc.surface.itae(1, 1.0, False, rule="x"),
                 lambda: smc.surface.coefficients(1, "x", integral=False),
                 lambda: smc.surface.differenced(6),
                 lambda: smc.surface.truncated(0)):
        with pytest.raises(smc.ParameterError):
            call()
    with pytest.raises(smc.ParameterError, match="derivative = 'x' is not allowed"):
        smc.surface.itae(2, derivative="x")


# ---- integral sliding mode -----------------------------------------------------------------------
NOMINAL = smc.pid.pd.with_(k_p=4.0, k_d=3.0)
PERTURBED = smc.applications.perturbed_chain(smc.smc1.sign_smc.with_(rho=6.0), 1).with_(
    plant=smc.applications.chain(2).with_(s0=1.0, s1=-0.5))
SLIDING = PERTURBED.with_(surface=integral_sliding(2, NOMINAL))


def test_integral_sliding_slides_from_the_first_sample_on():
    for xi in (0.0, 0.8, -1.5):
        run = simulate(SLIDING.with_(perturbation__xi_0=xi))
        assert run.sigma[0] == 0.0
        assert abs(run.sigma).max() <= 1e-3*(6.0 + abs(run.xi).max())  # the bound of a relay
    # itae has to reach sigma = 0 first
    assert abs(simulate(PERTURBED.with_(surface=itae(2, 4.0))).sigma[0]) > 1.0


@pytest.mark.parametrize("nominal", [NOMINAL, smc.hosmc.quasi_continuous(2).with_(alpha=1.2)],
                         ids=lambda b: b.name)
def test_under_a_matched_perturbation_the_nominal_motion_is_followed(nominal):
    wanted = simulate(PERTURBED.with_(law=nominal, perturbation__xi_1=0.0), 6.0)
    run = simulate(SLIDING.with_(surface=integral_sliding(2, nominal)), 6.0)
    alone = simulate(PERTURBED.with_(law=nominal), 6.0)
    assert abs(run.e[0] - wanted.e[0]).max() < 2e-3 and abs(run.e[1] - wanted.e[1]).max() < 2e-2
    assert nominal is not NOMINAL or abs(alone.e[0] - wanted.e[0]).max() > 0.1


def test_integral_sliding_shows_its_nominal_law_and_what_the_law_opposes():
    surface = integral_sliding(2, NOMINAL)
    assert list(surface.settable) == ["k_p", "k_d", "offset", "started"]
    assert surface.settable["k_p"] == smc.pid.pd.params["k_p"]
    assert surface.__doc__.startswith("Integral sliding mode around pd, relative degree 2.\n\n")
    assert r"\int_0^t v_0\,dt" in surface.__doc__ and "\nReferences\n---" in surface.__doc__
    assert "v = k_p" in surface.__doc__ and "e^{(1)}" in surface.__doc__
    assert surface.code() == ("smc.surface.integral_sliding(2, "
                              "smc.pid.pd.with_(k_p=4.0, k_d=3.0))")
    run = simulate(SLIDING, 0.5, method="rk4")
    opposed = run.d + 4.0*run.e[0] + 3.0*run.e[1]  # xi + v_0
    assert abs(run.xi - opposed)[5:].max() < 0.2
    weak = simulate(SLIDING.with_(law__rho=2.0))  # more than |xi|, less than |xi + v_0| = 3.3
    assert abs(weak.sigma).max() > 0.1
    again = surface.with_(offset=0.3, started=1.0)
    assert again((0.5, -0.2), again.z0, 0.01)[0] == pytest.approx(0.1)


def test_a_nominal_law_with_memory_keeps_its_states_and_its_check():
    for nominal in (smc.pid.pid, smc.hosmc.adaptive_continuous(2)):
        surface = integral_sliding(2, nominal)
        assert list(surface.states) == [*nominal.states, "offset", "started"]
        loop = SLIDING.with_(surface=surface, duration=1.0)
        compiled, plain = simulate(loop), simulate(loop, jit=False)
        assert np.array_equal(compiled.sigma, plain.sigma)
        last = list(nominal.states)[0]
        assert getattr(compiled.z.surface, last)[-1] != nominal.values[last]
    with pytest.raises(ParameterError, match="must be less than 1/beta_0"):
        surface.with_(alpha=0.99)
    one = integral_sliding(1, smc.smc1.quasi_smc)
    assert one((0.4, 7.0), one.z0, 0.5) == one(0.4, one.z0, 0.5) == (0.0, (-0.4 + 0.5*1.6, 1.0))


@block(state=dict(late=Buffer(3, 0.1), q=(0.0, 0.0)))
def late_pd(e, z, tau, k=(4.0, 3.0)):
    """With a delayed rate, a state and a parameter of two numbers."""
    late, q = z
    return k[0]*e[0] + k[1]*late, (e[1], (q[0] + tau, late))


def test_a_nominal_law_may_have_buffers_and_tuples():
    surface = integral_sliding(2, late_pd)
    assert surface.z0 == (0.1, (0.0, 0.0), 0.0, 0.0)
    assert surface.with_(k=(2.0, 1.0)).values["k"] == (2.0, 1.0)
    loop = SLIDING.with_(surface=surface, duration=1.0)
    compiled, plain = simulate(loop), simulate(loop, jit=False)
    assert np.array_equal(compiled.sigma, plain.sigma) and abs(plain.sigma).max() < 0.02
    assert compiled.z.surface.offset[-1] == plain.z.surface.offset[-1]


@block
def of_plants(x):
    return x[0]


@pytest.mark.parametrize(("arguments", "words"), [
    ((2, smc.hosmc.nested(3)), "r = 2 is not allowed; nested_3 is for relative degree 3"),
    ((7, NOMINAL), "r = 7"), ((2, of_plants), "of_plants asks for x, which a surface does not see"),
    ((2, block(lambda e, s=1.0: s*e[0])), "has a 's', which is a name of the surface's own")])
def test_a_nominal_law_that_does_not_fit_is_refused(arguments, words):
    with pytest.raises(ParameterError, match=words):
        integral_sliding(*arguments)
    with pytest.raises(BlockError, match="nominal must be a block"):
        integral_sliding(2, "pd")
