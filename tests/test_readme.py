"""The code in README and CONTRIBUTING runs, and their links lead somewhere."""

import inspect
import os
import pathlib
import re
import shutil
import subprocess
import sys
import textwrap

import pytest

import smcaero_nb as smc

ROOT = pathlib.Path(__file__).parents[1]
README = (ROOT/"README.md").read_text(encoding="utf-8")
CONTRIBUTING = (ROOT/"CONTRIBUTING.md").read_text(encoding="utf-8")


def code(text):
    """The Python blocks of a text."""
    found = re.findall(r"^( *)```python\n(.*?)^ *```", text, re.M | re.S)
    return [textwrap.dedent(block) for _, block in found]


BLOCKS = code(README)
LAW, THEOREM, PLANT, STAGE, NOTEBOOK = code(CONTRIBUTING)


def run(text, where, **names):
    """Run a block of a text, and the tests in it."""
    names = {"__name__": "contributing", **names}
    exec(compile(text, where, "exec"), names)
    for name, test in [*names.items()]:
        if name.startswith("test_"):
            test()
    return names


def test_the_example_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    exec(compile(BLOCKS[0], "README, In code", "exec"), {"__name__": "readme"})
    said = capsys.readouterr().out
    assert said.count("J_e") == 2 and "None" in said
    assert (tmp_path/"runs.html").stat().st_size > 100_000


def test_own_plant_and_law_run_compiled_and_plain_alike(capsys):
    exec(compile(BLOCKS[1], "README, Your own plant", "exec"), {"__name__": "readme"})
    compiled, plain = capsys.readouterr().out.strip().split("\n")
    assert compiled == plain and "diverged" not in compiled


def test_the_law_of_contributing_is_a_law_of_the_kit(monkeypatch):
    names = run(LAW, "CONTRIBUTING, A law", __name__="smcaero_nb.smc1.proportional",
                __package__="smcaero_nb.smc1")
    law = names["proportional_smc"]
    monkeypatch.setattr(smc.smc1, "proportional_smc", law, raising=False)
    run(THEOREM, "CONTRIBUTING, A law, its test")
    smc.ui.mask(law)
    doc = inspect.cleandoc(law.__doc__)
    assert all(f"\n{title}\n---" in doc for title in ("Parameters", "Returns", "References"))
    for name, meta in law.params.items():
        assert f"\n{name} : float\n" in doc and meta.symbol and meta.unit and meta.help


def test_a_new_law_takes_three_files_and_sixty_lines_and_is_in_the_catalogue(tmp_path):
    """CONTRIBUTING.md is followed to the letter in a copy of the kit, and the new tests pass."""
    for name in "smcaero_nb", "tests/test_smc1.py", "tests/chain.py":
        copy = shutil.copytree if (ROOT/name).is_dir() else shutil.copy
        (tmp_path/name).parent.mkdir(exist_ok=True)
        copy(ROOT/name, tmp_path/name)
    [literal] = re.findall(r"`(proportional_smc: .*?)`", CONTRIBUTING)
    added = {
        "smcaero_nb/smc1/proportional.py": [("", LAW)],
        "smcaero_nb/smc1/__init__.py": [
            ("from .relay", "from .proportional import proportional_smc\n"),
            ('"quasi_smc", ', '"proportional_smc", ')],
        "tests/test_smc1.py": [
            ("    adaptive_smc,\n", "    proportional_smc,\n"),
            ("sign_smc, quasi_smc, saturation_smc, tanh_smc", "proportional_smc, "),
            ("    sign_smc: (", f"    {literal},\n"),
            ("# ---- exact reaching times", THEOREM)]}
    for name, pieces in added.items():
        text = (tmp_path/name).read_text() if (tmp_path/name).exists() else ""
        for before, piece in pieces:
            assert before in text
            text = text.replace(before, piece + before, 1)
        (tmp_path/name).write_text(text)
    lines = [q for pieces in added.values() for _, piece in pieces for q in piece.split("\n")
             if q.strip()]
    assert len(added) <= 3 and len(lines) <= 60
    env = os.environ | {"PYTHONPATH": str(tmp_path), "SMCAERO_CACHE_DIR": str(tmp_path)}
    listed = ("import smcaero_nb as smc; law = smc.catalogue()['smc1.proportional_smc']; "
              "smc.ui.mask(law); print(law.card.needs, smc.cite(law), sep='; ')")
    said = subprocess.run([sys.executable, "-c", listed], env=env, cwd=tmp_path, text=True,
                          capture_output=True, check=True).stdout
    assert "W. Gao and J. C. Hung (1993)" in said and said.split(";")[0]
    tests = [sys.executable, "-m", "pytest", "-q", "-k", "proportional", "tests/test_smc1.py"]
    said = subprocess.run(tests, env=env, cwd=tmp_path, text=True, capture_output=True).stdout
    assert re.search(r"^[4-9] passed", said.split("\n")[-2]), said


@pytest.mark.parametrize(("text", "where"), [(PLANT, "A plant"), (STAGE, "A stage"),
                                             (NOTEBOOK, "A notebook")])
def test_the_other_examples_of_contributing_run(text, where):
    run(text, f"CONTRIBUTING, {where}")


def test_contributing_names_files_that_exist():
    new = {"smcaero_nb/smc1/proportional.py", "smcaero_nb/applications/tank.py",
           "notebooks/NN_name.ipynb"}
    for name in {*re.findall(r"`([\w/]+\.(?:py|md|toml|txt|yml|cff|ipynb))`", CONTRIBUTING)} - new:
        assert (ROOT/name).is_file(), name


@pytest.mark.parametrize("text", [README, CONTRIBUTING], ids=["README", "CONTRIBUTING"])
def test_links_and_names_exist(text):
    for target in re.findall(r"\]\(([^)#:]+)(?:#[\w-]+)?\)", text):
        assert (ROOT/target).is_file(), target
    for notebook in set(re.findall(r"`(\d\d_\w+)`", text)):
        assert (ROOT/"notebooks"/f"{notebook}.ipynb").is_file(), notebook
    makefile = (ROOT/"Makefile").read_text(encoding="utf-8")
    for goal in set(re.findall(r"make ([a-z-]+)(?= |`)", text)):
        assert re.search(rf"^{goal}:", makefile, re.M), goal
