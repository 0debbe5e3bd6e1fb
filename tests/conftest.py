"""What all tests share: a cache of compiled loops of the session's own, and runs that several tests
look at."""

import os
import pathlib
import subprocess
import sys

import pytest
from hypothesis import settings

import smcaero_nb as smc

settings.register_profile("kit", deadline=None, derandomize=True, database=None, max_examples=60)
settings.load_profile("kit")


@pytest.fixture(scope="session", autouse=True)
def compiled_loops(tmp_path_factory):
    """Keep the compiled loops of this session apart from the user's, also those of the processes
    that tests start."""
    before = os.environ.get("SMCAERO_CACHE_DIR")
    os.environ["SMCAERO_CACHE_DIR"] = str(tmp_path_factory.mktemp("loops"))
    yield
    if before is None:
        del os.environ["SMCAERO_CACHE_DIR"]
    else:
        os.environ["SMCAERO_CACHE_DIR"] = before


@pytest.fixture
def new_python():
    """Run a program in a new Python process; return what it printed."""
    def run(program, *args, background=False, **env):
        env = {**os.environ, "PYTHONPATH": str(pathlib.Path(smc.__file__).parents[1]), **env}
        command = [sys.executable, "-c", program, *map(str, args)]
        pipes = dict(stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=env)
        if background:
            return subprocess.Popen(command, **pipes)
        done = subprocess.run(command, timeout=120, **pipes)
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run


@pytest.fixture(scope="session")
def runs():
    """Runs of the launch vehicle as documented (30 s, dt = 1e-4 s), each simulated once however
    many tests ask for it."""
    made = {}

    def run(law, preset="recommended", **changes):
        key = law, preset, *changes.items()
        if key not in made:
            made[key] = smc.simulate(smc.lv.loop(law, preset).with_(**changes))
        return made[key]

    return run
