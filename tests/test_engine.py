"""The engine: exact solutions, orders of accuracy, sums over every step, divergence, bad input,
interruption, bits."""

import math
import signal
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from types import SimpleNamespace
from typing import Annotated

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba.core import event
from scipy.integrate import solve_ivp

import smcaero_nb as smc
from smcaero_nb import BlockError, ClosedLoop, Param, ParameterError, block, simulate
from smcaero_nb.core import build, writer

driver = sys.modules[simulate.__module__]


# ---- blocks that most tests share ----------------------------------------------------------------
@block(state=dict(x=1.0))
def linear(x, u, d, a=-0.5):
    return (a*x[0] + u + d,)


@block
def nothing(t):
    return 0.0


@block(state=dict(s=0.3, ds=-0.2))
def cart(x, u, d, k=0.7):
    return x[1], -k*x[0] + u + d


@block
def both(x):
    return x[0], x[1]


@block
def sine(t, amplitude=1.0):
    return amplitude*math.sin(t)


@block
def push(t, x, f=0.2):
    return f*math.cos(3.0*t) + 0.1*x[0]


@block(state=dict(integral=0.0))
def sliding(e, z, tau, c=1.5):
    integral, = z
    return e[1] + c*e[0] + 0.5*integral, (integral + tau*e[0],)


@block(state=dict(p=0.0))
def lag(u, z, tau, T=0.05):
    p, = z
    p += tau*(u - p)/T
    return p, (p,)


smooth = ClosedLoop(cart, reference=sine, output=both, perturbation=push, surface=sliding,
                    actuator=lag,
                    law=smc.smc1.quasi_smc.with_(rho=2.0, eps=0.3))
relay = smooth.with_(law=smc.smc1.sign_smc.with_(rho=1.5), actuator=None)


def same(a, b):
    """Whether two results are equal to the last bit, nesting included."""
    if isinstance(a, (smc.Run, SimpleNamespace)):
        a, b = ({k: v for k, v in vars(q).items() if k != "loop"} for q in (a, b))
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[k], b[k]) for k in a)
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, (float, np.ndarray)):
        return (type(a) is type(b) and np.array_equal(a, b, equal_nan=True)
                and np.array_equal(np.signbit(a), np.signbit(b)))
    return a == b


# ---- exact solutions and orders ------------------------------------------------------------------
@pytest.mark.parametrize("jit", [True, False])
@pytest.mark.parametrize("a", [-0.5, 0.5])
def test_euler_of_a_linear_plant_is_its_closed_form(a, jit):
    loop = ClosedLoop(linear.with_(a=a), allocation=nothing)
    run = simulate(loop, 10/16, 1/16, record=10, jit=jit)
    # all of them exact in binary
    assert [Fraction(x) for x in run.x.x] == [(1 + Fraction(a)/16)**k for k in range(11)]
    assert list(run.t) == [k/16 for k in range(11)]
    run = simulate(loop, 5.0, 1e-3, record=5000, jit=jit)
    assert np.allclose(run.x.x, (1 + a*1e-3)**np.arange(5001), rtol=1e-12, atol=0)


@block(state=dict(angle=1.0, rate=0.0))
def pendulum(x, d):
    return x[1], d - math.sin(x[0])


@block
def forcing(t, x):
    return 0.5*math.cos(2.0*t) - 0.1*x[1]


@pytest.mark.parametrize(("method", "order"), [("euler", 1), ("midpoint", 2), ("rk4", 4)])
def test_order_of_accuracy_with_a_perturbation_that_moves_within_the_step(method, order):
    exact = solve_ivp(lambda t, x: (x[1], 0.5*math.cos(2*t) - 0.1*x[1] - math.sin(x[0])), (0, 2),
                      (1.0, 0.0),
                      method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    loop = ClosedLoop(pendulum, perturbation=forcing)
    errors = []
    for dt in (0.1, 0.05, 0.025):
        run = simulate(loop, 2.0, dt, method=method, jit=False)
        errors.append(np.hypot(run.x.angle[-1] - exact[0], run.x.rate[-1] - exact[1]))
    slopes = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all(abs(slopes - order) < 0.2), slopes


def test_runge_kutta_is_exact_on_what_it_integrates_exactly():
    @block(state=dict(a=0.0, b=0.0))
    def ramp(d):
        return d, 4.0*d*d*d

    @block
    def time_itself(t):
        return t

    run = simulate(ClosedLoop(ramp, perturbation=time_itself), 2.0, 0.25, method="rk4", record=8,
                   jit=False)
    assert np.allclose(run.x.a, run.t**2/2, rtol=1e-15)
    assert np.allclose(run.x.b, run.t**4, rtol=1e-14, atol=1e-15)
    run = simulate(ClosedLoop(ramp, perturbation=time_itself), 2.0, 0.25, method="midpoint",
                   record=8, jit=False)
    assert np.allclose(run.x.a, run.t**2/2, rtol=1e-15)


def sampled_by_hand(n, dt, m):
    """The loop `smooth`, written out by hand."""
    tau, rows = m*dt, []
    s, ds, integral, p = 0.3, -0.2, 0.0, 0.0
    for k in range(n + 1):
        t = k*dt
        e, de = math.sin(t) - s, -ds
        if k % m == 0:
            sigma = de + 1.5*e + 0.5*integral
            integral = integral + tau*e
            v = 2.0*sigma/(abs(sigma) + 0.3)
            p = p + tau*(v - p)/0.05
        d = 0.2*math.cos(3.0*t) + 0.1*s
        rows.append((t, e, de, sigma, v, p, d, s, ds, integral))
        s, ds = s + dt*ds, ds + dt*(-0.7*s + p + d)
    return np.array(rows).T


@pytest.mark.parametrize("jit", [True, False])
@pytest.mark.parametrize("m", [1, 7])
def test_sample_and_hold_equals_a_loop_written_by_hand_to_the_last_bit(m, jit):
    n, dt = 1000, 1e-3
    run = simulate(smooth, n*dt, dt, tau=m*dt, record=n, jit=jit)
    got = run.t, *run.e, run.sigma, run.v, run.u, run.d, run.x.s, run.x.ds, run.z.surface.integral
    for mine, theirs in zip(got, sampled_by_hand(n, dt, m), strict=True):
        assert np.array_equal(mine, theirs)
    assert np.array_equal(run.z.actuator.p, run.u)
    held = run.u[:len(run.u)//m*m].reshape(-1, m)
    assert np.all(held == held[:, :1])
    assert run.steps == n and run.diverged_at is None


def launch_vehicle_by_hand(n, dt, rho, eps, c, f):
    """The launch vehicle under quasi-SMC in the order of states of its own study: numpy, US
    units."""
    a, K, J, c2, c0 = 0.4, 0.75, 8.5e-5, -1.5e-5, -0.05
    A = np.zeros((7, 7))  # servo, beta, beta', theta_r, theta_r', eta, eta'
    A[0, 0], A[1, 2], A[3, 4], A[5, 6] = -5.0, 1.0, 1.0, 1.0
    A[2, :3] = 144.0, -144.0, -12.0
    A[4] = -J*A[2]
    A[4, 3] += a
    A[4, 1] -= K
    A[6] = c2*A[2]
    A[6, 1] += c0
    A[6, 5:] = -156.25, -0.125
    B = np.array([5.0, 0, 0, 0, 0, 0, 0])
    x, integral, sums, rows = np.zeros(7), 0.0, np.zeros(2), []
    for k in range(n):
        t = k*dt
        command = np.deg2rad(-1.2*(t >= 2) + 2.3*(t >= 6) - 1.2*(t >= 10))
        e, de = command - x[3] - x[5], -x[4] - x[6]
        sigma = de + c[0]*e + c[1]*integral
        u = -rho*sigma/(abs(sigma) + eps)
        rows.append((e, sigma, u))
        sums += abs(e), abs(u)
        integral += dt*e
        x = x + dt*(A@x + B*(u + f*(0.2 + 0.1*np.sin(0.1*t))))
    return np.array(rows).T, sums/n


def test_the_launch_vehicle_equals_a_matrix_loop_written_by_hand():
    n, dt = 6000, 2e-3
    (e, sigma, u), (J_e, J_u) = launch_vehicle_by_hand(n, dt, 2.5, 0.45, (1.75, 1.56), 1.0)
    run = simulate(smc.lv.loop("quasi_smc", "eq69"), n*dt, dt, record=n)
    # the SI parameters have six digits, so the two models differ by 1e-5
    near = dict(rtol=0, atol=2e-5)
    assert np.allclose(run.e[0][:-1], e, **near) and np.allclose(run.sigma[:-1], sigma, **near)
    assert np.allclose(run.u[:-1], u, **near)
    assert (run.mean_e[0] == pytest.approx(J_e, rel=1e-4)
            and run.mean_u == pytest.approx(J_u, rel=1e-4))


# ---- an output that sees u and d -----------------------------------------------------------------
@block
def feeds(t, x, u, d, D=0.25):
    return x[0] + D*(u + d), x[1]


through = smooth.with_(output=feeds)


@pytest.mark.parametrize("jit", [True, False])
@pytest.mark.parametrize("m", [1, 7])
def test_an_output_sees_the_control_of_the_sample_before_to_the_last_bit(m, jit):
    n, dt = 1000, 1e-3
    run = simulate(through.with_(actuator=None), n*dt, dt, tau=m*dt, record=n, jit=jit)
    s, ds, integral, u, rows = 0.3, -0.2, 0.0, 0.0, []
    for k in range(n + 1):
        t = k*dt
        d = 0.2*math.cos(3.0*t) + 0.1*s
        y = s + 0.25*(u + d)
        e, de = math.sin(t) - y, -ds
        if k % m == 0:
            sigma = de + 1.5*e + 0.5*integral
            integral = integral + m*dt*e
            u = 2.0*sigma/(abs(sigma) + 0.3)
        rows.append((y, e, sigma, u, d, s))
        s, ds = s + dt*ds, ds + dt*(-0.7*s + u + d)
    for mine, theirs in zip((run.y[0], run.e[0], run.sigma, run.u, run.d, run.x.s),
                            np.array(rows).T, strict=True):
        assert np.array_equal(mine, theirs)


@pytest.mark.parametrize("method", ["euler", "midpoint", "rk4"])
def test_an_output_that_sees_u_and_d_changes_neither_by_chunks_nor_by_the_compiler(monkeypatch,
                                                                                   method):
    whole, plain = (simulate(through, 4.0, 4e-3, tau=12e-3, method=method, jit=jit, record=100)
                    for jit in (True, False))
    monkeypatch.setattr(driver, "CHUNK", 1e-9)
    assert (same(whole, plain)
            and same(whole, simulate(through, 4.0, 4e-3, tau=12e-3, method=method, record=100)))


def test_an_output_may_ask_for_one_of_u_and_d():
    sees = {n: block(f) for n, f in (("u", lambda u: u), ("d", lambda d: d))}
    loop = ClosedLoop(linear, law=block(lambda t: 1.0 + t), perturbation=sine)
    runs = {n: simulate(loop.with_(output=b), 1.0, 0.25, tau=0.5, jit=False)
            for n, b in sees.items()}
    assert (list(runs["u"].y) == [0.0, 1.0, 1.0, 1.5, 1.5]
            and np.array_equal(runs["d"].y, runs["d"].d))


def test_channels_and_tuples_see_their_controls():
    @block(state=dict(a=0.0, b=0.0))
    def pair(u):
        return u[0], u[1]

    y, law = block(lambda x, u: u), block(lambda t: (1.0 + t, 2.0))
    parts = smc.channels(first=block(lambda u: u), second=block(lambda x, u, k=3.0: k*u))
    runs = [simulate(ClosedLoop(pair, output=q, law=law), 1.0, 0.5, jit=False) for q in (y, parts)]
    assert [list(q) for q in runs[0].y] == [[0.0, 1.0, 1.5], [0.0, 2.0, 2.0]]
    assert [list(q) for q in runs[1].y] == [[0.0, 1.0, 1.5], [0.0, 6.0, 6.0]]


def test_who_asks_for_no_control_pays_nothing():
    """The perturbation stays behind the output, and no u before it, in the loops of all others."""
    sources = [writer.written(loop, "euler", 1e-3, 1).source for loop in (smooth, through)]
    lines, others = ([q.split("=")[0].strip() for q in s.split("\n")] for s in sources)
    assert (lines.index("out_output") < lines.index("out_reference")
            < lines.index("out_perturbation") < lines.index("out_law"))
    assert (others.index("out_perturbation") < others.index("out_output")
            and others.count("out_perturbation") == 1)


def test_what_does_not_fit_an_output_that_asks_for_u_is_named():
    pair = block(state=dict(a=0.0, b=0.0))(lambda u: (u[0], u[1]))
    loop = ClosedLoop(pair, output=block(lambda u: u[0]), law=block(lambda t: (1.0, 2.0, 3.0)))
    for changes, said in ((dict(), r"takes 2, but the loop gives it u = \(1.0, 2.0, 3.0\)"),
                          (dict(plant=pendulum, output=block(lambda u: u)),
                           r"takes one number, but the loop gives it u = \(")):
        with pytest.raises(BlockError, match="^the output asks for u, of which the plant " + said):
            simulate(loop.with_(**changes), 1.0, 0.1)
    with pytest.raises(BlockError,
                       match=r"^output '<lambda>' fails at t = 0.*IndexError.*It was given u = "
                             r"\(0.0, 0.0\) "
                       r"\(a tuple of 2\). u has 2 components, u\[0\] to u\[1\]$"):
        simulate(loop.with_(output=block(lambda u: u[2])), 1.0, 0.1)

    @block(state=dict(a=0.0))
    def never(x, u):
        return (x[5],)

    with pytest.raises(BlockError,
                       match=r"^plant 'never' could not be evaluated .* number of inputs from 1 to "
                             r"8; .*IndexError"):
        simulate(ClosedLoop(never, output=block(lambda u: u)), 1.0, 0.1)
    misspelt = block(state=dict(a=0.0))(lambda uu: (uu,))
    with pytest.raises(BlockError, match="^plant '<lambda>' .*'uu'$"):
        simulate(ClosedLoop(misspelt, output=block(lambda u: u)), 1.0, 0.1)


# ---- figures over every step ---------------------------------------------------------------------
M, N = 3, 3000


@pytest.fixture(scope="module")
def full():
    """A chattering run with every step on record; the tail begins at a sample."""
    return simulate(relay, 3.0, 1e-3, tau=3e-3, record=N)


def test_sums_maxima_and_variation_equal_those_of_the_full_record(full):
    samples, first = np.arange(0, N + 1, M), 2400
    assert len(full.t) == N + 1 and full.tail == pytest.approx(0.6)
    for i in (0, 1):
        size = abs(full.e[i])
        assert full.mean_e[i] == np.cumsum(size[:-1])[-1]/N
        assert full.max_e[i] == size.max()
        assert full.tail_peaks.e[i] == size[first:].max()
    assert full.mean_u == np.cumsum(abs(full.u[:-1]))[-1]/N
    for name in ("u", "sigma"):
        size = abs(getattr(full, name))
        assert getattr(full, f"max_{name}") == size.max()
        assert getattr(full, f"tail_{name}") == size[first:].max()
    steps = np.diff(full.u[samples], prepend=0.0)
    assert full.variation_u == np.cumsum(abs(steps))[-1]
    late = samples >= first
    assert full.tail_variation_u == pytest.approx(abs(steps[late]).sum(), rel=1e-12)
    moved = np.flatnonzero(steps)
    turned = moved[1:][steps[moved[1:]]*steps[moved[:-1]] < 0]
    assert full.tail_turns_u == np.count_nonzero(samples[turned] >= first) > 20


def test_low_and_high_hold_all_that_happens_between_rows(full):
    run = simulate(relay, 3.0, 1e-3, tau=3e-3, record=60)
    k = np.round(run.t/1e-3).astype(int)
    for name in ("sigma", "u"):
        every, low, high = getattr(full, name), getattr(run.low, name), getattr(run.high, name)
        assert low[0] == high[0] == every[0]
        for i in range(1, len(k)):
            between = every[k[i - 1]:k[i] + 1]
            assert low[i] == between.min() and high[i] == between.max()
    assert np.any(run.high.u - run.low.u == 3.0)


@pytest.mark.parametrize("record", [1, 7, 500, 2999, 10**9])
def test_the_figures_do_not_depend_on_what_is_recorded(full, record):
    run = simulate(relay, 3.0, 1e-3, tau=3e-3, record=record)
    for name, value in vars(full).items():
        if name.startswith(("mean", "max", "tail", "variation")):
            assert same(getattr(run, name), value), name
    every = -(-N//record)
    assert len(run.t) <= min(record, N) + 1 and run.t[0] == 0.0 and run.t[-1] == full.t[-1]
    assert np.array_equal(run.sigma[:-1], full.sigma[::every][:len(run.t) - 1])


def test_striding_would_hide_a_chatter_of_period_two():
    @block(state=dict(s=1.0))
    def flips(z):
        return z[0], (-z[0],)

    run = simulate(ClosedLoop(linear, law=flips), 1.0, 1e-3, record=500, jit=False)
    assert np.all(run.u == 1.0)  # all that a row every second step sees
    assert np.all(run.low.u[1:] == -1.0) and np.all(run.high.u == 1.0)
    assert run.tail_turns_u == 201 and run.tail_variation_u == 402.0


@pytest.mark.parametrize(("tail", "first"),
                         [(1.0, 0), (0.5, 1500), (0.2, 2400), (0.001, 2997), (0.0, 3000)])
def test_the_tail_is_the_fraction_asked_for(full, tail, first):
    run = simulate(relay, 3.0, 1e-3, tau=3e-3, tail=tail)
    assert run.tail == pytest.approx((N - first)*1e-3)
    assert run.tail_sigma == abs(full.sigma[first:]).max()
    assert run.tail_e == abs(full.e[0][first:]).max()
    assert run.max_e == full.max_e and run.max_sigma == full.max_sigma


def test_a_run_is_steps_of_dt():
    run = simulate(relay.with_(duration=2.0, dt=0.01), jit=False)
    assert run.steps == 200 and run.t[-1] == 2.0
    assert run.loop.duration == 2.0
    run = simulate(relay.with_(duration=2.0, dt=0.01, tau=0.5), 1.0, tau=0.25, jit=False)
    assert run.steps == 100 and len(set(run.u)) <= 5
    assert simulate(relay, 0.1, 0.1, jit=False).steps == 1


@block
def left(t, x, until=0.7004):
    return min(until - t, x[0] + 1e3)


@pytest.mark.parametrize("jit", [True, False])
@pytest.mark.parametrize("record", [1, 7, 10**6])
def test_stop_ends_the_run_at_the_first_step_with_nothing_left(jit, record):
    whole = simulate(relay, 3.0, 1e-3, tau=3e-3, record=10**6, jit=jit)
    run = simulate(relay.with_(stop=left), 3.0, 1e-3, tau=3e-3, record=record, jit=jit)
    assert (run.steps, run.stopped_at, run.diverged_at) == (701, 701*1e-3, None)
    assert run.t[0] == 0.0 and run.t[-1] == 701*1e-3 and len(run.t) <= record + 1
    rows = np.round(run.t/1e-3).astype(int)
    for name in ("y", "e", "sigma", "u"):
        assert np.array_equal(getattr(run, name), np.array(getattr(whole, name))[..., rows]), name
    assert run.mean_u == pytest.approx(abs(whole.u[:701]).mean(), rel=1e-12)
    assert run.max_sigma == abs(whole.sigma[:702]).max()


def test_stop_at_the_start_or_never():
    run = simulate(relay.with_(stop=left.with_(until=0.0)), 1.0, 1e-3)
    assert (run.steps, run.stopped_at, len(run.t)) == (0, 0.0, 1)
    run = simulate(relay.with_(stop=left.with_(until=9.0)), 1.0, 1e-3)
    assert run.stopped_at is None and run.steps == 1000
    assert np.array_equal(run.u, simulate(relay, 1.0, 1e-3).u)
    assert simulate(relay, 1.0, 1e-3).stopped_at is None


def test_a_loop_without_stop_has_no_line_for_it():
    text, other = (writer.written(q, "euler", 1e-3, 1).source
                   for q in (relay, relay.with_(stop=left)))
    assert "left" not in text and "left" in other


def test_stop_is_one_number():
    @block
    def two(x):
        return x[0], x[1]

    with pytest.raises(BlockError,
                       match="stop 'two' must return a float, what is left until the run ends; it "
                             "returned"):
        simulate(relay.with_(stop=two), 1.0, 1e-3)


@block(state=dict(count=0.0))
def holds(u, z, tau, time: Annotated[float, Param("T", "s", samples=True)] = 0.05):
    return u, (z[0] + 1.0,)


@pytest.mark.parametrize(("time", "dt", "tau", "good"), [
    (0.05, 1e-3, 0.05, True), (0.15, 1e-3, 0.05, True), (0.05, 1e-3, None, True),
    (0.3, 0.1, 0.1, True),
    (5e-4, 1e-3, None, False), (0.05, 1e-3, 0.1, False), (0.12, 1e-3, 0.05, False),
    (0.0, 1e-3, None, False)])
def test_a_time_that_a_block_counts_in_samples_is_a_multiple_of_them(time, dt, tau, good):
    loop = relay.with_(actuator=holds.with_(time=time))
    if good:
        assert simulate(loop, 1.0, dt, tau, jit=False, record=1).steps > 0
    else:
        with pytest.raises(ParameterError) as why:
            simulate(loop, 1.0, dt, tau)
        assert str(why.value) == (f"simulate: actuator__time = {time:g} s is not allowed; it must "
                                  f"be a multiple of "
                                  f"tau = {tau or dt:g} s")


# ---- the same numbers twice ----------------------------------------------------------------------
@pytest.mark.parametrize(("law", "preset"),
                         [(law, preset) for law, presets in smc.lv.PRESETS.items()
                          for preset in presets])
def test_compiled_equals_plain_to_the_last_bit_launch_vehicle(law, preset):
    loop = smc.lv.loop(law, preset)
    quick, plain = (simulate(loop, 4.0, 4e-3, jit=jit, record=1000) for jit in (True, False))
    assert quick.steps == 1000 and same(quick, plain)


@pytest.mark.parametrize(("loop", "method"),
                         [(smooth, "euler"), (smooth, "midpoint"), (smooth, "rk4"),
                          (relay, "euler")],
                         ids=["euler", "midpoint", "rk4", "relay"])
def test_compiled_equals_plain_to_the_last_bit_own_blocks(loop, method):
    quick, plain = (simulate(loop, 4.0, 4e-3, tau=12e-3, method=method, jit=jit, record=1000)
                    for jit in (True, False))
    assert quick.steps == 1000 and same(quick, plain)


@pytest.mark.parametrize("chunk", [1e-9, 1e-4, 1e9])
@pytest.mark.parametrize("preset", ["eq69", "paper"])
def test_chunks_change_no_bit(monkeypatch, preset, chunk):
    loop = smc.lv.loop("quasi_smc", preset)
    whole = simulate(loop, 20.0, 5e-3)
    monkeypatch.setattr(driver, "CHUNK", chunk)
    calls = []
    parts = simulate(loop, 20.0, 5e-3, progress=calls.append)
    assert same(whole, parts)
    assert len(calls) > 1000 if chunk < 1e-8 else calls
    assert (whole.diverged_at is None) == (preset == "eq69")


# ---- progress, cancel, Ctrl-C --------------------------------------------------------------------
def test_progress_is_told_and_what_it_raises_ends_the_run():
    told = []
    run = simulate(relay, 3000.0, 1e-3, tau=3e-3, progress=told.append)
    assert told == sorted(told) and told[0] < 0.01 and told[-1] == 1.0 and len(told) > 3
    assert run.steps == 3_000_000

    class Cancelled(Exception):
        pass

    told.clear()

    def cancel(fraction):
        told.append(fraction)
        if len(told) == 2:
            raise Cancelled

    with pytest.raises(Cancelled):
        simulate(relay, 3000.0, 1e-3, tau=3e-3, progress=cancel)
    assert len(told) == 2 and told[1] < 0.5
    # none the worse
    assert same(simulate(relay, 1.0, 1e-3, tau=3e-3),
                simulate(relay, 1.0, 1e-3, tau=3e-3, jit=False))


@settings(max_examples=50)
@given(cost=st.floats(2e-6, 1e-3), tail=st.floats(0.0, 1.0), n=st.integers(1000, 30_000))
def test_no_chunk_takes_more_than_50_ms(cost, tail, n):
    clock, longest = [0.0], [0.0]

    def run(S, P, R, rec, dt, tau, m, every, n, k, stop, sample, row, line):
        """Takes `cost` for each step, on a clock of its own."""
        clock[0] += (stop - k)*cost
        longest[0] = max(longest[0], (stop - k)*cost)
        return stop, sample, row, line, n, False

    written = writer.written(relay, "euler", 1e-3, 1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(driver, "built", lambda *args: (run, written))
        patch.setattr(driver.time, "perf_counter", lambda: clock[0])
        simulate(relay, n*1e-3, 1e-3, tail=tail, jit=False)
    assert longest[0] <= max(0.05, 20*cost)  # the first chunk, 20 steps of plain Python, is a guess


@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")
def test_ctrl_c_ends_a_long_run_within_a_second(new_python):
    said = new_python("""
import os, signal, threading, time
import smcaero_nb as smc
# a shell may start what runs in its background without this handler
signal.signal(signal.SIGINT, signal.default_int_handler)
loop = smc.lv.loop("quasi_smc", "eq69")
smc.simulate(loop, 1.0)
sent = []
def press():
    sent.append(time.perf_counter())
    os.kill(os.getpid(), signal.SIGINT)
threading.Timer(0.5, press).start()
try:
    smc.simulate(loop, 1e6, 1e-4)
    print("not interrupted")
except KeyboardInterrupt:
    print(time.perf_counter() - sent[0])
""")
    assert float(said) < 1.0


def test_three_million_steps_add_at_most_50_mb(new_python):
    pytest.importorskip("resource")
    said = new_python("""
import resource, sys
import smcaero_nb as smc
loop = smc.lv.loop("quasi_smc", "eq69")
smc.simulate(loop, 1.0)
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
run = smc.simulate(loop, 300.0, 1e-4)
unit = 1 if sys.platform == "darwin" else 1024
used = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)*unit
print(run.steps, len(run.t), used)
""")
    steps, rows, used = map(int, said.split())
    assert steps == 3_000_000 and rows <= 2001
    assert used <= 50e6


def test_threads_may_simulate_at_once(monkeypatch):
    """Those of masks do; the loop is new to all of them."""
    made = []

    def slowly(*args):
        made.append(args)
        threading.Event().wait(0.1)
        return writer.written(*args)

    monkeypatch.setattr(build, "written", slowly)

    @block
    def recursive(sigma):
        return halved(sigma, 3)

    with ThreadPoolExecutor(4) as pool, event.install_recorder("numba:compile") as recorder:
        results = [*pool.map(lambda k: simulate(relay.with_(law=recursive, plant__k=k), 1.0, 0.01),
                             (0.5, 0.6, 0.5, 0.6))]
    assert len(made) == 1
    assert (same(results[0], results[2]) and same(results[1], results[3])
            and not same(results[0], results[1]))
    assert same(results[0],
                simulate(relay.with_(law=recursive, plant__k=0.5), 1.0, 0.01, jit=False))
    assert len([e for _, e in recorder.buffer if e.is_start
                and e.data["dispatcher"].py_func.__name__ == "run"]) == 1


def halved(s, n):
    return s if n == 0 else 0.5*halved(s, n - 1)


# ---- compilations --------------------------------------------------------------------------------
def test_a_changed_parameter_costs_no_compilation():
    @block
    def law_of_its_own(sigma, k: Param("k", low=0.0) = 0.123456, n: int = 2, on: bool = True):
        return k*sigma*n if on else -k*sigma

    loop = smooth.with_(law=law_of_its_own, actuator=None)
    with event.install_recorder("numba:compile") as recorder:
        results = [simulate(loop.with_(**changes), 1.0, 0.01, tau=tau, record=record).mean_u
                   for changes, tau, record in (
            (dict(law__k=1.0), 0.01, 100), (dict(law__k=2.0), 0.01, 100),
            (dict(law__n=3), 0.02, 10),
            (dict(law__on=False), None, 7),
            (dict(plant__s=0.1, plant__k=0.4), None, 7),
            (dict(surface__c=2.0, surface__integral=0.5), None, 7))]
    started = [e.data["dispatcher"].py_func.__name__ for _, e in recorder.buffer if e.is_start]
    assert started.count("run") == 1
    assert len(started) == len(set(started))  # nor was any block compiled twice
    assert len(set(results)) == len(results)


# ---- divergence ----------------------------------------------------------------------------------
def finite(run):
    """Whether all that a run gives is finite, but for the tail figures of one that ended before its
    tail."""
    def of(v):
        if isinstance(v, (dict, SimpleNamespace)):
            return all(map(of, (vars(v) if isinstance(v, SimpleNamespace) else v).values()))
        return all(map(of, v)) if isinstance(v, tuple) else bool(np.all(np.isfinite(v)))

    unknown = () if run.tail else ("tail_e", "tail_sigma", "tail_u", "tail_peaks")
    other = ("loop", "diverged_at", "ended", "method", "_leaves", "_shapes", *unknown)
    return of({k: v for k, v in vars(run).items() if k not in other and v is not None})


@pytest.mark.parametrize("jit", [True, False])
def test_a_gain_of_the_wrong_sign_is_flagged_at_the_right_step(jit):
    loop = ClosedLoop(linear.with_(a=0.0), output=none_but_plus,
                      law=smc.smc1.quasi_smc.with_(rho=1.0, eps=1e-9))
    assert simulate(loop, 10.0, 1e-2, jit=jit).diverged_at is None
    grows = ClosedLoop(linear.with_(a=2.0), allocation=nothing)
    run = simulate(grows, 100.0, 1e-2, jit=jit)
    k = math.ceil(math.log(5e11)/math.log(1.02))  # |x| + |e| passes 1e12
    assert run.diverged_at == k*1e-2 and run.steps == k
    assert finite(run) and run.t[-1] < run.diverged_at and abs(run.x.x[-1]) <= 1e12
    # the mean over the valid steps
    assert run.mean_e == pytest.approx((1.02**k - 1)/0.02/k, rel=1e-9)
    assert run.metrics().diverged_at == run.diverged_at
    assert run.metrics().reaching_time is None  # without a law


@block
def none_but_plus(x):
    return x[0]


def poisoned(stage, bad):
    """A loop in which that stage goes bad at t = 0.5."""
    namespace = {"block": block, "bad": bad}
    arguments, good = dict(reference=("t", "0.1*t"), output=("t, x", "x[0]"),
                           differentiator=("t, e", "e"),
                           surface=("t, e", "e"), law=("t, sigma", "sigma"),
                           allocation=("t, v", "v"), actuator=("t, u", "u"),
                           perturbation=("t", "0.3"))[stage]
    exec(f"@block\ndef turns_bad({arguments}):\n    return {good} if t < 0.5 else bad", namespace)
    return ClosedLoop(linear, **{"output": none_but_plus, stage: namespace["turns_bad"]})


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("stage", ["reference", "output", "surface", "law", "allocation",
                                   "actuator", "perturbation"])
def test_what_is_not_finite_ends_the_run_before_it_is_recorded(stage, bad):
    run = simulate(poisoned(stage, bad), 1.0, 1/64, jit=False, record=64)
    assert run.diverged_at == 0.5 and run.steps == 32
    assert len(run.t) == 32 and finite(run)
    good = simulate(poisoned(stage, bad), 31/64, 1/64, jit=False, record=64)
    assert np.array_equal(good.u, run.u) and np.array_equal(good.x.x, run.x.x)


def test_a_memory_that_goes_bad_is_found():
    @block(state=dict(q=0.0))
    def forgets(t, sigma, z):
        return sigma, (z[0] if t < 0.5 else math.nan,)

    @block(state=dict(q=0.0))
    def differentiates(t, e, z):
        return (e, e if t < 0.5 else math.nan), (z[0],)

    for stage in (dict(law=forgets), dict(differentiator=differentiates, surface=head)):
        run = simulate(ClosedLoop(linear, output=none_but_plus, **stage), 1.0, 1/64, jit=False,
                       record=64)
        assert run.diverged_at == 0.5 and len(run.t) == 32 and finite(run)


@block
def head(e):
    return e[0]


def test_a_bad_number_that_the_actuator_hides_is_found():
    @block
    def clips(u):
        return max(-1.0, min(1.0, u))  # of a NaN it makes 1

    run = simulate(poisoned("law", math.nan).with_(actuator=clips), 1.0, 1/64, tau=1/32, record=64)
    plain = simulate(poisoned("law", math.nan).with_(actuator=clips), 1.0, 1/64, tau=1/32,
                     record=64, jit=False)
    assert run.diverged_at == 0.5 and finite(run) and same(run, plain)


def test_a_plant_that_leaves_the_limits_of_its_state_has_diverged():
    @block(state=dict(s=0.0, ds=(1.0, Param("v", "m/s", low=-2.0, high=1.5))))
    def bounded(x, d):
        return x[1], d

    loop = ClosedLoop(bounded, perturbation=constant)
    run = simulate(loop, 4.0, 1/16, jit=False, record=64)
    assert run.diverged_at == 1.0 + 1/16  # at t = 1 the rate is 1.5, which is allowed
    assert run.x.ds[-1] == 1.5 and finite(run)
    run = simulate(loop.with_(perturbation__level=-0.5), 8.0, 1/16, jit=False, record=128)
    assert run.diverged_at == 6.0 + 1/16 and run.x.ds[-1] == -2.0


@block
def constant(t, level=0.5):
    return level


def test_a_run_that_is_out_of_bounds_from_the_start_has_no_rows():
    @block
    def limited(x) -> Param("y", low=-0.5, high=0.5):
        return x[0]

    run = simulate(ClosedLoop(linear, output=limited), 1.0, 0.1, jit=False)
    assert run.diverged_at == 0.0 and run.steps == 0 and len(run.t) == 0
    assert "diverged_at = 0 s" in str(run.metrics()) and run.metrics().reaching_time == math.inf


# ---- bad input -----------------------------------------------------------------------------------
@pytest.mark.parametrize(("arguments", "words"), [
    (dict(duration=None), ["duration [s] is not given"]),
    (dict(dt=None), ["dt [s] is not given"]),
    (dict(duration=0.0), ["duration = 0 s is not allowed", "larger than 0 s"]),
    (dict(duration=-1), ["duration = -1 s", "larger than 0 s"]),
    (dict(duration=math.nan), ["duration = nan s", "a finite number, in s"]),
    (dict(duration=math.inf), ["duration = inf s"]),
    (dict(duration=True), ["duration = True"]),
    (dict(duration="1"), ["duration = '1' is not allowed"]),
    (dict(dt=0), ["dt = 0 s is not allowed", "larger than 0 s"]),
    (dict(dt=-1e-3), ["dt = -0.001 s", "larger than 0 s"]),
    (dict(dt=math.nan), ["dt = nan s"]),
    (dict(dt=1j), ["dt = 1j is not allowed"]),
    (dict(dt=1e-300), ["dt = 1e-300 s is not allowed", "1 s would take 1e+300 steps"]),
    (dict(duration=5e9), ["5e+09 s would take 5e+12 steps; at most 1e+11, ", "a larger dt"]),
    (dict(tau=0.0), ["tau = 0 s is not allowed", "larger than 0 s"]),
    (dict(tau=1.5e-3), ["tau = 0.0015 s is not allowed", "a multiple of dt = 0.001 s"]),
    (dict(tau=0.4e-3), ["tau = 0.0004 s", "a multiple of dt = 0.001 s"]),
    (dict(tau=math.nan), ["tau = nan s"]),
    (dict(tau=2.0), ["duration = 1 s is not allowed", "at least tau = 2 s"]),
    (dict(duration=1e-4), ["duration = 0.0001 s is not allowed", "at least tau = 0.001 s"]),
    (dict(method="heun"), ["method = 'heun' is not allowed", "'euler', 'midpoint', 'rk4'"]),
    (dict(record=0), ["record = 0 is not allowed", "a whole number, at least 1"]),
    (dict(record=2.5), ["record = 2.5 is not allowed", "a whole number, at least 1"]),
    (dict(record=True), ["record = True"]),
    (dict(tail=1.5), ["tail = 1.5 is not allowed", "from 0 to 1"]),
    (dict(tail=math.nan), ["tail = nan is not allowed"])])
def test_times_and_numbers_that_are_not_allowed(arguments, words):
    with pytest.raises(ParameterError) as why:
        simulate(smooth, **{"duration": 1.0, "dt": 1e-3, **arguments})
    for word in ("simulate: ", *words):
        assert word in str(why.value)


def test_nearly_a_multiple_is_a_multiple():
    assert simulate(relay, 0.3, 0.1, tau=0.3, jit=False).steps == 3  # 3*0.1 is not 0.3 in binary
    assert simulate(relay, 1.0, 1/3, tau=2/3, jit=False).steps == 3


OUTPUTS = [("law", "None", "must return a float or a tuple of floats; it returned None"),
           ("law", "[sigma]", "must return a float or a tuple of floats; it returned [1.0]"),
           ("law", "()", "must return a float or a tuple of floats; it returned ()"),
           ("law", "'fast'", "it returned 'fast'"),
           ("law", "sigma > 0", "it returned True"),
           ("law", "1j*sigma", "it returned 1j"),
           ("output", "None", "must return a float or a tuple of floats; it returned None"),
           ("plant", "(1.0,)", "must return dx/dt as a tuple of 2 (s, ds); it returned (1.0,)"),
           ("plant", "(1.0, 2.0, 3.0)",
            "must return dx/dt as a tuple of 2 (s, ds); it returned (1.0, 2.0, 3.0)"),
           ("plant", "1.0", "must return dx/dt as a tuple of 2 (s, ds); it returned 1"),
           ("plant", "(1.0, (2.0,))",
            "must return dx/dt as a tuple of 2 (s, ds); it returned (1.0, (2.0,))"),
           ("memory", "sigma",
            "must return (output, next z), next z a tuple of 2 (a, b); it returned 1"),
           ("memory", "sigma, z[0]",
            "must return (output, next z), next z a tuple of 2 (a, b); it returned (1.0, 0.0)"),
           ("memory", "sigma, (0.0,)", "next z a tuple of 2 (a, b); it returned (1.0, (0.0,))"),
           ("memory", "sigma, [0.0, 0.0]", "next z a tuple of 2 (a, b)"),
           ("memory", "None, z", "must return a float or a tuple of floats; it returned None")]


@pytest.mark.parametrize(("stage", "returned", "words"), OUTPUTS)
def test_an_output_of_the_wrong_kind_or_length_is_named(stage, returned, words):
    head = dict(law="@block\ndef wrong(sigma)", output="@block\ndef wrong(x)",
                plant="@block(state=dict(s=1.0, ds=0.0))\ndef wrong(x)",
                memory="@block(state=dict(a=0.0, b=0.0))\ndef wrong(sigma, z)")[stage]
    namespace = {"block": block}
    exec(f"{head}: return {returned}", namespace)
    stages = {"plant": cart.with_(s=-1.0), "output": none_but_plus,
              "law" if stage == "memory" else stage: namespace["wrong"]}
    with pytest.raises(BlockError) as why:
        simulate(ClosedLoop(**stages), 1.0, 0.1)
    assert str(why.value).startswith(f"{'law' if stage == 'memory' else stage} 'wrong' ")
    assert words in str(why.value)


def line_of(function, text):
    """Number of the first line of a function's source that holds a text."""
    import inspect

    lines, first = inspect.getsourcelines(function)
    return first + next(i for i, line in enumerate(lines) if text in line)


def test_a_block_that_raises_at_the_start_is_named_with_its_line_and_what_it_was_given():
    def deeper(q):
        return 1.0/q

    @block
    def divides(e, sigma):
        a = sigma + 1.0
        return deeper(a - a)

    with pytest.raises(BlockError) as why:
        simulate(smooth.with_(law=divides), 1.0, 0.1)
    said = str(why.value)
    assert said.startswith(f"law 'divides' fails at t = 0, line {line_of(deeper, '1.0/q')} (return "
                           f"1.0/q): ZeroDivisionError: ")
    assert "It was given e = (-0.3, 0.2) (a tuple of 2), sigma = " in said
    assert isinstance(why.value.__cause__, ZeroDivisionError)


def test_the_shape_that_a_block_did_not_expect_is_shown():
    @block
    def wants_pairs(sigma):
        return sigma[0]

    with pytest.raises(BlockError,
                       match=r"law 'wants_pairs' fails at t = 0.*'float' object is not "
                             r"subscriptable.*sigma = -"):
        simulate(smooth.with_(law=wants_pairs), 1.0, 0.1)


def uncompilable():
    """Blocks that Python runs and numba does not compile: (block, function, text of the line to
    name)."""
    def words(q):
        return q if q > -9.0 else "negative"

    @block
    def by_helper(sigma):
        a = 2.0*sigma
        return 2.0*words(a)

    @block
    def by_import(sigma):
        import math as m
        return m.sin(sigma)

    @block
    def by_generator(sigma):
        a = sigma
        return sum(q for q in (a, 1.0))

    return [(by_helper, by_helper.f, "2.0*words(a)"), (by_import, by_import.f, "import math"),
            (by_generator, by_generator.f, "sum(")]


@pytest.mark.parametrize(("law", "fault", "text"), uncompilable(),
                         ids=lambda q: getattr(q, "name", ""))
def test_a_block_that_numba_cannot_compile_is_named_with_its_line(law, fault, text):
    loop = smooth.with_(law=law)
    assert simulate(loop, 0.1, 0.01, jit=False).diverged_at is None
    with pytest.raises(BlockError) as why:
        simulate(loop, 0.1, 0.01)
    said = str(why.value)
    assert said.startswith(f"law '{law.name}' cannot be compiled, line {line_of(fault, text)} (")
    assert text in said and "simulate(..., jit=False) runs it as plain Python" in said


def test_a_block_that_raises_later_ends_the_run_with_its_own_exception():
    @block
    def strict(t, sigma):
        if t > 0.5:
            raise ValueError("too late")
        return sigma

    for jit in (True, False):
        with pytest.raises(ValueError, match="too late"):
            simulate(relay.with_(law=strict), 1.0, 0.01, jit=jit)


def test_blocks_without_a_proper_name_run():
    assert simulate(relay.with_(law=block(lambda sigma: 0.5*sigma)), 1.0, 0.01,
                    jit=False).steps == 100


def test_numpy_functions_may_be_used():
    @block
    def numpys(sigma, rho=1.0):
        return rho*np.sign(sigma)*np.sqrt(np.abs(sigma))

    quick, plain = (simulate(relay.with_(law=numpys), 1.0, 0.01, jit=jit) for jit in (True, False))
    assert same(quick, plain)


def test_a_trial_of_the_blocks_makes_no_step():
    @block(state=dict(h=1e-3))
    def tank(x):
        return (-math.sqrt(x[0]),)  # fails below zero, where a step of tau would lead

    @block
    def wrong_side(x):
        assert x[0] == 1e-3
        return x[0]

    run = simulate(ClosedLoop(tank), 0.5, 1e-3, tau=0.5, method="rk4")
    assert run.x.h[1] == pytest.approx((math.sqrt(1e-3) - run.t[1]/2)**2, rel=1e-9)
    with pytest.raises(AssertionError):
        simulate(ClosedLoop(tank, output=wrong_side), 0.01, 1e-3, jit=False)


def test_the_plain_run_uses_the_functions_of_the_loop_it_is_given():
    """A breakpoint in a block that was defined anew, without a change, has to be met."""
    def define(seen):
        @block
        def watched(sigma):
            seen.append(sigma)
            return sigma
        return watched

    watches = [], []
    first, second = map(define, watches)
    assert first.content() == second.content()
    for law in (first, second):
        simulate(relay.with_(law=law), 0.1, 0.01, jit=False)
    assert len(watches[0]) == len(watches[1]) > 10


def test_interrupt_of_a_plain_run():
    def press(fraction):
        signal.raise_signal(signal.SIGINT)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            simulate(smooth, 1.0, 1e-3, jit=False, progress=press)
    finally:
        signal.signal(signal.SIGINT, before)


# ---- the outcome of a call depends on its arguments alone ----------------------------------------
@block
def inverse(sigma, k=2.0):
    return sigma/(k - 1.0)


def test_a_value_that_fails_at_the_start_is_refused_whatever_ran_before(own_memory):
    loop = ClosedLoop(linear, law=inverse, duration=1.0, dt=0.1)
    refused = loop.with_(law__k=1.0)
    for first in (lambda: None, lambda: simulate(loop)):
        first()
        for jit in (True, False):
            with pytest.raises(BlockError,
                               match="^law 'inverse' fails at t = 0, line .* ZeroDivisionError"):
                simulate(refused, jit=jit)
    simulate(loop)


def test_a_sampling_step_or_start_that_fails_is_refused_whatever_ran_before(own_memory):
    @block(state=dict(w=0.0))
    def late(sigma, z, tau):
        return sigma/(tau - 0.2), (math.sqrt(z[0]),)

    loop = ClosedLoop(linear, law=late, duration=1.0, dt=0.1)
    simulate(loop)
    for bad, said in ((loop.with_(tau=0.2), "ZeroDivisionError"),
                      (loop.with_(law__w=-1.0), "ValueError")):
        with pytest.raises(BlockError, match=f"law 'late' fails at t = 0.*{said}"):
            simulate(bad)


def test_a_truth_value_at_the_start_is_refused_whatever_ran_before(own_memory):
    law = block(lambda sigma, mode=0.0: sigma > 0.0 if mode > 0.5 else -1.0)
    loop = ClosedLoop(linear, law=law, duration=1.0, dt=0.1)
    for first in (lambda: None, lambda: simulate(loop)):
        first()
        with pytest.raises(BlockError, match="must return a float or a tuple of floats"):
            simulate(loop.with_(law__mode=1.0))


def test_the_number_of_inputs_does_not_depend_on_what_ran_before(own_memory):
    plant = block(state=dict(x=1.0))(lambda u, k=2.0: (u/(k - 1.0),))
    loop = ClosedLoop(plant, output=block(lambda x, u: x[0]), law=block(lambda sigma: -sigma),
                      duration=1.0, dt=0.1)
    for first in (lambda: None, lambda: simulate(loop)):
        first()
        with pytest.raises(BlockError,
                           match="^plant '<lambda>' could not be evaluated at its initial state"):
            simulate(loop.with_(plant__k=1.0))


# ---- a plant with one state, and shapes that do not fit ------------------------------------------
SCALAR_LAWS = [smc.smc1.sign_smc, smc.smc1.quasi_smc, smc.smc1.saturation_smc, smc.smc1.tanh_smc,
               smc.smc2.super_twisting,
               smc.smc1.dual_layer_smc]


@pytest.fixture
def own_memory(monkeypatch):
    """No memory of loops that were made."""
    monkeypatch.setattr(build, "_made", {})


@pytest.mark.parametrize("law", SCALAR_LAWS, ids=lambda b: b.name)
@pytest.mark.parametrize("jit", [True, False])
def test_of_a_plant_with_one_state_and_no_output_y_is_a_number(law, jit):
    run = simulate(ClosedLoop(linear, law=law), 1.0, 0.01, jit=jit)
    assert (isinstance(run.y, np.ndarray) and np.array_equal(run.y, run.x.x)
            and np.array_equal(run.e, -run.x.x))


def test_plain_blocks_see_floats():
    plant = block(state=dict(v=1.0))(lambda x, u, k=1.0: (-0.5*((x[0] > 0.0) - (x[0] < 0.0)),))
    law = block(state=dict(n=1.0))(
        lambda y, z, tau: (float(type(y) is type(z[0]) is float), (z[0] + 1.0,)))
    runs = [simulate(ClosedLoop(plant, law=law if not jit else nothing), 1.0, 0.01, jit=jit)
            for jit in (True, False)]
    assert np.array_equal(runs[0].x.v, runs[1].x.v) and np.all(runs[1].u == 1.0)


def test_an_error_of_shape_speaks_of_the_shape_and_the_way_out():
    two = block(state=dict(a=1.0, b=0.0))(lambda x, u: (x[1], u))
    pair = r"= \(-?1.0, -?0.0\) \(a tuple of 2\)\. "
    for law, said in ((lambda sigma: 2.0*(sigma > 0.0),
                       pair + r"sigma\[0\] is the first component of sigma; a stage"),
                      (lambda e: 2.0*e, pair + r"e\[0\] is the first component of e; a stage"),
                      (lambda e: e[2], pair + r"e has 2 components, e\[0\] to e\[1\]"),
                      (lambda y: sum(*zip(*y, strict=False)), pair.removesuffix(r"\. "))):
        with pytest.raises(BlockError, match="^law '<lambda>' fails at t = 0.*" + said):
            simulate(ClosedLoop(two, law=block(law)), 1.0, 0.1)
    with pytest.raises(BlockError,
                       match=r"sigma = -1 \(a number\)\. A number has no components: write sigma"):
        simulate(ClosedLoop(linear, law=block(lambda sigma: sigma[0])), 1.0, 0.1)
    with pytest.raises(BlockError,
                       match=r"write u, without an index, or let a stage before this one"):
        simulate(ClosedLoop(block(state=dict(x=1.0))(lambda x, u: (u[0],))), 1.0, 0.1)
    with pytest.raises(BlockError,
                       match=r"law 'twisting' .*\(a number\).* before this one .* give several"):
        simulate(ClosedLoop(linear, law=smc.smc2.twisting), 1.0, 0.1)


def test_tail_figures_of_run_and_metrics_have_one_shape():
    motor = smc.applications.dc_motor("super_twisting")
    for loop in (smc.lv.loop("quasi_smc"), smc.rpl.loop("adaptive_smc"), motor, ClosedLoop(linear)):
        run = simulate(loop, 2.0, *[] if loop.dt else [1e-2])
        for name in ("tail_e", "tail_sigma"):
            assert np.shape(getattr(run, name)) == np.shape(getattr(run.metrics(), name))
            assert np.all(np.equal(getattr(run, name), getattr(run.metrics(), name)))


# ---- chance --------------------------------------------------------------------------------------
CHANCE = {
    "a module": "import numpy as np\ndef law(sigma): return np.random.normal()",
    "a function": "from numpy.random import normal\ndef law(sigma): return normal()",
    "python's own": "import random\ndef law(sigma): return random.random()",
    "python's own function": "from random import uniform\ndef law(sigma): return uniform(0.0, 1.0)",
    "a helper": "import numpy as np\ndef noise(): return np.random.rand()\n"
                "def law(sigma): return noise()",
    "a numba helper": ("import numba, numpy as np\n@numba.njit\n"
                       "def noise(): return np.random.rand()\n"
                       "def law(sigma): return noise()"),
    "a generator": "import numpy as np\nrng = np.random.default_rng(1)\n"
                   "def law(sigma): return rng.normal()",
    "a module of helpers": ("import types, numpy as np\nm = types.ModuleType('m')\n"
                            "m.f = np.random.rand\n"
                            "def law(sigma): return m.f()"),
    "a closure": ("import numpy as np\ndef make(r):\n    def law(sigma): return r.rand()\n"
                  "    return law\n"
                  "law = make(np.random)"),
    "a tuple of helpers": ("import numba, numpy as np\n@numba.njit\n"
                           "def noise(s): return np.random.rand()\n"
                           "both = (noise, 1.0)\ndef law(sigma): return both[0](sigma)"),
    "a default of a helper": ("import numpy as np\ndef noise(s, f=np.random.rand): return f()\n"
                              "def law(sigma): return noise(sigma)"),
    "a callback of C": ("import numba, numpy as np\n@numba.cfunc('f8(f8)')\n"
                        "def noise(s): return np.random.rand()\n"
                        "def law(sigma): return noise(sigma)"),
    "a ufunc": ("import numba, numpy as np\n@numba.vectorize\n"
                "def noise(s): return np.random.rand()\n"
                "def law(sigma): return noise(sigma)"),
}


@pytest.mark.parametrize("how", CHANCE)
@pytest.mark.parametrize("jit", [True, False])
def test_a_block_that_draws_random_numbers_is_refused_with_the_way_out(how, jit):
    exec(CHANCE[how], names := {"__name__": "__main__"})
    with pytest.raises(BlockError,
                       match="law 'law' draws random numbers with (numpy.)?random, .*default_rng"):
        simulate(ClosedLoop(linear, law=block(names["law"])), 1.0, 0.1, jit=jit)


def test_numbers_that_were_drawn_once_may_have_any_name():
    exec("import numpy as np\nrandom = np.random.default_rng(1).standard_normal(100)\n"
         "def law(sigma, t): return np.abs(random[int(t)]) - sigma",
         names := {"__name__": "__main__"})
    assert simulate(ClosedLoop(linear, law=block(names["law"])), 1.0, 0.1, jit=False).steps == 10


# ---- which signal an error is about --------------------------------------------------------------
@pytest.mark.parametrize(("stage", "wrong", "said"), [
    ("plant", lambda x, u, d: (x[1], u + d[0]), "write d, without an index"),
    ("plant", lambda x, u, d: (x[1], d + u[0]), "write u, without an index"),
    ("plant", lambda x, u, d: (x[1], u + d + x), r"x\[0\] is the first component of x"),
    ("plant", lambda x, u, d: (x[1] + x[2], u + d), r"x has 2 components, x\[0\] to x\[1\]$"),
    ("law", lambda y, e: y[0]*2.0*e, r"e\[0\] is the first component of e"),
    ("law", lambda y, e: y[0] + e[2], r"tuple of 2\)\. e has 2 components, e\[0\] to e\[1\]$"),
    ("output", lambda x: (x[0], x[1], x[2]), "x has 2 components")])
def test_a_hint_names_the_signal_of_the_failing_expression(stage, wrong, said):
    """Not the first one that it could be."""
    plant = block(state=dict(x=1.0, v=0.0))
    loop = ClosedLoop(plant(wrong if stage == "plant" else lambda x, u, d: (x[1], u + d)),
                      output=block(lambda x: (x[0], x[1])), law=block(lambda e: e[0]))
    with pytest.raises(BlockError, match=said):
        simulate(loop if stage == "plant" else loop.with_(**{stage: block(wrong)}), 1.0, 0.1)


def test_a_hint_names_the_signal_that_a_helper_of_the_block_was_given():
    def heavy(q):
        return 2.0*q

    @block
    def law(y, e):
        return heavy(e)

    with pytest.raises(BlockError, match=r"e\[0\] is the first component of e"):
        simulate(smc.applications.double_integrator("sign_smc").with_(law=law, surface=None))


def test_one_component_is_singular():
    @block(state=dict(x=1.0))
    def plant(x, u, d):
        return (u + x[1],)

    with pytest.raises(BlockError, match=r"x has 1 component, x\[0\]$"):
        simulate(ClosedLoop(plant), 1.0, 0.1)


def test_a_sensor_that_gives_fewer_numbers_than_the_output_is_named():
    loop = smc.applications.double_integrator("sign_smc").with_(
        reference=block(lambda t: (1.0, 0.0)), sensor=block(lambda y: y[0]))
    with pytest.raises(BlockError, match=(
            r"^sensor '<lambda>' gives y_m = 1 \(a number\), which does not fit r = \(1.0, 0.0\) .*"
            "let it give as many numbers as y has")):
        simulate(loop)


def test_what_a_block_was_given_has_its_own_names_and_where_they_come_from():
    """In a chain, the path of the block before; in channels, the component that it sees."""
    wrong = block(lambda y: 2.0*y)
    loop = smc.applications.double_integrator("sign_smc")
    for sensor, said in (
            (smc.chain(first=block(lambda y: y), second=wrong), "y = sensor__first = .1.0, 0.0."),
            (wrong, "given y = .1.0, 0.0.")):
        with pytest.raises(BlockError, match=f"{said} .a tuple of 2.. y.0. is the first"):
            simulate(loop.with_(sensor=sensor))
    with pytest.raises(BlockError, match=r"given e = e_hat = .* e has 2 components"):
        simulate(loop.with_(differentiator=smc.differentiators.differentiator(1), surface=None,
                            output=block(lambda x: x[0]), law=block(lambda e: e[2])))
    side = smc.rpl.loop().with_(law__descent=block(lambda sigma: sigma[1]))
    with pytest.raises(BlockError, match=r"given sigma = \S+ \(a number\)"):
        simulate(side)
