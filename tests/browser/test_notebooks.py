"""Every notebook runs in JupyterLab, draws its live plots, and takes files of your own."""

import pytest
from labserver import ROOT

pytestmark = pytest.mark.browser
NOTEBOOKS = sorted(p.relative_to(ROOT).as_posix() for p in (ROOT / "notebooks").glob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS)
def test_runs_without_an_error(notebook, path, tmp_path):
    nb = notebook(path)
    assert nb.run() == []
    for view in ("smcaero-live", "smcaero-mask"):
        for i in range(nb.page.locator(f".{view}").count()):
            nb.page.locator(f".{view}").nth(i).wait_for()
    nb.page.wait_for_function("() => [...document.querySelectorAll('.smcaero-live')]"
                              ".every(l => l.querySelector('.js-line'))")
    pictures_fit(nb)
    lives = nb.page.locator(".smcaero-live").all()
    for live in [*lives[:1], *lives[1:][-1:]]:
        mask_drives_the_plot(nb, live)
        nonsense_is_answered(nb, live)
    if nb.page.locator(".smcaero-own").count():
        own_files_are_taken(nb, tmp_path)
    if "practical_relative_degree" in path:
        own_transfer_function_is_taken(nb)
    if "differentiators" in path:
        result_is_downloaded(nb)
    if nb.page.locator(".smcaero-flight").count():
        film_is_scrubbed_and_played(nb)
    for study in nb.page.locator(".smcaero-study:not(.smcaero-own)").all():
        study.locator(".js-line, .point").first.wait_for()  # drawn, and as wide as its cell
        plot, cell = (study.locator(f".{q}").first.bounding_box()
                      for q in ("main-svg", "smcaero-plot"))
        assert abs(plot["width"] - cell["width"]) < 3 and plot["height"] <= cell["height"] + 3
    assert nb.errors == []
    nb.close()


FITTED = """() => [...document.querySelectorAll('.smcaero-picture .js-plotly-plot')].every(plot => {
    const [there, place] = [plot.querySelector('.svg-container'), plot.parentElement]
        .map(e => e.getBoundingClientRect());
    return plot._fullLayout.height > 300 && ['width', 'height'].every(
        q => [plot._fullLayout[q], place[q]].every(v => Math.abs(v - there[q]) < 3)) })"""
AREA = "() => window.jupyterapp.commands.execute('application:toggle-left-area')"


def pictures_fit(nb):
    """Every picture keeps its height and takes the available width, whatever that is."""
    for _ in range(2):
        nb.page.evaluate(AREA)
        nb.page.wait_for_timeout(300)
        nb.page.wait_for_function(FITTED)


DATA = """live => { const curves = live.querySelector('.js-plotly-plot').data;
                    return Object.fromEntries(
                      curves.map((c, i) => [c.meta ?? i, Array.from(c.y)])) }"""
CHANGED = """(live, before) => {
    const curves = live.querySelector('.js-plotly-plot').data, kind = k => k.split('[')[0];
    const runs = Object.keys(before).filter(k => ['y', 'sigma', 'u', 'phase'].includes(kind(k)));
    const moved = k => curves.find(c => c.meta === k)?.y.some((v, i) => v !== before[k][i]);
    return runs.length
        ? [...new Set(runs.map(kind))].every(n => runs.some(k => kind(k) === n && moved(k)))
        : curves.some((c, i) => { const was = before[c.meta ?? i];
                                  return !was || c.y.some((v, j) => v !== was[j]) }) }"""


def mask_drives_the_plot(nb, live):
    """The first slider of a mask moves each curve, at least in one channel, and the portrait."""
    before = live.evaluate(DATA)
    handle, entry = (live.locator(f".smcaero-row {q}").first
                     for q in ("[role=slider]", "input[type=text]"))
    handle.scroll_into_view_if_needed()
    handle.focus()
    for _ in range(3):
        was = entry.input_value()
        handle.press("ArrowRight")
        until(nb, lambda was=was: entry.input_value() != was)  # it has been to the kernel and back
    until(nb, lambda: live.evaluate(CHANGED, before))


def until(nb, holds):
    for _ in range(300):
        if holds():
            return
        nb.page.wait_for_timeout(100)
    raise AssertionError("not even after half a minute")


def nonsense_is_answered(nb, live):
    entry = live.locator(".smcaero-row input[type=text]").first
    was = entry.input_value()
    entry.fill("much")
    entry.press("Enter")
    status = live.locator(".smcaero-mask .smcaero-status").first
    until(nb, lambda: f"It stays at {was}" in status.text_content())
    live.locator(".smcaero-top button").click()


def own_files_are_taken(nb, tmp_path):
    """A file given by hand becomes a case of the mask; a bad one is refused by line and column."""
    own = nb.page.locator(".smcaero-own", has_text="Your own file")

    def give(name, text):
        (tmp_path/name).write_text(text)
        with nb.page.expect_file_chooser() as chooser:
            own.locator("button").first.click()
        chooser.value.set_files(tmp_path/name)

    t = [k*1e-3 for k in range(2000)]
    rows = "".join(f"{1e3*a:.3f}\t{(a - 0.5)**2 if a > 0.5 else 0.0:.7g}\t{1.0*(a >= 0.5)}\n"
                   for a in t)
    give("bad.csv", "time\tangle\tvolts\n0\t1\t2\n1\tx\t2\n")
    nb.page.wait_for_function(STATUS, arg="line 3: column 2 ('angle'): 'x' is not a finite number")
    give("mine.csv", "time [ms]\tangle\tvolts\n" + rows)
    nb.page.wait_for_function(STATUS,
                              arg="mine.csv: 2000 rows, 3 columns, delimiter tab; t = 'time' [ms]")
    live = nb.page.locator(".smcaero-live").first
    nb.page.wait_for_function("""() =>
        document.querySelector('.smcaero-choice select').selectedOptions[0].text === 'mine.csv'""")
    nb.page.wait_for_function(WIDE)
    assert live.locator(".js-line").count() > 2


STATUS = """words => [...document.querySelectorAll('.smcaero-own .smcaero-status')]
    .some(s => s.textContent.includes(words))"""
WIDE = """() => { const plot = document.querySelector('.smcaero-live .js-plotly-plot');
                  const x = plot.data[0].x, end = x[x.length - 1];
                  return x.length > 100 && end > 0.5 && end < 2.1 }"""


def own_transfer_function_is_taken(nb):
    own = nb.page.locator(".smcaero-own", has_text="denominator")
    entries = own.locator("input")
    for text, said in (("1 x", "denominator: 'x' is not a finite number"),
                       ("0", "denominator: '0' is not allowed"),
                       ("2", "(1)/(2) is chosen in the mask"),
                       ("1 2 5", "(1)/(s^2 + 2s + 5) is chosen in the mask")):
        entries.nth(1).fill(text)
        own.locator("button").click()
        nb.page.wait_for_function(STATUS, arg=said)
    nb.page.wait_for_function("""() => document.querySelector('.smcaero-result').textContent ===
                                       'The experimentally determined PRD is equal to 2'""")


def result_is_downloaded(nb):
    with nb.page.expect_download() as download:
        nb.page.locator(".smcaero-download").first.click()
    lines = download.value.path().read_text().splitlines()
    assert download.value.suggested_filename == "mine, estimates.csv" and len(lines) == 2001
    assert lines[0].startswith("t [s],f,z_0")
    assert all(len(q.split(",")) == len(lines[0].split(",")) for q in lines)


# below the centre of mass [m]
GROUND = "document.querySelector('.smcaero-flight .js-plotly-plot').data[0].y[0]"
BODY = "() => Array.from(document.querySelector('.smcaero-flight .js-plotly-plot').data[3].y)"
SECONDS = """parseFloat(
    document.querySelector('.smcaero-flight .smcaero-moment').textContent.slice(4))"""


def film_is_scrubbed_and_played(nb):
    """The slider of the film brings the lander to the ground, and its button lets it fly."""
    film = nb.page.locator(".smcaero-flight").first
    handle = film.get_by_role("slider", name="time")
    play = film.get_by_role("button", name="play or pause")
    handle.scroll_into_view_if_needed()
    handle.focus()

    def scrubbed(key, shown):
        def there():  # a new run of the plot above may come between
            handle.press(key)
            nb.page.wait_for_timeout(400)
            return nb.page.evaluate(f"() => {shown}")

        until(nb, there)

    scrubbed("Home", f"{SECONDS} === 0 && {GROUND} < -10")
    before = nb.page.evaluate(BODY)
    scrubbed("End", f"{SECONDS} > 230 && {GROUND} > -3")
    assert nb.page.evaluate(BODY) != before  # upright now
    scrubbed("Home", f"{SECONDS} === 0")
    play.click()
    nb.page.wait_for_function(f"() => {SECONDS} > 2")
    play.click()
    film.locator("select").select_option("2 s a picture")
    scrubbed("End", f"{SECONDS} > 230")
    for _ in range(70):  # a few seconds before the end
        handle.press("ArrowLeft")
    play.click()
    moment = film.locator(".smcaero-moment")
    until(nb, lambda: "touchdown" in moment.text_content())  # which is the last moment of the run


def test_there_are_notebooks():
    assert [n[10:12] for n in NOTEBOOKS] == ["00", "01", "02", "03", "04", "05", "06", "07", "08"]
