"""Every notebook runs from top to bottom in JupyterLab, and its live plots are drawn."""

import pytest
from labserver import ROOT

pytestmark = pytest.mark.browser
NOTEBOOKS = sorted(p.relative_to(ROOT).as_posix() for p in (ROOT / "notebooks").glob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS)
def test_runs_without_an_error(notebook, path):
    nb = notebook(path)
    assert nb.run() == []
    for view in ("smcaero-live", "smcaero-mask"):
        for i in range(nb.page.locator(f".{view}").count()):
            nb.page.locator(f".{view}").nth(i).wait_for()
    nb.page.wait_for_function("() => [...document.querySelectorAll('.smcaero-live')].every(l => l.querySelector('.js-line'))")
    assert nb.errors == []
    nb.close()


def test_there_are_notebooks():
    assert {"notebooks/00_start_here.ipynb", "notebooks/07_launch_vehicle.ipynb"} <= set(NOTEBOOKS)
