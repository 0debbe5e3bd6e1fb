"""The README's code runs, and its links lead somewhere."""

import pathlib
import re

ROOT = pathlib.Path(__file__).parents[1]
README = (ROOT/"README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", README, re.S)


def test_the_example_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    exec(compile(BLOCKS[0], "README, In code", "exec"), {"__name__": "readme"})
    said = capsys.readouterr().out
    assert said.count("J_e") == 2 and "None" in said
    assert (tmp_path/"runs.html").stat().st_size > 100_000


def test_own_plant_and_law_run_compiled_and_plain_alike(capsys):
    exec(compile(BLOCKS[1], "README, An own plant", "exec"), {"__name__": "readme"})
    compiled, plain = capsys.readouterr().out.strip().split("\n")
    assert compiled == plain and "diverged" not in compiled


def test_links_and_names_exist():
    for target in re.findall(r"\]\(([^)#:]+)\)", README):
        assert (ROOT/target).is_file(), target
    for notebook in set(re.findall(r"`(\d\d_\w+)`", README)):
        assert (ROOT/"notebooks"/f"{notebook}.ipynb").is_file(), notebook
    makefile = (ROOT/"Makefile").read_text(encoding="utf-8")
    for goal in set(re.findall(r"make ([a-z-]+)(?= |`)", README)):
        assert re.search(rf"^{goal}:", makefile, re.M), goal
