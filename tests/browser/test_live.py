"""Mask and live plot as used: keyboard, typing, reload, cancel, narrow windows, assistance."""

import json
import os

import numpy as np
import pytest

pytestmark = pytest.mark.browser

CELL = """import smcaero_nb as smc
loops = {"quasi-SMC": "quasi_smc", "adaptive super-twisting": "adaptive_super_twisting", "PD": "pd"}
picture = smc.ui.live({name: smc.lv.loop(law) for name, law in loops.items()}, states=("beta",))
picture"""
RESET = """picture.times["dt"] = None
picture.mask.choice.value = "quasi-SMC"
picture.mask.reset()
picture.wait()"""
FITS = """() => { const plot = document.querySelector('.js-plotly-plot');
                  const box = plot.closest('.jp-OutputArea-output').getBoundingClientRect();
                  const inside = e => {
                    const r = e.getBoundingClientRect();
                    return r.width > 0 && r.left >= box.left - 1 && r.right <= box.right + 1 };
                  return inside(plot.querySelector('.main-svg'))
                         && inside(document.querySelector('.smcaero-mask'))
                         && ["width", "height"].every(
                           q => Math.abs(plot._fullLayout[q] - plot.getBoundingClientRect()[q]) < 3)
                }"""


@pytest.fixture(scope="module")
def opened(notebook):
    nb = notebook(CELL)
    assert nb.run() == []
    nb.curve("y")
    return nb


@pytest.fixture
def nb(opened):
    """The page with the live plot, as it is at the start."""
    opened.errors.clear()
    opened.page.set_viewport_size(dict(width=1400, height=1000))
    opened.ask(RESET)
    agrees(opened, "y")
    yield opened
    assert opened.errors == []


def agrees(nb, key):
    """Wait until the page has the kernel's curve; (values, SVG path)."""
    for _ in range(100):  # what was pressed may still be on its way to the kernel
        wanted = json.loads(nb.ask("import json; picture.wait(); "
                                   f"print(json.dumps(picture.curves['{key}'].y.tolist()))"))
        if nb.page.evaluate("([curve, key]) => Array.from(eval(curve)(key).y ?? [])",
                            [nb.CURVE, key]) == wanted:
            return nb.curve(key)
        nb.page.wait_for_timeout(200)
    raise AssertionError(f"the page does not show the kernel's {key}")


def changed(nb, key, before):
    """Wait until a curve differs from what it was, and is the kernel's; (values, SVG path)."""
    nb.page.wait_for_function(
        "([curve, key, before]) => eval(curve)(key).y?.some((v, i) => v !== before[i])",
        arg=[nb.CURVE, key, before])
    return agrees(nb, key)


def shown(nb, name, text):
    """Wait until an entry shows this: all that was pressed has been to the kernel and back."""
    nb.page.wait_for_function("""([name, text]) =>
        document.querySelector(`.smcaero-set-${name} input[type=text]`).value === text""",
                              arg=[name, text])


def test_slider_moves_the_curve(nb):
    before, path = nb.curve("y")
    handle = nb.slider("law__rho")
    assert float(handle.get_attribute("aria-valuenow")) == 2.0
    for _ in range(4):
        handle.press("ArrowRight")
    shown(nb, "law__rho", "2.2")
    after, moved = changed(nb, "y", before)
    assert float(handle.get_attribute("aria-valuenow")) == 2.2
    assert path != moved  # what is drawn, not only the data
    assert max(abs(np.subtract(before, after))) > 0.01
    assert float(nb.ask("print(picture.loop.stages['law'].values['rho'])")) == 2.2


def test_drag_ends_where_the_slider_is(nb):
    before, _ = nb.curve("u")
    box = nb.slider("law__eps").bounding_box()
    x, y = box["x"] + box["width"]/2, box["y"] + box["height"]/2
    nb.page.mouse.move(x, y)
    nb.page.mouse.down()
    for i in range(1, 60):
        nb.page.mouse.move(x + 40*np.sin(i/6), y)
    nb.page.mouse.up()
    # the page gives the logarithm with one decimal
    nb.page.wait_for_function("""() => {
        const row = document.querySelector('.smcaero-set-law__eps');
        const there = row.querySelector('[role=slider]').ariaValueNow;
        return Math.abs(Math.log10(row.querySelector('input').value) - there) < 0.051 }""")
    shown = float(nb.entry("law__eps").input_value())
    assert shown == float(nb.ask("print(picture.loop.stages['law'].values['eps'])")) != 0.25
    changed(nb, "u", before)


def test_the_last_of_what_a_program_sets_wins(nb):
    """The page answers each value that is not one of the slider's steps, sometimes too late."""
    nb.ask("for v in (3.017, 0.517, 1.234):\n    picture.set(law__rho=v, law__eps=0.1*v)\n"
           "picture.mask.reset()")
    nb.page.wait_for_timeout(1500)
    agrees(nb, "y")
    values = "[picture.mask.values[n] for n in ('law__rho', 'law__eps')]"
    assert nb.ask(f"print({values})") == "[2.0, 0.25]"
    assert nb.entry("law__rho").input_value() == "2"
    assert float(nb.slider("law__rho").get_attribute("aria-valuenow")) == 2.0
    before, _ = nb.curve("y")
    handle = nb.slider("law__rho")
    for _ in range(3):  # hands are not affected
        handle.press("ArrowRight")
    shown(nb, "law__rho", "2.15")
    changed(nb, "y", before)


def test_nonsense_is_answered_in_words(nb):
    before, _ = nb.curve("y")
    entry = nb.entry("law__rho")
    for text in ("-5", "abc", "1e999", "nan", "", "1,5"):
        entry.fill(text)
        entry.press("Enter")
        said = nb.said(f"rho = {text!r}" if text in ("abc", "", "1,5")
                       else f"rho = {float(text):g}")
        assert "it must be a finite number, at least 0 [v]. It stays at 2." in said
        nb.page.wait_for_function(
            "() => document.querySelector('.smcaero-set-law__rho input').ariaInvalid === 'true'")
    status = nb.page.locator(".smcaero-status")
    assert status.get_attribute("aria-live") == "polite"
    assert status.get_attribute("role") == "status"
    assert nb.curve("y")[0] == before
    entry.fill("0.2")
    entry.press("Enter")
    said = nb.said("diverged at")
    assert "θ left its limit of 573 deg; the curves end there, those of the last good" in said
    lost, _ = nb.curve("y")
    assert abs(lost[-1]) > 500.0 and nb.curve("before:y")[0] == before
    nb.page.locator(".smcaero-top button").click()
    shown(nb, "law__rho", "2")
    nb.page.wait_for_function("() => document.querySelector('.smcaero-status').textContent === ''")
    assert entry.get_attribute("aria-invalid") == "false"
    errors = ".jp-RenderedText[data-mime-type='application/vnd.jupyter.stderr']"
    assert nb.page.locator(errors).count() == 0


def test_page_loaded_anew_shows_what_is_set(nb):
    before, _ = nb.curve("y")
    entry = nb.entry("law__rho")
    entry.fill("3.017")  # between two steps of the slider
    entry.press("Enter")
    now, _ = changed(nb, "y", before)
    nb.page.evaluate(nb.SAVE)
    nb.page.goto(nb.page.url.replace("&reset", "").replace("?reset", ""))
    nb.page.reload()
    nb.ready()
    again, path = nb.curve("y")
    assert again == now and path
    shown(nb, "law__rho", "3.017")
    assert abs(float(nb.slider("law__rho").get_attribute("aria-valuenow")) - 3.017) <= 0.025
    assert float(nb.ask("print(picture.loop.stages['law'].values['rho'])")) == 3.017
    nb.slider("law__rho").press("ArrowRight")
    changed(nb, "y", now)


def test_long_run_is_cancelled_from_the_page(nb):
    before, _ = nb.curve("y")
    nb.ask("picture.times['dt'] = 1e-8")  # minutes
    nb.slider("law__rho").press("ArrowRight")
    cancel = nb.page.locator(".smcaero-busy button")
    cancel.wait_for()
    nb.page.wait_for_function(
        "() => parseFloat(document.querySelector('.smcaero-busy .progress-bar').style.width) > 0")
    # the kernel answers meanwhile
    assert nb.ask("print(picture.job.worker.idle.is_set())") == "False"
    # the newest setting takes the place of the one at work
    nb.slider("law__rho").press("ArrowRight")
    shown(nb, "law__rho", "2.1")
    cancel.click()
    assert "the curves are those of the last good setting" in nb.said("Cancelled")
    cancel.wait_for(state="hidden")
    assert nb.ask("print(picture.job.worker.idle.is_set())") == "True"
    assert nb.ask("print(picture.loop.stages['law'].values['rho'])") == "2.1"
    assert nb.curve("y")[0] == before
    nb.ask("picture.times['dt'] = None")
    nb.slider("law__rho").press("ArrowRight")
    changed(nb, "y", before)


def test_choice_of_loops(nb):
    before, _ = nb.curve("y")
    for name, there, gone in (("PD", "law__k_p", "law__rho"),
                              ("adaptive super-twisting", "law__gamma", "law__k_p")):
        nb.page.locator(".smcaero-choice select").select_option(name)
        nb.page.locator(f".smcaero-set-{there}").wait_for()
        assert nb.page.locator(f".smcaero-set-{gone}").count() == 0
        before, _ = changed(nb, "y", before)
    agrees(nb, "law.lam")
    nb.page.wait_for_function(FITS)


def test_nothing_is_clipped(nb):
    for width, name in ((1400, "PD"), (900, "adaptive super-twisting"), (1900, "quasi-SMC"),
                        (900, "PD"),
                        (1400, "adaptive super-twisting")):
        nb.page.set_viewport_size(dict(width=width, height=1000))
        nb.page.locator(".smcaero-choice select").select_option(name)
        agrees(nb, "y")
        nb.page.wait_for_function(FITS)
    side = nb.page.locator(".smcaero-mask").bounding_box()
    assert side["width"] <= 420
    assert side["x"] + side["width"] <= nb.page.locator(".js-plotly-plot").bounding_box()["x"]
    nb.page.set_viewport_size(dict(width=900, height=1000))
    nb.page.wait_for_function(FITS)
    side = nb.page.locator(".smcaero-mask").bounding_box()
    # one above the other
    assert side["y"] + side["height"] <= nb.page.locator(".js-plotly-plot").bounding_box()["y"]


def test_a_picture_that_was_hidden_shows_what_is_there_now(nb):
    before, _ = nb.curve("y")
    hide = """q => { document.querySelector('.smcaero-live').closest('.jp-Cell-outputArea')
                            .style.display = q }"""
    nb.page.evaluate(hide, "none")
    nb.ask("picture.set(law__rho=3.0)")
    nb.page.wait_for_timeout(500)
    nb.page.evaluate(hide, "")
    changed(nb, "y", before)
    nb.page.wait_for_function(FITS)


def test_keys_for_a_control_are_no_commands_of_the_notebook(nb):
    cells = nb.page.locator(".jp-Cell").count()
    choice = nb.page.locator(".smcaero-choice select")
    choice.focus()
    choice.press("ArrowDown")
    nb.page.wait_for_function("""() =>
        document.querySelector('.smcaero-choice select').selectedOptions[0].text !== 'quasi-SMC'""")
    for control, key in ((nb.slider("law__gamma"), "b"),
                         (nb.page.locator(".smcaero-fold").first, "x")):
        control.press(key)
        nb.page.wait_for_timeout(300)
        assert nb.page.locator(".jp-Cell").count() == cells


def test_picture_for_the_readme(nb):
    nb.page.locator(".smcaero-choice select").select_option("adaptive super-twisting")
    agrees(nb, "law.lam")
    nb.page.set_viewport_size(dict(width=1500, height=1100))
    nb.page.wait_for_function(FITS)
    nb.page.mouse.move(5, 5)
    picture = nb.page.locator(".smcaero-live").screenshot(path=os.environ.get("SMCAERO_SCREENSHOT"))
    assert picture[:8] == b"\x89PNG\r\n\x1a\n" and len(picture) > 20_000


def test_mask_is_accessible(nb):
    from axe_playwright_python.sync_playwright import Axe

    folds = nb.page.locator(".smcaero-fold")
    for i in range(folds.count()):
        if folds.nth(i).get_attribute("aria-expanded") == "false":
            folds.nth(i).press("Enter")
    for i in range(nb.page.locator(".smcaero-help").count()):
        nb.page.locator(".smcaero-help").nth(i).press("Enter")
    nb.page.locator(".smcaero-doc mjx-container").first.wait_for()
    nb.page.locator(".smcaero-set-plant__deta input[aria-label]").wait_for()
    nb.entry("law__rho").fill("abc")
    nb.entry("law__rho").press("Enter")
    nb.said("not allowed")
    for name in ("law__rho", "law__eps", "plant__I"):
        assert nb.slider(name).get_attribute("aria-label").split()[:2] == name.split("__")
    # the value of the step next to 0.25, not its logarithm
    nb.page.wait_for_function("""() =>
        document.querySelector('.smcaero-set-law__eps [role=slider]').ariaValueText === '0.251'""")
    found = Axe().run(nb.page, context=".smcaero-mask",
                      options={"runOnly": ["wcag2a", "wcag2aa"]}).response["violations"]
    assert {v["id"]: [n["html"][:200] for n in v["nodes"]] for v in found} == {}


SLOW = """AbortSignal.timeout = () => { const c = new AbortController();
                                        setTimeout(() => c.abort()); return c.signal }"""
TRIAL = "import smcaero_nb as smc\npicture = smc.ui.live(smc.differentiators.trial())\npicture"


def test_a_slow_page_is_as_live_as_any(notebook):
    """Anywidget gives up on what takes more than 2 s to load; here it does so at once."""
    nb = notebook(TRIAL, script=SLOW)
    assert nb.run() == []
    nb.page.wait_for_selector(".smcaero-live .js-line")
    assert nb.late
    curve = "() => Array.from(document.querySelector('.js-plotly-plot').data[1].y)"
    before = nb.page.evaluate(curve)
    handle = nb.slider("L")
    assert handle.get_attribute("aria-label") == "L [f]/s^n"
    for _ in range(3):
        handle.press("ArrowRight")
    nb.page.wait_for_function(f"before => ({curve})().some((v, i) => v !== before[i])", arg=before)
    with nb.page.expect_download() as download:
        nb.page.locator(".smcaero-download").click()
    assert download.value.path().read_text().startswith("t [s],f,z_0")
    assert nb.errors == []


FIGURES = """import numpy as np, plotly.graph_objects as go, smcaero_nb as smc
made = [go.Scatter(y=[1.0, 2.0]), go.Pie(values=[1, 2]), go.Bar(x=["a", "b"], y=[3, 4]),
        go.Scatter(x=1.7e9 + np.arange(3.0), y=[0.0, 1.0, 2.0])]
def figures(k: int = 0):
    return go.Figure(made[k])
own = smc.ui.live(smc.block(figures))
own"""


def test_any_figure_of_plotly_is_drawn(notebook):
    nb = notebook(FIGURES)
    assert nb.run() == []
    for k, wanted in enumerate(("[undefined, [1, 2]]", "[undefined, undefined]",
                                "[['a', 'b'], [3, 4]]",
                                "[[1.7e9, 1.7e9 + 1, 1.7e9 + 2], [0, 1, 2]]")):
        nb.ask(f"own.set(k={k})")
        nb.page.wait_for_function("""wanted => {
            const t = document.querySelector('.js-plotly-plot')?._fullData?.[0];
            const plain = q => q && Array.from(q._inputArray ?? q);
            const said = JSON.stringify([t?._input.x, t?._input.y].map(plain));
            return t && said === JSON.stringify(eval(wanted)) }""", arg=wanted)


CASES = """import smcaero_nb as smc
rpl, prd = smc.rpl, smc.prd
own = smc.ui.live({"eq (7)": prd.experiment(smc.lv.transfer_function()),
                   "lander": prd.experiment(rpl.lander, output=rpl.attitude_and_altitude)})
own"""
SPAN = "() => document.querySelector('.js-plotly-plot')?._fullLayout?.xaxis?.range"


def test_axes_follow_the_case_that_is_chosen(notebook):
    """Also where one case gives the range of an axis and the other does not."""
    nb = notebook(CASES)
    assert nb.run() == []
    choice, seen = nb.page.locator(".smcaero-choice select"), {}
    for name in ("eq (7)", "lander", "eq (7)", "lander"):
        choice.select_option(name)
        nb.page.wait_for_function("""n =>
            document.querySelectorAll('.js-plotly-plot .main-svg .xy').length
            && document.querySelector('.smcaero-result').textContent.includes(n)""",
                                  arg="[2, 2]" if name == "lander" else "equal to 5")
        nb.page.wait_for_timeout(500)
        low, high = nb.page.evaluate(SPAN)
        assert -0.1 < low < 0.0 < high < 0.1
        assert seen.setdefault(name, (low, high)) == (low, high)
    assert nb.errors == []
