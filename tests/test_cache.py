"""Compiled loops on disk: private, shared between processes, never stale, and dispensable."""

import json
import os
import stat
import textwrap
import types
import warnings

import numba.core.compiler
import numba.core.serialize
import pytest
from numba import float64, njit
from numba.core import event

import smcaero_nb as smc
from smcaero_nb import ClosedLoop, Param, block, simulate
from smcaero_nb.core import cache
from smcaero_nb.core.cache import cache_folder, compiled, fingerprint, kept

posix = pytest.mark.skipif(not hasattr(os, "getuid"), reason="needs POSIX owners and permissions")


@block(state=dict(x=1.0))
def plant(u):
    return (-u,)


@block
def output(x):
    return -x[0]


def loop_of(law):
    return ClosedLoop(plant, output=output, law=law, duration=0.5, dt=0.125)


def compilations(recorder):
    """How often a whole loop was compiled."""
    return sum(e.is_start and e.data["dispatcher"].py_func.__name__ == "run" for _, e in recorder.buffer)


@pytest.fixture
def own_folder(tmp_path, monkeypatch):
    """A cache that is empty, and no memory of what was made or said."""
    monkeypatch.setenv("SMCAERO_CACHE_DIR", str(tmp_path / "loops"))
    monkeypatch.setattr(smc.core.engine, "_made", {})
    monkeypatch.setattr(cache, "_compiled", {})
    monkeypatch.setattr(cache, "_said", set())
    return tmp_path / "loops"


# ---- the folder ------------------------------------------------------------------------------------------------------
@posix
def test_the_folder_is_private_whatever_the_umask(own_folder):
    before = os.umask(0)
    try:
        folder = cache_folder()
    finally:
        os.umask(before)
    assert folder == own_folder and stat.S_IMODE(folder.stat().st_mode) == 0o700
    folder.chmod(0o755)  # others may look: mended
    assert stat.S_IMODE(cache_folder().stat().st_mode) == 0o700


@posix
@pytest.mark.parametrize("mode", [0o770, 0o707, 0o777, 0o720, 0o702])
def test_a_folder_that_others_may_write_to_is_refused(own_folder, mode):
    own_folder.mkdir()
    own_folder.chmod(mode)
    with pytest.raises(PermissionError, match="others may write to it"):
        cache_folder()


@posix
def test_a_folder_of_another_user_is_refused(own_folder, monkeypatch):
    cache_folder()
    monkeypatch.setattr(os, "getuid", lambda: own_folder.stat().st_uid + 1)
    with pytest.raises(PermissionError, match="belongs to another user"):
        cache_folder()


@posix
def test_a_run_does_without_a_refused_folder_and_leaves_nothing_in_it(own_folder):
    own_folder.mkdir()
    own_folder.chmod(0o777)

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert [keep(k) for k in (0.25, 0.5)] == [0.25, 0.5]
    assert len(caught) == 1 and "others may write to it" in str(caught[0].message)
    assert not list(own_folder.iterdir())


def test_the_folder_is_the_users_own_unless_told(tmp_path, monkeypatch):
    monkeypatch.delenv("SMCAERO_CACHE_DIR")
    asked = []

    def user_cache_path(*args):
        asked.append(args)
        return tmp_path / "of the user"

    monkeypatch.setattr(cache.platformdirs, "user_cache_path", user_cache_path)
    assert cache_folder() == tmp_path / "of the user" and asked[0][0] == "smcaero_nb"


def test_a_folder_that_cannot_be_made_is_done_without(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("SMCAERO_CACHE_DIR", str(tmp_path / "file" / "loops"))
    monkeypatch.setattr(cache, "_said", set())
    with pytest.warns(RuntimeWarning, match="no folder for compiled code .*; it is compiled anew in every process"):
        assert keep(0.75) == 0.75


@posix
def test_files_are_private_too(own_folder):
    before = os.umask(0)
    try:
        keep(0.375)
    finally:
        os.umask(before)
    files = list(own_folder.iterdir())
    assert len(files) == 1 and files[0].suffix == ".loop"
    assert stat.S_IMODE(files[0].stat().st_mode) & 0o077 == 0


def test_the_oldest_files_go_first(own_folder, monkeypatch):
    monkeypatch.setattr(cache, "_FILES", 3)
    folder = cache_folder()
    for i in range(5):
        (folder / f"{i}.loop").write_bytes(b"")
        os.utime(folder / f"{i}.loop", (i, i))

    keep(0.125)
    left = sorted(f.name for f in folder.glob("*.loop"))
    assert len(left) == 3 and {"3.loop", "4.loop"} < {*left}


# ---- processes -------------------------------------------------------------------------------------------------------
#: Runs the loop of each folder named, and says its result and how often it was compiled.
PROGRAM = """
import importlib, json, sys
from numba.core import event
from smcaero_nb import simulate

said = {}
for folder in sys.argv[1:]:
    sys.path.insert(0, folder)
    for name in ("mine", "helpers", "more", "cfg"):
        sys.modules.pop(name, None)
    importlib.invalidate_caches()
    with event.install_recorder("numba:compile") as recorder:
        run = simulate(importlib.import_module("mine").loop)
    made = sum(e.is_start and e.data["dispatcher"].py_func.__name__ == "run" for _, e in recorder.buffer)
    said[folder] = [run.u[0], run.x.x[-1], made]
    sys.path.remove(folder)
print(json.dumps(said))
"""

SOURCES = dict(
    mine="""
        import cfg
        import helpers
        from helpers import shaped
        from smcaero_nb import ClosedLoop, block

        GAIN = 2.0

        @block(state=dict(x=1.0))
        def plant(u):
            return (-u,)

        @block
        def output(x):
            return -x[0]

        @block
        def law(sigma, k=1.0):
            return k*GAIN*shaped(sigma)*cfg.factor + helpers.offset(sigma)

        loop = ClosedLoop(plant, output=output, law=law, duration=1.0, dt=0.125)
        """,
    helpers="""
        from more import deeper

        def shaped(sigma, width=1.0):
            return deeper(sigma)*width

        def offset(sigma):
            return 0.0*sigma
        """,
    more="""
        def deeper(q):
            return 1.0*q
        """,
    cfg="factor = 1.0\n")

#: An edit (file, old, new), and u(0), which is 2.0 without it.
EDITS = {
    "nothing": ("cfg", "factor = 1.0", "factor = 1.0  # with a comment", 2.0),
    "a global constant": ("mine", "GAIN = 2.0", "GAIN = 3.0", 3.0),
    "a helper": ("helpers", "deeper(sigma)*width", "4.0*deeper(sigma)*width", 8.0),
    "a helper's helper in another file": ("more", "1.0*q", "5.0*q", 10.0),
    "a default of a helper": ("helpers", "width=1.0", "width=6.0", 12.0),
    "an attribute of a module": ("cfg", "1.0", "7.0", 14.0),
    "a helper reached through a module": ("helpers", "0.0*sigma", "8.0*sigma", 10.0),
    "the law itself": ("mine", "return k*GAIN", "return 9.0*k*GAIN", 18.0),
}


def write(folder, file=None, old="", new="", _=None):
    folder.mkdir()
    for name, source in SOURCES.items():
        text = textwrap.dedent(source)
        if name == file:
            assert old in text
            text = text.replace(old, new)
        (folder / f"{name}.py").write_text(text)
    return folder


def test_an_edit_in_another_process_recompiles_and_going_back_does_not(new_python, tmp_path, own_folder):
    base = write(tmp_path / "base")
    folders = {what: write(tmp_path / what.replace(" ", "_").replace("'", ""), *edit) for what, edit in EDITS.items()}

    def run(*folders):
        return json.loads(new_python(PROGRAM, *folders))

    assert run(base)[str(base)][::2] == [2.0, 1]
    second = run(base, *folders.values(), base)
    for what, (*_, u) in EDITS.items():
        got, end, made = second[str(folders[what])]
        assert (got, made) == (u, 0 if what == "nothing" else 1), what
        assert end == pytest.approx((1 - u/8)**8, rel=1e-12), what
    assert second[str(base)][::2] == [2.0, 0]
    third = run(*folders.values(), base)
    assert {k: v[:2] for k, v in third.items()} == {k: v[:2] for k, v in second.items()}
    assert not any(made for *_, made in third.values())


#: Ten children start on a sign, none of which has compiled the loop or finds it on disk.
TEN = """
import os, sys
from numba import njit
sys.path.insert(0, sys.argv[1])
import mine
from smcaero_nb import simulate

njit(lambda x: x + 1.0)(1.0)  # so that the children share what numba itself needs
ready, go = os.pipe(), os.pipe()
for _ in range(10):
    if os.fork() == 0:
        os.close(go[1])
        os.read(go[0], 1)  # until the parent closes its end
        run = simulate(mine.loop)
        os.write(ready[1], f"{run.u[0]!r} {run.x.x[-1]!r}\\n".encode())
        os._exit(0)
os.close(go[1])
print([os.waitstatus_to_exitcode(os.wait()[1]) for _ in range(10)])
os.close(ready[1])
print(open(ready[0]).read(), end="")
"""


@posix
def test_ten_processes_that_start_cold_at_once_agree(new_python, tmp_path, own_folder):
    folder = write(tmp_path / "base")
    said = new_python(TEN, folder, PYTHONWARNINGS="error").splitlines()
    assert said[0] == str([0]*10)
    assert len(said) == 11 and len(set(said[1:])) == 1 and said[1].startswith("np.float64(2.0)")
    assert [f.suffix for f in own_folder.iterdir()] == [".loop"]  # one file, and no half-written ones
    assert json.loads(new_python(PROGRAM, folder))[str(folder)][2] == 0


# ---- within one process: a cell run again ---------------------------------------------------------------------------
def cell(source, **names):
    """Run a notebook's cell; return what it defined."""
    exec(textwrap.dedent(source), namespace := {"block": block, "__name__": "__main__", **names})
    return namespace


LAW = "\n@block\ndef law(sigma): return {}\n".format

#: What is edited: (the cell, what stands in it first, and what later).
CELLS = {
    "a global constant": ("K = {}" + LAW("K*sigma"), 2.0, 3.0),
    "a helper": ("def helper(s): return {}*s" + LAW("helper(sigma)"), 2.0, 3.0),
    "a default of a helper": ("def helper(s, k={}): return k*s" + LAW("helper(sigma)"), 2.0, 3.0),
    "the type of a default": ("def helper(s, k={}): return s/k" + LAW("helper(sigma)"), "2", "2.0"),
    "a helper of a helper": ("def deep(s): return {}*s\ndef helper(s): return deep(s)" + LAW("helper(sigma)"), 2.0, 3.0),
    "which helper a name stands for": ("def A(s): return s\ndef B(s): return 2.0*s\na = A\nb = B\nc = {}"
                                       + LAW("a(sigma) + 10.0*b(sigma) + 100.0*c(sigma)"), "A", "B"),
    "a tuple": ("K = (1.0, {})" + LAW("K[1]*sigma"), 2.0, 3.0),
    "an array": ("import numpy as np\nK = np.array([1.0, {}])" + LAW("K[1]*sigma"), 2.0, 3.0),
    "a parameter of a block that helps": (
        "from smcaero_nb.smc1 import quasi_smc\nsoft = quasi_smc.with_(rho={})" + LAW("soft(sigma)"), 2.0, 3.0),
    "a constant that a numba function read": (
        "from numba import njit\nK = {}\n@njit\ndef helper(s): return K*s" + LAW("helper(sigma)"), 2.0, 3.0),
    "an enumeration": ("import enum\nclass Mode(enum.Enum):\n    A = {}" + LAW("Mode.A.value*sigma"), 2.0, 3.0),
    "a closure": ("def make(k):\n    @block\n    def law(sigma): return k*sigma\n    return law\nlaw = make({})", 2.0, 3.0),
}


def value(law, jit=True):
    """law(1.0), compiled as in a loop."""
    if not jit:
        return law(1.0)
    f = compiled(law.f)
    return njit(lambda s: f(s))(1.0)


@pytest.mark.parametrize("what", CELLS)
def test_a_cell_that_is_run_again_is_never_stale(what):
    source, *values = CELLS[what]
    first, second, again = (cell(source.format(v))["law"] for v in (*values, values[0]))
    assert [value(law) for law in (first, second, again)] == [value(law, False) for law in (first, second, again)]
    assert first.content() == again.content() != second.content()
    assert value(first) != value(second) or "type" in what


@pytest.mark.parametrize("wrap", ["", "@njit\n"])
def test_a_constant_that_is_changed_while_the_functions_stay_is_seen(wrap):
    names = cell(f"from numba import njit\nK = 2.0\n{wrap}def helper(s): return K*s" + LAW("K*helper(sigma)"))
    seen = []
    for names["K"] in (2.0, 3.0, 2.0):
        seen.append(value(names["law"]))
    assert seen == [4.0, 9.0, 4.0]


def test_a_module_attribute_that_is_changed_is_seen():
    cfg = types.ModuleType("cfg")
    cfg.inner = types.ModuleType("cfg.inner")
    cfg.inner.cfg = cfg  # modules that know one another
    law = cell("@block\ndef law(sigma): return cfg.k*cfg.inner.k*sigma", cfg=cfg)["law"]
    seen = []
    for cfg.k, cfg.inner.k in ((2.0, 2.0), (3.0, 2.0), (3.0, 3.0)):
        seen.append(value(law))
    assert seen == [4.0, 6.0, 9.0]


def test_a_loop_with_a_changed_helper_is_compiled_once_and_remembered():
    source = "def helper(s, k={}): return k*s\n@block\ndef law(sigma): return helper(sigma)"
    with event.install_recorder("numba:compile") as recorder:
        seen = [simulate(loop_of(cell(source.format(k))["law"])).u[0] for k in (0.75, 0.5, 0.75, 0.5)]
    assert seen == [0.75, 0.5, 0.75, 0.5] and compilations(recorder) == 2


def test_a_comment_or_another_name_of_the_same_thing_changes_nothing():
    a = cell("K = 2.0\n@block\ndef law(sigma): return K*sigma")["law"]
    b = cell("K = 2.0\n\n@block\ndef law(sigma):\n    # twice\n    return K*sigma")["law"]
    assert fingerprint(a.f) == fingerprint(b.f)
    assert fingerprint(a.f) != fingerprint(cell("K = 2.0\n@block\ndef law(sigma): return K*sigma*1.0")["law"].f)


def test_limits_and_kinds_are_compiled_in_and_the_rest_of_the_metadata_is_not():
    def motion(x, k=1.0):
        return (k*x[0],)

    def typed(annotation, default, output=None):
        def law(sigma, k=default):
            return k*sigma
        law.__annotations__ = {"k": annotation} | ({"return": output} if output else {})
        return block(law).content()

    def with_state(initial, **meta):
        return block(state=dict(s=(initial, Param(**meta))))(motion).content()

    plain = with_state(0.0)
    assert plain == with_state(1.0, symbol="s", unit="m", help="words", slider=(0.0, 1.0), log=True)
    assert len({repr(c) for c in (plain, with_state(0.0, low=-1.0), with_state(0.0, high=1.0), with_state(0.0, high=2.0))}) == 4
    assert block(state=dict(other=0.0))(motion).content() != plain
    assert typed(float, 1.0) == typed(Param("k", low=-9.0, high=9.0), 2.0)
    limited = [typed(float, 1.0, Param("v", high=h)) for h in (1.0, 2.0)]
    assert len({repr(c) for c in (typed(float, 1.0), typed(int, 1), typed(bool, True), *limited)}) == 5
    assert typed(float, 1.0, Param("v", "N", help="words")) == typed(float, 1.0, Param("w"))


@pytest.mark.parametrize("pair", [("1", "1.0"), ("1", "True"), ("0.0", "-0.0"), ("'a'", "b'a'"), ("(1,)", "(1.0,)")])
def test_constants_that_compare_equal_are_told_apart(pair):
    prints = {fingerprint(cell(f"K = {v}\ndef f(s): return K")["f"]) for v in pair}
    prints |= {fingerprint(cell(f"def g(k={v}): return k\ndef f(s): return g()")["f"]) for v in pair}
    prints |= {fingerprint(cell(f"def f(s): return {v}")["f"]) for v in pair}
    assert len(prints) == 6


# ---- damage and change -----------------------------------------------------------------------------------------------
def keep(factor):
    """A numba function that is kept on disk, compiled or loaded; what it gives for 1."""
    f = kept(njit(eval(f"lambda x: {factor}*x")), f"times {factor}")
    f.compile((float64,))
    return f(1.0)


@pytest.mark.parametrize("damage", ["garbage", "half", "empty", "another pickle"])
def test_a_damaged_file_is_compiled_again_with_a_warning(own_folder, damage):
    assert keep(0.625) == 0.625
    path, = own_folder.iterdir()
    whole = path.read_bytes()
    path.write_bytes({"garbage": b"\x80\x04nonsense", "half": whole[:len(whole)//2], "empty": b"",
                      "another pickle": b"\x80\x04K\x01."}[damage])
    with pytest.warns(RuntimeWarning, match="compiled code not read from disk .*; compiling again"):
        assert keep(0.625) == 0.625
    assert len(path.read_bytes()) > 1000  # mended
    with event.install_recorder("numba:compile") as recorder, warnings.catch_warnings():
        warnings.simplefilter("error")
        assert keep(0.625) == 0.625
    assert not recorder.buffer


@pytest.mark.parametrize("missing", ["_rebuild", "_reduce", "dumps", "_cache"])
def test_without_numbas_internals_it_runs_and_says_so_once(own_folder, monkeypatch, missing):
    if missing == "dumps":
        monkeypatch.delattr(numba.core.serialize, "dumps")
    elif missing != "_cache":
        monkeypatch.delattr(numba.core.compiler.CompileResult, missing)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        if missing == "_cache":
            for _ in range(2):
                kept(types.SimpleNamespace(), "a dispatcher of another version")
        else:
            assert [keep(k) for k in (0.3125, 0.4375)] == [0.3125, 0.4375]
    said = [str(w.message) for w in caught]
    assert len(said) == 1 and said[0].startswith("smcaero_nb: this version of numba")
    assert not own_folder.exists() or not list(own_folder.glob("*.loop"))


def test_internals_that_fail_are_survived(own_folder, monkeypatch):
    def broken(self):
        raise TypeError("changed")

    monkeypatch.setattr(numba.core.compiler.CompileResult, "_reduce", broken)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert [keep(k) for k in (0.1875, 0.6875)] == [0.1875, 0.6875]
    assert len(caught) == 1 and "TypeError: changed" in str(caught[0].message)


def test_plain_runs_need_no_numba(new_python):
    said = new_python("""
import sys
sys.modules["numba"] = None  # import numba fails
import smcaero_nb as smc
print(smc.simulate(smc.lv.loop("quasi_smc"), 0.1, 1e-2, jit=False).steps)
""")
    assert said.split() == ["10"]


def test_numbas_own_switch_makes_runs_plain(new_python):
    said = new_python("""
import smcaero_nb as smc
print(smc.simulate(smc.lv.loop("quasi_smc"), 0.1, 1e-2).steps)
""", NUMBA_DISABLE_JIT="1")
    assert said.split() == ["10"]


def test_importing_the_kit_loads_neither_plots_nor_widgets(new_python):
    said = new_python("""
import sys
import smcaero_nb
print([m for m in ("plotly", "ipywidgets", "anywidget", "IPython", "matplotlib", "control") if m in sys.modules])
""")
    assert said.strip() == "[]"

