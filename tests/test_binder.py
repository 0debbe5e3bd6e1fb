"""The Binder image: repo2docker finds the folder and renders it as meant; its versions are those of
constraints.txt."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[1]
BINDER = ROOT / "binder"


@pytest.mark.skipif(os.name == "nt", reason="repo2docker does not run on Windows")
def test_repo2docker_renders_it():
    command = [sys.executable, "-m", "repo2docker", "--no-build", "--debug", str(ROOT)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "Building conda environment for python=3.11" in done.stderr
    dockerfile = done.stdout
    assert re.search(r'env update .*--file "binder/environment\.yml"', dockerfile)
    assert "RUN ./binder/postBuild" in dockerfile
    assert 'R2D_ENTRYPOINT="${REPO_DIR}/binder/start"' in dockerfile


@pytest.mark.skipif(os.name == "nt", reason="Windows has no executable bit")
@pytest.mark.parametrize("name", ["postBuild", "start"])
def test_scripts_are_executable_shell(name):
    assert os.access(BINDER / name, os.X_OK)
    assert subprocess.run(["bash", "-n", BINDER / name]).returncode == 0


def test_what_is_compiled_at_build_is_found_at_start():
    cpu = [re.findall(r"^export (NUMBA_.*)", (BINDER / name).read_text(), re.M)
           for name in ("postBuild", "start")]
    assert cpu[0] == cpu[1] != []


def test_versions_are_the_exact_ones():
    *conda, pip = yaml.safe_load((BINDER / "environment.yml").read_text())["dependencies"]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    asked = project["dependencies"] + project["optional-dependencies"]["lab"]
    assert conda == ["python=3.11", "pip"]
    assert [pin.split("==")[0] for pin in pip["pip"]] == [Requirement(need).name for need in asked]
    assert set(pip["pip"]) <= set((ROOT / "constraints.txt").read_text().splitlines())
