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
    if nb.page.locator(".smcaero-live").count():
        mask_drives_the_plot(nb)
        nonsense_is_answered(nb)
    for study in nb.page.locator(".smcaero-study").all():
        study.locator(".js-line, .point").first.wait_for()  # drawn, and as wide as its cell
        plot, cell = (study.locator(f".{q}").first.bounding_box() for q in ("main-svg", "smcaero-plot"))
        assert abs(plot["width"] - cell["width"]) < 3 and plot["height"] <= cell["height"] + 3
    assert nb.errors == []
    nb.close()


DATA = """live => { const curves = live.querySelector('.js-plotly-plot').data;
                    return Object.fromEntries(curves.map(c => [c.meta, Array.from(c.y)])) }"""
CHANGED = """before => { const curves = document.querySelector('.smcaero-live .js-plotly-plot').data;
                         return Object.keys(before).filter(k => ['y', 'sigma', 'u', 'phase'].includes(k)).every(k =>
                           curves.find(c => c.meta === k).y.some((v, i) => v !== before[k][i])) }"""


def mask_drives_the_plot(nb):
    """The first slider of the first mask moves every curve, the phase portrait too."""
    live = nb.page.locator(".smcaero-live").first
    before = live.evaluate(DATA)
    handle = live.locator(".smcaero-row [role=slider]").first
    handle.scroll_into_view_if_needed()
    handle.focus()
    for _ in range(3):
        handle.press("ArrowRight")
    nb.page.wait_for_function(CHANGED, arg=before)


def nonsense_is_answered(nb):
    live = nb.page.locator(".smcaero-live").first
    entry = live.locator(".smcaero-row input[type=text]").first
    was = entry.input_value()
    entry.fill("much")
    entry.press("Enter")
    nb.page.wait_for_function("() => document.querySelector('.smcaero-live .smcaero-status').textContent.includes('It stays at')")
    assert f"It stays at {was}" in live.locator(".smcaero-mask .smcaero-status").text_content()
    live.locator(".smcaero-top button").click()


def test_there_are_notebooks():
    assert [n[10:12] for n in NOTEBOOKS] == ["00", "02", "03", "04", "07", "08"]
