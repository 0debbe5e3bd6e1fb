"""`make lab` itself: it serves the start page, and says so when its port is taken."""

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import time
import urllib.error
import urllib.request
from contextlib import contextmanager
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
START = "notebooks/00_start_here.ipynb"
TOKEN = "of-the-test"
pytestmark = [pytest.mark.browser,
              pytest.mark.skipif(not shutil.which("make"), reason="no make here")]


@contextmanager
def make_lab(port, home):
    """Run `make lab` on `port` without the user's Jupyter settings; gives address, output file."""
    env = {k: v for k, v in os.environ.items() if not k.startswith(("MAKE", "MFLAGS", "PYTHON"))}
    env |= {f"JUPYTER_{what}_DIR": str(home / what) for what in ("CONFIG", "RUNTIME", "DATA")}
    output = home / "output"
    args = f"ARGS=--no-browser --port={port} --IdentityProvider.token={TOKEN}"
    with output.open("w") as file:
        lab = subprocess.Popen(["make", "lab", args], cwd=ROOT, env=env, stdin=subprocess.DEVNULL,
                               stdout=file, stderr=subprocess.STDOUT, start_new_session=True)
    try:
        for _ in range(600):
            found = re.search(r"https?://127\.0\.0\.1:\d+", output.read_text())
            if found or lab.poll() is not None:
                break
            time.sleep(0.1)
        assert found, output.read_text()
        for _ in range(300):  # it names its address a moment before it listens there
            try:
                socket.create_connection(("127.0.0.1", int(found[0].rpartition(":")[2])),
                                         timeout=5).close()
                break
            except OSError:
                time.sleep(0.1)
        yield found[0], output
    finally:
        os.killpg(lab.pid, signal.SIGTERM)
        lab.wait(30)


def get(address, token=TOKEN):
    with urllib.request.urlopen(f"{address}?token={token}", timeout=10) as answer:
        return answer.read().decode()


def test_make_lab_serves_the_start_page(tmp_path):
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        port = s.getsockname()[1]
    with make_lab(port, tmp_path) as (address, output):
        assert address.endswith(f":{port}")
        assert f"/lab/tree/{START}?token=" in output.read_text()
        assert "<title>JupyterLab</title>" in get(f"{address}/lab/tree/{START}")
        assert json.loads(get(f"{address}/api/contents/{START}"))["type"] == "notebook"
        with pytest.raises(urllib.error.HTTPError, match="403"):
            get(f"{address}/api/contents/{START}", token="wrong")


def test_a_taken_port_is_said_and_the_next_free_one_used(tmp_path):
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        s.listen()
        port = s.getsockname()[1]
        with make_lab(port, tmp_path) as (address, output):
            assert f"The port {port} is already in use, trying another port." in output.read_text()
            assert not address.endswith(f":{port}")
            assert "<title>JupyterLab</title>" in get(f"{address}/lab/tree/{START}")
