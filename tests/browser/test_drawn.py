"""What pictures show, measured as drawn: zoomed chattering, compared laws, lost runs, words."""

import io

import numpy as np
import pytest
from PIL import Image
from plotly.offline import get_plotlyjs

import smcaero_nb as smc
from smcaero_nb.applications import perturbed_chain

pytestmark = pytest.mark.browser

LIVE = """import smcaero_nb as smc
chain = smc.applications.perturbed_chain
picture = smc.ui.live({"sign": chain(smc.smc1.sign_smc, 1), "quasi": chain(smc.smc1.quasi_smc, 1)})
picture"""
#: Path of a curve as drawn, in points of the panel.
PATH = """key => { const plot = document.querySelector('.js-plotly-plot');
    const n = plot.data.findIndex(t => t.meta === key), { uid } = plot._fullData[n];
    return plot.querySelector(`.scatterlayer .trace${uid} path.js-line`)?.getAttribute('d') }"""
RANGE = "() => document.querySelector('.js-plotly-plot')._fullLayout.xaxis.range"
POINTS = """key => { const plot = document.querySelector('.js-plotly-plot');
    const t = plot.data.find(t => t.meta === key);
    return t && [Array.from(t.x), Array.from(t.y)] }"""


@pytest.fixture(scope="module")
def opened(notebook):
    nb = notebook(LIVE)
    assert nb.run() == []
    nb.curve("u")
    return nb


@pytest.fixture
def nb(opened):
    opened.errors.clear()
    opened.ask("picture.mask.choice.value = 'sign'; picture.mask.reset(); picture.wait()")
    zoom(opened, None)
    while opened.ask("print(picture._picture.view.span)") != "[]":
        opened.page.wait_for_timeout(100)
    points = int(opened.ask("picture.wait(); print(len(picture.curves['u'].x))"))
    opened.page.wait_for_function(f"n => ({POINTS})('u')[0].length === n", arg=points)
    yield opened
    assert opened.errors == []


def zoom(nb, span):
    """Zoom the axis of time to a span, as dragging does; or show all again, as a double click."""
    nb.page.evaluate("""async span => {
        const plot = document.querySelector('.js-plotly-plot');
        await (await smcaeroPlotly).relayout(plot, span
            ? { 'xaxis.range[0]': span[0], 'xaxis.range[1]': span[1] }
            : { 'xaxis.autorange': true }) }""", span and list(span))


def edges(path):
    """(x, y) of the points of a path of straight lines."""
    pairs = path.replace("M", " ").replace("L", " ").split()
    return np.array([[float(v) for v in p.split(",")] for p in pairs])


def test_a_zoomed_relay_has_all_its_reversals_and_upright_edges(nb):
    box = nb.page.locator(".js-plotly-plot .nsewdrag").first.bounding_box()
    for k, act in ((0.1, nb.page.mouse.down), (0.4, nb.page.mouse.up)):  # by hand
        nb.page.mouse.move(box["x"] + k*box["width"], box["y"] + box["height"]/2, steps=5)
        act()
    nb.page.wait_for_function(f"() => Math.abs(({RANGE})()[0] - 2.0) < 0.1")
    zoom(nb, (2.0, 2.2))
    nb.page.wait_for_function(f"() => {{ const [x] = ({POINTS})('u');"
                              " return x.filter(q => q > 2.05 && q < 2.15).length > 100 }")
    x, y = (np.array(q) for q in nb.page.evaluate(POINTS, "u"))
    every = smc.simulate(perturbed_chain(smc.smc1.sign_smc, 1), record=20_000)
    u = every.u[(every.t > 2.0) & (every.t < 2.2)]
    reversals = np.count_nonzero(np.diff(u))
    assert reversals > 100  # of 200 samples
    assert np.count_nonzero(np.diff(y[(x > 2.0) & (x < 2.2)])) == pytest.approx(reversals, abs=1)
    drawn = edges(nb.page.evaluate(PATH, "u"))
    seen = (drawn[:, 0] > 1.0) & (drawn[:, 0] < box["width"] - 1.0)  # more is drawn, but clipped
    drawn = np.diff(drawn[seen], axis=0)
    assert np.all((np.abs(drawn) < 0.02).any(axis=1))  # level or upright, never slanted
    assert np.count_nonzero(np.abs(drawn[:, 1]) > 20.0) == pytest.approx(reversals, abs=2)


def test_all_of_it_is_a_band_with_the_mean(nb):
    _, band = nb.page.evaluate(POINTS, "u.range")
    assert {q for q in band if q is not None and q == q} == {-2.0, 2.0}
    t, u = (np.array(q) for q in nb.page.evaluate(POINTS, "u"))
    assert np.abs(u[t > 1.0]).max() < 1.0  # |xi| <= 0.8


def test_a_zoom_stays_when_a_slider_moves(nb):
    zoom(nb, (2.0, 2.2))
    nb.page.wait_for_timeout(800)
    nb.ask("picture.set(law__rho=3.0)")
    nb.page.wait_for_function(f"() => Math.max(...({POINTS})('u')[1]) === 3")
    x, y = (np.array(q) for q in nb.page.evaluate(POINTS, "u"))
    inside = (x > 2.02) & (x < 2.18)
    assert set(y[inside]) == {-3.0, 3.0} and np.count_nonzero(np.diff(y[inside])) > 80


def test_the_shadow_and_what_is_grey_or_gone(nb):
    before, _ = nb.page.evaluate(POINTS, "sigma")
    nb.ask("picture._rested = 0.0; picture.set(law__rho=3.0)")
    nb.page.wait_for_function(f"() => ({POINTS})('before:sigma')")
    assert nb.page.evaluate(POINTS, "before:sigma")[0] == before
    state = "() => document.querySelector('.smcaero-picture').dataset.state"
    opacity = "() => getComputedStyle(document.querySelector('.smcaero-picture')).opacity"
    assert nb.page.evaluate(state) == "" and nb.page.evaluate(opacity) == "1"
    nb.ask("picture.times['dt'] = 1e-8")  # minutes
    nb.slider("law__rho").press("ArrowRight")
    nb.page.wait_for_function(f"() => ({state})() === 'old'")
    assert float(nb.page.evaluate(opacity)) < 0.6
    nb.page.locator(".smcaero-choice select").select_option("quasi")
    nb.page.locator(".js-plotly-plot").wait_for(state="hidden")
    nb.page.locator(".smcaero-busy button").click()
    nb.said("Cancelled")
    assert not nb.page.locator(".js-plotly-plot").is_visible()
    nb.ask("picture.times['dt'] = None; picture.set(law__rho=2.5)")
    nb.page.locator(".js-plotly-plot").wait_for()
    assert nb.page.evaluate(state) == ""


def test_a_lost_run_ends_where_it_was_lost_before_the_last_good_one(nb):
    nb.ask("picture.set(law__rho=1.0, perturbation__xi_0=400.0)")
    nb.ask("picture.mask.offer('weak', smc.lv.loop('quasi_smc')); picture.wait()")
    nb.page.wait_for_function(f"() => ({POINTS})('dy')")
    good, _ = nb.page.evaluate(POINTS, "y")
    nb.ask("picture.set(law__rho=0.2)")
    assert "those of the last good setting are grey" in nb.said("diverged at")
    assert nb.page.evaluate(POINTS, "y")[0][-1] < 10.0 < good[-1]
    assert nb.page.evaluate(POINTS, "before:y")[0] == good


def test_no_button_shares_a_chart_and_the_picture_is_told_in_words(nb):
    titles = nb.page.locator(".js-plotly-plot .modebar-btn").evaluate_all(
        "q => q.map(b => b.dataset.title || b.getAttribute('aria-label') || '')")
    assert len(titles) > 3 and not any("hare" in q or "loud" in q for q in titles)
    told = nb.page.locator(".js-plotly-plot [role=img]")
    assert told.count() == 1
    assert told.get_attribute("aria-label") == "Curves of v, σ over t [s]."


# ---- comparisons ---------------------------------------------------------------------------------
def comparison(number):
    """{law: run} of a notebook's comparison."""
    chain, rpl = perturbed_chain, smc.rpl
    loops = {
        "02": {n: chain(getattr(smc.smc1, n), 1)
               for n in ("sign_smc", "quasi_smc", "adaptive_smc", "dual_layer_smc")},
        "03": {"super-twisting": chain(smc.smc2.super_twisting, 1),
               "twisting": chain(smc.smc2.twisting, 1), "sign": chain(smc.smc1.sign_smc, 1),
               "quasi": chain(smc.smc1.quasi_smc, 1)},
        "06": {"1-SMC": rpl.loop(), "2-SMC": rpl.loop("adaptive_super_twisting"),
               "HOSMC": rpl.loop("hosm"), "PID": rpl.loop("pid", "paper")},
        "08": {n: smc.applications.double_integrator(n)
               for n in ("super_twisting", "sign_smc", "quasi_smc", "quasi_continuous")}}
    return {n: smc.simulate(q, record=1000) for n, q in loops[number].items()}


NUMBERS = "02", "03", "06", "08"


@pytest.fixture(scope="module")
def shown(browser):
    """Show a figure of plotly; gives the page."""
    page = browser.new_page(viewport=dict(width=800, height=1000))
    page.set_content("<div class=js-plotly-plot></div>")
    page.add_script_tag(content=get_plotlyjs())

    def show(figure):
        page.evaluate("""async drawn => { const { data, layout } = JSON.parse(drawn);
            await Plotly.newPlot(document.querySelector('.js-plotly-plot'), data, layout) }""",
                      figure.to_json())
        return page

    yield show
    page.close()


def pixels(page):
    shot = page.screenshot(full_page=True)
    return np.asarray(Image.open(io.BytesIO(shot)).convert("L"), float)  # in grey


HIDE = """async ([name, there]) => { const plot = document.querySelector('.js-plotly-plot');
    const at = plot.data.map((t, i) => t.legendgroup === name ? i : -1).filter(i => i >= 0);
    await Plotly.restyle(plot, { opacity: there ? 1 : 0 }, at) }"""
PANEL = """() => { const plot = document.querySelector('.js-plotly-plot');
    const y = plot.data.find(t => t.meta.startsWith('u')).yaxis.replace('y', 'yaxis');
    const { _offset, _length } = plot._fullLayout[y], box = plot.getBoundingClientRect();
    return [box.top + _offset, box.top + _offset + _length] }"""


@pytest.mark.parametrize("number", NUMBERS)
def test_every_law_of_a_comparison_has_visible_pixels(shown, number):
    """In the panel of the control, in grey: hiding a law changes the picture there."""
    runs = comparison(number)
    page = shown(smc.ui.plot(runs))
    top, bottom = (round(q) for q in page.evaluate(PANEL))
    whole = pixels(page)[top:bottom]
    for name in runs:
        page.evaluate(HIDE, [name, False])
        seen = np.count_nonzero(np.abs(pixels(page)[top:bottom] - whole) > 8.0)
        page.evaluate(HIDE, [name, True])
        assert seen > 150, f"{name}: {seen} pixels"


def test_a_figure_of_plot_has_no_button_that_shares_it(shown):
    page = shown(smc.ui.plot(smc.simulate(smc.lv.loop("pd"), 3.0)))
    titles = page.locator(".modebar-btn").evaluate_all(
        "q => q.map(b => b.dataset.title || b.getAttribute('aria-label') || '')")
    assert len(titles) > 3 and not any("hare" in q or "loud" in q for q in titles)


OVERLAPS = """() => { const plot = document.querySelector('.js-plotly-plot');
    const parts = ['> [class*=legend]', '[class*=title] text', 'text[class*=title]']
        .map(q => `.infolayer ${q}`).join();
    const boxes = [...new Set(plot.querySelectorAll(parts))].filter(e => e.textContent.trim())
        .map(e => [e.textContent, e.getBoundingClientRect()]);
    const apart = (a, b) => a.right <= b.left + 1 || b.right <= a.left + 1
                            || a.bottom <= b.top + 1 || b.bottom <= a.top + 1;
    return [boxes.length, boxes.flatMap(([n, a], i) => boxes.slice(i + 1)
        .filter(([, b]) => !apart(a, b)).map(([m]) => [n, m]))] }"""


@pytest.mark.parametrize("number", NUMBERS)
def test_legends_and_titles_do_not_overlap(shown, number):
    """Nor at 150 %, where a page has two thirds of the points."""
    runs = comparison(number)
    for width in (800, 533):
        for result in (runs, *({n: run} for n, run in runs.items())):
            page = shown(smc.ui.plot(result, phase=True).update_layout(width=width))
            count, overlaps = page.evaluate(OVERLAPS)
            assert count > 4 and overlaps == [], (width, list(result))


def test_the_legend_of_many_answers_lies_below_the_title_of_the_axis_above_it(shown):
    lander, output = smc.rpl.lander, smc.rpl.attitude_and_altitude
    found = smc.prd.experiment(lander, output=output)()
    for width in (800, 480):
        page = shown(smc.ui.plot(found).update_layout(width=width))
        count, overlaps = page.evaluate(OVERLAPS)
        assert count > 4 and overlaps == [], width


# ---- themes --------------------------------------------------------------------------------------
FLOWN = """import smcaero_nb as smc
run = smc.simulate(smc.rpl.loop(), record=4800)
smc.ui.compare({"1-SMC": smc.rpl.loop(), "PID": smc.rpl.loop("pid", "paper")})""", """\
film = smc.ui.flight(run)
film""", "smc.ui.plot(smc.simulate(smc.lv.loop('pd'), 3.0))"
DRAWN = "() => document.querySelectorAll('.smcaero-table, .smcaero-flight .js-line').length > 4 " \
        "&& document.querySelector('.jp-RenderedPlotly .js-line')"
THEME = """async theme => {
    await window.jupyterapp.commands.execute('apputils:change-theme', { theme })
    while (document.body.dataset.jpThemeLight !== String(theme.endsWith('Light')))
        await new Promise(r => setTimeout(r, 50)) }"""
BROKEN = """() => [...document.querySelectorAll('.smcaero-table :is(th, td)')]
    .filter(e => !e.querySelector('.smcaero-verdict')).map(e => {
        const range = document.createRange();
        range.selectNodeContents(e);
        return [e.textContent, range.getBoundingClientRect().height] })
    .filter(([, high]) => high > 28)"""
PICTURES = ".smcaero-study:not(.smcaero-flight) .js-plotly-plot", ".jp-RenderedPlotly .main-svg"


def grey(nb, place):
    """How light the points of an element are, from 0 to 255."""
    shot = nb.page.locator(place).first.screenshot()
    return np.asarray(Image.open(io.BytesIO(shot)).convert("L"), float)


def test_pictures_are_dark_in_the_dark_and_tables_do_not_break_before_a_unit(notebook):
    nb = notebook(*FLOWN)
    nb.page.set_viewport_size(dict(width=1280, height=800))
    assert nb.run() == []
    nb.page.wait_for_function(DRAWN)
    assert nb.page.locator(".smcaero-table td").count() > 8
    assert nb.page.evaluate(BROKEN) == []
    nb.page.set_viewport_size(dict(width=1280, height=1800))
    nb.page.wait_for_timeout(500)
    assert [q for q in PICTURES if not np.median(grey(nb, q)) > 250.0] == []
    nb.page.evaluate(THEME, "JupyterLab Dark")
    nb.page.wait_for_timeout(500)
    for place in PICTURES:
        seen = grey(nb, place)
        assert np.median(seen) < 40.0 and seen.max() > 150.0, place  # and its texts are light
    film = grey(nb, ".smcaero-flight .js-plotly-plot")
    height, width = film.shape
    sky = film[round(0.2*height):round(0.75*height), round(0.02*width):round(0.4*width)]
    assert np.median(sky) < 60.0 and np.count_nonzero(sky > 180.0) > 100  # the lander is light
    nb.page.evaluate(THEME, "JupyterLab Light")
    assert nb.errors == []
