"""What a newcomer meets first: the Makefile's words when Python does not fit, and the list of exact versions."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from importlib.metadata import requires, version
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
PINS = dict(line.split("==") for line in (ROOT / "constraints.txt").read_text().splitlines() if "==" in line)
PINS = {canonicalize_name(name): version for name, version in PINS.items()}
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
ASKED = [
    Requirement(need)
    for needs in (PROJECT["dependencies"], *PROJECT["optional-dependencies"].values())
    for need in needs
]
needs_make = pytest.mark.skipif(not shutil.which("make"), reason="no make here")
either_environment = pytest.mark.parametrize(
    "goal, venv, versions",
    [("test", ".venv", "constraints.txt"), ("test-oldest", ".venv-oldest", "tests/floors.py")],
)


@pytest.fixture
def kit(tmp_path):
    """A copy of the files that the set-up reads, in a folder with a space in its name."""
    folder = tmp_path / "a kit"
    (folder / "tests").mkdir(parents=True)
    for name in "Makefile", "pyproject.toml", "constraints.txt", "tests/floors.py":
        shutil.copy(ROOT / name, folder / name)
    return folder


def make(folder, *args, **env):
    left_out = {"MAKEFLAGS", "MAKELEVEL", "MAKEOVERRIDES", "MFLAGS", "PYTHON", "ARGS"}
    env = {k: v for k, v in os.environ.items() if k not in left_out} | {"LC_ALL": "C"} | env
    return subprocess.run([shutil.which("make"), *args], cwd=folder, env=env, capture_output=True, text=True)


def fake_python(path, change):
    """An interpreter that differs from this one by `change`, a statement run before what it is asked to run."""
    path.write_text(f"""#!/bin/sh\nexec "{sys.executable}" -c 'import sys; {change}; exec(sys.argv[2])' "$@"\n""")
    path.chmod(0o755)
    return path


def ready(folder, made_in=None, venv=".venv"):
    """Pretend that the set-up was done, in this folder unless told."""
    bin = folder / venv / "bin"
    bin.mkdir(parents=True)
    (bin / "python").symlink_to(sys.executable)
    (folder / venv / ".ready").write_text(f"{(made_in or folder).resolve()}\npython3\n")


@needs_make
@pytest.mark.parametrize(
    "change, says",
    [
        ("sys.version_info = (3, 9, 18)", r"is Python 3\.9, but the kit needs 3\.11 or newer"),
        ('sys.modules["ensurepip"] = None', r"lacks the venv module: install it \(Debian: .*python3\.\d+-venv\)"),
        ('sys.modules["venv"] = None', r"lacks the venv module"),
        ("sys.exit(1)", r"does not run: install Python 3\.11 or newer"),
    ],
)
def test_a_python_that_does_not_fit_gets_one_sentence(kit, change, says):
    python = fake_python(kit / "python3", change)
    for way in ({"PYTHON": str(python)}, {"PATH": f"{kit}:{os.environ['PATH']}"}):
        done = make(kit, "test", **way)
        assert done.returncode != 0
        assert done.stdout == ""
        assert re.fullmatch(rf"Makefile:\d+: \*\*\* .*{says}.*  Stop\.\n", done.stderr), done.stderr
        assert not (kit / ".venv").exists()


@needs_make
def test_no_python_at_all_gets_one_sentence(kit, tmp_path):
    tools = tmp_path / "tools"
    tools.mkdir()
    for name in "sh", "sed", "cat", "id":
        (tools / name).symlink_to(shutil.which(name))
    done = make(kit, "lab", PATH=str(tools))
    assert done.returncode != 0
    assert re.fullmatch(r"Makefile:\d+: \*\*\* python3 does not run: install .*  Stop\.\n", done.stderr), done.stderr


@needs_make
@either_environment
def test_a_failed_install_says_so_and_does_not_count_as_done(kit, goal, venv, versions):
    no_packages = {"PIP_NO_INDEX": "1", "PIP_FIND_LINKS": "", "PIP_CONFIG_FILE": os.devnull}
    done = make(kit, goal, PYTHON=sys.executable, **no_packages)
    assert done.returncode != 0
    assert done.stdout.splitlines()[0].startswith(f"Setting up {venv} with Python 3.")
    assert "could not be installed" in done.stdout.splitlines()[-1]
    assert "Traceback" not in done.stdout + done.stderr
    assert (kit / venv).exists() and not (kit / venv / ".ready").exists()


@needs_make
@either_environment
def test_set_up_is_done_once_and_again_when_something_changed(kit, goal, venv, versions):
    ready(kit, venv=venv)
    assert "Setting up" not in (out := make(kit, "-n", goal).stdout) and "Updating" not in out
    assert f"{venv}/bin/python -m pytest" in out
    assert f"Setting up {venv} " in make(kit, "-n", goal, f"PYTHON={sys.executable}").stdout
    for changed in "pyproject.toml", versions:
        os.utime(kit / changed, (2**32 - 1,) * 2)
        assert f"Updating {venv} " in make(kit, "-n", goal).stdout
        os.utime(kit / changed, (0, 0))


@needs_make
@either_environment
def test_a_folder_that_was_moved_is_set_up_anew(kit, goal, venv, versions):
    ready(kit, made_in=kit.parent, venv=venv)
    assert f"Setting up {venv} " in make(kit, "-n", goal).stdout


@needs_make
def test_the_two_environments_leave_each_other_alone(kit):
    ready(kit)
    oldest = make(kit, "-n", "test-oldest").stdout
    assert "Setting up .venv-oldest " in oldest and ".venv/" not in oldest
    ready(kit, venv=".venv-oldest")
    assert ".venv-oldest" not in make(kit, "-n", "test").stdout


@needs_make
def test_clean_removes_what_was_set_up(kit):
    for venv in ".venv", ".venv-oldest":
        ready(kit, venv=venv)
    assert make(kit, "clean").returncode == 0
    assert sorted(path.name for path in kit.iterdir()) == [
        "Makefile", "constraints.txt", "pyproject.toml", "tests"
    ]


@needs_make
def test_lab_passes_arguments_on(kit):
    ready(kit)
    out = make(kit, "-n", "lab", "ARGS=--no-browser --port=8899").stdout
    assert "notebooks/00_start_here.ipynb" in out and "--no-browser --port=8899" in out
    assert ("--allow-root" in out) == (os.getuid() == 0)


@needs_make
def test_browser_test_without_chromium_says_what_is_missing(kit):
    ready(kit)
    done = make(kit, "browser-test", "CHROMIUM=")
    assert done.returncode != 0
    assert re.fullmatch(r"Makefile:\d+: \*\*\* No Chromium was found: install it .*  Stop\.\n", done.stderr)


def test_exact_versions_hold_nothing_else():
    for line in (ROOT / "constraints.txt").read_text().splitlines():
        assert re.fullmatch(r"[A-Za-z0-9._-]+==[0-9][0-9A-Za-z.]*", line)


def test_all_that_is_asked_for_has_a_floor_and_nothing_else():
    for need in ASKED:
        assert re.fullmatch(r">=\d+\.\d+(\.\d+)?", str(need.specifier)), need
        assert not need.marker and not need.extras, need


def test_the_oldest_environment_is_held_at_the_floors():
    command = [sys.executable, ROOT / "tests/floors.py"]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    pins = dict(line.split("==") for line in printed.splitlines())
    assert pins == {need.name: str(need.specifier).removeprefix(">=") for need in ASKED}


@needs_make
def test_the_oldest_environment_is_installed_with_these_pins(kit):
    out = make(kit, "-n", "test-oldest").stdout
    install = re.search(r"-m pip install .*?-c (\S+)", out, re.S)
    assert f"tests/floors.py >{install[1]}\n" in out


def test_exact_versions_suit_what_is_asked_for():
    for need in ASKED:
        assert need.specifier.contains(PINS[canonicalize_name(need.name)]), need


@pytest.mark.skipif(sys.platform != "linux", reason="made on Linux; other systems need a few more")
def test_exact_versions_cover_all_that_is_installed():
    if any(version(name) != PINS[name] for name in ("numba", "jupyterlab", "pytest")):
        pytest.skip("installed without the list")
    todo, seen = [("smcaero_nb", "lab"), ("smcaero_nb", "test")], set()
    while todo:
        name, extra = todo.pop()
        if (name, extra) in seen:
            continue
        seen.add((name, extra))
        for need in map(Requirement, requires(name) or ()):
            if not need.marker or need.marker.evaluate({"extra": extra}):
                assert canonicalize_name(need.name) in PINS, f"{name} needs {need}"
                todo += [(need.name, e) for e in ("", *need.extras)]
    assert len(seen) > 100


def test_no_file_names_a_package_host_or_somebodys_machine():
    git = subprocess.run(["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT, capture_output=True, text=True)
    if git.returncode:
        pytest.skip("not a git checkout")
    hosts = "|".join((r"pypi\.", r"pythonhosted\.", r"anaconda\.", "registry" + r"\.", "/simple/"))
    homes = "|".join(("/ho" + r"me/\w", "/Us" + r"ers/\w", "/ro" + "ot/", re.escape(f"{ROOT}/")))
    for name in git.stdout.splitlines():
        if (ROOT / name).is_file():
            text = (ROOT / name).read_bytes().decode(errors="ignore")
            found = re.search(rf"https?://[^\s\"')]*({hosts})|{homes}", text)
            assert not found, f"{name}: {found[0]}"
