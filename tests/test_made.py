"""How a block was made: code, equality, pickle, cards, the text of written functions."""

import copy
import importlib
import inspect
import linecache
import pickle
import subprocess
import sys
import traceback
import types

import control
import numpy as np
import pytest

import smcaero_nb as smc
from smcaero_nb import Block, BlockError, ClosedLoop, ParameterError, block, simulate
from smcaero_nb.core.card import Card, Law, Source, Surface
from smcaero_nb.core.family import family
from smcaero_nb.surface import itae
from smcaero_nb.ui import certificate, compare, live

ONES = ("sign_smc", "quasi_smc", "adaptive_smc", "dual_layer_smc", "super_twisting", "twisting",
        "adaptive_super_twisting", "adaptive_twisting", "quasi_continuous", "levant2005", "nested",
        "adaptive_continuous")


def presets():
    """{name: loop} of every preset."""
    made = {f"{m.__name__} {law} {preset}": m.loop(law, preset)
            for m in (smc.lv, smc.rpl) for law, q in m.PRESETS.items() for preset in q}
    made |= {f"integrator {law}": smc.applications.double_integrator(law) for law in ONES}
    made |= {f"motor {law} {y}": smc.applications.dc_motor(law, y)
             for law in ONES for y in ("angle", "speed")}
    return made | {"chain": smc.applications.perturbed_chain(smc.hosmc.nested(3), 2, raised=True)}


LOOPS = presets()
BLOCKS = {n: b for n, b in smc.catalogue().items() if isinstance(b, Block)}
MADE = [smc.hosmc.quasi_continuous(3), smc.hosmc.quasi_continuous(2, "levant2005"),
        smc.hosmc.nested(1), smc.hosmc.adaptive_continuous(2), smc.hosmc.integrated,
        itae(2, 10.0), itae(3, table="optimal", derivative="difference"),
        smc.surface.polynomial(np.array([2.0, 1.0]), derivative=True), smc.surface.differenced(2),
        smc.surface.truncated(1), smc.surface.integral_sliding(2, smc.pid.pd.with_(k_p=2.0)),
        smc.smc1.decoupling([[2, 1], [0, 4]]),
        smc.smc1.dual_layer_unit_vector(3), smc.differentiators.observer(2),
        smc.differentiators.differentiator(2, 1, method="implicit", of="y"),
        smc.applications.chain(3),
        smc.interop.from_control(control.tf([1.0, 2.0], [1.0, 2.0, 5.0], name="mass"))]


@block
def mine(sigma, k=2.0):
    """A law of this module."""
    return k*sigma


@family(card=Law(r=1))
def times(k):
    """Laws of this module."""
    return block(lambda sigma, shift=0.0: k*sigma + shift)


def near(y):
    return (2.0, 0.1*y[0]), (0.0, 1.0)


def local(text, name="own", module="__main__"):
    """A block made from text, as in a notebook cell."""
    exec(text, names := {"block": block, "__name__": module})
    return names[name]


OWN = "@block\ndef own(sigma, k=2.0): return k*sigma"


# ---- how it was made ---------------------------------------------------------------------------
@pytest.mark.parametrize("b", [*BLOCKS.values(), *MADE], ids=lambda b: b.name)
def test_the_code_of_a_block_makes_an_equal_one(b):
    again = eval(b.code(), {"smc": smc})
    assert again == b and hash(again) == hash(b) and again.made == b.made is not None
    changes = {n: v for n, v in b.values.items() if b.kinds.get(n, float) is float}
    try:
        other = b.with_(**{n: v*1.01 + 1e-3 for n, v in changes.items()})
    except ParameterError:  # values that do not go together
        return
    assert eval(other.code(), {"smc": smc}) == other and (other != b or not changes)


def test_made_says_who_made_it_with_what():
    assert smc.hosmc.quasi_continuous(np.int64(3)).made == (
        "hosmc.quasi_continuous", {"r": 3, "family": "rational"})
    assert smc.hosmc.quasi_continuous(3).with_(alpha=2.0).code() == (
        "smc.hosmc.quasi_continuous(3).with_(alpha=2.0)")
    assert smc.smc1.sign_smc.with_(rho=3.0).made == ("smc1.sign_smc", {})
    assert mine.made == (f"{__name__}.mine", {})
    assert times(2).made == (f"{__name__}.times", {"k": 2})
    assert local(OWN).made is None and local(OWN).with_(k=3.0).code() == "own.with_(k=3.0)"
    assert smc.channels(a=mine).code() == f"smc.channels(a={__name__}.mine)"


def test_a_block_that_its_module_has_changed_is_spelt_from_what_the_module_has(monkeypatch):
    changed = mine.with_(k=5.0)
    monkeypatch.setattr(sys.modules[__name__], "mine", changed)
    assert changed.code() == f"{__name__}.mine"
    back = changed.with_(k=2.0)
    assert back.code() == f"{__name__}.mine.with_(k=2.0)"
    assert pickle.loads(pickle.dumps(back)) == back


def test_a_block_made_anew_of_the_function_of_another_is_not_taken_for_it():
    again = block(mine.f, output=smc.Param(unit="deg"))
    other = block(smc.lv.gimbal.f, state=dict(first=1.0, second=2.0))
    for b in (again, other, other.with_(first=3.0)):
        assert b.made is None and "smc" not in b.code() and __name__ not in b.code()
        with pytest.raises(BlockError, match="cannot be pickled.* is another block of this func"):
            pickle.dumps(b)
    assert again.code() == "mine" and other.with_(first=3.0).code() == "gimbal.with_(first=3.0)"


# ---- equality ------------------------------------------------------------------------------------
def test_itae_surfaces_of_two_tables_differ_although_they_show_the_same():
    a, b = itae(2, 10.0), itae(2, 10.0, table="optimal")
    assert (a.p, a.z0, repr(a)) == (b.p, b.z0, repr(b)) and a != b
    loop = smc.lv.loop("quasi_smc").with_(surface=a)
    assert loop == loop.with_(surface=itae(2, 10)) != loop.with_(surface=b)


def test_a_comparison_with_the_surface_of_another_table_is_said_to_be_stale():
    loop = smc.applications.double_integrator("sign_smc")
    loop = loop.with_(duration=0.05, surface=itae(2, 10.0))
    picture = live({"a": loop})
    picture.wait()
    c, measured = compare(picture), certificate(picture)
    c.wait()
    measured.result, measured._told = types.SimpleNamespace(loop=picture.mask.target), ""
    assert c.status == ""
    picture.mask.offer("a", loop.with_(surface=itae(2, 10.0, table="optimal")))
    assert "Refresh uses its settings" in c.status and "has changed since" in measured.status


def test_own_blocks_are_equal_if_they_say_the_same():
    a, b, other = local(OWN), local(OWN), local(OWN.replace("k*sigma", "-k*sigma"))
    assert a == b and hash(a) == hash(b) and a != other and a != b.with_(k=3.0)
    assert a != "own" and smc.channels(a=a) == smc.channels(a=b) != smc.channels(b=b)
    assert len({a, b, other, smc.channels(a=a), smc.channels(a=b)}) == 3
    named = local(OWN.replace("own", "another"), "another")
    assert named.name != a.name and named == a and hash(named) == hash(a)


def test_loops_differ_in_each_of_their_parts():
    loop = LOOPS["chain"]
    for change in (dict(dt=1e-3), dict(name="q"), dict(law=None), dict(plant__s0=2.0),
                   dict(law__lam=2.0), dict(verdict=print)):
        assert loop.with_(**change) != loop
    assert loop.with_() == loop and hash(loop.with_()) == hash(loop) and loop != 1
    assert len(set(LOOPS.values())) >= len(LOOPS) - 3  # some presets have two names


def test_a_copy_is_equal_and_its_own():
    for b in (local(OWN), mine, smc.channels(a=local(OWN)), LOOPS["chain"]):
        assert copy.copy(b) == copy.deepcopy(b) == b
    again = copy.copy(mine)
    again.values["k"] = 7.0
    assert mine.values["k"] == 2.0


# ---- pickle --------------------------------------------------------------------------------------
@pytest.mark.parametrize("b", [*BLOCKS.values(), *MADE, mine, times(3.0), smc.smc1.decoupling(near),
                               smc.channels(a=mine, b=times(2.0))], ids=lambda b: b.name)
def test_a_block_survives_pickle(b):
    again = pickle.loads(pickle.dumps(b))
    assert again == b and hash(again) == hash(b) and again.code() == b.code()


THERE = """
import pathlib, pickle, sys
sys.path.insert(0, sys.argv[2])
loops = pickle.loads(pathlib.Path(sys.argv[1]).read_bytes())
from test_made import presets, ran
print([n for n, loop in presets().items() if loop != loops[n]])
print(repr([ran(loop) for loop in loops.values()]))
"""


def ran(loop):
    """The end of twenty steps, or of one sampling step, in plain Python."""
    run = simulate(loop, max(20*loop.dt, loop.tau or 0.0), jit=False)
    return [float(v[-1]) for v in vars(run.x).values()]


def test_a_loop_of_each_preset_survives_pickle_and_a_second_process(tmp_path):
    file = tmp_path/"loops"
    file.write_bytes(pickle.dumps(LOOPS))
    assert pickle.loads(file.read_bytes()) == LOOPS
    here = str(importlib.import_module(__name__).__file__).rpartition("/")[0]
    said = subprocess.run([sys.executable, "-c", THERE, str(file), here], check=True, text=True,
                          capture_output=True).stdout.strip().split("\n")
    assert said == ["[]", repr([ran(loop) for loop in LOOPS.values()])]


def inside():
    @block
    def hidden(sigma):
        return sigma
    return hidden


@pytest.mark.parametrize(("make", "said"), [
    (lambda: local(OWN), "'own' cannot be pickled, because __main__.own is defined in the "
                          "script or notebook itself; move it to a module"),
    (inside, "'hidden' cannot be pickled, because .*inside.<locals>.hidden cannot be imported"),
    (lambda: smc.smc1.decoupling(lambda y: ((1.0,),)), "<lambda> cannot be imported"),
    (lambda: family()(lambda: block(lambda e: e))(), "<lambda> cannot be imported")])
def test_a_block_that_cannot_be_imported_says_what_to_do(make, said):
    stage = make().card.stage if make().card else "law"
    loop = ClosedLoop(smc.applications.chain(1), **{stage: make()})
    for thing in (make(), smc.channels(a=make()), loop):
        with pytest.raises(BlockError, match=said):
            pickle.dumps(thing)


# ---- text ----------------------------------------------------------------------------------------
WRITTEN = [b for b in MADE if b.name not in ("integrated", "dual_layer_unit_vector", "integrators",
                                             "observer_2")]


@pytest.mark.parametrize("b", WRITTEN, ids=lambda b: b.name)
def test_the_text_of_a_written_block_can_be_read(b):
    text = inspect.getsource(b.f)
    assert text.startswith(f"def {b.name}(") and "\n    return " in text
    linecache.checkcache()
    assert inspect.getsource(b.f) == text


def test_an_error_in_a_written_block_names_its_line():
    with pytest.raises(TypeError) as why:
        smc.hosmc.quasi_continuous(2)((None, 1.0))
    last = traceback.extract_tb(why.value.__traceback__)[-1]
    assert last.name == "quasi_continuous_2" and "psi(s0/L" in last.line


def test_a_breakpoint_can_be_set_in_a_written_block():
    import bdb

    class Debugger(bdb.Bdb):
        stops = ()

        def user_line(self, frame):
            self.stops = (*self.stops, (frame.f_code.co_name, frame.f_lineno))
            self.set_continue()

    law, debugger = smc.hosmc.quasi_continuous(2), Debugger()
    assert debugger.set_break(law.f.__code__.co_filename, 3) is None
    debugger.runcall(law, (1.0, 0.0))
    assert ("quasi_continuous_2", 3) in debugger.stops


# ---- cards ---------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", smc.catalogue())
def test_every_public_block_has_a_card(name):
    thing = smc.catalogue()[name]
    assert isinstance(thing.card, Card)
    for s in thing.card.source:
        assert s.authors and s.title and s.journal and (s.year is None or 1900 < s.year < 2100)
    if isinstance(thing.card, Law):
        assert thing.card.source and thing.card.needs and thing.card.guarantees


@pytest.mark.parametrize("name", LOOPS)
def test_the_card_of_a_block_is_of_the_stage_where_it_stands(name):
    for stage, b in LOOPS[name].stages.items():
        for part in getattr(b, "parts", {"": b}).values() if b else ():
            assert part.card.stage == stage


def test_the_catalogue_has_the_public_blocks_and_families_by_name():
    found = smc.catalogue()
    assert found["smc1.sign_smc"] is smc.smc1.sign_smc and found["hosmc.nested"] is smc.hosmc.nested
    assert all(b.made == (n, {}) for n, b in BLOCKS.items())
    libraries = [m for m in vars(smc).values() if isinstance(m, types.ModuleType)]
    public = [b for m in libraries for n in getattr(m, "__all__", ())
              if isinstance(b := getattr(m, n), Block)]
    assert len(public) > 40 and all(any(b is q for q in found.values()) for b in public)


MINE = '''
from smcaero_nb import block
from smcaero_nb.card import Law, Source
from smcaero_nb.smc1 import sign_smc


@block(card=Law(order=1, r=1, needs="the bound of |xi|", guarantees="sigma = 0",
                source=(Source("A. Student", 2026, "My law", "Thesis"),)))
def my_law(sigma, k=2.0):
    return k*((sigma > 0.0) - (sigma < 0.0))


@block
def _hidden(sigma):
    return sigma
'''


def test_a_law_of_your_own_module_appears_in_the_catalogue(tmp_path, monkeypatch):
    (tmp_path/"my_laws.py").write_text(MINE.replace("smcaero_nb.card", "smcaero_nb.core.card"))
    monkeypatch.syspath_prepend(tmp_path)
    my_laws = importlib.import_module("my_laws")
    new = smc.catalogue(my_laws).keys() - smc.catalogue().keys()
    assert new == {"my_laws.my_law"}
    law = smc.catalogue(my_laws)["my_laws.my_law"].with_(k=3.0)
    assert law.code() == "my_laws.my_law.with_(k=3.0)" and pickle.loads(pickle.dumps(law)) == law
    loop = smc.applications.perturbed_chain(law, 1)
    assert "A. Student (2026). My law. Thesis." in smc.cite(loop).split("\n")
    with pytest.raises(ParameterError, match=r"modules\[0\] = 'my_laws' .* must be a module"):
        smc.catalogue("my_laws")


def test_references_of_a_loop_are_those_of_its_blocks_each_once():
    said = smc.cite(smc.rpl.loop()).split("\n")
    assert len(said) == len(set(said)) and any("Plestan" not in s and "Kode" in s for s in said)
    assert "Graham" in smc.cite(smc.lv.loop()) and smc.cite(mine) == ""
    with pytest.raises(ParameterError, match="cite: source = 3 .* a block or a closed loop"):
        smc.cite(3)


def test_a_card_says_what_the_engine_asks_of_a_law():
    assert smc.smc2.twisting.r == 1 and smc.smc1.sign_smc.r is None and smc.hosmc.nested(3).r == 3
    assert smc.hosmc.nested(1).r is None and smc.hosmc.nested.card.r is None and mine.r is None
    assert smc.smc1.sign_smc.theorem(dict(rho=1.0), 2.0, 0.0).startswith("|xi| reaches 2")
    assert smc.rpl.off_pulse_smc.band and smc.smc1.sign_smc.band is None


@pytest.mark.parametrize(("wrong", "said"), [
    (dict(order=0), "order = 0"), (dict(sees="x"), "'sigma', 'derivatives'"),
    (dict(adaptive=1), "a switch"), (dict(needs=3), "must be text"),
    (dict(assumes=3), "a function"), (dict(source="q"), "a tuple of Source"),
    (dict(source=Source("a", 1, "b", "c")), r"source\[0\]")])
def test_a_card_that_is_wrong_is_refused(wrong, said):
    with pytest.raises(ParameterError, match=f"Law: .*{said}"):
        Law(**wrong)
    with pytest.raises(ParameterError, match="block: card = 3 is not allowed"):
        block(card=3)
    assert block(card=Surface())(lambda e: e).card == Surface()


# ---- the stage of a card -------------------------------------------------------------------------
def test_a_surface_given_as_law_is_refused_with_where_it_belongs():
    """It would run, as v = sigma, and nothing in the figures would say so."""
    plain = ClosedLoop(smc.applications.chain(2))
    surface = smc.surface.itae(2, 10.0)
    for law in surface, smc.channels(a=smc.smc1.sign_smc, b=surface):
        with pytest.raises(BlockError, match="^law 'itae' is a block for the stage surface, as .*; "
                                             "give it as surface=itae, and a law"):
            plain.with_(law=law)
    assert plain.with_(surface=surface, law=smc.smc1.sign_smc).stages["surface"] is surface
    own = block(lambda e: e[1] + e[0])
    assert plain.with_(law=own).stages["law"] is own  # without a card


# ---- factories outside the law packages ----------------------------------------------------------
def test_every_public_function_that_makes_a_block_for_a_stage_is_in_the_catalogue():
    listed, masks = [*smc.catalogue().values()], {smc.prd.experiment, smc.differentiators.trial}
    libraries = [m for n in smc.__all__ if inspect.ismodule(m := getattr(smc, n))]
    makers = {f for m in libraries for n in m.__all__ if inspect.isfunction(f := getattr(m, n))
              and inspect.signature(f).return_annotation in (smc.Block, "Block")}
    assert {smc.interop.from_control, smc.surface.itae} < makers - masks
    assert all(f in listed for f in makers - masks)
    assert isinstance(smc.interop.from_control.card, smc.card.Plant)
    assert smc.catalogue()["interop.from_control"] is smc.interop.from_control
