"""Texts of a user's blocks in the page: all are shown as typed, and none runs."""

import re

import pytest

from smcaero_nb.core.param import said

pytestmark = pytest.mark.browser

TEXTS = ("<script>globalThis.hacked=1</script>", '<img src=x onerror="globalThis.hacked=2">',
         "<a href='javascript:globalThis.hacked=3'>a</a>", "N<m>", "&lt;b&gt;", "%", "#", "&", "~",
         "{", "\\", "$x$", r"\(x\)", r"\dot{}", r"\frac{a}", "x_a_b", "x^2^3", "%{y}")
ALL = " ".join(TEXTS)
CELL = f"""import warnings, ipywidgets
import smcaero_nb as smc
from typing import Annotated
from smcaero_nb import ClosedLoop, Param, block
TEXTS, ALL = {TEXTS!r}, {ALL!r}
def param(place):
    symbol, unit, about = (f"{{place}} {{q}} {{ALL}}" for q in ("symbol", "unit", "help"))
    return Param(symbol, unit, help=about)
""" + r"""
@block(state={f"state {ALL}": (0.4, Param("", "N")), "w": (0.0, param("w"))})
def plant(x, u, d):
    return x[1], u + d
@block
def output(x) -> (param("y"), param("dy")):
    return x[0], x[1]
@block
def surface(e, c: Annotated[float, Param("c", "1/s")] = 1.0) -> param("sigma"):
    return e[1] + c*e[0]
def law(sigma, rho: Annotated[float, Param(r"\rho", "kg^2")] = 2.0,
        long: Annotated[float, param("long")] = 1.0, SHORT) -> param("u"):
    return rho*((sigma > 0.0) - (sigma < 0.0))
law.__name__ = f"law {ALL}"
law.__doc__ = f"doc {ALL}\n\n.. math:: a = \\href{{javascript:globalThis.hacked=4}}{{x}}"
loop = ClosedLoop(plant=plant, output=output, surface=surface, law=block(law), name=f"name {ALL}",
                  duration=1.0, dt=0.01, verdict=lambda run: f"verdict {ALL}")
picture = smc.ui.live({f"first {ALL}": loop, "second": loop}, states=(f"state {ALL}",))
picture""".replace("SHORT", ", ".join(
    f"k{i}: Annotated[float, Param(TEXTS[{i}], TEXTS[{i}])] = 1.0" for i in range(len(TEXTS))))
SHOWN = r"""([place, text]) => Array.from(document.querySelectorAll(place)).some(
    e => (e.innerText ?? e.textContent).replace(/\s+/g, ' ').includes(text))"""


@pytest.fixture
def shown(notebook):
    """Open a notebook; gives it and a function that waits until a text is shown in a place."""
    def run(*cells):
        nb = notebook(*cells)
        assert nb.run() == []

        def wait(place, text):
            try:
                nb.page.wait_for_function(SHOWN, arg=[place, text], timeout=20_000)
            except Exception as why:
                there = nb.page.locator(place).all_inner_texts()
                raise AssertionError(f"{place} does not show {text}, but {there}") from why

        opened.append(nb)
        return nb, wait

    opened = []
    yield run
    for nb in opened:
        nb.page.wait_for_timeout(500)
        assert nb.page.evaluate("() => globalThis.hacked") is None
        assert nb.page.locator("mjx-merror, [data-mjx-error], a[href^=javascript]").count() == 0
        assert nb.errors == []


def test_a_mask_and_its_curves_show_texts_as_typed(shown):
    nb, wait = shown(CELL)
    nb.page.wait_for_selector(".smcaero-set-law__rho .widget-label mjx-container")
    assert nb.curve("y")[1] and nb.curve("u")[1]
    nb.page.wait_for_timeout(500)
    for i, text in enumerate(TEXTS):
        wait(f".smcaero-set-law__k{i} .widget-label", f"{text} [{text}]")
    wait(".smcaero-set-law__long .widget-label", f"long symbol {ALL} [long unit {ALL}]")
    help = nb.page.locator(".smcaero-set-law__long [title]").first
    assert help.get_attribute("title") == f"long help {ALL}"
    assert nb.slider("law__long").get_attribute("aria-label") == f"law long long unit {ALL}"
    wait(".smcaero-choice option", f"first {ALL}")
    wait(".smcaero-fold", f"law: law {ALL}".replace("_", " "))
    nb.page.locator(".smcaero-head", has_text="law: law").locator(".smcaero-help").click()
    wait(".smcaero-doc", f"doc {ALL}")
    wait(".smcaero-doc code", r"a = \href{javascript:globalThis.hacked=4}{x}")
    nb.page.locator(".smcaero-fold", has_text="initial state").click()
    wait(".smcaero-mask .widget-label", f"state {ALL}")
    wait(".smcaero-verdict", f"verdict {ALL}")
    wait(".smcaero-metrics", f" u unit {ALL}")
    for place, unit in (("y", "y"), ("dy", "dy"), ("u", "u"), ("sigma", "sigma")):
        wait(".js-plotly-plot text", f"{place} symbol {ALL} [{unit} unit {ALL}]")
    wait(".js-plotly-plot text", f"state {ALL} [N]")
    nb.entry("law__k2").fill(f"typed {ALL}")
    nb.entry("law__k2").press("Enter")
    wait(".smcaero-status", f"law {ALL}: k2 = {said('typed ' + ALL)} is not allowed")


STUDY = """study = smc.ui.compare({f"first {ALL}": loop, f"second {ALL}": loop})
study"""
CALLED = """class Result(smc.differentiators.Trial):
    def __str__(self):
        return f"result {ALL}"
def called(k: Annotated[float, Param("k")] = 0.0):
    warnings.warn(f"remark {ALL}")
    if k:
        raise ValueError(f"error {ALL}")
    return Result(**vars(smc.differentiators.trial()()))
own = smc.ui.live({f"called {ALL}": block(called)})
own"""
UPLOAD = """trial = smc.ui.live(smc.differentiators.trial())
mine = smc.ui.upload(trial, smc.differentiators.read_csv, smc.differentiators.trial)
name, column = f"file {ALL}.csv".replace("/", "."), f"column {ALL}"
for c in ",;[('" + '"':  # they part columns, and columns from units
    column = column.replace(c, ".")
rows = "".join(f"{0.01*i:.2f},{i*i}\\n" for i in range(50))
mine.take(name, f"t,{column}\\n{rows}".encode())
ipywidgets.VBox([trial, mine])"""


def test_a_comparison_shows_texts_as_typed(shown):
    nb, wait = shown(CELL.rpartition("\n")[0], STUDY)
    nb.page.wait_for_selector(".smcaero-table")
    assert nb.curve("y")[1]
    for name in ("first", "second"):
        wait(".smcaero-choices button", f"{name} {ALL}")
        wait(".smcaero-table th", f"{name} {ALL}")
        wait(".js-plotly-plot [class^=legend][class$=text]", f"{name} {ALL}")
    wait(".smcaero-table td", f"sigma unit {ALL}")
    wait(".smcaero-table .smcaero-verdict", f"verdict {ALL}")
    nb.page.evaluate("""async () => { const plot = document.querySelector('.js-plotly-plot');
        const n = plot.data.findIndex(t => t.meta === 'u');
        (await globalThis.smcaeroPlotly).Fx.hover(plot, [{ curveNumber: n, pointNumber: 5 }]) }""")
    wait(".js-plotly-plot .hoverlayer", f"first {ALL}")
    wait(".js-plotly-plot .hoverlayer", f"u symbol {ALL}")


def test_remarks_errors_and_files_show_texts_as_typed(shown):
    nb, wait = shown(CELL.rpartition("\n")[0], CALLED, UPLOAD)
    nb.page.wait_for_selector(".js-plotly-plot .js-line")
    wait(".smcaero-status", f"remark {ALL}.")
    nb.ask("own.set(k=1.0)")
    wait(".smcaero-status", f"ValueError: error {ALL}; ")
    wait(".smcaero-result", f"result {ALL}")
    name, column = f"file {ALL}".replace("/", "."), re.sub(r"[,;[(\"']", ".", f"column {ALL}")
    wait(".smcaero-own .smcaero-status", f"{name}.csv: 50 rows")
    wait(".smcaero-own .smcaero-status", f"f = '{column}'")
    wait(".smcaero-own option", column)
    wait(".smcaero-choice option", f"{name}.csv")
    wait(".smcaero-download", f"Download {name}, estimates.csv")


FAILING = """const made = globalThis.Function;
globalThis.loads = 0;
globalThis.Function = new Proxy(made, { construct(target, given) {
  if (given[0] === 'module' && given[2] === 'define' && ++globalThis.loads === 1)
    throw new Error('the first load fails');
  return new target(...given);
} })"""


def test_plotly_is_loaded_again_where_that_failed(notebook):
    trial = "import smcaero_nb as smc\nsmc.ui.live(smc.differentiators.trial())"
    nb = notebook(trial, script=FAILING)
    assert nb.run() == []
    nb.page.wait_for_function("() => globalThis.loads === 1")
    nb.page.wait_for_timeout(1000)
    assert nb.page.locator(".js-plotly-plot").count() == 0
    for _ in range(2):  # the cell is run again
        assert nb.run() == []
        nb.page.wait_for_selector(".js-plotly-plot .js-line")
    assert nb.page.evaluate("() => globalThis.loads") == 2  # and what was loaded is kept
