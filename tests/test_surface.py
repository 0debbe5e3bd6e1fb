"""Sliding variables: the paper's designs, ITAE polynomials and their settling, derivatives,
sampling."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial
from published import ITAE, SLIDING_VARIABLES
from scipy.linalg import expm

import smcaero_nb as smc
from smcaero_nb import BlockError, ClosedLoop, ParameterError, block, simulate
from smcaero_nb.surface import SETTLING, TABLES, coefficients, itae, polynomial

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


@pytest.mark.parametrize(("table", "p"), DEGREES)
def test_measured_settling_to_two_percent(table, p):
    t = np.arange(0.0, 40.0, 1e-3)
    e = error_of_step_response(TABLES[table][p], t)
    assert t[np.flatnonzero(abs(e) > 0.02)[-1]] == pytest.approx(SETTLING[table][p], rel=5e-3)
    e = error_of_step_response(coefficients(p, 3.0, table=table, rule="settling"), t)
    assert t[np.flatnonzero(abs(e) > 0.02)[-1]] == pytest.approx(3.0, rel=5e-3)


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
    """A double integrator held on sigma = 0 by the equivalent control, e(0) = 1."""
    t_s = 4.0
    c0, ci = coefficients(2, t_s, rule=rule)

    @block
    def equivalent(e):
        return -(c0*e[1] + ci*e[0])  # e'' that keeps sigma' = 0

    @block
    def shown(x):
        return -x[0], -x[1]

    @block(state=dict(a=1.0, b=0.0))
    def double(x, u):
        return x[1], u

    run = simulate(ClosedLoop(double, output=shown, surface=itae(2, t_s, rule=rule),
                              law=equivalent), 12.0, 1e-3, method="rk4",
                   record=12000, jit=False)
    last = run.t[np.flatnonzero(abs(run.e[0]) > 0.02)[-1]]
    assert last == pytest.approx(t_s if rule == "settling" else t_s*SETTLING["classical"][2]/10,
                                 rel=0.01)
    assert np.ptp(run.sigma) < 5e-3*max(abs(run.sigma))  # sigma stays where it began


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
