"""What pictures show, measured as drawn: zoomed chattering, compared laws, lost runs, words."""

import json

import numpy as np
import pytest

pytestmark = pytest.mark.browser

LIVE = """import smcaero_nb as smc
chain = smc.applications.perturbed_chain
picture = smc.ui.live({"sign": chain(smc.smc1.sign_smc, 1), "quasi": chain(smc.smc1.quasi_smc, 1)})
picture"""
#: Path of a curve as drawn, in points of the panel.
PATH = """key => { const plot = document.querySelector('.js-plotly-plot');
    const n = plot.data.findIndex(t => t.meta === key), { uid } = plot._fullData[n];
    return plot.querySelector(`.scatterlayer .trace${uid} path.js-line`)?.getAttribute('d') }"""
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
    yield opened
    assert opened.errors == []


def zoom(nb, span):
    """Drag a box from one time to another, as a person does; or show all again."""
    if span is None:
        nb.page.locator(".js-plotly-plot .nsewdrag").first.dblclick()
        nb.page.wait_for_timeout(400)
        return
    box = nb.page.locator(".js-plotly-plot .nsewdrag").first.bounding_box()
    low, high = nb.page.evaluate("() => document.querySelector('.js-plotly-plot')"
                                 "._fullLayout.xaxis.range")
    xs = [box["x"] + (t - low)/(high - low)*box["width"] for t in span]
    y = box["y"] + box["height"]/2
    nb.page.mouse.move(xs[0], y)
    nb.page.mouse.down()
    nb.page.mouse.move(xs[1], y, steps=5)
    nb.page.mouse.up()


def edges(path):
    """(x, y) of the points of a path of straight lines."""
    pairs = path.replace("M", " ").replace("L", " ").split()
    return np.array([[float(v) for v in p.split(",")] for p in pairs])


def test_a_zoomed_relay_has_all_its_reversals_and_upright_edges(nb):
    """Between 2.0 and 2.2 s the relay reverses 154 times."""
    zoom(nb, (2.0, 2.2))
    nb.page.wait_for_function(f"() => {{ const [x] = ({POINTS})('u'), i = x.findIndex(q => q > 2.05);"
                              " return x[i + 1] - x[i] < 0.005 }")
    low, high = nb.page.evaluate("() => document.querySelector('.js-plotly-plot')"
                                 "._fullLayout.xaxis.range")
    x, y = (np.array(q) for q in nb.page.evaluate(POINTS, "u"))
    truth = json.loads(nb.ask(
        "import json, numpy as np; r = smc.simulate(picture.loop, record=20_000)\n"
        f"u = r.u[(r.t > {low}) & (r.t < {high})]; print(json.dumps(int((np.diff(u) != 0).sum())))"))
    inside = (x > low) & (x < high)
    assert abs(truth - 154) < 12  # what the drag hit is not exactly 2.0 to 2.2
    assert np.count_nonzero(np.diff(y[inside])) == pytest.approx(truth, abs=2)
    drawn = np.diff(edges(nb.page.evaluate(PATH, "u")), axis=0)
    assert np.all((np.abs(drawn) < 0.02).any(axis=1))  # level or upright, never slanted
    assert np.count_nonzero(np.abs(drawn[:, 1]) > 20.0) == pytest.approx(truth, abs=3)


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
