"""Differentiators: coefficients, one step, orders, records, feedback, observer, bad input."""

import itertools
import math
import tracemalloc
import warnings

import numpy as np
import pytest

from smcaero_nb import (
    BlockError,
    ClosedLoop,
    Param,
    ParameterError,
    block,
    channels,
    hosmc,
    simulate,
)
from smcaero_nb.applications import chain, chain_output, chain_perturbation, dc_motor
from smcaero_nb.differentiators import LAMBDA, differentiate, differentiator, lipschitz, observer

METHODS = ("levant", "implicit", "matching", "euler")
ORDERS = [(1, 0), (2, 0), (3, 0), (5, 0), (3, 2)]


def signal(t, i):
    """0.5 sin t + 0.5 cos(t/2), all of whose derivatives are less than 1; the i-th of them."""
    return 0.5*np.sin(t + i*np.pi/2) + 0.5*0.5**i*np.cos(0.5*t + i*np.pi/2)


def errors(method, n_d, n_f, h, duration=40.0, noise=lambda t: 0.0):
    """Greatest error of each estimate in the last 0.4 of a record."""
    t = np.arange(round(duration/h) + 1)*h
    z, late = differentiate(t, signal(t, 0) + noise(t), 1.0, n_d, n_f, method), t > 0.6*duration
    return [np.abs(z[i] - signal(t, i))[late].max() for i in range(n_d + 1)]


def slopes(x, E):
    """Slope of each column of E over x, both logarithmic."""
    return np.polyfit(np.log(x), np.log(E), 1)[0]


# ---- table ---------------------------------------------------------------------------------------
def test_table_follows_its_recursion():
    last = (1.1, 1.5, 2, 3, 5, 7, 10, 12, 14, 17, 20, 26, 32)
    for n, row in enumerate(LAMBDA):
        exact = [float(last[n])]
        for i in reversed(range(n)):
            exact.insert(0, last[i]*exact[0]**(i/(i + 1)))
        assert row == pytest.approx(exact, rel=2e-3)


@pytest.mark.parametrize("n", range(13))
def test_rows_are_hurwitz(n):
    assert np.roots([1.0, *LAMBDA[n][::-1]]).real.max() < 0.0


def test_rows_of_the_paper():
    assert LAMBDA[5] == (1.1, 6.75, 20.26, 32.24, 23.72, 7.0)  # (43)
    assert LAMBDA[2] == (1.1, 2.12, 2.0)  # (41) prints 3 for the last


# ---- one step ------------------------------------------------------------------------------------
def power(x, a):
    return np.sign(x)*abs(x)**a


def by_hand(method, x, n_d, n_f, L, h, f):
    """One step as the equations are printed: next states, and estimates."""
    n, lam = n_d + n_f, np.array(LAMBDA[n_d + n_f])
    A = np.diag(np.ones(n), 1)
    b = -np.eye(n + 1)[n_f - 1] if n_f else np.zeros(n + 1)  # of f
    s = x[0] - (0.0 if n_f else f)
    exact = sum(np.linalg.matrix_power(A, k)*h**k/math.factorial(k) for k in range(n + 1))
    exact[:n_f] = (np.eye(n + 1) + h*A)[:n_f]  # Euler's in the rows of w
    if method == "implicit":
        total = sum(h**i*x[i] for i in range(n + 1)) - h**n_f*f
        B = abs(total)/(h**(n + 1)*L)
        if B <= lam[0]:
            xi, rho = total/(h**(n + 1)*L*lam[0]), 0.0
        else:
            roots = np.roots([1.0, *lam[:0:-1], lam[0] - B])
            xi, rho = np.sign(total), max(q.real for q in roots
                                          if abs(q.imag) < 1e-9)*h*L**(1/(n + 1))
        y = np.array(x)
        for i in reversed(range(n + 1)):
            y[i] += h*((y[i + 1] if i < n else 0.0) + b[i]*f
                       - lam[n - i]*L**((i + 1)/(n + 1))*xi*rho**(n - i))
        c = np.zeros((n_d + 1, n_d + 1))
        for j in range(n_d + 1):  # unsigned Stirling numbers: x (x + 1) ... (x + j - 1)
            c[j, :j + 1] = np.atleast_1d(np.poly(-np.arange(j)))[::-1]
        out = [sum(math.factorial(i)/math.factorial(j)*c[j, i]*h**(j - i)*y[n_f + j]
                   for j in range(i, n_d + 1))
               for i in range(n_d + 1)]
        return y, out
    if method == "matching":
        D = exact - np.eye(n + 1)
        q = np.expm1(h*np.roots([1.0, *lam[::-1]])*(L/abs(s))**(1/(n + 1)))
        wanted = sum(a.real*np.linalg.matrix_power(D, n + 1 - k)
                     for k, a in enumerate(np.atleast_1d(np.poly(q))))
        seen = np.array([np.linalg.matrix_power(D, k)[0] for k in range(n + 1)])
        return exact@x + h*b*f - wanted@np.linalg.solve(seen, np.eye(n + 1)[-1])*s, x[n_f:]
    phi = np.array([power(s, (n - i)/(n + 1)) if i < n else np.sign(s) for i in range(n + 1)])
    correction = lam[::-1]*L**(np.arange(1, n + 2)/(n + 1))*phi
    return (exact if method == "levant" else np.eye(n + 1) + h*A)@x + h*(b*f - correction), x[n_f:]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("n_d", "n_f"), [*ORDERS, (0, 0), (0, 2), (1, 1), (5, 2), (7, 0)])
def test_one_step(method, n_d, n_f):
    blk, rng = differentiator(n_d, n_f, method), np.random.default_rng(1)
    for h, size in itertools.product((0.1, 0.01), (1.0, 1e-3, 1e-6)):
        x, f, L = size*rng.uniform(-1.0, 1.0,
                                   n_d + n_f
                                   + 1), size*rng.uniform(-1.0, 1.0), 10.0**rng.uniform(-2.0, 2.0)
        y, z = blk(f, (*x.tolist(), 1.0), h, L=L)
        z_by_hand, y_by_hand = by_hand(method, x, n_d, n_f, L, h, f)
        assert z[-1] == 1.0
        assert z[:-1] == pytest.approx(z_by_hand, rel=1e-8, abs=1e-9*size)
        assert np.ravel(y) == pytest.approx(y_by_hand, rel=1e-8, abs=1e-9*size)


def test_one_step_of_order_2():
    """Numbers worked out apart from the code: x = (1, 2, 3), f = 0.9, L = 2, h = 0.01."""
    root = 0.1/2.0
    g = [2.0*root**(2/3), 2.0*root**(1/3), 2.0]
    euler = (1.02 - 0.02*g[0], 2.03 - 0.0212*g[1], 3.0 - 0.011*g[2])
    x = (1.0, 2.0, 3.0, 1.0)
    assert differentiator(2, method="euler")(0.9, x, 0.01,
                                             L=2.0) == ((1.0, 2.0, 3.0),
                                                        pytest.approx((*euler, 1.0)))
    assert differentiator(2)(0.9, x, 0.01,
                             L=2.0)[1] == pytest.approx((euler[0] + 1.5e-4, *euler[1:], 1.0))


@pytest.mark.parametrize("method", METHODS)
def test_a_step_on_the_signal_is_finite(method):
    for n_d, n_f in [*ORDERS, (0, 0)]:
        blk = differentiator(n_d, n_f, method)
        assert np.isfinite(np.ravel(blk(0.0, (0.0,)*(n_d + n_f + 1) + (1.0,), 0.01)[1])).all()
        for f in (5e-324, 1e-300, 1e-12, 1.0, 1e9):
            assert np.isfinite(np.ravel(blk(f, (0.0,)*(n_d + n_f + 1) + (1.0,), 0.01)[1])).all()


@pytest.mark.parametrize("n", range(1, 8))
def test_matching_tends_to_eulers_gains(n):
    """As tau tends to 0.

    Expanded in powers of the eigenvalues, the gains of order 7 would be wrong by a factor of 1e14.
    """
    h, x = 1e-6, (1.0,)*(n + 1) + (1.0,)
    one, two = (np.array(differentiator(n, method=m)(0.5, x, h)[1][:-1])
                for m in ("matching", "levant"))
    still = np.array(differentiator(n)(1.0, x, h)[1][:-1])  # without a correction
    assert (one - still)[0]/(two - still)[0] == pytest.approx(1.0, abs=1e-3*n)
    q = h/0.5**(1/(n + 1))
    D = sum(np.linalg.matrix_power(np.diag(np.ones(n), 1), k)/math.factorial(k)
            for k in range(1, n + 1))
    # of the chain scaled to steps of 1: eigenvalues exp(q p_j)
    gain = (still - one)/0.5*h**np.arange(n + 1)
    D[:, 0] -= gain
    assert -D[0, 0]/n == pytest.approx(q*LAMBDA[n][n]/n, rel=1e-3)


# ---- accuracy ------------------------------------------------------------------------------------
CASES = [(m, *q) for m in METHODS[:3] for q in ORDERS]


@pytest.mark.parametrize(("method", "n_d", "n_f"), [*CASES, ("euler", 1, 0), ("euler", 3, 0)])
def test_slopes_without_noise(method, n_d, n_f):
    first = {1: 5e-3, 2: 5e-3, 3: 2e-2}.get(n_d + n_f, 0.1 if method == "implicit" else 0.00625)
    h = first/2.0**np.arange(4 if n_d + n_f < 5 else 3)
    found = np.array([errors(method, n_d, n_f, q) for q in h])
    expected = np.arange(n_d + 1, 0, -1.0)
    if method == "implicit":
        assert found[:, 0].max() < 1e-15
        found, expected = found[:, 1:], expected[1:]
    if method == "euler":  # the derivatives lose their orders
        expected[1:] = 1.0
    assert slopes(h, found) == pytest.approx(expected, abs=0.15)


@pytest.mark.parametrize(("method", "n_d", "n_f"), CASES)
def test_slopes_in_noise(method, n_d, n_f):
    eps = np.array([1e-2, 1e-3, 1e-4,
                    1e-5]) if n_d + n_f < 5 else np.array([3e-2, 1e-2, 3e-3, 1e-3, 3e-4])
    h = {1: 5e-4, 2: 1e-3, 3: 2e-3, 5: 5e-3}[n_d + n_f]
    found = [errors(method, n_d, n_f, h, 60.0, lambda t,
                    e=e: e*np.cos(1.3*(1.0/e)**(1/(n_d + 1))*t)) for e in eps]
    assert slopes(eps, found) == pytest.approx(np.arange(n_d + 1, 0, -1)/(n_d + 1), abs=0.15)


def test_the_filter_takes_away_large_fast_noise():
    """cos 1000 t, twice as large as the signal; figures of a study of its own."""
    for n_f, expected in ((0, (0.48, 0.95, 0.90)), (2, (0.0016, 0.022, 0.16)),
                          (4, (0.00046, 0.0096, 0.106))):
        assert errors("levant", 2, n_f, 1e-4, 30.0,
                      lambda t: np.cos(1000.0*t)) == pytest.approx(expected, rel=0.05)


def test_float64_ends_the_accuracy():
    assert 1e-3 < errors("implicit", 5, 0, 2e-3)[-1] < 5e-2
    # 40 digits give 4.3e-8 for the derivative 5 and 0.0062 for 8
    with pytest.warns(UserWarning, match="float64"):
        fine = errors("levant", 12, 0, 1e-3)
    assert fine[5] > 1e-6 and fine[8] > 0.05
    with pytest.warns(UserWarning, match="n_d \\+ n_f = 8 is more than float64 can resolve"):
        assert "float64" in differentiator(5, 3).params["L"].help
    differentiator(5, 2)


@pytest.mark.parametrize(("n_d", "factor"), [(1, 5.0), (2, 5.0), (3, 10.0), (4, 70.0), (5, 3200.0)])
def test_levant_follows_polynomials_from_exact_values(n_d, factor):
    """Within factor L h^(n_d + 1 - i): 5 for n_d = 1, 2.

    Where nothing rounds there is no error at all: see the next test.
    But 0 is unstable, and the least rounding starts a limit cycle of a size of its own. Its
    greatest error is that of z_1, of 1.1, 3.8, 9.8, 66, 3376 L h^(n_d + 1 - i) for n_d = 1..5: the
    same with 50 digits, after a push of 1e-40 or 1e-60 with 80 digits (n_d = 3 to 5), and for n_d =
    3 with h = 0.01 and 0.001. So no arithmetic keeps 5 for n_d > 2.
    """
    rng, h = np.random.default_rng(n_d), 0.01
    for degree in range(n_d + 1):
        p = np.polynomial.Polynomial(rng.uniform(-1.0, 1.0, degree + 1))
        exact = [p.deriv(i) if i else p for i in range(n_d + 1)]
        z = (*(float(q(0.0)) for q in exact), 1.0)
        blk = differentiator(n_d).with_(L=1.0)
        for k in range(300):
            y, z = blk(float(p(k*h)), z, h)
            assert all(abs(v - q(k*h)) <= factor*h**(n_d + 1 - i)
                       for i, (v, q) in enumerate(zip(y, exact, strict=True)))


@pytest.mark.parametrize("n_d", range(1, 6))
def test_levant_follows_polynomials_exactly_where_nothing_rounds(n_d):
    """Numbers of few binary digits: s and its sign are 0, and Taylor's steps are exact."""
    blk, h = differentiator(n_d), 1.0/128.0
    for degree in range(n_d + 1):
        p = np.polynomial.Polynomial((3.0, -2.0, 5.0, 1.0, -3.0, 2.0)[:degree + 1])
        exact = [p.deriv(i) if i else p for i in range(n_d + 1)]
        z = (*(float(q(0.0)) for q in exact), 1.0)
        for k in range(300):
            y, z = blk(float(exact[0](k*h)), z, h)
            assert y == tuple(q(k*h) for q in exact)


# ---- metamorphic ---------------------------------------------------------------------------------
@pytest.mark.parametrize(("method", "n_d", "n_f"), [*CASES, ("euler", 3, 0)])
def test_scaling(method, n_d, n_f):
    t, rng = np.arange(2000)*0.01, np.random.default_rng(0)
    f = signal(t, 0) + 1e-3*rng.uniform(-1.0, 1.0, len(t))
    base = differentiate(t, f, 2.0, n_d, n_f, method)
    assert np.array_equal(differentiate(t, 8.0*f, 16.0, n_d, n_f, method), 8.0*base)
    assert np.array_equal(differentiate(t, -f, 2.0, n_d, n_f, method), -base)
    slow = differentiate(2.0*t, f, 2.0/2.0**(n_d + 1), n_d, n_f,
                         method)*2.0**np.arange(n_d + 1)[:, None]
    # roots round: not to the last bit
    assert np.all(np.abs(slow - base).max(axis=1) <= 1e-9*np.abs(base).max(axis=1))


@pytest.mark.parametrize(("method", "n_d"), [*itertools.product(METHODS[:3], (2, 3, 5))])
def test_the_unit_of_time_does_not_matter_where_the_bound_is_found(method, n_d):
    """A daily sine, one sample per minute, in days and in seconds.

    In seconds the bound is 2.8e-16 K/s^4 for n_d = 3.
    """
    t, rng, powers = np.arange(0.0, 10.0,
                               1.0/1440.0), np.random.default_rng(0), np.arange(n_d + 1)[:, None]
    f = 10.0*np.sin(2.0*np.pi*t) + 0.05*rng.standard_normal(len(t))
    days, seconds = differentiate(t, f, "auto", n_d, 0,
                                  method), differentiate(86400.0*t, f, "auto", n_d, 0, method)
    assert np.all(np.abs(86400.0**powers*seconds
                         - days).max(axis=1) <= 1e-6*np.abs(days).max(axis=1))
    assert np.abs(days[1] - 20.0*np.pi*np.cos(2.0*np.pi*t))[t > 5.0].max() < 0.12*20.0*np.pi
    assert not differentiate(86400.0*t, 0.0*f, "auto", n_d, 0, method).any()


# ---- block, loop and record agree ----------------------------------------------------------------
@block
def wave(t, omega=1.0):
    return math.sin(omega*t), omega*math.cos(omega*t), -omega*omega*math.sin(omega*t)


@block
def still(x):
    return x[0], 0.0, 0.0


@block
def ramp(t):
    return math.sin(1.5*t) + 0.3*t


@block
def zero(x):
    return 0.0


@block(state=dict(s=0.0))
def nothing(x):
    return (0.0*x[0],)


@block
def none(e):
    return 0.0


@pytest.mark.parametrize(("method", "n_d", "n_f"),
                         [*((m, 3, 2) for m in METHODS[:3]), ("levant", 0, 1)])
def test_block_loop_and_record_are_the_same(method, n_d, n_f):
    blk = differentiator(n_d, n_f, method).with_(L=2.0)
    loop = ClosedLoop(nothing, reference=ramp, output=zero, differentiator=blk, surface=none)
    compiled, plain = (simulate(loop, 2.0, 0.01, record=200, jit=jit) for jit in (True, False))
    f, z, rows = compiled.e, blk.z0, []
    for v in f.tolist():
        y, z = blk(v, z, 0.01)
        rows.append(y)
    rows = np.transpose(rows).reshape(n_d + 1, -1)
    assert np.array_equal(np.reshape(compiled.e_hat, rows.shape), rows)
    assert np.array_equal(np.reshape(plain.e_hat, rows.shape), rows)
    assert len(vars(compiled.z.differentiator)) == n_d + n_f + 2
    h = differentiate(np.arange(201)*0.01, f, 2.0, n_d, n_f, method)
    assert h.shape == (n_d + 1, 201)
    # the steps of a record are rounded
    assert np.abs(h - rows)[:, :50].max() <= 1e-9*np.abs(rows).max()
    binary = np.arange(201)/128.0
    z, rows = blk.z0, []
    for v in f.tolist():
        y, z = blk(v, z, 1/128)
        rows.append(y)
    assert np.array_equal(differentiate(binary, f, 2.0, n_d, n_f, method),
                          np.transpose(rows).reshape(n_d + 1, -1))


def test_columns_are_estimates_at_their_own_time():
    t = np.arange(4001)*1e-2
    f = signal(t, 0)
    g = f.copy()
    g[2000:] += 1.0
    for method, first in (("levant", 2001), ("matching", 2001), ("implicit", 2000)):
        one, two = differentiate(t, f, 1.0, 2, 0, method), differentiate(t, g, 1.0, 2, 0, method)
        assert np.array_equal(one[:, :first], two[:, :first])
        assert not np.array_equal(one[:, first], two[:, first])
        assert one[:, 0] == pytest.approx([f[0], 0.0, 0.0], abs=0.0)


def test_start():
    blk = differentiator(2).with_(z_0=0.3, z_1=1.0)
    assert blk(5.0, blk.z0, 0.01)[0] == (5.0, 1.0, 0.0)
    blk = blk.with_(started=1.0)
    assert blk(5.0, blk.z0, 0.01)[0] == (0.3, 1.0, 0.0)


@pytest.mark.parametrize("method", METHODS)
def test_of_the_output(method):
    """A step of the reference moves e at once and leaves the derivatives alone."""
    loop = ClosedLoop(chain(2).with_(s0=1.0, s1=0.5), output=chain_output, reference=jump,
                      duration=3.0, dt=1e-3, surface=none,
                      differentiator=differentiator(1, method=method, of="y").with_(L=2.0))
    run = simulate(loop, record=3000, jit=False)
    late = run.t > 1.5
    assert late.sum() and np.abs(run.e_hat[0] - run.e[0])[late].max() < 1e-4
    assert np.abs(run.e_hat[1] - run.e[1])[late].max() < 1e-2
    stirred = simulate(loop.with_(differentiator=differentiator(1, method=method).with_(L=2.0)),
                       record=3000, jit=False)
    assert np.abs(stirred.e_hat[1] - stirred.e[1])[late].max() > 0.5
    moving = simulate(ClosedLoop(nothing, reference=wave, output=still, surface=none,
                                 differentiator=differentiator(2, method=method, of="y")), 1.0,
                      0.01, jit=False)
    for estimate, value in zip(moving.e_hat, moving.e, strict=True):
        assert np.array_equal(estimate, value)
    with pytest.raises(BlockError, match="gives 2 derivatives; it must give 3"):
        simulate(ClosedLoop(nothing, reference=wave, output=still,
                            differentiator=differentiator(3, of="y")), 1.0, 0.01)


@block
def jump(t):
    return 3.0 if t >= 2.0 else 0.0


@block
def two_outputs(x):
    return (-x[0], -x[1]), -x[0]


@block
def none_of_two(sigma):
    return 0.0


def test_channels():
    loop = ClosedLoop(chain(2).with_(s0=1.0), output=two_outputs, law=none_of_two,
                      differentiator=channels(a=differentiator(2, of="y"), b=differentiator(0, 1)))
    run = simulate(loop, 1.0, 0.01, jit=False)
    assert np.shape(run.e_hat[0]) == (3, 101) and np.shape(run.e_hat[1]) == (101,)


# ---- records -------------------------------------------------------------------------------------
def test_uneven_steps():
    rng = np.random.default_rng(0)
    for method in ("levant", "matching"):
        found = []
        for h in (0.02, 0.01, 0.005):
            t = np.cumsum(h*rng.uniform(0.5, 1.5, round(40.0/h)))
            z = differentiate(t, signal(t, 0), 1.0, 3, 0, method)
            found.append([np.abs(z[i] - signal(t, i))[t > 24.0].max() for i in range(4)])
        assert slopes([0.02, 0.01, 0.005], found) == pytest.approx([4.0, 3.0, 2.0, 1.0], abs=0.3)
    t = np.sort(rng.uniform(0.0, 40.0, 40_000))
    z = differentiate(t, signal(t, 0), 1.0, 2)
    assert (np.array([np.abs(z[i] - signal(t, i))[t > 24.0].max()
                      for i in range(3)]) < [1e-5, 1e-3, 5e-2]).all()


def test_gaps_are_named_and_start_anew():
    t = np.concatenate([np.arange(2000), 5000.0 + np.arange(2000), 9000.0 + np.arange(2000)])*0.01
    for method in METHODS[:3]:
        with pytest.warns(UserWarning, match="2 gaps in the record, 30.01 s from t = 19.99 s, "
                                             "20.01 s from t = 69.99 s; "):
            z = differentiate(t, signal(t, 0), 1.0, 2, 0, method)
        assert np.array_equal(z[:, 2000], [signal(t[2000], 0), 0.0, 0.0])
        for end in (1999, 3999, 5999):
            assert abs(z[1, end] - signal(t[end], 1)) < 0.01


def test_what_a_gap_is():
    """Ten steps, anywhere; also as the first step, after which the estimates start only once."""
    for at, long in itertools.product((1, 500), (9.0, 11.0, 1e4)):
        t = 0.01*np.arange(1000)
        t[at:] += 0.01*(long - 1.0)
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            z = differentiate(t, signal(t, 0), 1.0, 2)
        assert [str(w.message).split(";")[0] for w in said] == (
            [f"differentiate: 1 gap in the record, {0.01*long:g} s from t = {t[at - 1]:g} s"]
            if long > 10.0 else [])
        assert np.array_equal(z[:, at], [signal(t[at], 0), 0.0, 0.0]) == (long > 10.0)
        assert z[0, 0] == signal(t[0], 0)


@pytest.mark.parametrize(("method", "n_d"), [("levant", 1), ("implicit", 2), ("matching", 3)])
@pytest.mark.parametrize("at", [1, 2, 5, 5000])
def test_a_steady_motion_is_found_again_after_a_gap(method, n_d, at):
    """With a bound found in it, which is next to nothing, from zeros it never would."""
    t, rng = 1e-3*np.arange(10_000), np.random.default_rng(0)
    t[at:] += 25.0
    for noise, tolerance in ((0.0, 1e-6), (1e-2, 0.05)):
        with pytest.warns(UserWarning, match="1 gap"):
            z = differentiate(t, 5.0 + 2.0*t + noise*rng.standard_normal(len(t)), "auto", n_d, 0,
                              method)
        assert abs(z[1, -1] - 2.0) < tolerance and np.isfinite(z).all()


@pytest.mark.parametrize("dtype", [float, np.float32, int, list])
def test_records_of_any_type(dtype):
    t, f = list(range(40)), [k*k for k in range(40)]
    t, f = (t, f) if dtype is list else (np.array(t, dtype), np.array(f, dtype))
    assert np.array_equal(differentiate(t, f, 2.0, 1),
                          differentiate(np.arange(40.0), np.arange(40.0)**2, 2.0, 1))
    t, f = (np.repeat(np.asarray(q, float), 2)[::2] for q in (t, f))  # with a stride
    assert np.array_equal(differentiate(t, f, 2.0, 1),
                          differentiate(np.arange(40.0), np.arange(40.0)**2, 2.0, 1))


@pytest.mark.parametrize(("t", "f", "change", "message"), [
    ([0, 1, 2], [1, 2], {}, r"same length, 2 or more; they have the shapes \(3,\) and \(2,\)"),
    ([[0, 1]], [[1, 2]], {}, "shapes"), ([0], [1], {}, "2 or more"), (3.0, 4.0, {}, "2 or more"),
    (["a", "b"], [1, 2], {}, "t holds text"), ([0, 1], [1j, 2], {}, "f holds complex numbers"),
    ([0, 1], None, {}, "f must be real numbers, in an array or a list; it holds None"),
    ([0, 1, 1, 2], [1, 2, 3, 4], {}, r"t\[2\] = 1 s is not allowed after 1 s; times must increase"),
    ([0, 1, 0.5, 2], [1, 2, 3, 4], {}, r"t\[2\] = 0.5 s is not allowed after 1 s"),
    ([0, 1, math.nan, 3], [1, 2, 3, 4], {}, r"t\[2\] = nan is not allowed"),
    ([0, 1, 2, 3], [1, math.nan, math.inf, 4], {}, r"f\[1\] = nan at t = 1 s .* first of 2 "),
    ([0, 1, 2, 3.2], [1, 2, 3, 4], dict(method="implicit"),
     r"even steps, but that from t\[0\] = 0 s is 1 s, their mean 1.06667"),
    ([0, 1, math.nan, 3], [1, 2, 3, 4], dict(method="implicit"), r"t\[2\] = nan"),
    ([0, 1, 2], [1, 2, 3], dict(L=0.0), r"L = 0 \[e\]/s\^3 is not allowed"),
    ([0, 1, 2], [1, 2, 3], dict(L="car"), "L = 'car' is not allowed"),
    ([0, 1, 2], [1, 2, 3], dict(L=math.nan), "L = nan"),
    ([0, 1, 2], [1, 2, 3], dict(n_d=13),
     "n_d = 13 is not allowed; it must be a whole number from 0 to 12"),
    ([0, 1, 2], [1, 2, 3], dict(n_f=11),
     "n_f = 11 is not allowed; it must be a whole number from 0 to 10"),
    ([0, 1, 2], [1, 2, 3], dict(n_d=1.5), "n_d = 1.5"),
    ([0, 1, 2], [1, 2, 3], dict(n_f=-1), "n_f = -1"),
    ([0, 1, 2], [1, 2, 3], dict(method="taylor"),
     "method = 'taylor' is not allowed; it must be one of 'levant', 'implicit'"),
    ([0, 1, 2], [1, 2, 3], dict(method=None), "method = None"),
    ([0, 1, 2], [1, 2, 3], dict(method=["levant"]),
     r"method = \['levant'\] is not allowed; it must be one of 'levant'"),
    ([0, 1, 2], [1, 2, 3], dict(L="auto"), "3 samples without a gap are too few; n_d = 2 needs 12"),
])
def test_bad_records(t, f, change, message):
    with pytest.raises(ParameterError, match=message):
        differentiate(t, f, **{**dict(L=1.0, n_d=2), **change})


def test_other_bad_input():
    for make, message in ((lambda: differentiator(2, of="x"),
                           "of = 'x' is not allowed; it must be one of 'e', 'y'"),
                          (lambda: differentiator(2, method=["levant"]),
                           r"method = \['levant'\] is not allowed"),
                          (lambda: differentiator(True), "n_d = True"),
                          (lambda: observer(0), "from 1 to 6"),
                          (lambda: observer(2).with_(G0=0.0), "G0 = 0 is not allowed"),
                          (lambda: differentiator(2).with_(L=-1.0), "L = -1"),
                          (lambda: lipschitz([0, 1], [1, 2], 13), "n_d = 13"),
                          (lambda: differentiator(2).with_(w_1=0.0), "has no 'w_1'")):
        with pytest.raises(ParameterError, match=message):
            make()


@pytest.mark.parametrize("n_d", [0, 1, 2, 3])
def test_lipschitz(n_d):
    rng, t = np.random.default_rng(n_d), np.arange(0.0, 40.0, 2e-3)
    uneven = np.sort(rng.uniform(0.0, 40.0, len(t)))
    for q, eps in itertools.product((t, uneven), (0.0, 1e-6, 1e-4, 1e-3)):
        true = np.abs(signal(q, n_d + 1)).max()
        assert 1.0 <= lipschitz(q, signal(q, 0) + eps*rng.uniform(-1.0, 1.0, len(q)),
                                n_d)/true < 4.0
    digits = np.round(signal(t, 0), 3)
    assert 1.0 <= lipschitz(t, digits, n_d)/np.abs(signal(t, n_d + 1)).max() < 4.0
    assert lipschitz(t, 8.0*digits, n_d) == pytest.approx(8.0*lipschitz(t, digits, n_d))
    assert lipschitz(2.0*t, digits, n_d) == pytest.approx(lipschitz(t, digits, n_d)/2.0**(n_d + 1))
    assert lipschitz(t, 0.0*t, n_d) == pytest.approx(2.0**-52/t[-1]**(n_d + 1))
    broken = np.concatenate([t[:15_000], t[15_000:] + 50.0])
    assert 1.0 <= lipschitz(broken, signal(broken, 0), n_d)/np.abs(signal(t, n_d + 1)).max() < 4.0


def test_automatic_bound_is_nearly_as_good_as_the_true_one():
    t, rng = np.arange(0.0, 40.0, 2e-3), np.random.default_rng(0)
    f = signal(t, 0) + 1e-3*rng.uniform(-1.0, 1.0, len(t))
    true, auto = (differentiate(t, f, L, 2) for L in (np.abs(signal(t, 3)).max(), "auto"))
    for i in range(3):
        one, two = (np.sqrt(np.mean((z[i] - signal(t, i))[t > 10.0]**2)) for z in (true, auto))
        assert two < 2.0*one
    # but for the start, the same
    assert np.abs(auto - differentiate(t, f, lipschitz(t, f, 2), 2))[0, t > 10.0].max() < 5e-3


@pytest.mark.parametrize("n_d", [1, 2, 3])
def test_automatic_bound_of_a_steady_motion(n_d):
    """Its L is next to nothing, so that the estimates have to start where the record does."""
    t, rng, count = np.arange(0.0, 20.0, 1e-3), np.random.default_rng(0), 2.0*np.pi/2048
    for noise, tolerance in ((0.0, 1e-6), (1e-2, 2e-2)):
        z = differentiate(t, 5.0 + 2.0*t + noise*rng.standard_normal(len(t)), "auto", n_d)
        assert abs(z[1, -1] - 2.0) < tolerance
    encoder = differentiate(t, count*np.round(50.0*t/count), "auto", n_d)
    assert abs(encoder[1, -1] - 50.0) < 0.01 and abs(encoder[0, -1] - 50.0*t[-1]) < 0.2
    if n_d > 1:
        z = differentiate(t, t*t, "auto", n_d)
        assert abs(z[1, -1] - 2.0*t[-1]) < 1e-2 and abs(z[2, -1] - 2.0) < 1e-3


def test_a_whole_float_is_an_order_as_everywhere():
    t = np.arange(100)*0.1
    for n_d in (1.0, np.int64(1), np.float32(1.0)):
        assert np.array_equal(differentiate(t, t*t, "auto", n_d), differentiate(t, t*t, "auto", 1))


@pytest.mark.parametrize("size", [1e308, 1e200, 1e-300])
def test_times_and_samples_of_any_size_give_a_bound_or_a_sentence(size):
    q = np.arange(100.0)/100
    for t, f in ((q*size, q), ((q - 0.5)*size, q), (q, (-1.0)**np.arange(100)*size)):
        for n_d in (0, 2, 12):
            try:
                assert 0.0 < lipschitz(t, f, n_d) < math.inf
            except ParameterError as why:
                assert "beyond float64" in str(why) or "too few" in str(why)


def test_estimates_beyond_float64_are_said_to_be():
    with pytest.warns(UserWarning, match="beyond float64; count time or f in other units"):
        differentiate(np.arange(100)*1e300, np.arange(100.0), 1e300, 2)


def test_memory():
    t = np.arange(1_000_000)*1e-3
    f = np.sin(t)
    differentiate(t[:100], f[:100], 1.0, 5)
    for method, L in (("levant", 1.0), ("implicit", 1.0), ("levant", "auto")):
        tracemalloc.start()
        out = differentiate(t, f, L, 5, 0, method)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak - out.nbytes < 20e6


def test_a_new_process_compiles_nothing(new_python):
    code = """
import numpy as np
from smcaero_nb.core import cache
from smcaero_nb.differentiators import differentiate
save = cache._Disk.save_overload
cache._Disk.save_overload = lambda self, *a: (print('compiled'), save(self, *a))
print(differentiate(np.arange(50)*0.1, np.arange(50.0), 1.25, 4, 1)[:, -1].tolist())
"""
    one, two = (new_python(code).split("\n") for _ in range(2))
    assert one[0] == "compiled" and one[1:] == two


# ---- output feedback -----------------------------------------------------------------------------
@block
def measured(x):
    return -x[0]


def feedback(law, r, method="levant", L=None, start=0.5, xi=0.5, **stages):
    """A law on its chain, of which only sigma is measured; L covers law and perturbation."""
    L = L or xi + law.values.get("alpha", 0.0)*law.values.get("L", 0.0)
    return ClosedLoop(chain(r).with_(s0=start), output=measured, law=law,
                      perturbation=chain_perturbation.with_(xi_1=xi),
                      differentiator=differentiator(r - 1, method=method).with_(L=L), **stages)


def tail(run, seconds):
    """Greatest |sigma^(i)| of the last seconds."""
    return [np.abs(s[run.t > run.t[-1] - seconds]).max() for s in vars(run.x).values()]


@pytest.mark.parametrize(("r", "method"), [(2, "levant"), (3, "implicit"), (5, "implicit")])
def test_output_feedback_keeps_the_accuracy(r, method):
    taus = np.array([2e-3, 1e-3, 5e-4])/(1.0 if r == 5 else 2.0)
    loop = feedback(hosmc.quasi_continuous(r), r, method)
    duration = 50.0 if r == 5 else 30.0
    found = [tail(simulate(loop, duration, tau, method="rk4", record=20_000), 8.0) for tau in taus]
    assert slopes(taus, found) == pytest.approx(np.arange(r, 0, -1), abs=0.15)


@block
def noisy(t, x, eps=1e-3):
    """The error with noise as good as random, |noise| < eps."""
    q = math.sin(t*78.233e4)*43758.5453
    return -x[0] + eps*(2.0*(q - math.floor(q)) - 1.0)


def test_output_feedback_in_noise():
    loop, eps = feedback(hosmc.quasi_continuous(3),
                         3).with_(output=noisy), np.array([1e-2, 1e-3, 1e-4])
    found = [tail(simulate(loop.with_(output__eps=e), 30.0, 2.5e-4, method="rk4", record=20_000),
                  8.0) for e in eps.tolist()]
    assert slopes(eps, found) == pytest.approx([1.0, 2/3, 1/3], abs=0.15)


LAWS = [(family, r) for family in ("quasi_continuous", "levant2005", "nested",
                                   "adaptive_continuous") for r in (2, 3, 4, 5)]


@pytest.mark.parametrize(("family", "r"), LAWS)
def test_every_law_runs_with_an_estimate_in_place_of_the_state(family, r):
    law = hosmc.quasi_continuous(r, family) if family == "levant2005" else getattr(hosmc, family)(r)
    L = 100.0 if family == "adaptive_continuous" else None
    slow = r == 5 and family in ("nested", "levant2005")
    tau, jit = (2.5e-4, True) if slow else (2e-3 if r > 3 else 4e-3, False)
    run = simulate(feedback(law, r, "implicit", L), 20.0, tau, method="rk4", record=20_000, jit=jit)
    assert run.diverged_at is None
    assert sum(v**(1/(r - i)) for i, v in enumerate(tail(run, 3.0))) < 0.5


# ---- observer ------------------------------------------------------------------------------------
def test_observer_finds_the_perturbation():
    """A discontinuous law, estimates in place of the state, and xi to the order tau."""
    r, law = 3, hosmc.quasi_continuous(3)
    taus, found = np.array([2e-3, 1e-3, 5e-4]), []
    for tau in taus:
        run = simulate(feedback(law, r, "implicit", allocation=observer(r).with_(L=1.0)), 20.0, tau,
                       method="rk4")
        late = run.t > 10.0
        found.append(np.abs(run.z.allocation.xi - run.d)[late].max())
        assert np.array_equal(run.u, run.v)
    assert found[-1] < 0.02
    assert slopes(taus, found) == pytest.approx(1.0, abs=0.3)


def test_observer_has_the_gain():
    blk = observer(2).with_(G0=-4.0)
    assert blk(1.0, 2.0, blk.z0, 0.1)[0] == -0.5
    y, z = blk((1.0, 7.0), 2.0, (1.0, 0.0, 2.0, 1.0), 0.1)  # xi = v: nothing moves
    assert y == -0.5 and z == (1.0, 0.0, 2.0, 1.0)


def test_perturbation_from_the_highest_derivative():
    """Where v is Lipschitz, e_hat[r] + v will do: an integrated law, a plant of order 2."""
    loop = ClosedLoop(chain(2).with_(s0=1.0), output=chain_output, law=hosmc.quasi_continuous(3),
                      allocation=hosmc.integrated,
                      differentiator=differentiator(2).with_(L=9.0),
                      perturbation=chain_perturbation.with_(xi_1=0.5))
    run = simulate(loop, 20.0, 5e-4, method="rk4")
    late = run.t > 12.0
    assert np.abs(run.e_hat[2] + run.u - run.d)[late].max() < 0.05


def test_observer_of_the_motor():
    """Load torque and back-EMF from the angle alone."""
    loop = dc_motor("quasi_continuous").with_(
        differentiator=differentiator(1, of="y").with_(L=4000.0),
        allocation=observer(2).with_(G0=307.5, L=1e4))
    run = simulate(loop)
    k, J, R = (loop.stages["plant"].values[n] for n in ("k", "J", "R"))
    xi, late = run.d/J + k*k/(J*R)*run.x.omega, run.t > 0.4
    assert run.tail_e < 1e-3
    assert np.ptp(xi[late]) > 400.0
    assert np.abs(run.z.allocation.xi - xi)[late].max() < 45.0


# ---- help ----------------------------------------------------------------------------------------
BLOCKS = [*(differentiator(*q, m, of) for q in [(0, 0), (3, 2)] for m in METHODS for of in "ey"),
          observer(3)]


@pytest.mark.parametrize("blk", BLOCKS, ids=lambda b: f"{b.name} {b.signals[0]}")
def test_help_is_complete(blk):
    for part in (".. math::", "Parameters\n", "Returns\n", "Notes\n", "References\n"):
        assert part in blk.__doc__
    assert all(name in blk.__doc__ for name in blk.params)
    for name, meta in blk.settable.items():
        assert isinstance(meta, Param) and meta.help and (meta.unit or name == "started")
        assert meta.slider[0] <= blk.values[name] <= meta.slider[1]
    assert "{" not in blk.__doc__.replace("{sign}", "").split("Parameters")[1]


def test_names():
    names = [differentiator(*q).name for q in ((3,), (3, 2), (3, 2, "implicit"))]
    assert names == ["levant_3", "levant_3_2", "implicit_3_2"]
    assert list(differentiator(1, 2).states) == ["w_1", "w_2", "z_0", "z_1", "started"]
    assert [m.unit
            for m in differentiator(1,
                                    2).states.values()] == ["[e] s^2", "[e] s", "[e]", "[e]/s", "1"]
    assert differentiator(2).f is differentiator(2).f  # made, and compiled, once
