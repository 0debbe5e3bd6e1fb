"""What a screen of 1280 x 800 shows with the file browser open: nothing clipped, mask by plot."""

import pytest

pytestmark = pytest.mark.browser

CELLS = """import smcaero_nb as smc
from typing import Annotated
from smcaero_nb import Param, block

@block
def settled(y, settling_time_of_the_filter=0.1, by=0.0):
    return y[0] + by, y[1]

@block(state=dict(q=((1.0, 0.0, 0.0, 0.0), Param("q"))))
def turning(x, u, d, J: Annotated[tuple, Param("J", "kg m^2", low=0.0)] =
            ((2.0, 0.0, 0.0), (0.0, 3.0, 0.0), (0.0, 0.0, 4.0))):
    return (0.0, 0.0, 0.0, -J[0][0]*u*x[0][0]),

@block
def pitch(x):
    return x[0][3], 0.0

own = smc.ClosedLoop(turning, output=pitch, law=smc.block(lambda e, k=1.0: k*e[0]),
                     sensor=smc.chain(first=settled, second=settled.with_(by=0.01)),
                     duration=5.0, dt=1e-3)
lander = smc.ui.live(smc.rpl.loop())
lander""", "odd = smc.ui.live(own)\nodd"
PLACES = """() => [...document.querySelectorAll('.smcaero-live')].map(live => {
    const box = q => live.querySelector(q).getBoundingClientRect();
    const [mask, plot, row] = ['.smcaero-mask', '.smcaero-plot', '.smcaero-row'].map(box);
    return { apart: plot.left - mask.right, high: plot.top - row.bottom,
             wide: plot.width, over: live.scrollWidth - live.clientWidth } })"""
# labels and entries of rows that do not show all of their text, or lie beyond their mask
CUT = """() => [...document.querySelectorAll('.smcaero-mask')].flatMap(mask => {
    const right = mask.getBoundingClientRect().right;
    return [...mask.querySelectorAll(
            '.smcaero-row .widget-label, .smcaero-row input, .smcaero-fold')]
        .filter(e => e.getClientRects().length && (e.scrollWidth > e.clientWidth + 1
                 || e.scrollHeight > e.clientHeight + 2 || e.getBoundingClientRect().right > right))
        .map(e => e.textContent || e.value) })"""


@pytest.fixture(scope="module")
def nb(notebook):
    page = notebook(*CELLS)
    page.page.set_viewport_size(dict(width=1280, height=800))
    assert page.run() == []
    page.page.wait_for_function("() => [...document.querySelectorAll('.smcaero-live')].length === 2"
                                " && [...document.querySelectorAll('.smcaero-live')]"
                                ".every(q => q.querySelector('.js-line'))")
    yield page
    assert page.errors == []


def test_mask_and_plot_are_side_by_side(nb):
    assert nb.page.locator(".jp-DirListing").is_visible()
    for place in nb.page.evaluate(PLACES):
        assert place["apart"] >= 0 and place["high"] < 0 and place["wide"] >= 380
        assert place["over"] <= 0


def test_no_label_and_no_entry_is_clipped(nb):
    folds = nb.page.locator(".smcaero-fold")
    for i in range(folds.count()):
        if folds.nth(i).get_attribute("aria-expanded") == "false":
            folds.nth(i).press("Enter")
    nb.page.locator(".smcaero-entries.smcaero-set-plant__J").wait_for()
    nb.page.wait_for_timeout(500)
    nb.page.locator(".smcaero-entries").first.scroll_into_view_if_needed()
    assert nb.page.evaluate(CUT) == []
    said = nb.page.locator(".smcaero-set-sensor__first__settling_time_of_the_filter .widget-label")
    assert said.first.text_content() == "settling_time_of_the_filter"


def test_an_entry_of_a_matrix_sets_it_or_says_why_not(nb):
    live = nb.page.locator(".smcaero-live").nth(1)
    entry = live.locator(".smcaero-set-plant__J-0-0 input")
    assert entry.get_attribute("aria-label") == "plant J 1, 1 kg m^2"
    entry.fill("much")
    entry.press("Enter")
    status = live.locator(".smcaero-status")
    for _ in range(100):
        if "J[0][0] = 'much' is not allowed" in status.text_content():
            break
        nb.page.wait_for_timeout(100)
    assert "It stays at ((2, 0, 0), (0, 3, 0), (0, 0, 4))" in status.text_content()
    nb.page.wait_for_function("() => document.querySelector('.smcaero-set-plant__J-0-0 input')"
                              ".ariaInvalid === 'true'")
    assert live.locator(".smcaero-set-plant__J-0-1 input").get_attribute("aria-invalid") == "false"
    entry.fill("5")
    entry.press("Enter")
    nb.page.wait_for_function("() => document.querySelectorAll('.smcaero-status')[1].textContent"
                              " === ''")
    assert nb.ask("print(odd.loop.stages['plant'].values['J'][0])") == "(5.0, 0.0, 0.0)"


def test_method_and_latency_are_set_in_the_page(nb):
    live = nb.page.locator(".smcaero-live").nth(1)
    live.locator(".smcaero-set-method select").select_option("rk4")
    handle = live.locator(".smcaero-set-latency [role=slider]")
    handle.focus()
    handle.press("ArrowRight")
    nb.page.wait_for_function("""() => [...document.querySelectorAll(
        '.smcaero-set-latency input[type=text]')].some(q => q.value === '0.001')""")
    nb.ask("odd.wait()")
    assert nb.ask("print(odd.mask.method, odd.loop.latency, odd.status)") == "rk4 0.001"
