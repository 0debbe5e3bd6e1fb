"""Stages: sensors, latency, memory of the world, probes, sample numbers; the program."""

import csv
import io
import itertools
import math
import pickle
import types

import numpy as np
import pytest

import smcaero_nb as smc
from smcaero_nb import (
    BlockError,
    ClosedLoop,
    Param,
    ParameterError,
    block,
    chain,
    channels,
    simulate,
)
from smcaero_nb.core import build, program, stages, writer

PRESETS = {
    **{f"lv {law}": smc.lv.loop(law) for law in smc.lv.PRESETS},
    **{f"rpl {law}": smc.rpl.loop(law)
       for law in ("adaptive_smc", "adaptive_super_twisting", "hosm", "pid")},
    "motor": smc.applications.dc_motor("super_twisting"),
    "integrator": smc.applications.double_integrator("sign_smc"),
    "chain": smc.applications.perturbed_chain(smc.hosmc.quasi_continuous(3), 3),
}


@block(state=dict(x=1.0, v=0.0))
def cart(x, u, d):
    return x[1], u + d


@block
def place(x):
    return x[0], x[1]


@block
def line(e, c=1.0):
    return e[1] + c*e[0]


@block
def push(sigma, k=2.0):
    return k*sigma


LOOP = ClosedLoop(cart, output=place, surface=line, law=push, duration=2.0, dt=1/128, tau=1/32)


def both(loop, *args, **options):
    """The run of a loop, compiled and plain, which agree to the last bit."""
    runs = [simulate(loop, *args, jit=jit, record=10**6, **options) for jit in (True, False)]
    for name in ("r", "y", "y_m", "e", "sigma", "u", "d"):
        np.testing.assert_array_equal(*(np.array(getattr(run, name)) for run in runs))
    return runs[0]


# ---- sensor --------------------------------------------------------------------------------------
@block
def offset(t, y, by=0.25):
    return y[0] + by, y[1]


def test_the_control_sees_what_the_sensor_gives_and_the_error_stays_the_true_one():
    run = both(LOOP.with_(sensor=offset))
    np.testing.assert_array_equal(run.e, -np.array(run.y))
    sampled = np.arange(len(run.t)) % 4 == 0
    np.testing.assert_array_equal(run.y_m[0][sampled], run.y[0][sampled] + 0.25)
    np.testing.assert_array_equal(run.sigma[sampled], -run.y_m[1][sampled] - run.y_m[0][sampled])
    assert run.y[0][-1] == pytest.approx(-0.25, abs=0.1) and run.tail_e > 0.1


def test_without_a_sensor_the_control_sees_the_output():
    run = both(LOOP)
    assert run.y_m is run.y and run.leaves("y_m") == run.leaves("y")


def test_a_differentiator_sees_what_the_sensor_gives():
    @block
    def seen(y, e):
        return y[0], e[0]

    run = both(LOOP.with_(sensor=offset, differentiator=seen, surface=block(lambda e: e[0] + e[1])))
    np.testing.assert_array_equal(run.e_hat[0], -run.e_hat[1])
    assert not np.any(run.sigma)


# ---- what acted ----------------------------------------------------------------------------------
def test_the_stages_of_the_control_see_the_control_that_acted():
    @block
    def limited(u, high=0.5):
        return max(-high, min(high, u))

    @block(state=dict(acted=0.0))
    def remembers(sigma, u, z, tau):
        return 2.0*sigma, (u,)

    run = both(LOOP.with_(law=remembers, actuator=limited))
    sampled = np.arange(len(run.t)) % 4 == 0
    u, acted = run.u[sampled], run.z.law.acted[sampled]
    assert acted[0] == 0.0 and abs(u).max() == 0.5
    np.testing.assert_array_equal(acted[1:], u[:-1])


# ---- latency -------------------------------------------------------------------------------------
@pytest.mark.parametrize("steps", [1, 3, 4, 5, 8, 23])
def test_with_latency_the_control_acts_so_much_later(steps):
    """An output of the sample number tells which sample a control is of."""
    count = block(lambda sigma, k: 1.0 + k)
    run = both(LOOP.with_(law=count, latency=steps/128))
    step = np.arange(len(run.t))
    np.testing.assert_array_equal(run.u, np.where(step < steps, 0.0, 1.0 + (step - steps)//4))
    np.testing.assert_array_equal(run.v, 1.0 + step//4)


def test_latency_of_zero_changes_nothing():
    np.testing.assert_array_equal(both(LOOP.with_(latency=0.0)).u, both(LOOP).u)


def test_a_dead_time_destabilises_where_theory_says():
    """x' = u, u = -k x(t - T) is stable up to k T = pi/2."""
    @block(state=dict(x=1.0))
    def tank(u):
        return (u,)

    loop = ClosedLoop(tank, law=push, latency=1.0, duration=60.0, dt=1/256)
    ends = [abs(simulate(loop.with_(law__k=q*math.pi/2)).y[-400:]).max() for q in (0.9, 1.1)]
    assert ends[0] < 0.05 and ends[1] > 2.0


@pytest.mark.parametrize("latency, said", [(0.003, "a multiple of dt"), (1e6, "100000 samples"),
                                           (2.0, "less than the duration of 2 s")])
def test_a_latency_that_is_not_so_many_steps_is_refused(latency, said):
    with pytest.raises(ParameterError, match=f"latency = .* s is not allowed.*{said}"):
        simulate(LOOP.with_(latency=latency))
    with pytest.raises(ParameterError, match="latency = -1 s"):
        LOOP.with_(latency=-1.0)


def test_a_loop_shows_its_latency_and_a_misspelt_one_is_guessed():
    assert "latency 0.0625 s" in repr(LOOP.with_(latency=0.0625)) and "latency" not in repr(LOOP)
    with pytest.raises(ParameterError, match="has no 'latencyy'; did you mean 'latency'"):
        LOOP.with_(latencyy=0.0625)


def test_latencies_of_other_lengths_are_compiled_apart_and_shared_between_equal_ones():
    runs = [simulate(LOOP.with_(latency=q/128)) for q in (5, 6, 5)]
    assert np.array_equal(runs[0].u, runs[2].u) and not np.array_equal(runs[0].u, runs[1].u)


# ---- the world with memory -----------------------------------------------------------------------
@pytest.mark.parametrize("stage, signal", [("reference", "r"), ("perturbation", "d")])
def test_reference_and_perturbation_with_memory_act_at_samples_and_are_held(stage, signal):
    @block(state=dict(w=0.0))
    def walk(t, z, tau, k, step=0.125):
        return z[0] + 0.0*k, (z[0] + step,)

    loop = LOOP.with_(**{stage: walk})
    for method in ("euler", "rk4"):
        run = both(loop, method=method)
        np.testing.assert_array_equal(getattr(run, signal), 0.125*(np.arange(len(run.t))//4))
    assert getattr(run.z, stage).w[0] == 0.125


def test_an_output_may_see_a_perturbation_with_memory():
    @block(state=dict(w=0.5))
    def held(z, tau):
        return z[0], (z[0],)

    run = both(LOOP.with_(perturbation=held, output=block(lambda x, d: (x[0] + d, x[1]))))
    np.testing.assert_array_equal(run.y[0], run.x.x + 0.5)


# ---- sample number and salt ----------------------------------------------------------------------
def test_the_sample_number_counts_and_the_salt_tells_stages_apart():
    number = block(lambda y, k, salt: (y[0] + 0.0*k, float(salt)))
    other = block(lambda e, salt, k: (float(salt), float(k)))
    run = both(LOOP.with_(sensor=number, differentiator=other, surface=block(lambda e: e[1])))
    np.testing.assert_array_equal(run.sigma, np.arange(len(run.t))//4)
    assert run.y_m[1][0] != run.e_hat[0][0] and 0.0 <= run.y_m[1][0] < 2**32
    parts = channels(a=block(lambda salt: float(salt)), b=block(lambda salt: float(salt)))
    pair = block(state=dict(a=0.0, b=0.0))(lambda u: (u[0], u[1]))
    u = simulate(ClosedLoop(pair, law=parts, duration=1.0, dt=0.5), jit=False).u
    assert u[0][0] != u[1][0]


def test_stages_without_samples_have_no_sample_number():
    with pytest.raises(BlockError, match="perturbation '<lambda>' asks for k; it may ask for t, x"):
        simulate(LOOP.with_(perturbation=block(lambda t, k: 0.0*k)))


# ---- probe ---------------------------------------------------------------------------------------
def test_a_probe_records_signals_and_changes_nothing():
    power = block(lambda x, u: x[1]*u)
    sums = block(lambda y, e: (y[0] + e[0], y[1] + e[1]))
    run = both(LOOP.with_(probe=channels(power=power, both=sums)))
    np.testing.assert_array_equal(run.probe.power, run.x.v*run.u)
    assert not np.any(run.probe.both)
    np.testing.assert_array_equal(run.u, both(LOOP).u)
    single = simulate(LOOP.with_(probe=block(power.f)))
    assert vars(single.probe).keys() == {"<lambda>"} and not vars(simulate(LOOP).probe)


# ---- chains --------------------------------------------------------------------------------------
@block
def scaled(y, by=2.0):
    return by*y[0], by*y[1]


def test_a_chain_is_its_blocks_one_after_the_other():
    loop = LOOP.with_(sensor=chain(offset=offset, scale=scaled))
    once = block(lambda y, by=0.25, times=2.0: (times*(y[0] + by), times*y[1]))
    np.testing.assert_array_equal(both(loop).u, both(LOOP.with_(sensor=once)).u)
    reached = loop.with_(sensor__offset__by=0.5, sensor__scale__by=1.0)
    other = LOOP.with_(sensor=offset.with_(by=0.5))
    np.testing.assert_array_equal(both(reached).u, both(other).u)
    assert "sensor__scale__by" in smc.ui.mask(loop).values


def test_blocks_in_a_chain_have_memory_of_their_own():
    @block(state=dict(w=0.0))
    def lag(u, z, tau, T=0.125):
        w = z[0] + tau/T*(u - z[0])
        return w, (w,)

    run = both(LOOP.with_(actuator=chain(first=lag, second=lag.with_(T=0.25))))
    held = [0.0, 0.0]
    for k, v in enumerate(run.v[::4]):
        held[0] += (1/32)/0.125*(v - held[0])
        held[1] += (1/32)/0.25*(held[0] - held[1])
        assert run.u[4*k] == held[1] == run.z.actuator.second.w[4*k]


def test_every_stage_that_passes_a_signal_may_be_a_chain():
    gain = block(lambda v, k=2.0: k*v)
    flip = block(lambda x: (-x[0], -x[1]))
    copy = block(lambda e: (e[0], e[1]))
    whole = LOOP.with_(output=chain(a=flip, b=flip), differentiator=chain(a=copy, b=copy),
                       surface=chain(a=copy, b=line), allocation=chain(a=gain, b=gain.with_(k=0.5)))
    np.testing.assert_array_equal(both(whole).u, both(LOOP).u)


@pytest.mark.parametrize("stage, said", [("law", "belongs in allocation or actuator"),
                                         ("perturbation", "write one block"),
                                         ("reference", "write one block")])
def test_a_chain_that_nothing_passes_through_is_refused(stage, said):
    with pytest.raises(BlockError, match=f"^{stage} cannot be a chain; .*{said}"):
        simulate(LOOP.with_(**{stage: chain(a=block(lambda t: t), b=block(lambda t: t))}))


def test_a_chain_is_not_compiled_as_the_same_blocks_side_by_side():
    doubled = block(lambda v: smc.core.signal.scaled(v, 2.0, 1.0))
    pair = block(state=dict(a=1.0, b=0.5))(lambda u: (u[0], u[1]))
    loop = ClosedLoop(pair, law=block(lambda sigma: (sigma[0], sigma[1])), duration=1.0, dt=0.25)
    parts = dict(a=doubled, b=doubled)
    side, series = (both(loop.with_(allocation=f(**parts))) for f in (channels, chain))
    assert side.u[0][0] == -2.0 and series.u[0][0] == -4.0


def test_a_chain_survives_pickle_and_is_not_channels():
    made = chain(a=smc.lv.gimbal, b=smc.lv.gimbal.with_(rate=1.0))
    assert pickle.loads(pickle.dumps(made)) == made != channels(**made.parts)
    assert eval(made.code(), {"smc": smc}) == made and repr(made).startswith("chain(a=")


# ---- the table -----------------------------------------------------------------------------------
def test_the_table_of_the_readme_is_that_of_the_stages():
    from pathlib import Path

    assert stages.table() in (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def test_the_docstring_of_the_loop_names_every_stage():
    assert all(name in ClosedLoop.__doc__ for name in stages.STAGES)


# ---- the program ---------------------------------------------------------------------------------
def stepped(p, loop, n, dt, m):
    """The states after n steps of the `step` layout, each as {variable: value}."""
    names = p.functions(loop)
    exec(program.step(p), names)
    values = {q: v for q, (_, v, _) in loop.parameters().items()}
    P = [float(v) for v in values.values()]
    x, z = loop.start()
    state, R = tuple((p.state | x | z).values()), np.array(p.ring(values))
    for k in range(n):
        yield dict(zip(p.state, state, strict=True))
        state = names["step"](k, state, P, R, dt, m*dt, m)


@pytest.mark.parametrize("name", PRESETS)
def test_the_step_layout_reproduces_the_serial_one_to_the_last_bit(name):
    loop, n = PRESETS[name].with_(stop=None), 60
    dt = loop.dt
    m = round((loop.tau or dt)/dt)
    p = writer.written(loop, "euler", m*dt, m)
    run = simulate(loop, n*dt, jit=False, record=n)
    for row, state in enumerate(stepped(p, loop, n, dt, m)):
        for name_, values in zip(p.x, vars(run.x).values(), strict=True):
            assert state[name_] == values[row]


def test_the_step_layout_has_latency_sensor_and_memory_too():
    @block(state=dict(w=0.0))
    def walk(t, z, tau):
        return z[0], (z[0] + 0.01,)

    loop, n = LOOP.with_(sensor=offset, latency=5/128, perturbation=walk), 100
    p = writer.written(loop, "rk4", 4/128, 4, 5)
    run = simulate(loop, n/128, method="rk4", record=n)
    for row, state in enumerate(stepped(p, loop, n, 1/128, 4)):
        assert (state["x_0"], state["x_1"]) == (run.x.x[row], run.x.v[row])


def lanes(p, W):
    """A layout of this test: W runs side by side, each line in a loop over them."""
    def looped(lines, depth):
        return [" "*depth + f"for i in range({W}):", *(" "*(depth + 4) + q for q in lines)]

    state = [*p.state]
    load = [f"{q} = A[{j}][i]" for j, q in enumerate(state)]
    load += [f"{q} = {program.CAST[p.kinds[q]].format(f'P[{j}][i]')}"
             for j, q in enumerate(p.params)]
    store = [f"A[{j}][i] = {q}" for j, q in enumerate(state)]
    text = {n: [q.text for q in s] for n, s in p.segments.items()}
    every = load + text["measure"] + text["disturb"]
    sampled = p.updates("sample") + text["control"] + p.updates("act") + p.updates("watch")
    return "\n".join([
        "def run(A, P, dt, tau, m, n):", "    for k in range(n):", "        t = k*dt",
        *looped(every + store, 8), "        if k%m == 0:", *looped(every + sampled + store, 12),
        *looped(every + p.updates("peak") + p.updates("step") + text["advance"] + store, 8)])


@pytest.mark.parametrize("name", ["lv quasi_smc", "rpl adaptive_smc", "chain"])
def test_a_program_has_what_lanes_need(name):
    loop, n, W = PRESETS[name].with_(stop=None), 120, 3
    m = round((loop.tau or loop.dt)/loop.dt)
    p = writer.written(loop, "euler", m*loop.dt, m)
    gains = [1.0, 1.01, 0.98]
    kinds = {q: kind for q, (_, _, kind) in loop.settable().items()}
    first = next(q for q in p.params.values() if q.startswith("law__") and kinds[q] is float)
    loops = [loop.with_(**{first: loop.settable()[first][1]*g}) for g in gains]
    names = p.functions(loop)
    exec(lanes(p, W), names)
    P = np.array([[float(v) for _, v, _ in one.parameters().values()] for one in loops]).T
    A = np.array([[*(p.state | one.start()[0] | one.start()[1]).values()] for one in loops]).T
    names["run"](A, P, loop.dt, m*loop.dt, m, n)
    for i, one in enumerate(loops):
        run = simulate(one, n*loop.dt, jit=False, record=n)
        for q, values in zip(p.x, vars(run.x).values(), strict=True):
            assert A[[*p.state].index(q)][i] == values[-1]
        samples = simulate(one, (n - 1)*loop.dt, jit=False)  # a run has a sample at its end, too
        u = [q for q in p.state if q.startswith("variation_u")]
        assert [A[[*p.state].index(q)][i] for q in u] == np.ravel(samples.variation_u).tolist()


def test_lines_say_what_they_read_and_write():
    p = writer.written(LOOP, "rk4", 1/32, 4)
    defined = {"t", "dt", "tau", "m", "k", "float", *p.state, *p.params, *p.places}
    for segment in ("measure", "disturb", "control", "advance"):
        for q in p.segments[segment]:
            assert q.reads <= defined, (q.text, q.reads - defined)
            defined |= q.writes


# ---- leaves --------------------------------------------------------------------------------------
def test_leaves_say_channel_derivative_and_unit():
    run = simulate(smc.rpl.loop("adaptive_smc"), 1.0)
    assert [(q.channel, q.derivative) for q in run.leaves("e")] == [(0, 0), (0, 1), (1, 0), (1, 1)]
    assert [q.key for q in run.leaves("e")] == ["e[0]", "e[0]'", "e[1]", "e[1]'"]
    assert [q.meta.unit for q in run.leaves("y")] == ["rad", "rad/s", "m", "m/s"]
    one = simulate(smc.lv.loop("quasi_smc"), 0.1)
    assert [q.key for q in one.leaves("e")] == ["e", "e'"] and one.leaves("u")[0].meta.unit == "rad"
    own = simulate(LOOP.with_(output=None))
    assert [(q.key, q.derivative) for q in own.leaves("y")] == [("y.x", None), ("y.v", None)]
    assert np.shape(own.metrics().J_e) == (2,)


def test_what_is_measured_without_an_output_has_the_names_of_the_states():
    seen = block(lambda y: (y[0], y[1]), output=(Param(unit="V"), Param(unit="V")))
    run = simulate(LOOP.with_(output=None, sensor=seen))
    assert [q.meta.unit for q in run.leaves("y_m")] == ["V", "V"]
    assert [(q.key, q.derivative) for q in run.leaves("e_hat")] == [("e_hat.x", None),
                                                                    ("e_hat.v", None)]


def test_a_number_as_reference_of_several_channels_is_refused():
    nested = block(lambda x: ((x[0],), (x[1],)))
    with pytest.raises(BlockError, match="one number, but y has 2 channels; give one for each"):
        simulate(LOOP.with_(output=nested, surface=None, reference=block(lambda t: 1.0)))


def test_a_program_holds_nothing_of_the_loop_but_what_its_lines_depend_on():
    """Loops that differ in names, units and values share it, and it travels as text."""
    def pushed(sigma, k=2.0):
        return k*sigma

    other = LOOP.with_(law=block(pushed), plant__x=0.5, law__k=3.0)
    one, two = (writer.written(q, "euler", 1/32, 4) for q in (LOOP.with_(law=push), other))
    assert vars(one) == vars(two) == vars(pickle.loads(pickle.dumps(one)))


def test_loops_that_share_a_program_show_their_own_names_and_units():
    def own(unit, name):
        f = types.FunctionType(push.f.__code__, globals(), name, push.f.__defaults__)
        return LOOP.with_(law=block(f, output=Param(unit=unit)), surface=None,
                          output=block(lambda x: x[0], output=Param(unit=unit)))

    first, second = own("N", "first_law"), own("lbf", "second_law")
    for loop, unit in ((first, "N"), (second, "lbf")):
        run = simulate(loop)
        assert [run.leaves(s)[0].meta.unit for s in ("y", "e", "v", "u")] == [unit]*4
        assert f"u [{unit}]" in run.to_csv().split("\n")[0].split(",")
    with pytest.raises(BlockError, match="law 'second_law' fails at t = 0"):
        simulate(second.with_(output=block(lambda x: (x[0], x[1]))))


def test_units_are_those_of_the_loop_that_was_run():
    def first(x):
        return x[0]

    def loop(unit):
        plant = block(state=dict(x=1.0, v=(0.0, Param(unit=unit))))(cart.f)
        return ClosedLoop(plant, output=block(first, output=Param(unit=unit)), law=push,
                          duration=1.0, dt=0.25)

    for unit in ("rad", "deg"):
        for one in (loop(unit), loop(unit).with_(output=None, law=block(lambda sigma: sigma[0]))):
            run = simulate(one)
            assert run.leaves("y")[-1].meta.unit == unit
            assert f"[{unit}]" in run.to_csv().split("\n")[0].split("x.x")[0]


# ---- runs ----------------------------------------------------------------------------------------
def test_a_run_is_read_only_says_how_it_ended_and_is_short():
    run = simulate(LOOP)
    with pytest.raises(AttributeError):
        run.t = None
    assert run.ended == "done" and len(repr(run)) < 80 and "rows" in repr(run)
    bounded = block(state=dict(x=(1.0, Param(high=2.0)), v=1.0))(cart.f)
    lost = simulate(LOOP.with_(plant=bounded, law__k=0.0))
    assert lost.ended == "diverged" and f"{lost.diverged_at:g} s" in repr(lost)


def test_the_record_as_text_has_units_and_every_number(tmp_path):
    run = simulate(smc.lv.loop("quasi_smc"), 0.1, 1e-2)
    names, *rows = csv.reader(io.StringIO(run.to_csv()))
    assert names[0] == "t [s]" and {"y [rad]", "y' [rad/s]", "x.beta [rad]"} < {*names}
    table = dict(zip(names, np.array(rows, float).T, strict=True))
    np.testing.assert_array_equal(table["t [s]"], run.t)
    np.testing.assert_array_equal(table["y' [rad/s]"], run.y[1])
    np.testing.assert_array_equal(table["u [rad]"], run.u)
    assert run.to_csv(tmp_path / "run.csv") is None
    assert (tmp_path / "run.csv").read_text() == run.to_csv()
    with pytest.raises(ParameterError, match=r"to_csv: path = 5 is .*a path or an open text file"):
        run.to_csv(5)
    watched = LOOP.with_(probe=block(lambda x, u: (x[1]*u, u)), law=smc.smc2.super_twisting)
    header = simulate(watched).to_csv().split("\n")[0]
    assert "z.law.w" in header and "probe.<lambda>[0],probe.<lambda>[1]" in header
    back = smc.records.Table("test", tmp_path / "run.csv")
    np.testing.assert_array_equal(back.times("t"), run.t)


def test_a_loop_without_new_stages_is_written_as_it_was():
    """No ring, no count, no condition where nothing asks for it."""
    for loop in itertools.islice(PRESETS.values(), 3):
        source = writer.written(loop, "euler", loop.dt, 1).source
        assert "count" not in source and "R[" not in source and "y_m" not in source
    assert build.LOOPS > 0
