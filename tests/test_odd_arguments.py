"""Odd arguments: every public function takes them for what they are, or refuses them in a sentence.

The names and their arguments are found by themselves; a new function needs an entry in `examples`
only for an argument without a default whose name is not yet there.
"""

import functools
import inspect
import io
import math
import random
import types
import warnings
from decimal import Decimal
from fractions import Fraction

import control
import numpy as np
import pytest
from numba import config

import smcaero_nb as smc
from smcaero_nb import Block, BlockError, ParameterError, applications, block, simulate

LIBRARIES = (smc, smc.core, smc.surface, smc.interop, smc.pid, smc.smc1, smc.smc2, smc.hosmc,
             smc.differentiators, smc.prd, smc.applications, smc.lv, smc.rpl)
CLASSES = (smc.Param, smc.ClosedLoop, smc.prd.Record)  # made by hand; functions make the others
LONGEST = 700  # characters of a message


@block
def law(sigma, k=2.0):
    """A law."""
    return k*sigma


@pytest.fixture(autouse=True)
def plain(monkeypatch):
    """Run as plain Python: what is refused is refused before anything is compiled."""
    monkeypatch.setattr(config, "DISABLE_JIT", True)


def public():
    """{name: function, class or block} of the kit, each once."""
    found = {}
    for module in LIBRARIES:
        for name in module.__all__:
            thing = getattr(module, name)
            if isinstance(thing, (types.FunctionType, Block)) or thing in CLASSES:
                if not any(thing is q for q in found.values()):
                    library = module.__name__.removeprefix("smcaero_nb")
                    found[f"{library}.{name}".lstrip(".")] = thing
    return found


PUBLIC = public()
FUNCTIONS = {n: t for n, t in PUBLIC.items() if not isinstance(t, Block)}
BLOCKS = {n: t for n, t in PUBLIC.items() if isinstance(t, Block)}
T = np.arange(200)*0.01
Y = np.where(T > 0.5, (T - 0.5)**2, 0.0)


@functools.cache
def examples():
    """{argument, or (function, argument): what it may be}, without a default or with a slow one."""
    loop = applications.double_integrator().with_(duration=0.02, dt=1e-3)
    landed = simulate(smc.rpl.loop(), 0.5, record=4800, jit=False)
    return {
        "loop": loop, "run": simulate(loop, jit=False), "plant": loop.stages["plant"], "law": law,
        "r": 2, "L": 1.0, "n_d": 1, "t": T, "f": Y, "y": Y, "step_time": 0.5, "windows": (0.02,),
        "source": control.tf([1.0], [1.0, 2.0, 5.0]), "c": (1.0, 1.0), "settling_time": 8.0,
        "G0": ((2.0, 1.0), (0.0, 4.0)), "sys": control.tf([1.0], [1.0, 2.0]), "name": "rho",
        "table": [(0, 100, 0.1)], "jit": False, "path": None, "nominal": smc.pid.pd,
        ("cite", "source"): loop,
        ("identify", "source"): smc.prd.Record(T, Y, 0.5), ("block", "f"): lambda sigma, k=1.0: k,
        ("landing", "run"): landed, ("pulses", "run"): landed,
        ("double_integrator", "law"): "twisting", ("dc_motor", "law"): "twisting",
        ("lv.loop", "law"): "hosm", ("rpl.loop", "law"): "adaptive_smc"}


def arguments(name, f):
    """{argument: example}, and the name of those that are free, or None."""
    made, free, short = {}, None, name.rpartition(".")[2]
    for n, a in inspect.signature(f).parameters.items():
        if a.kind is a.VAR_KEYWORD:
            free = n
            continue
        if a.kind is a.VAR_POSITIONAL:
            continue
        known = [examples()[k] for k in ((name, n), (short, n), n) if k in examples()]
        assert known or a.default is not a.empty, f"{name}: `examples` needs one of '{n}'"
        slow = n in ("jit", "law")
        made[n] = known[0] if known and (a.default is a.empty or slow) else a.default
    return made, free


def files(made):
    """The arguments, with a file to read where one is wanted, a new one for each call."""
    if "path" in made and made["path"] is None:
        rows = (f"{a:.2f},{b:.4f},{a > 0.5:d}\n" for a, b in zip(T, Y, strict=True))
        return {**made, "path": io.StringIO("t,y,u\n" + "".join(rows))}
    return made


#: Values that are hardly ever meant; each may be refused, or taken for the number that it is.
ODD = {
    "None": None, "text": "text", "bytes": b"x", "1j": 1j, "nan": math.nan, "inf": math.inf,
    "-inf": -math.inf, "True": True, "1e308": 1e308, "-1e308": -1e308, "5e-324": 5e-324, "-1": -1,
    "10**400": 10**400, "10**5000": 10**5000, "0": 0, "2": 2, "1.0": 1.0, "[]": [], "()": (),
    "{}": {},
    "object": object(), "function": lambda x: x, "class": type("Odd", (), {}), "module": math,
    "array": np.array([1, 2]), "float32": np.float32(1), "int64": np.int64(1), "block": law,
    "masked": np.ma.masked, "duration": np.timedelta64(1, "s"), "date": np.datetime64("2026-01-01"),
    "Fraction": Fraction(1, 2), "Decimal": Decimal(1), "long": "q"*10_000, "nested": [[1.0]],
    "names": {f"n{i}": i for i in range(10_000)}, "numbers": list(range(10_000)),
    "repr": type("Big", (), {"__repr__": lambda self: "q"*10_000})(),
}
#: No argument of the kit is one of these.
NEVER = ("object", "1j", "Decimal", "masked", "duration", "module", "repr")
CALLED = ("check", "progress")  # functions of the caller's, who answers for them


def called(f, /, *args, **given):
    """What a call raised in a documented way, as text, or None; anything else fails the test."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        try:
            f(*args, **files(given))
        except (ParameterError, BlockError) as why:
            said = str(why)
            assert len(said) < LONGEST and "q"*200 not in said, f"{len(said)}: {said[:200]}"
            return said
    return None


def test_there_is_something_to_fuzz():
    assert len(FUNCTIONS) > 35 and len(BLOCKS) > 40
    assert {"simulate", "prd.identify", "Param"} <= set(FUNCTIONS)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_each_argument_is_taken_or_refused_in_a_sentence(name):
    f, (made, free) = FUNCTIONS[name], arguments(name, FUNCTIONS[name])
    if name not in ("chain", "channels"):  # which need a part
        assert called(f, **made) is None
    for n in [*made, *([free] if free else [])]:
        for kind, odd in ODD.items():
            if callable(odd) and (n in CALLED or callable(made.get(n))):
                continue
            said = called(f, **{**made, "odd" if n == free else n: odd})
            assert said or kind not in NEVER, f"{name}: {n} = {kind} passes in silence"


def test_arguments_that_are_odd_together():
    rng, wrong = random.Random(0), [k for k, v in ODD.items() if not callable(v)]
    for name, f in FUNCTIONS.items():
        made, _ = arguments(name, f)
        for _ in range(20 if len(made) > 1 else 0):
            odd = {n: ODD[rng.choice(wrong)] for n in rng.sample(list(made), 2)}
            called(f, **{**made, **odd})


@pytest.mark.parametrize("name", BLOCKS)
def test_each_parameter_of_a_block_is_taken_or_refused_in_a_sentence(name):
    b = BLOCKS[name]
    for n in b.settable:
        for kind, odd in ODD.items():
            said = called(b.with_, **{n: odd})
            assert said or kind not in NEVER
            if said is None:
                assert type(b.with_(**{n: odd}).values[n]) is b.kinds.get(n, float)
    assert "has no 'qqqq" in called(b.with_, **{"q"*10_000: 1.0})


def test_a_parameter_given_in_a_call_is_checked_as_in_with():
    for kind, odd in ODD.items():
        said = called(law, 1.0, k=odd)
        assert said == called(law.with_, k=odd) and (said or kind not in NEVER)
    with pytest.raises(ParameterError, match="law has no 'gain'. It has: sigma, k"):
        law(1.0, gain=2.0)
    assert law(1.0, k=np.float32(3.0)) == law(sigma=1.0, k=3) == law(1.0, 3.0) == 3.0


def test_changes_of_a_loop():
    loop = examples()["loop"]
    for odd in ODD.values():
        for n in ("law", "plant", "stop", "duration", "dt", "tau", "name", "verdict", "law__lam",
                  "plant__s", "stage", "q"*10_000):
            called(loop.with_, **{n: odd})
        called(loop.with_, law=odd, law__k=2.0)
        called(smc.channels(a=law).with_, a=odd)
        called(smc.channels(a=law).with_, a=odd, a__k=2.0)


@pytest.mark.parametrize("value", [1, 1.0, np.int64(1), np.float32(1), np.float64(1), Fraction(1)])
def test_whole_numbers_of_any_kind_are_orders(value):
    for make in (smc.hosmc.nested, smc.surface.itae, smc.surface.differenced, applications.chain,
                 smc.differentiators.differentiator, smc.differentiators.observer):
        assert repr(make(value)) == repr(make(1))
    assert len(smc.differentiators.differentiate(T, Y, 1.0, value)) == 2
    assert applications.perturbed_chain(law, value).name == "law, chain of 1"
    assert len(simulate(examples()["loop"], record=value, jit=False).t) == 2


# ---- slips, one by one ---------------------------------------------------------------------------
def test_a_name_where_a_block_is_wanted():
    loop, said = examples()["loop"], "law must be a block .*"
    with pytest.raises(BlockError, match=f"chain: {said}, not 'sign_smc'; give the block itself"):
        applications.perturbed_chain("sign_smc", 1)
    with pytest.raises(BlockError, match=f"{said}, not 'sign_smc'; give the block itself, not its"):
        loop.with_(law="sign_smc", law__rho=2.0)
    with pytest.raises(BlockError, match=f"{said}, not <function nested.*call it if it makes"):
        loop.with_(law=smc.hosmc.nested)


def test_a_function_where_a_loop_is_wanted():
    for f in (simulate, smc.accuracy):
        with pytest.raises(ParameterError, match="loop = <function loop .* must be a Closed"):
            f(smc.lv.loop)
    for f in (smc.core.reaching_time, smc.rpl.landing, smc.rpl.pulses):
        with pytest.raises(ParameterError, match="run = ClosedLoop.* it must be a Run"):
            f(examples()["loop"])


def test_times_that_float64_can_hardly_hold():
    held = applications.double_integrator().with_(actuator=smc.rpl.sample_and_hold)
    with pytest.raises(ParameterError, match="actuator__pulse = 0.05 s is not allowed; it must"):
        simulate(held, 1e-319, 1e-320, 1e-320, jit=False)
    with pytest.raises(ParameterError, match="record = .* at most 1e.08, as there are 1e.10"):
        simulate(examples()["loop"], 1e7, 1e-3, record=10**12, jit=False)


def test_messages_show_the_beginning_of_a_value_only():
    many = dict.fromkeys(range(10_000))
    for value, said in (("q"*10_000, "'qqqq"), (list(many)*100, r"\[0, 1, 2"), (many, "{0: None"),
                        (10**5000, "1e5000 or so"), (-10**5000, "-1e5000 or so")):
        with pytest.raises(ParameterError, match=f"law: k = {said}") as why:
            law.with_(k=value)
        assert len(str(why.value)) < 200
    many = block(lambda sigma, z, tau: (sigma, z), state={f"n{i}": 0.0 for i in range(10_000)})
    with pytest.raises(ParameterError, match=r"has no 'x'. It has: n0, n1, .* \(10000 in") as why:
        many.with_(x=1.0)
    assert len(str(why.value)) < 600


HUGE = 10**5000  # Python writes no more than 4300 digits


@pytest.mark.parametrize(("stage", "source", "said"), [
    ("law", "lambda sigma: HUGE", "it returned 1e5000 or so"),
    ("law", "lambda sigma: (HUGE, 1.0)", r"it returned \(1e5000 or so, 1.0\)"),
    ("law", "lambda sigma: list(range(10_000))", r"it returned \[0, 1, 2"),
    ("law", "lambda " + ", ".join(f"q{i}" for i in range(3000)) + ": 1.0", "asks for q0, q1"),
    ("output", "lambda x: (x[0],)*10_000", r"It was given .*e = \(-0.1, -0.1"),
    ("reference", "lambda t: (1.0,)*10_000", "reference and output do not fit: e = r - y with r"),
    ("plant", "lambda x: (HUGE,)", r"it returned \(1e5000 or so,\)"),
])
def test_messages_of_a_loop_show_the_beginning_of_what_a_stage_returned(stage, source, said):
    made = block(eval(source, {"HUGE": HUGE}), state=dict(x=0.1) if stage == "plant" else None)
    plant = block(lambda u: (u,), state=dict(x=0.1))
    loop = smc.ClosedLoop(**{"plant": plant, "law": block(lambda e: e + 1.0), stage: made})
    with pytest.raises(BlockError, match=said) as why:
        simulate(loop, 1.0, 0.1, jit=False)
    assert len(str(why.value)) < LONGEST


def test_a_state_of_many_numbers_is_shown_in_short():
    with pytest.raises(ParameterError, match=r"w = \(0, 1, 2, .* is not allowed") as why:
        block(state=dict(w=tuple(range(10_000))))(lambda x: x)
    assert len(str(why.value)) < LONGEST


def test_a_declaration_that_contradicts_itself():
    for given, said in ((dict(low=2.0, high=1.0), "low = 2 .* at most high = 1"),
                        (dict(low="a"), "low = 'a'"), (dict(high=math.nan), "high = nan"),
                        (dict(slider=(2.0, 1.0)), r"slider = \(2.0, 1.0\)"),
                        (dict(slider=5), "slider = 5"), (dict(help=3), "help = 3"),
                        (dict(log=1), "log = 1"), (dict(unit=None), "unit = None")):
        with pytest.raises(ParameterError, match=f"Param: .*{said}"):
            smc.Param(**given)
    assert "from 0.5 to 2" in smc.Param(low=Fraction(1, 2), high=np.int64(2)).allowed()
