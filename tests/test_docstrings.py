"""Docstrings: every public name has one, every argument is in it and no other, in numpy's form;
examples run."""

import dataclasses
import doctest
import importlib
import inspect
import pkgutil
import re
import types
from typing import Annotated

import pytest

import smcaero_nb as smc
from smcaero_nb import Block, Metrics, Run

ORDER = ["Parameters", "Attributes", "Returns", "Raises", "Warns", "Notes", "References",
         "Examples"]
CONTRACT = {"z", "tau"}  # what the state and the step are is the same in every block


def modules():
    """All modules of the kit."""
    names = [m.name for m in pkgutil.walk_packages(smc.__path__, "smcaero_nb.")]
    return [smc, *map(importlib.import_module, names)]


def public():
    """{name: thing} of what a user meets: the names of the packages and of the modules beside them,
    each thing once."""
    seen = {}
    for module in (smc, smc.core, smc.surface, smc.interop, smc.pid, smc.smc1, smc.smc2, smc.hosmc,
                   smc.differentiators, smc.prd,
                   smc.applications, smc.lv, smc.rpl, smc.ui):
        for name in module.__all__:
            thing = getattr(module, name)
            if not isinstance(thing, types.ModuleType) and not any(thing is other
                                                                   for other in seen.values()):
                seen[f"{module.__name__.removeprefix('smcaero_nb')}.{name}".lstrip(".")] = thing
    return seen


PUBLIC = public()
#: What the architecture promises by name.
PROMISED = dict(
    core="block Param channels ClosedLoop simulate Run", surface="itae coefficients polynomial",
    smc1="sign_smc quasi_smc saturation_smc tanh_smc unit_vector quasi_unit_vector adaptive_smc "
         "adaptive_quasi_smc "
         "adaptive_unit_vector adaptive_quasi_unit_vector dual_layer_smc dual_layer_quasi_smc "
         "dual_layer_unit_vector",
    smc2="super_twisting twisting adaptive_super_twisting adaptive_twisting gains",
    hosmc="quasi_continuous nested adaptive_continuous", lv="loop transfer_function",
    rpl="loop landing pulses",
    applications="double_integrator dc_motor", interop="from_control",
    differentiators="LAMBDA differentiator differentiate lipschitz observer trial read_csv",
    prd="identify sweep read_csv PRDResult",
    ui="mask live plot compare certificate flight")
CALLABLE = {n: t for n, t in PUBLIC.items() if isinstance(t, (types.FunctionType, Block, type))}
BLOCKS = {n: t for n, t in PUBLIC.items() if isinstance(t, Block)}


def sections(doc):
    """{title: text} of a docstring in numpy's form."""
    parts = re.split(r"^(\w[\w ]*)\n-{3,}\n", inspect.cleandoc(doc), flags=re.M)
    return dict(zip(["", *parts[1::2]], parts[::2], strict=True))


def listed(text):
    """Names of a section's entries."""
    heads = [line for line in text.split("\n") if line and not line.startswith(" ")]
    return [n.strip().lstrip("*") for head in heads for n in head.split(" : ")[0].split(",")]


def arguments(thing):
    """Names of the arguments that a docstring has to explain."""
    f = thing.f if isinstance(thing, Block) else thing
    names = [n for n in inspect.signature(f).parameters if n != "self"]
    return [n for n in names if not (isinstance(thing, Block) and n in CONTRACT)]


@pytest.mark.parametrize("module", modules(), ids=lambda m: m.__name__)
def test_every_module_says_what_it_is_and_what_it_offers(module):
    assert module.__doc__ and module.__doc__.strip()
    for name in getattr(module, "__all__", []):
        assert getattr(module, name) is not None


@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_name_has_a_docstring(name):
    thing = PUBLIC[name]
    # a table: its comment is its documentation
    if isinstance(thing, (dict, list, tuple, str, float)):
        module = importlib.import_module(f"smcaero_nb.{name}".rpartition(".")[0])
        files = [module, *(m for m in modules() if m.__name__.startswith(module.__name__))]
        assert any(re.search(rf"^#:.*\n{name.rpartition('.')[2]}\b", inspect.getsource(m), re.M)
                   for m in files)
    else:
        first = (thing.__doc__ or "").strip().split("\n")[0]
        assert len(first) > 10 and first[0].isupper() and first.endswith((".", ":")), first


@pytest.mark.parametrize(("module", "name"),
                         [(m, n) for m, names in PROMISED.items() for n in names.split()])
def test_promised_names_are_public(module, name):
    thing = getattr(getattr(smc, module), name)
    assert any(thing is other for other in PUBLIC.values()) and len(thing.__doc__) > 100


#: The other classes are made by functions, not by hand.
MADE_BY_HAND = [n for n, t in CALLABLE.items() if not isinstance(t, type)
                or t in (smc.Param, smc.ClosedLoop)]


@pytest.mark.parametrize("name", MADE_BY_HAND)
def test_every_argument_is_explained_and_no_other(name):
    thing = CALLABLE[name]
    found = sections(thing.__doc__)
    wanted = arguments(thing)
    if thing is smc.ClosedLoop:
        wanted = [n for n in wanted if n != "stages"] + [s for s in smc.core.stages.STAGES
                                                         if s != "plant"]
    assert sorted(listed(found.get("Parameters", ""))) == sorted(wanted)
    if isinstance(thing, (types.FunctionType, Block)):
        assert "Returns" in found


@pytest.mark.parametrize("name", CALLABLE)
def test_sections_are_known_and_in_order(name):
    titles = [t for t in sections(CALLABLE[name].__doc__) if t]
    assert {*titles} <= {*ORDER} and titles == sorted(titles, key=ORDER.index)


@pytest.mark.parametrize("name", BLOCKS)
def test_every_block_shows_its_equation_and_its_source(name):
    doc = BLOCKS[name].__doc__
    assert ".. math::" in doc
    assert "References" in sections(doc) or "Not in the paper" in sections(doc)["Notes"]
    assert "\\\\dot" not in doc and "\\\\sigma" not in doc  # a backslash too many shows as such
    for meta in BLOCKS[name].params.values():
        assert meta.symbol and meta.unit and meta.help


def test_attributes_of_results_are_all_documented():
    run = smc.simulate(smc.lv.loop("quasi_smc"), 0.01, 1e-3, jit=False)
    public = [n for n in vars(run) if not n.startswith("_")]
    assert sorted(listed(sections(Run.__doc__)["Attributes"])) == sorted(public)
    assert (listed(sections(Metrics.__doc__)["Attributes"])
            == [f.name for f in dataclasses.fields(Metrics)])
    assert {"f", "signals", "params", "states", "kinds", "values",
            "output"} <= {*listed(sections(Block.__doc__)["Attributes"])}


@pytest.mark.parametrize("cls", [t for t in PUBLIC.values() if isinstance(t, type)],
                         ids=lambda t: t.__name__)
def test_methods_are_explained(cls):
    for name, method in vars(cls).items():
        if isinstance(method, types.FunctionType) and not name.startswith("_"):
            assert method.__doc__, f"{cls.__name__}.{name}"


@pytest.mark.parametrize("name", [n for n, t in PUBLIC.items() if ">>>" in (t.__doc__ or "")
                                  and not n.startswith("ui.")])
def test_examples_run(name):
    thing = PUBLIC[name]
    home = vars(importlib.import_module(getattr(thing, "f", thing).__module__))
    names = {**home, **{n: getattr(smc, n) for n in smc.__all__ if n != "ui"},
             "Annotated": Annotated, "smc": smc}
    examples = doctest.DocTestParser().get_doctest(thing.__doc__, names, name, None, 0)
    results = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(examples)
    assert results.attempted and not results.failed
