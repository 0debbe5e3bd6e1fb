"""States and parameters that are tuples, arrays that blocks return, and states that are buffers."""

import math
import pickle
import time
from typing import Annotated

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import smcaero_nb as smc
from smcaero_nb import (
    BlockError,
    Buffer,
    ClosedLoop,
    Param,
    ParameterError,
    block,
    channels,
    simulate,
)
from smcaero_nb.core import build, program, writer

INERTIA = ((1200.0, 100.0, -200.0), (100.0, 2200.0, 300.0), (-200.0, 300.0, 3100.0))


@block(state=dict(q=(1.0, 0.0, 0.0, 0.0),
                  w=((0.1, -0.2, 0.3), Param(r"\omega", "rad/s", low=-5.0, high=5.0))))
def body(x, u, J: Annotated[tuple, Param("J", "kg m^2")] = INERTIA):
    q, w = x
    a, b, c, d = smc.vec.quaternion_product(q, (0.0, w[0], w[1], w[2]))
    g = smc.vec.cross(w, smc.vec.times(J, w))
    return ((0.5*a, 0.5*b, 0.5*c, 0.5*d),
            smc.vec.solve(J, (u[0] - g[0], u[1] - g[1], u[2] - g[2])))


@block
def free(t, k: tuple[float, float, float] = (0.0, 0.0, 0.0)):
    return k[0], k[1], k[2]


SPIN = ClosedLoop(body, law=free, duration=20.0, dt=0.01)


def same(loop, **how):
    """A run, compiled, after a check that it equals the plain one bit for bit."""
    runs = [simulate(loop, jit=jit, **how) for jit in (True, False)]
    assert runs[0].to_csv() == runs[1].to_csv()
    return runs[0]


# ---- tuples --------------------------------------------------------------------------------------
@pytest.mark.parametrize("method", ["euler", "midpoint", "rk4"])
def test_a_rigid_body_is_the_same_compiled_plain_and_written_number_by_number(method):
    names = [*(f"q{i}" for i in range(4)), *(f"w{i}" for i in range(3))]
    start = dict(zip(names, (1.0, 0.0, 0.0, 0.0, 0.1, -0.2, 0.3), strict=True))

    @block(state=start)
    def flat(x, u):
        dq, dw = body.f(((x[0], x[1], x[2], x[3]), (x[4], x[5], x[6])), u, INERTIA)
        return dq[0], dq[1], dq[2], dq[3], dw[0], dw[1], dw[2]

    nested = same(SPIN, method=method)
    plain = simulate(SPIN.with_(plant=flat), jit=False, method=method)
    for got, wanted in zip((*nested.x.q, *nested.x.w), vars(plain.x).values(), strict=True):
        assert np.array_equal(got, wanted)


def test_a_free_body_keeps_energy_momentum_and_norm_and_moves_as_scipy_says():
    run = simulate(SPIN, method="rk4")
    J, w, q = np.array(INERTIA), np.array(run.x.w), np.array(run.x.q)
    energy, momentum = np.sum(w*(J @ w), 0), np.linalg.norm(J @ w, axis=0)
    for kept in (energy, momentum, np.linalg.norm(q, axis=0)):
        assert np.ptp(kept) < 1e-9*kept[0]
    euler = solve_ivp(lambda t, w: np.linalg.solve(J, -np.cross(w, J @ w)), (0.0, 20.0), w[:, 0],
                      rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(w[:, -1], euler.y[:, -1], atol=1e-9)


def test_a_matrix_is_set_whole_as_tuples_lists_or_an_array():
    other = tuple(tuple(2.0*v for v in row) for row in INERTIA)
    forms = (other, [*map(list, other)], np.array(other))
    one, two, three = (SPIN.with_(plant__J=J) for J in forms)
    assert one == two == three != SPIN and hash(one) == hash(two)
    assert one.stages["plant"].values["J"] == other
    assert simulate(one.with_(law__k=(2.0, 0.0, 0.0))).to_csv() != simulate(one).to_csv()


def test_other_entries_compile_nothing():
    simulate(SPIN)
    before = len(build._made)
    simulate(SPIN.with_(plant__J=2*np.array(INERTIA), plant__w=(0.0, 1.0, 0.0)))
    assert len(build._made) == before


@pytest.mark.parametrize("change, said", [
    (dict(plant__J=3.0), r"J = 3 kg m\^2 is not allowed; it must be 3 rows of 3 numbers"),
    (dict(plant__J=((1.0, 2.0), (3.0, 4.0))), "J = .* must be 3 rows of 3 numbers"),
    (dict(plant__q=(1.0, 2.0)), "q = .* must be 4 numbers"),
    (dict(plant__w=(1.0, 2.0, 9.0)), r"w\[2\] = 9 rad/s .* from -5 to 5 rad/s"),
    (dict(plant__w=(1.0, math.nan, 0.0)), r"w\[1\] = nan"),
    (dict(plant__w=(1.0, "2", 0.0)), r"w\[1\] = '2'"),
    (dict(plant__J=(*INERTIA[:2], (0.0, True, 0.0))), r"J\[2\]\[1\] = True"),
    (dict(law__k="123"), "k = '123' .* must be 3 numbers")])
def test_a_value_of_another_form_is_refused_by_entry(change, said):
    with pytest.raises(ParameterError, match=said):
        SPIN.with_(**change)


@pytest.mark.parametrize("value", [(), ((),), (((1.0,),),), (1.0,)*101])
def test_what_is_nested_deeper_or_longer_is_refused(value):
    for make in (lambda: block(state=dict(q=value))(lambda x: x),
                 lambda: block(eval("lambda x, k=value: x", {"value": value}))):
        with pytest.raises(ParameterError, match="must be a number, a tuple of numbers or a tuple"):
            make()


def test_a_wrong_rate_is_refused_with_the_shape_of_each_state():
    wrong = block(state=dict(q=(1.0, 0.0), w=0.0))(lambda x, u: (x[0][0], x[0][1], u))
    with pytest.raises(BlockError, match=r"dx/dt as a tuple of 2 \(q: 2 numbers, w\); it returned"):
        simulate(ClosedLoop(wrong, duration=1.0, dt=0.1))


def test_limits_of_a_state_hold_for_each_entry():
    run = simulate(SPIN.with_(law__k=(0.0, 0.0, 2000.0)))
    assert run.diverged_at is not None and abs(run.x.w[2][-1]) > 4.9
    assert "left its limit of 286 deg/s" in smc.ui.text.why_diverged(run)


def test_a_loop_of_tuples_has_named_leaves_and_survives_pickle_and_text():
    run = simulate(SPIN, 0.1)
    assert [q.key for q in run.leaves("y")] == [
        *(f"y.q[{i}]" for i in range(4)), *(f"y.w[{i}]" for i in range(3))]
    assert run.leaves("y")[5].meta.unit == "rad/s"
    head = run.to_csv().split("\n")[0]
    assert head.endswith("x.q[3],x.w[0] [rad/s],x.w[1] [rad/s],x.w[2] [rad/s]")
    assert np.shape(run.metrics().J_e) == (7,)
    set_ = SPIN.with_(law__k=(1, 2, 3), plant__q=(0, 1, 0, 0))
    assert pickle.loads(pickle.dumps(set_)) == set_ != SPIN
    assert set_.stages["law"].code().endswith("free.with_(k=(1.0, 2.0, 3.0))")
    assert "q=(0, 1, 0, 0)" in repr(set_)


def test_a_block_remembers_tuples():
    @block(state=dict(last=((0.0, 0.0), (0.0, 0.0)), sum=0.0))
    def memory(e, z, tau):
        (a, b), s = z
        return s, (((e[0], e[1]), a), s + b[0])

    pair = block(state=dict(a=1.0, b=0.0))(lambda x, u: (x[1], -x[0] + 0.0*u))
    run = same(ClosedLoop(pair, law=memory, duration=2.0, dt=0.125))
    (now, _), (before, _) = run.z.law.last
    assert np.array_equal(now, run.e[0]) and np.array_equal(before[1:], now[:-1])


# ---- arrays --------------------------------------------------------------------------------------
A, B = np.array([[0.0, 1.0], [-2.0, -1.0]]), np.array([0.0, 1.0])
W = math.sqrt(7.0)/2


def test_arrays_that_blocks_return_are_taken_as_tuples():
    plant = block(state=dict(p=1.0, v=0.0))(lambda x, u: A @ np.array(x) + B*u)
    output = block(lambda x: np.array([x[0], x[1]]))
    law = block(state=dict(n=0.0, w=(0.0, 0.0)))(
        lambda e, z, tau: (0.0*e[0], (z[0] + 1.0, np.array(z[1]) + 1.0)))
    run = same(ClosedLoop(plant, output=output, law=law, duration=5.0, dt=1e-3), method="rk4",
               record=100)
    right = math.exp(-2.5)*(math.cos(5*W) + math.sin(5*W)/(2*W))
    assert abs(run.x.p[-1] - right) < 1e-12
    assert run.z.law.w[1][-1] == 5001.0 and np.array_equal(run.y[1], run.x.v)


def test_an_array_of_a_wrong_length_or_kind_is_refused():
    for rate, said in ((lambda x: np.zeros(3), r"a tuple of 2 \(p, v\)"),
                       (lambda x: np.array([1j, 0.0]), "a float or a tuple of floats")):
        plant = block(state=dict(p=1.0, v=0.0))(rate)
        with pytest.raises(BlockError, match=said):
            simulate(ClosedLoop(plant, duration=1.0, dt=0.1))


def test_plants_as_people_write_them_run_or_are_told_what_to_write_instead():
    class Vehicle:
        k = 2.0

        def rates(self, x, u, d):
            return x[1], -self.k*x[0] - x[1] + u + d

    start, constants = dict(p=1.0, v=0.0), dict(k=2.0)
    for rate, said in (
            (lambda x: [x[1], -2.0*x[0]], r"returned \[0.0, -2.0\]; write \(a, b\) in place of \["),
            (Vehicle().rates, r"not of <bound .*; write a function .* def rates\(x, u, d, k=2.0\)"),
            (lambda x: (x[1], -constants["k"]*x[0]), r"numbers of a dict .* as parameters")):
        with pytest.raises(BlockError, match=said):
            simulate(ClosedLoop(block(state=start)(rate), duration=1.0, dt=0.1))
    law = block(state=start)(lambda e, z, tau: (0.0, [1.0, 2.0]))
    with pytest.raises(BlockError, match=r"next z a tuple of 2 \(p, v\); .* in place of \["):
        simulate(ClosedLoop(swing, law=law, duration=1.0, dt=0.1))


# ---- buffers -------------------------------------------------------------------------------------
@block(state=dict(late=Buffer(5)))
def delay(y, z, tau):
    return (z[0], 0.0), (y[0],)


swing = block(state=dict(a=1.0, b=0.0))(lambda x, u: (x[1], -x[0] + u))
nothing = block(lambda t: 0.0)
LATE = ClosedLoop(swing, output=block(lambda x: (x[0], x[1])), sensor=delay, law=nothing,
                  duration=3.0, dt=0.01, tau=0.02)


@pytest.mark.parametrize("n", [1, 5, 40])
def test_a_buffer_gives_back_what_it_took_n_samples_ago(n):
    run = same(LATE.with_(sensor__late=n))
    taken, given = run.y[0][::2], run.y_m[0][::2]
    assert np.array_equal(given[n:], taken[:-n]) and not given[:n].any()


def test_buffers_of_channels_and_latency_do_not_mix():
    def shifted(n, start):
        def f(v, z, tau, by=0.0):
            return z[0] + by, (v,)
        return block(f, state=dict(late=Buffer(n, start)))

    two = block(state=dict(a=0.0, b=0.0))(lambda x, u: (u[0], u[1]))
    law = block(lambda t: (t, -t))
    loop = ClosedLoop(two, law=law, allocation=channels(a=shifted(3, 7.0), b=shifted(5, 8.0)),
                      latency=0.5, duration=4.0, dt=0.0625, tau=0.125)
    run = same(loop)
    t = np.arange(0.0, 4.0, 0.125)
    u = [q[:-1:2] for q in run.u]
    for q, n, start, way in zip(u, (3, 5), (7.0, 8.0), (1.0, -1.0), strict=True):
        wanted = np.where(t < 0.5, 0.0, np.where(t < 0.5 + n*0.125, start,
                                                 way*(t - 0.5 - n*0.125)))
        np.testing.assert_allclose(q, wanted, atol=1e-12)


def test_the_length_of_a_buffer_costs_nothing():
    simulate(LATE)
    before = len(build._made)
    short, long = (LATE.with_(sensor__late=n, duration=2000.0) for n in (5, 500))
    times = {5: [], 500: []}
    for _ in range(5):
        for n, loop in ((5, short), (500, long)):
            began = time.perf_counter()
            simulate(loop)
            times[n].append(time.perf_counter() - began)
    assert len(build._made) == before
    assert min(times[500]) < 1.5*min(times[5])


def test_a_buffer_is_not_recorded_but_counts_in_equality_and_text():
    run = simulate(LATE)
    assert not vars(run.z.sensor) and "late" not in run.to_csv().split("\n")[0]
    assert LATE.with_(sensor__late=6) != LATE and "late=5 samples" in repr(LATE)
    other = block(state=dict(late=Buffer(5, 1.0)))(delay.f)
    assert other != delay and simulate(LATE.with_(sensor=other)).y_m[0][0] == 1.0


def test_the_step_layout_has_buffers():
    loop = LATE.with_(sensor__late=3)
    p = writer.written(loop, "euler", 0.02, 2)
    values = {q: v for q, (_, v, _) in loop.parameters().items()}
    exec(program.step(p), names := p.functions(loop))
    x, z = loop.start()
    state, R = tuple((p.state | x | z).values()), np.array(p.ring(values))
    P, run = np.array([*values.values()]), simulate(loop, record=300)
    for k in range(100):
        state = names["step"](k, state, P, R, 0.01, 0.02, 2)
        assert dict(zip(p.state, state, strict=True))["y_m_0"] == run.y_m[0][k]


@pytest.mark.parametrize("n", [0, -1, 2.5, 1e9, math.nan, "5", (1, 2)])
def test_a_length_that_is_not_allowed_is_refused(n):
    for make in (lambda: LATE.with_(sensor__late=n),
                 lambda: block(state=dict(late=Buffer(n)))(lambda y, z, tau: (y, (y,)))):
        with pytest.raises(ParameterError, match="late = .* must be a whole number from 1 to"):
            make()
    with pytest.raises(ParameterError, match="start of late = .* must be a finite number"):
        block(state=dict(late=Buffer(2, math.inf)))(lambda y, z, tau: (y, (y,)))


def test_a_plant_has_no_buffer():
    plant = block(state=dict(q=Buffer(2)))(lambda x: (0.0,))
    with pytest.raises(BlockError, match="the state q is a Buffer, and a plant integrates"):
        simulate(ClosedLoop(plant, duration=1.0, dt=0.1))
