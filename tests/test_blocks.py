"""Blocks: signals by name, parameters by annotation, states by name, families, channels, use as
plain Python."""

import functools
import math
from typing import Annotated

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import smcaero_nb as smc
from smcaero_nb import (
    BlockError,
    Channels,
    ClosedLoop,
    Param,
    ParameterError,
    block,
    chain,
    channels,
    simulate,
)
from smcaero_nb.core import signal, stages

GAIN = Param("k", "N/m", low=0.0, high=5.0, help="a gain")


@block
def law(sigma, k: Annotated[float, GAIN] = 2.0,
        order: Annotated[int, Param("n", low=1, high=3)] = 2,
        on: Annotated[bool, Param("on")] = True) -> Param("v", "N"):
    """Linear law, for tests."""
    return k*sigma*order if on else 0.0


@block(state=dict(w=(0.5, Param("w", "N", low=-1.0, high=1.0)), n=0.0))
def remembers(sigma, z, tau, gain: Annotated[float, GAIN] = 1.0):
    w, n = z
    return gain*sigma + w, (0.5*w, n + 1.0)


@block(state=dict(x=1.0))
def integrator(u, d):
    return (d - u,)


@block
def minus(x):
    return -x[0]


# ---- declaration ---------------------------------------------------------------------------------
def test_signals_parameters_kinds_and_output_come_from_the_signature():
    assert law.signals == ("sigma",)
    assert list(law.params) == ["k", "order", "on"]
    assert law.kinds == dict(k=float, order=int, on=bool)
    assert law.values == dict(k=2.0, order=2, on=True)
    assert law.params["k"] is GAIN
    assert law.output == Param("v", "N")
    assert law.name == "law" and law.__doc__.startswith("Linear law")


def test_states_are_named_and_have_initial_values():
    assert remembers.signals == ("sigma", "z", "tau")
    assert list(remembers.states) == ["w", "n"]
    assert remembers.z0 == (0.5, 0.0)
    assert remembers.with_(w=-0.25).z0 == (-0.25, 0.0)
    assert list(remembers.settable) == ["gain", "w", "n"]


def test_a_parameter_without_annotation_is_a_float_and_a_default_that_is_a_switch_makes_a_switch():
    @block
    def plain(e, k=3, on=False):
        return e if on else k*e

    assert plain.kinds == dict(k=float, on=bool)
    assert isinstance(plain.values["k"], float) and plain.values["on"] is False


def test_metadata_are_found_however_they_are_written():
    @block
    def loose(e, k: GAIN = 2.0) -> Annotated[float, Param("v", "N", high=3.0)]:
        return k*e

    @block
    def several(e) -> (Annotated[float, GAIN], (Param("w"), float)):
        return e, (e, e)

    assert loose.params["k"] is GAIN and loose.kinds == dict(k=float)
    assert loose.output == Param("v", "N", high=3.0)
    assert several.output == (GAIN, (Param("w"), None))


@pytest.mark.parametrize(("default", "words"),
                         [(math.nan, "nan"), (9.0, "from 0 to 5 N/m"), ("2", "'2'"), (None, "None"),
                          (True, "True")])
def test_a_default_has_to_be_allowed(default, words):
    with pytest.raises(ParameterError, match="k = ") as why:
        @block
        def bad(sigma, k: Annotated[float, GAIN] = default):
            return k
    assert words in str(why.value)


def test_initial_states_are_validated_too():
    with pytest.raises(ParameterError,
                       match=r"w = 2 N is not allowed; it must be a finite number from -1 to 1 N"):
        remembers.with_(w=2)
    with pytest.raises(ParameterError, match="w = nan"):
        @block(state=dict(w=math.nan))
        def bad(sigma, z, tau):
            return sigma, z


def test_a_declaration_that_contradicts_itself_is_refused():
    with pytest.raises(BlockError, match="'k' is both a parameter and a state"):
        @block(state=dict(k=0.0))
        def twice(sigma, z, tau, k=1.0):
            return k*sigma, z
    with pytest.raises(BlockError, match="asks for z, but names no state"):
        @block
        def forgets(sigma, z, tau):
            return sigma, z
    for thing in (5, "sigma", functools.partial(max, 0.0), int):
        with pytest.raises(BlockError, match="plain function"):
            block(thing)


# ---- with_ ---------------------------------------------------------------------------------------
def test_with_gives_a_copy_and_leaves_the_block_alone():
    other = law.with_(k=1, order=3, on=False)
    assert other.values == dict(k=1.0, order=3, on=False)
    assert isinstance(other.values["k"], float)
    assert law.values == dict(k=2.0, order=2, on=True)
    assert other.f is law.f


@given(st.one_of(st.floats(), st.integers(), st.booleans(), st.none(), st.text(max_size=3),
                 st.fractions().map(float), st.floats(0, 5).map(np.float64),
                 st.integers(0, 5).map(np.int64),
                 st.complex_numbers(), st.just(10**400)))
def test_with_takes_exactly_the_numbers_that_the_metadata_allow(value):
    number = isinstance(value, (int, float, np.integer)) and not isinstance(value, bool)
    if number and 0 <= value <= 5:
        got = law.with_(k=value).values["k"]
        assert type(got) is float and got == value
    else:
        with pytest.raises(ParameterError) as why:
            law.with_(k=value)
        said = str(why.value)
        assert said.startswith("law: k = ") and "it must be a finite number from 0 to 5 N/m" in said


@given(st.one_of(st.floats(), st.integers(-2, 6), st.booleans(), st.floats(0, 4).map(np.float64)))
def test_whole_numbers_and_switches(value):
    if isinstance(value, bool):
        assert law.with_(on=value).values["on"] is value
    else:
        with pytest.raises(ParameterError, match="it is a switch, True or False"):
            law.with_(on=value)
    if not isinstance(value, bool) and value in (1, 2, 3):
        got = law.with_(order=value).values["order"]
        assert type(got) is int and got == value
    else:
        with pytest.raises(ParameterError, match="it must be a whole number from 1 to 3"):
            law.with_(order=value)


@given(st.floats(allow_nan=False, allow_infinity=False),
       st.floats(allow_nan=False, allow_infinity=False))
def test_the_message_tells_a_value_from_the_bound_next_to_it(low, width):
    high = low + abs(width)
    value = math.nextafter(high, math.inf)
    assume(math.isfinite(value))
    with pytest.raises(ParameterError) as why:
        Param(unit="m", low=low, high=high).check("b", "p", value)
    said = str(why.value).split(" is not")[0].removeprefix("b: p = ").removesuffix(" m")
    assert float(said) == value


def test_numpy_switches_are_switches():
    assert law.with_(on=np.bool_(False)).values["on"] is False
    with pytest.raises(ParameterError):
        law.with_(k=np.bool_(True))


def test_unknown_names_are_refused_with_the_known_ones():
    with pytest.raises(ParameterError) as why:
        law.with_(ordr=2)
    assert str(why.value) == "law has no 'ordr'; did you mean 'order'? It has: k, order, on"
    with pytest.raises(ParameterError, match="nothing to set"):
        minus.with_(k=1.0)


def test_repr_says_values_and_units():
    assert repr(law) == "law(k=2 N/m, order=2, on=1)"
    assert repr(remembers.with_(gain=0.1)) == "remembers(gain=0.1 N/m, w=0.5 N, n=0)"


# ---- a block is a plain function -----------------------------------------------------------------
def test_a_block_can_be_called_as_plain_python():
    assert law(3.0) == 12.0
    assert law.with_(k=1.0)(3.0) == 6.0
    assert law(3.0, k=1.0) == 6.0
    assert law(3.0, 1.0) == 6.0
    assert law(3.0, 1.0, 1) == 3.0
    assert law(sigma=3.0, on=False) == 0.0
    assert remembers(2.0, (0.25, 0.0), 0.1) == (2.25, (0.125, 1.0))
    assert smc.smc1.quasi_smc(1.0, rho=2.0, eps=1.0) == 1.0


def test_a_block_can_be_a_helper_of_another_block():
    slow = law.with_(k=0.5, order=1)

    @block
    def both(sigma, k=10.0):
        return slow(sigma) + k*law(sigma, k=1.0, order=1) + law(sigma, 0.0)

    assert both(1.0) == 10.5
    loop = ClosedLoop(integrator, output=minus, law=both)
    for jit in (True, False):
        run = simulate(loop, 1.0, 0.25, jit=jit)
        assert run.u[0] == 10.5*run.sigma[0]
        assert np.array_equal(run.u, 10.5*run.sigma)


def test_a_helper_may_be_reached_through_a_module_and_may_call_itself():
    def power(x, n):
        return 1.0 if n < 1 else x*power(x, n - 1)

    @block
    def cubic(sigma):
        return smc.core.signal.sign(sigma)*power(abs(sigma), 3)

    run = simulate(ClosedLoop(integrator, output=minus, law=cubic), 1.0, 0.25)
    plain = simulate(ClosedLoop(integrator, output=minus, law=cubic), 1.0, 0.25, jit=False)
    assert run.u[0] == 1.0
    assert np.array_equal(run.u, plain.u)


def family(order):
    """A law of some order: a family is a function that returns a block."""
    @block
    def member(sigma, k: Annotated[float, GAIN] = 1.0):
        v = 0.0
        for i in range(order):
            v += k*sigma/(i + 1)
        return v

    return member


def test_families_of_blocks_do_not_mix():
    members = [family(n) for n in (1, 2, 1)]
    runs = [simulate(ClosedLoop(integrator, output=minus, law=law), 1.0, 0.25) for law in members]
    assert [r.u[0]/r.sigma[0] for r in runs] == [1.0, 1.5, 1.0]
    assert family(3)(1.0) == 1.0 + 0.5 + 1/3


@pytest.mark.parametrize("jit", [True, False])
def test_whole_numbers_and_switches_arrive_as_such(jit):
    @block
    def repeats(sigma, n: Annotated[int, Param("n", low=0, high=9)] = 2,
                doubled: Annotated[bool, Param("2")] = False):
        v = 0.0
        for _ in range(n):  # a float would fail here
            v += sigma
        return 2.0*v if doubled else v

    loop = ClosedLoop(integrator, output=minus, law=repeats)
    for n in (0, 3):
        for doubled in (False, True):
            run = simulate(loop.with_(law__n=n, law__doubled=doubled), 0.25, 0.25, jit=jit)
            assert run.u[0] == n*(1 + doubled)


# ---- wiring --------------------------------------------------------------------------------------
def test_signals_are_wired_by_name_whatever_their_order():
    @block
    def shuffled(e, t, sigma, y, r):
        return 1e0*r + 1e1*y + 1e2*e + 1e3*sigma + 1e4*t

    @block
    def five(t):
        return 5.0

    @block
    def double(e):
        return 2.0*e

    run = simulate(ClosedLoop(integrator, reference=five, output=minus, surface=double,
                              law=shuffled), 0.5, 0.5, jit=False)
    r, y, e = 5.0, -1.0, 6.0
    assert (run.r[0], run.y[0], run.e[0], run.sigma[0]) == (r, y, e, 12.0)
    assert run.u[0] == r + 10*y + 100*e + 1000*12.0


#: What each stage may ask for.
OWN = ("z", "tau", "k", "salt")
STAGES = dict(reference="t", output="t x u d", sensor="t y z tau k salt",
              differentiator="t r y e u z tau k salt",
              surface="t r y e u z tau k salt", law="t r y e sigma u z tau k salt",
              allocation="t r y e sigma v u z tau k salt", actuator="t y u z tau k salt",
              perturbation="t x",
              plant="t x u d", stop="t x", probe="t x u d r y e")


@pytest.mark.parametrize("stage", STAGES)
def test_a_misspelt_signal_is_an_error_that_lists_the_allowed_ones(stage):
    namespace = {"block": block}
    exec("@block(state=dict(x=0.0))\ndef misspelt(sgima, u, d): return (0.0,)" if stage == "plant"
         else
         "@block\ndef misspelt(sgima): return 0.0", namespace)
    loop = ClosedLoop(**{"plant": integrator, "output": minus, stage: namespace["misspelt"]})
    with pytest.raises(BlockError) as why:
        simulate(loop, 1.0, 0.5)
    assert (str(why.value)
            == f"{stage} 'misspelt' asks for sgima; it may ask for "
               f"{STAGES[stage].replace(' ', ', ')}")


@pytest.mark.parametrize(("stage", "forbidden"), [
    *((s, "x")
      for s in ("reference", "differentiator", "surface", "law", "allocation", "actuator")),
    *((s, "d") for s in ("differentiator", "surface", "law", "allocation", "actuator")),
    ("surface", "sigma"), ("law", "v"), ("output", "e"), ("output", "v"), ("plant", "e"),
    ("perturbation", "u")])
def test_no_stage_can_look_where_it_must_not(stage, forbidden):
    namespace = {"block": block}
    exec(f"@block\ndef peeks({forbidden}): return 0.0", namespace)
    loop = ClosedLoop(integrator, output=minus) if stage != "plant" else None
    with pytest.raises(BlockError,
                       match=rf"^{stage} 'peeks' asks for {forbidden}; it may ask for "):
        if loop:
            simulate(loop.with_(**{stage: namespace["peeks"]}), 1.0, 0.5)
        else:
            exec(f"@block(state=dict(x=0.0))\ndef peeks({forbidden}): return (0.0,)", namespace)
            simulate(ClosedLoop(namespace["peeks"]), 1.0, 0.5)


def test_the_contract_of_the_stages_is_that_of_the_engine():
    assert {s: " ".join((*q.asks, *OWN*(q.when == "tau")))
            for s, q in stages.STAGES.items()} == STAGES


def test_surface_and_law_see_what_the_differentiator_gives():
    @block
    def estimates(e):
        return e + 100.0, 7.0

    @block
    def adds(e):
        return e[0] + e[1]

    @block
    def looks(e, sigma):
        return 1000.0*e[1] + sigma

    run = simulate(ClosedLoop(integrator, output=minus, differentiator=estimates, surface=adds,
                              law=looks), 0.5, 0.5, jit=False)
    assert run.e[0] == 1.0
    assert (run.e_hat[0][0], run.e_hat[1][0]) == (101.0, 7.0)
    assert run.sigma[0] == 108.0 and run.u[0] == 7108.0


def test_states_only_where_a_stage_has_memory():
    @block(state=dict(q=0.0))
    def dreams(t, x):
        return 0.0

    for stage in ("stop", "output"):
        with pytest.raises(BlockError,
                           match=f"{stage} 'dreams' names a state \\(q\\), but this stage has no "
                                 f"memory"):
            simulate(ClosedLoop(**{"plant": integrator, "output": minus, stage: dreams}), 1.0, 0.5)

    @block(state=dict(q=0.0))
    def ignores(sigma):
        return sigma

    with pytest.raises(BlockError,
                       match=r"law 'ignores' names a state \(q\), but does not ask for z"):
        simulate(ClosedLoop(integrator, output=minus, law=ignores), 1.0, 0.5)

    @block
    def stateless(u):
        return (u,)

    with pytest.raises(BlockError, match=r"plant 'stateless' names no state"):
        simulate(ClosedLoop(stateless, output=zero), 1.0, 0.5)


# ---- loops ---------------------------------------------------------------------------------------
def test_the_double_underscore_reaches_into_a_stage():
    loop = ClosedLoop(integrator, output=minus, law=law, duration=2.0, dt=0.5, name="first")
    other = loop.with_(law__k=1.0, plant__x=4.0, dt=0.25, name="second")
    assert other.stages["law"].values["k"] == 1.0 and other.stages["plant"].z0 == (4.0,)
    assert (other.duration, other.dt, other.tau, other.name) == (2.0, 0.25, None, "second")
    assert loop.stages["law"].values["k"] == 2.0 and loop.dt == 0.5
    # the replacement first, whatever the order
    both = loop.with_(law__gain=3.0, law=remembers, law__w=0.25)
    assert both.stages["law"].values == dict(gain=3.0, w=0.25, n=0.0)
    assert ClosedLoop(integrator, law=law, law__k=0.5).stages["law"].values["k"] == 0.5
    assert loop.with_(law=None).stages["law"] is None


@pytest.mark.parametrize(("changes", "words"), [
    (dict(lew=law),
     ["ClosedLoop has no 'lew'; did you mean 'law'?",
      "reference, output, sensor, differentiator, surface, law"]),
    (dict(law__kk=1.0), ["law has no 'kk'; did you mean 'k'?", "It has: k, order, on"]),
    (dict(law__k=-1.0), ["law: k = -1 N/m is not allowed", "from 0 to 5 N/m"]),
    (dict(law__k=math.inf), ["k = inf N/m"]),
    (dict(law__k="high"), ["k = 'high' is not allowed"]),
    (dict(law__on=1), ["on = 1 is not allowed; it is a switch, True or False"]),
    (dict(surface__c=1.0), ["surface is not used, so it has no 'c'"]),
    (dict(plant__theta=1.0), ["integrator has no 'theta'", "It has: x"]),
    (dict(order=2), ["ClosedLoop has no 'order'; did you mean 'law__order'? It has: "]),
    (dict(law_order=2), ["ClosedLoop has no 'law_order'; did you mean 'law__order'?"])])
def test_bad_changes_name_thing_value_unit_and_what_is_allowed(changes, words):
    with pytest.raises(ParameterError) as why:
        ClosedLoop(integrator, output=minus, law=law).with_(**changes)
    for word in words:
        assert word in str(why.value)


@pytest.mark.parametrize(("stage", "thing"),
                         [("law", 5), ("law", lambda sigma: sigma), ("plant", None),
                          ("plant", channels(a=integrator))])
def test_a_stage_is_a_block(stage, thing):
    with pytest.raises(BlockError, match=f"^{stage} must be a block"):
        ClosedLoop(**{"plant": integrator, stage: thing})


def test_settable_lists_what_with_accepts():
    loop = smc.lv.loop("adaptive_super_twisting", "r3")
    for path, (meta, value, kind) in loop.settable().items():
        assert isinstance(meta, Param) and type(value) is kind
        assert loop.with_(**{path: value}).settable()[path] == (meta, value, kind)
    assert {"plant__theta", "law__lam", "surface__settling_time", "perturbation__f_0",
            "plant__coupling"} <= {*loop.settable()}
    assert "output__I" not in loop.settable()  # it follows the plant's


def test_the_output_follows_the_plant_in_what_they_share():
    @block(state=dict(x=1.0))
    def plant(u, k=2.0):
        return (-k*u,)

    @block
    def output(x, k=7.0, offset=0.5):
        return k*x[0] + offset

    loop = ClosedLoop(plant, output=output)
    assert loop.p["output"] == (2.0, 0.5)
    assert simulate(loop.with_(plant__k=3.0, output__offset=0.0), 1.0, 1.0, jit=False).y[0] == 3.0
    with pytest.raises(ParameterError, match="k of the output follows the plant; set plant__k"):
        loop.with_(output__k=1.0)


@pytest.mark.parametrize("made", [chain, channels])
def test_a_name_inside_a_part_is_suggested_with_its_path(made):
    both = made(first=law, second=remembers)
    for name, said in (("gain", "second__gain"), ("k", "first__k"), ("firs", "first")):
        with pytest.raises(ParameterError, match=f"{made.__name__} has no '{name}'; did you mean "
                                                 f"'{said}'. It has: first, second"):
            both.with_(**{name: 1.0})


@pytest.mark.parametrize("made", [chain, channels])
@pytest.mark.parametrize("name", ["a b", "1st", "class", "a__b", ""])
def test_the_name_of_a_part_can_be_reached_into(made, name):
    with pytest.raises(BlockError, match=f"^{made.__name__}: a part cannot be called '{name}'"):
        made(**{name: law})


@pytest.mark.parametrize("f", [lambda *sigma: 0.0, lambda sigma, **more: 0.0])
def test_arguments_without_names_of_their_own_are_refused(f):
    with pytest.raises(BlockError, match=r"<lambda> takes \*args or \*\*kwargs, but"):
        block(f)


@pytest.mark.parametrize("made", [chain, channels])
def test_parts_of_the_output_follow_the_plant_too(made):
    @block(state=dict(x=1.0, v=1.0))
    def plant(u, k=2.0):
        return (-k*u[0], -k*u[1]) if isinstance(u, tuple) else (-k*u, -k*u)

    @block
    def scaled(x, k=7.0, offset=0.5):
        return (k*x[0], k*x[1])

    loop = ClosedLoop(plant, output=made(a=scaled, b=scaled), law=block(lambda t: (0.0, 0.0)))
    factor = 9.0 if made is chain else 3.0
    y = simulate(loop.with_(plant__k=3.0), 1.0, 1.0, jit=False).y
    assert all(q[0] == factor for q in signal.flat(y))
    assert loop.with_(plant__k=3.0).p["output"] == (3.0, 0.5)*2
    assert "output__a__k" not in loop.settable() and "output__a__offset" in loop.settable()
    with pytest.raises(ParameterError, match="k of the output follows the plant; set plant__k"):
        loop.with_(output__b__k=1.0)


# ---- channels ------------------------------------------------------------------------------------
@block(state=dict(a=1.0, b=-2.0))
def pair(x, u, d):
    return d[0] - u[0], d[1] - u[1]


@block
def outputs(x):
    return (-x[0], 0.5), (-x[1], 0.25)


@block
def waves(t):
    return 0.5*math.cos(1.3*t), 0.3*math.sin(2.0*t)


@block
def head(e):
    return e[0]


@block
def wave(t):
    return 0.5*math.cos(1.3*t)


@block
def output_a(x):
    return -x[0], 0.5


def test_channels_run_independent_blocks():
    law = channels(attitude=smc.smc2.adaptive_super_twisting.with_(lam=1.2),
                   descent=smc.smc1.quasi_smc.with_(rho=1.0))
    loop = ClosedLoop(pair, output=outputs, perturbation=waves,
                      surface=channels(attitude=head, descent=head), law=law)
    two = simulate(loop, 2.0, 1e-3, record=100)
    one = simulate(ClosedLoop(integrator, output=output_a, perturbation=wave, surface=head,
                              law=smc.smc2.adaptive_super_twisting.with_(lam=1.2)), 2.0, 1e-3,
                   record=100)
    # to the last bit
    assert np.array_equal(two.sigma[0], one.sigma) and np.array_equal(two.u[0], one.u)
    assert (np.array_equal(two.z.law.attitude.lam, one.z.law.lam)
            and np.array_equal(two.x.a, one.x.x))
    assert vars(two.z.law.descent) == {}
    assert np.shape(two.e) == (2, 2, 101) and np.shape(two.u) == (2, 101)

    metrics, alone = two.metrics(), one.metrics()
    for figure in ("J_e", "J_u", "max_u", "tail_e", "tail_sigma", "reaching_time", "variation_u",
                   "turns_u"):
        values = getattr(metrics, figure)
        assert len(values) == 2 and values[0] == getattr(alone, figure), figure

    plain = simulate(loop, 0.2, 1e-3, jit=False)
    quick = simulate(loop, 0.2, 1e-3)
    assert np.array_equal(plain.u, quick.u) and np.array_equal(plain.sigma, quick.sigma)


def test_channels_are_reached_by_name():
    law = channels(attitude=remembers, descent=smc.smc1.quasi_smc)
    assert isinstance(law, Channels)
    assert list(law.settable) == ["attitude__gain", "attitude__w", "attitude__n", "descent__rho",
                                  "descent__eps"]
    assert list(law.params) == ["attitude__gain", "descent__rho", "descent__eps"]
    assert law.z0 == (0.5, 0.0)
    loop = ClosedLoop(pair, output=outputs, law=law)
    other = loop.with_(law__attitude__w=0.25, law__descent__rho=3.0)
    assert (other.stages["law"].values["attitude__w"] == 0.25
            and other.stages["law"].values["descent__rho"] == 3.0)
    assert loop.with_(law__descent=remembers).stages["law"].parts["descent"] is remembers
    with pytest.raises(ParameterError, match="channels has no 'atitude'; did you mean 'attitude'"):
        loop.with_(law__atitude__w=0.0)
    with pytest.raises(ParameterError, match=r"remembers: w = 9 N is not allowed"):
        loop.with_(law__attitude__w=9)


def test_channels_hold_blocks_only():
    with pytest.raises(BlockError, match="channels: a must be a block"):
        channels(a=abs)
    with pytest.raises(BlockError, match="channels: a must be a block"):
        channels(a=channels(b=law))


def test_a_missing_channel_is_named():
    three = channels(a=head, b=head, c=head)
    with pytest.raises(BlockError,
                       match=r"surface 'head': a signal it asks for has no channel 2: e = "):
        simulate(ClosedLoop(pair, output=outputs, perturbation=waves, surface=three), 1.0, 0.5)


def test_a_law_of_several_inputs_takes_the_whole_tuple():
    @block
    def unit_vector(sigma, rho=1.0):
        size = math.hypot(sigma[0], sigma[1])
        return (rho*sigma[0]/size, rho*sigma[1]/size) if size > 0.0 else (0.0, 0.0)

    loop = ClosedLoop(pair, output=outputs, perturbation=waves, surface=channels(a=head, b=head),
                      law=unit_vector)
    run = simulate(loop, 1.0, 0.25, jit=False)
    assert np.allclose(np.hypot(*run.u), 1.0, rtol=1e-15)
    assert np.allclose(run.u[0]*run.sigma[1], run.u[1]*run.sigma[0], rtol=1e-14)


def test_limits_of_channels_count():
    tight = Param("y", low=-3.0, high=3.0)

    @block
    def first_of(x) -> tight:
        return x[0]

    @block
    def second_of(x):
        return x[1]

    @block
    def pushes(r):
        return -1.0

    loop = ClosedLoop(pair, output=channels(a=first_of, b=second_of), reference=waves,
                      law=channels(a=pushes, b=pushes),
                      perturbation=waves)
    run = simulate(loop, 10.0, 0.01, jit=False)
    assert run.diverged_at is not None and np.all(run.y[0] <= 3.0)


# ---- shapes --------------------------------------------------------------------------------------
shapes = st.recursive(st.none(), lambda s: st.lists(s, min_size=1, max_size=3).map(tuple),
                      max_leaves=8)


@given(shapes)
def test_leaves_text_and_flat_agree(s):
    paths = signal.leaves(s)
    values = [float(i) for i in range(len(paths))]
    made = eval(signal.text(s, (repr(v) for v in values)))
    assert signal.shape(made) == s
    assert signal.flat(made) == values
    assert [eval(f"made{p}", {"made": made}) for p in paths] == values
    assert signal.first(made) == 0.0


@given(shapes)
def test_signals_keep_their_nesting_through_the_loop(s):
    number = iter(range(100))
    text = signal.text(s, (f"{next(number)}.0*t" for _ in range(100)))
    namespace = {"block": block}
    exec(f"@block\ndef reference(t): return {text}\n@block\ndef output(t): return {text}",
         namespace)
    run = simulate(ClosedLoop(integrator, reference=namespace["reference"],
                              output=namespace["output"], allocation=zero),
                   1.0, 0.5, jit=False)
    for name in ("r", "y", "e"):
        assert signal.shape(getattr(run, name)) == s
    plain = s and (None,) in s and tuple(None if v == (None,) else v for v in s)
    for name in ("sigma", "v"):  # without a surface, a channel of one number is a number
        assert signal.shape(getattr(run, name)) == (plain or s)
    for i, leaf in enumerate(signal.flat(run.r)):
        assert np.array_equal(leaf, i*run.t)
    assert not np.any(signal.flat(run.e))


@block
def zero(t):
    return 0.0


def test_a_reference_left_out_is_zero_in_every_channel():
    run = simulate(ClosedLoop(pair, output=outputs, perturbation=waves, allocation=pairs), 0.5, 0.5,
                   jit=False)
    assert [[leaf[0] for leaf in channel] for channel in run.e] == [[1.0, -0.5], [-2.0, -0.25]]


def test_a_reference_without_derivatives_is_piecewise_constant():
    @block
    def commands(t):
        return 3.0, 4.0

    loop = ClosedLoop(pair, reference=commands, output=outputs, perturbation=waves,
                      allocation=pairs)
    run = simulate(loop, 0.5, 0.5, jit=False)
    assert [[leaf[0] for leaf in channel] for channel in run.e] == [[4.0, -0.5], [2.0, -0.25]]


@block
def pairs(t):
    return 0.0, 0.0


@pytest.mark.parametrize(("r", "y"),
                         [("(1.0, 2.0)", "3.0"), ("(1.0,)", "(1.0, 2.0)"),
                          ("((1.0, 2.0),)", "(1.0, 2.0)")])
def test_reference_and_output_have_to_fit(r, y):
    namespace = {"block": block}
    exec(f"@block\ndef reference(t): return {r}\n@block\ndef output(t): return {y}", namespace)
    with pytest.raises(BlockError) as why:
        simulate(ClosedLoop(integrator, reference=namespace["reference"],
                            output=namespace["output"]), 1.0, 0.5)
    shown = y.removesuffix(".0")
    assert f"reference and output do not fit: e = r - y with r = {r}, y = {shown}" in str(why.value)
