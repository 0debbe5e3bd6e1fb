"""What a newcomer meets first: the Makefile's words when Python does not fit, and the list of exact
versions."""

import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from importlib.metadata import requires, version
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import smcaero_nb as smc

ROOT = Path(__file__).parents[1]
PINS = dict(line.split("==") for line in (ROOT / "constraints.txt").read_text().splitlines()
            if "==" in line)
PINS = {canonicalize_name(name): version for name, version in PINS.items()}
PYPROJECT = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
PROJECT = tomllib.loads(PYPROJECT)["project"]
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
    return subprocess.run([shutil.which("make"), *args], cwd=folder, env=env, capture_output=True,
                          text=True)


def fake_python(path, change):
    """An interpreter that differs from this one by `change`, a statement run before what it is
    asked to run."""
    run = f"import sys; {change}; exec(sys.argv[2])"
    path.write_text(f"""#!/bin/sh\nexec "{sys.executable}" -c '{run}' "$@"\n""")
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
        ('sys.modules["ensurepip"] = None',
         r"lacks the venv module: install it \(Debian: .*python3\.\d+-venv\)"),
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
    assert re.fullmatch(r"Makefile:\d+: \*\*\* python3 does not run: install .*  Stop\.\n",
                        done.stderr), done.stderr


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
    assert re.fullmatch(r"Makefile:\d+: \*\*\* No Chromium was found: install it .*  Stop\.\n",
                        done.stderr)


def test_exact_versions_hold_nothing_else():
    for line in (ROOT / "constraints.txt").read_text().splitlines():
        assert re.fullmatch(r"[A-Za-z0-9._-]+==[0-9][0-9A-Za-z.]*", line)


def test_all_that_is_asked_for_has_a_floor_and_nothing_else():
    for need in ASKED:
        assert re.fullmatch(r">=\d+\.\d+(\.\d+)?", str(need.specifier)), need
        assert not need.marker, need


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


@pytest.fixture(scope="module")
def distributions(tmp_path_factory):
    """The names in the sdist, the metadata of the wheel, and the names in it."""
    folder = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "hatchling", "build", "-d", folder]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (sdist,), (wheel,) = folder.glob("*.tar.gz"), folder.glob("*.whl")
    with tarfile.open(sdist) as names, zipfile.ZipFile(wheel) as files:
        (metadata,) = (n for n in files.namelist() if n.endswith("/METADATA"))
        return ({n.partition("/")[2] for n in names.getnames()},
                files.read(metadata).decode(), {*files.namelist()})


def test_the_sdist_holds_what_its_tests_need(distributions):
    sdist, _, _ = distributions
    for name in ("Makefile", "constraints.txt", "CITATION.cff", "CHANGELOG.md", "CONTRIBUTING.md",
                 "binder/start", "tests/published.py", "tests/bench/laws.c", "tests/floors.py",
                 "notebooks/00_start_here.ipynb", "notebooks/images/launch_vehicle.png"):
        assert name in sdist, name


def test_the_wheel_holds_the_library_with_its_scripts_and_styles_alone(distributions):
    _, _, wheel = distributions
    inside = {p.relative_to(ROOT).as_posix() for p in (ROOT / "smcaero_nb").rglob("*")
              if p.is_file() and "__pycache__" not in p.parts}
    assert {n for n in wheel if ".dist-info/" not in n} == inside


def test_the_long_description_shows_no_image_that_only_the_repository_holds(distributions):
    _, metadata, _ = distributions
    assert "# smcaero_nb\n" in metadata and "## Two commands" in metadata
    assert "![" in (ROOT / "README.md").read_text(encoding="utf-8") and "![" not in metadata


def test_what_builds_the_kit_is_among_what_the_tests_install():
    builds = tomllib.loads(PYPROJECT)["build-system"]["requires"]
    assert {*builds} <= {*PROJECT["optional-dependencies"]["test"]}


def test_the_version_has_one_source():
    assert "version" in PROJECT["dynamic"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert citation["version"] == re.search(r"^## (\S+)", changes, re.M)[1] == smc.__version__


def test_a_check_of_the_guide_that_is_not_followed_says_why():
    ignored = re.search(r"\[tool\.repo-review\]\nignore = \[\n(.*?)\]", PYPROJECT, re.S)[1]
    assert ignored.count("\n") == len(tomllib.loads(PYPROJECT)["tool"]["repo-review"]["ignore"])
    for line in ignored.splitlines():
        assert re.fullmatch(r' +"[A-Z]+\d+", +# \S.{10,}', line), line


def test_no_file_names_a_package_host_or_somebodys_machine():
    git = subprocess.run(["git", "ls-files", "-co", "--exclude-standard"], cwd=ROOT,
                         capture_output=True, text=True)
    if git.returncode:
        pytest.skip("not a git checkout")
    hosts = "|".join((r"pypi\.", r"pythonhosted\.", r"anaconda\.", "registry" + r"\.", "/simple/"))
    homes = "|".join(("/ho" + r"me/\w", "/Us" + r"ers/\w", "/ro" + "ot/", re.escape(f"{ROOT}/")))
    for name in git.stdout.splitlines():
        if (ROOT / name).is_file():
            text = (ROOT / name).read_bytes().decode(errors="ignore")
            found = re.search(rf"https?://[^\s\"')]*({hosts})|{homes}", text)
            assert not found, f"{name}: {found[0]}"
