"""Compiled loops on disk: private, shared between processes, never stale, and dispensable."""

import json
import math
import os
import pathlib
import random
import shutil
import stat
import textwrap
import time
import types
import warnings

import numba.core.compiler
import numba.core.serialize
import numpy as np
import pytest
from numba import float64, njit
from numba.core import event

import smcaero_nb as smc
from smcaero_nb import ClosedLoop, Param, block, simulate
from smcaero_nb.core import cache
from smcaero_nb.core.cache import cache_folder, compiled, kept
from smcaero_nb.core.content import fingerprint

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
    return sum(e.is_start and e.data["dispatcher"].py_func.__name__ == "run"
               for _, e in recorder.buffer)


@pytest.fixture
def own_folder(tmp_path, monkeypatch):
    """A cache that is empty, and no memory of what was made or said."""
    monkeypatch.setenv("SMCAERO_CACHE_DIR", str(tmp_path / "loops"))
    monkeypatch.setattr(smc.core.build, "_made", {})
    monkeypatch.setattr(cache, "_compiled", {})
    monkeypatch.setattr(cache, "_said", set())
    return tmp_path / "loops" / f"loops-{cache._FORMAT}"


# ---- the folder ----------------------------------------------------------------------------------
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
    own_folder.mkdir(parents=True)
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
    own_folder.mkdir(parents=True)
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
    assert cache_folder().parent == tmp_path / "of the user" and asked[0][0] == "smcaero_nb"


@posix
def test_a_directory_that_was_there_keeps_its_permissions(tmp_path, monkeypatch):
    monkeypatch.setenv("SMCAERO_CACHE_DIR", str(tmp_path))
    tmp_path.chmod(0o755)
    cache_folder()
    assert stat.S_IMODE(tmp_path.stat().st_mode) == 0o755


@posix
def test_a_folder_that_is_a_link_is_refused(own_folder, tmp_path):
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    own_folder.parent.mkdir()
    own_folder.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(PermissionError, match="is a link"):
        cache_folder()


@pytest.mark.parametrize("home", [RuntimeError("could not determine the home directory"),
                                  "~/.cache/smcaero_nb"])
def test_without_a_home_directory_a_run_does_without_a_folder(home, tmp_path, monkeypatch):
    def user_cache_path(*_):
        if isinstance(home, Exception):
            raise home
        return pathlib.Path(home)

    monkeypatch.delenv("SMCAERO_CACHE_DIR")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cache.platformdirs, "user_cache_path", user_cache_path)
    monkeypatch.setattr(cache, "_said", set())
    with pytest.warns(RuntimeWarning, match="no folder for compiled code .*home directory"):
        assert keep(0.8125) == 0.8125
    assert not list(tmp_path.iterdir())


def test_what_an_ended_process_left_half_written_goes(own_folder):
    old, new = cache_folder() / "old.part", cache_folder() / "new.part"
    for path, age in ((old, 2*cache._STALE), (new, 0.5*cache._STALE)):
        path.write_bytes(b"half")
        os.utime(path, (time.time() - age,)*2)
    keep(0.6875)
    assert not old.exists() and new.exists()


def test_a_full_disk_leaves_nothing_behind(own_folder, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(cache.os, "replace", full)
    with pytest.warns(RuntimeWarning, match="compiled code not kept on disk .*No space left"):
        assert keep(0.5625) == 0.5625
    assert not list(own_folder.iterdir())


def test_a_folder_that_cannot_be_made_is_done_without(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("SMCAERO_CACHE_DIR", str(tmp_path / "file" / "loops"))
    monkeypatch.setattr(cache, "_said", set())
    with pytest.warns(RuntimeWarning,
                      match="no folder for compiled code .*; it is compiled anew in every process"):
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


# ---- processes -----------------------------------------------------------------------------------
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
    names = [e.data["dispatcher"].py_func.__name__ for _, e in recorder.buffer if e.is_start]
    made = names.count("run")
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


def test_an_edit_in_another_process_recompiles_and_going_back_does_not(new_python, tmp_path,
                                                                       own_folder):
    base = write(tmp_path / "base")
    folders = {what: write(tmp_path / what.replace(" ", "_").replace("'", ""), *edit)
               for what, edit in EDITS.items()}

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


@pytest.mark.parametrize(("file", "compiles_anew"), [
    ("records.py", False), ("interop.py", False), ("core/signal.py", True),
    ("core/cache.py", True)])
def test_editing_the_reader_of_files_keeps_every_compiled_loop_on_disk(
        new_python, tmp_path, file, compiles_anew):
    kit = tmp_path / "smcaero_nb"
    shutil.copytree(pathlib.Path(smc.__file__).parent, kit,
                    ignore=shutil.ignore_patterns("__pycache__", "ui"))
    program = f"""
import sys
sys.path.insert(0, {str(tmp_path)!r})
from smcaero_nb.core import cache
print(cache.__file__)
print(cache._ENGINE)
"""
    where, before = new_python(program).splitlines()
    assert where == str(kit / "core" / "cache.py")
    with open(kit / file, "a") as f:
        f.write("# edited\n")
    _, after = new_python(program).splitlines()
    assert (after != before) == compiles_anew


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
    # one file, and no half-written ones
    assert [f.suffix for f in own_folder.iterdir()] == [".loop"]
    assert json.loads(new_python(PROGRAM, folder))[str(folder)][2] == 0


# ---- within one process: a cell run again --------------------------------------------------------
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
    "a helper of a helper": ("def deep(s): return {}*s\ndef helper(s): return deep(s)"
                             + LAW("helper(sigma)"), 2.0, 3.0),
    "which helper a name stands for": ("def A(s): return s\ndef B(s): return 2.0*s\na = A\nb = B\n"
                                       "c = {}"
                                       + LAW("a(sigma) + 10.0*b(sigma) + 100.0*c(sigma)"), "A",
                                       "B"),
    "a tuple": ("K = (1.0, {})" + LAW("K[1]*sigma"), 2.0, 3.0),
    "an array": ("import numpy as np\nK = np.array([1.0, {}])" + LAW("K[1]*sigma"), 2.0, 3.0),
    "a parameter of a block that helps": (
        "from smcaero_nb.smc1 import quasi_smc\nsoft = quasi_smc.with_(rho={})"
        + LAW("soft(sigma)"), 2.0, 3.0),
    "a constant that a numba function read": (
        "from numba import njit\nK = {}\n@njit\ndef helper(s): return K*s" + LAW("helper(sigma)"),
        2.0, 3.0),
    "an enumeration": ("import enum\nclass Mode(enum.Enum):\n    A = {}"
                       + LAW("Mode.A.value*sigma"), 2.0, 3.0),
    "a closure": ("def make(k):\n    @block\n    def law(sigma): return k*sigma\n    return law\n"
                  "law = make({})", 2.0, 3.0),
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
    assert [value(law) for law in (first, second, again)] == [value(law, False)
                                                              for law in (first, second, again)]
    assert first.content() == again.content() != second.content()
    assert value(first) != value(second) or "type" in what


@pytest.mark.parametrize("wrap", ["", "@njit\n"])
def test_a_constant_that_is_changed_while_the_functions_stay_is_seen(wrap):
    names = cell(f"from numba import njit\nK = 2.0\n{wrap}def helper(s): return K*s"
                 + LAW("K*helper(sigma)"))
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


def test_a_value_of_a_block_used_as_a_helper_that_is_changed_in_place_is_seen():
    gain = block(lambda s, k=2.0: k*s)
    law = block(lambda sigma: gain(sigma))
    plant = block(state=dict(x=1.0))(lambda u: (u,))
    loop = ClosedLoop(plant, law=law, duration=1.0, dt=0.25)
    assert simulate(loop).u[0] == -2.0
    gain.values["k"] = 3.0
    assert simulate(loop).u[0] == simulate(loop, jit=False).u[0] == -3.0


def test_a_loop_with_a_changed_helper_is_compiled_once_and_remembered():
    source = "def helper(s, k={}): return k*s\n@block\ndef law(sigma): return helper(sigma)"
    with event.install_recorder("numba:compile") as recorder:
        seen = [simulate(loop_of(cell(source.format(k))["law"])).u[0]
                for k in (0.75, 0.5, 0.75, 0.5)]
    assert seen == [0.75, 0.5, 0.75, 0.5] and compilations(recorder) == 2


def test_a_comment_or_another_name_of_the_same_thing_changes_nothing():
    a = cell("K = 2.0\n@block\ndef law(sigma): return K*sigma")["law"]
    b = cell("K = 2.0\n\n@block\ndef law(sigma):\n    # twice\n    return K*sigma")["law"]
    assert fingerprint(a.f) == fingerprint(b.f)
    assert (fingerprint(a.f) != fingerprint(cell("K = 2.0\n@block\n"
                                                 "def law(sigma): return K*sigma*1.0")["law"].f))


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
    assert len({repr(c) for c in (plain, with_state(0.0, low=-1.0), with_state(0.0, high=1.0),
                                  with_state(0.0, high=2.0))}) == 4
    assert block(state=dict(other=0.0))(motion).content() != plain
    assert typed(float, 1.0) == typed(Param("k", low=-9.0, high=9.0), 2.0)
    limited = [typed(float, 1.0, Param("v", high=h)) for h in (1.0, 2.0)]
    assert len({repr(c) for c in (typed(float, 1.0), typed(int, 1), typed(bool, True),
                                  *limited)}) == 5
    assert typed(float, 1.0, Param("v", "N", help="words")) == typed(float, 1.0, Param("w"))


@pytest.mark.parametrize("pair", [("1", "1.0"), ("1", "True"), ("0.0", "-0.0"), ("'a'", "b'a'"),
                                  ("(1,)", "(1.0,)")])
def test_constants_that_compare_equal_are_told_apart(pair):
    prints = {fingerprint(cell(f"K = {v}\ndef f(s): return K")["f"]) for v in pair}
    prints |= {fingerprint(cell(f"def g(k={v}): return k\ndef f(s): return g()")["f"])
               for v in pair}
    prints |= {fingerprint(cell(f"def f(s): return {v}")["f"]) for v in pair}
    assert len(prints) == 6


# ---- damage and change ---------------------------------------------------------------------------
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


def changed(data, rng):
    """A file with some kind of damage."""
    data, i = bytearray(data), rng.randrange(len(data))
    kind = rng.choice(["bit", "byte", "cut", "hole", "more", "doubled"])
    if kind == "bit":
        data[i] ^= 1 << rng.randrange(8)
    elif kind == "byte":
        data[i] = (data[i] + rng.randrange(1, 256)) % 256
    elif kind == "cut":
        del data[i:]
    elif kind == "hole":
        data[i:i + 4096] = bytes(len(data[i:i + 4096]))
        data[i] ^= 255
    elif kind == "more":
        data[i:i] = rng.randbytes(rng.randrange(1, 100))
    return bytes(data*2 if kind == "doubled" else data)


#: Reads as many damaged files of a loop as there are; says u(0) of each, and how many warnings
#: there were.
DAMAGED = """
import pathlib, sys, warnings
sys.path.insert(0, sys.argv[1])
import mine
from smcaero_nb import simulate
from smcaero_nb.core import build, cache

path, whole = pathlib.Path(sys.argv[2]), None
warnings.simplefilter("always")
seen, said = set(), 0
for damaged in sorted(pathlib.Path(sys.argv[3]).iterdir()):
    path.write_bytes(damaged.read_bytes())
    try:
        cache._unsealed(path)
    except ValueError:
        said += 1
path.write_bytes(damaged.read_bytes())
build._made.clear()
cache._said.clear()
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    print(simulate(mine.loop).u[0], said, len(caught))
"""


def test_two_hundred_damaged_files_crash_nothing_and_change_no_number(new_python, tmp_path,
                                                                      own_folder):
    folder = write(tmp_path / "base")
    new_python(PROGRAM, folder)
    path, = own_folder.iterdir()
    whole, rng = path.read_bytes(), random.Random(1)
    (tmp_path / "damaged").mkdir()
    for i in range(200):
        (tmp_path / "damaged" / f"{i}").write_bytes(changed(whole, rng))
    said = new_python(DAMAGED, folder, path, tmp_path / "damaged").split()
    assert said == ["2.0", "200", "1"]
    assert path.read_bytes()[32:36] == whole[32:36]  # mended


def test_the_file_of_another_loop_is_not_loaded(own_folder):
    keep(0.25)
    first, = own_folder.iterdir()
    keep(0.125)
    second, = {*own_folder.iterdir()} - {first}
    second.write_bytes(first.read_bytes())
    with pytest.warns(RuntimeWarning, match="is damaged.*; compiling again"):
        assert keep(0.125) == 0.125


@posix
@pytest.mark.parametrize("how", ["another user's", "others may write", "a link", "a pipe"])
def test_a_file_that_somebody_else_may_have_put_there_is_not_read(own_folder, monkeypatch, how):
    assert keep(0.71875) == 0.71875
    path, = own_folder.iterdir()
    whole = path.read_bytes()
    if how == "others may write":
        path.chmod(0o666)
    elif how == "a link":
        path.rename(own_folder.parent / "target")
        path.symlink_to(own_folder.parent / "target")
    elif how == "a pipe":
        path.unlink()
        os.mkfifo(path)
    else:
        fstat = os.fstat
        monkeypatch.setattr(cache.os, "fstat", lambda fd: os.stat_result(
            [os.getuid() + 1 if i == stat.ST_UID else v for i, v in enumerate(fstat(fd))]))
    monkeypatch.setattr(cache.pickle, "loads", lambda _: pytest.fail("it was unpickled"))
    with pytest.warns(RuntimeWarning, match="compiled code not read from disk .*; compiling again"):
        assert keep(0.71875) == 0.71875
    # replaced by one of this user
    assert not path.is_symlink() and len(path.read_bytes()) > len(whole)//2


def test_an_entry_of_the_old_format_is_never_loaded(own_folder, tmp_path):
    """They stood in the directory itself, without a checksum, and could hold addresses."""
    path = cache._Disk("times 0.40625").path
    sig, seen = (float64,), []
    f = kept(njit(lambda x: 0.40625*x), "times 0.40625")
    f._cache.path = lambda *a: seen.append(path(*a)) or seen[0]
    f.compile(sig)
    old = own_folder.parent / seen[0].name
    old.write_bytes(cache.pickle.dumps("planted"))
    seen[0].unlink()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert keep(0.40625) == 0.40625
    assert (cache.pickle.loads(old.read_bytes()) == "planted"
            and str(cache._FORMAT) in own_folder.name)


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
late = {"plotly", "ipywidgets", "anywidget", "IPython", "matplotlib", "control"}
print(sorted(late & {*sys.modules}))
""")
    assert said.strip() == "[]"



# ---- what blocks refer to ------------------------------------------------------------------------
#: Ways to have a table, all with the same numbers: the code that makes `d` of the contiguous
#: `whole`.
TABLES = {
    "contiguous": "d = whole",
    "a column of a file": "t, d = np.loadtxt([f'0,{q!r}' for q in whole.tolist()], delimiter=',', "
                          "unpack=True)",
    "a column": "d = np.column_stack([0*whole, whole])[:, 1]",
    "backwards": "d = whole[::-1].copy()[::-1]",
    "every second": "d = np.repeat(whole, 2)[::2]",
    "a field of records": "d = np.rec.fromarrays([whole.astype('i1'), whole], names='a,d')['d']",
    "single precision": "d = np.repeat(whole.astype('f4'), 3)[::3]",
    "whole numbers": "d = np.repeat(whole.astype('i8'), 3)[::3]",
    "small whole numbers": "d = np.column_stack([whole.astype('u1')]*2)[:, 0]",
    "two dimensions": "d2 = np.asfortranarray(np.stack([whole]*2)).T; d = d2",
    "above 1 MB": "d = np.tile(whole, 300)",
    "above 1 MB, a column": "d = np.column_stack([np.tile(whole, 300)]*2)[:, 1]",
    "read only": "d = np.broadcast_to(whole, (1, 1000))[0]; d.flags.writeable = False",
    "in a tuple": "d = (1.0, np.column_stack([whole, whole])[:, 0])",
    "a default of a helper": "d = np.column_stack([whole, whole])[:, 0]",
}
#: How each is read at the row k, where not as d[k].
READ = {"in a tuple": "d[1][k]", "two dimensions": "d[k, 1]", "a default of a helper": "helper(k)"}
ALL_TABLES = """
import json, sys
import numpy as np
import smcaero_nb as smc

whole, said = np.floor(100.0 + 100.0*np.sin(np.arange(1000)*0.1)), {}
@smc.block(state=dict(x=1.0))
def plant(x, d):
    return (d - x[0],)
for what, (make, read) in json.loads(sys.argv[1]).items():
    names = {"np": np, "smc": smc, "whole": whole}
    exec(f'''{make}
def helper(k, q=d):
    return q[k]
@smc.block
def gust(t):
    k = min(int(t*100.0), 999)
    return 1.0*{read}''', names)
    loop = smc.ClosedLoop(plant, perturbation=names["gust"], duration=5.0, dt=1e-2)
    said[what] = float(smc.simulate(loop).x.x[-1])
print(json.dumps(said))
"""


def test_a_table_gives_the_same_number_in_five_processes(new_python, own_folder):
    given = json.dumps({what: (make, READ.get(what, "d[k]")) for what, make in TABLES.items()})
    said = [json.loads(new_python(ALL_TABLES, given, PYTHONWARNINGS="ignore")) for _ in range(5)]
    expected = 1.0
    for k in range(500):
        expected += 0.01*(math.floor(100.0 + 100.0*math.sin(int(k*0.01*100.0)*0.1)) - expected)
    assert said[0] == pytest.approx(dict.fromkeys(TABLES, expected), rel=1e-12)
    assert all(q == said[0] for q in said[1:])


def test_a_large_table_is_said_to_cost_a_compilation_in_every_process(own_folder):
    table = np.arange(200_000.0)
    law = cell("@block\ndef law(sigma): return sigma + 0.0*table[3]", table=table)["law"]
    with pytest.warns(RuntimeWarning, match="above 1 MB, .*compiled anew in every process"):
        simulate(loop_of(law))
    assert not list(own_folder.glob("*.loop"))


@pytest.mark.parametrize("size", [1000, 200_000])
def test_a_table_that_changes_in_place_is_never_read_in_place_of_its_copy(size):
    table = np.ones(size)
    law = cell("@block\ndef law(sigma): return table[3]*sigma", table=table)["law"]
    seen = [value(law)]
    table *= 2.0
    seen.append(value(law))
    law.f.__globals__["table"] = np.ones(size)  # the cell that loads it is run again
    assert [*seen, value(law)] == [1.0, 2.0, 1.0]


STALE = {
    "a table in a default of a helper": (
        "import numpy as np\nT = np.zeros(5000); T[2500] = {}\ndef helper(s, q=T): return q[2500]*s"
        + LAW("helper(sigma)"), 2.0, 3.0),
    "the names in a named tuple": (
        "from collections import namedtuple\nK = namedtuple('K', '{}')(2.0, 3.0)"
        + LAW("K.a*sigma"), "a b", "b a"),
    "a function of a C library": (
        "import ctypes, ctypes.util\nf = ctypes.CDLL(ctypes.util.find_library('m')).{}\n"
        "f.argtypes = [ctypes.c_double]\n"
        "f.restype = ctypes.c_double" + LAW("f(sigma)"), "cos", "exp"),
}


@pytest.mark.parametrize("what", STALE)
def test_what_looks_alike_is_told_apart(what):
    source, *values = STALE[what]
    laws = [cell(source.format(v))["law"] for v in values]
    assert [value(law) for law in laws] == [value(law, False) for law in laws]
    assert value(laws[0]) != value(laws[1])


def test_loops_in_memory_are_bounded(own_folder, monkeypatch):
    monkeypatch.setattr(smc.core.build, "LOOPS", 3)
    monkeypatch.setattr(cache, "_FUNCTIONS", 5)
    source = "def helper(s): return {}*s" + LAW("helper(sigma)")
    seen = [simulate(loop_of(cell(source.format(k))["law"])).u[0]
            for k in (0.75, 0.5, 0.25, 0.125, 0.75)]
    assert seen == [0.75, 0.5, 0.25, 0.125, 0.75]
    assert len(smc.core.build._made) == 3 and len(cache._compiled) <= 5
