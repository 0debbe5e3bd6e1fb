"""Masks and live plots, without a browser: the page's part is in tests/browser."""

import _thread
import math
import subprocess
import sys
import threading
import time
from typing import Annotated

import ipywidgets
import numpy as np
import pytest

import smcaero_nb as smc
from smcaero_nb import ClosedLoop, Param, ParameterError, block, channels
from smcaero_nb.ui import board, live, mask, plot
from smcaero_nb.ui.panels import panels
from smcaero_nb.ui.words import doc_html, label, symbol, unit_html
from smcaero_nb.ui.worker import Dropped, Newest

LOOPS = {law: smc.lv.loop(law) for law in smc.lv.PRESETS}


@block(state=dict(m=(0.5, Param("m_0", "kg"))))
def everything(sigma, z, tau,
               gain: Annotated[float, Param("k", "[v]/[sigma]^1/2", low=0.0, help="gain", slider=(0.0, 10.0))] = 2.0,
               width: Annotated[float, Param(r"\varepsilon", "m^2", low=1e-9, log=True, slider=(1e-3, 10.0))] = 0.1,
               order: Annotated[int, Param("n", low=1, high=5)] = 2,
               smooth: Annotated[bool, Param("smooth", help="a switch")] = True,
               free: Annotated[float, Param()] = -3.0):
    r"""Law with every kind of parameter.

    .. math::

        a &= b < c \\
        d &= e

    Parameters
    ----------
    sigma : float
        Sliding variable.

    Notes
    -----
    Here ``code``, :math:`\|\sigma\|` and \|text\|.
    """
    return gain*sigma, (0.0,)


def typed(m, name, text):
    """Type a text and leave the entry; what the mask says."""
    m.entries[name].value = text
    return m._status.value


def test_widgets_load_only_when_asked_for():
    code = ("import sys, smcaero_nb as smc; few = {'plotly', 'ipywidgets', 'anywidget'}; assert not few & set(sys.modules);"
            "smc.ui.mask; assert few <= set(sys.modules)")
    subprocess.run([sys.executable, "-c", code], check=True)


# ---- masks -------------------------------------------------------------------------------------------------------
def test_a_remark_on_what_was_typed_is_said():
    m = mask(smc.smc1.decoupling(((2.0, 1.0), (1.0, 1.0))))
    m.entries["G0_11"].value = "1.00001"
    assert m.target.values["G0_11"] == 1.00001 and "nearly singular" in m._status.value and "smcaero-good" in m._status.value
    m.entries["G0_11"].value = "1"
    assert "is singular" in m._status.value and "It stays at 1.00001" in m._status.value


def test_form_follows_the_metadata():
    m = mask(everything)
    kinds = {"gain": ipywidgets.FloatSlider, "width": ipywidgets.FloatLogSlider, "order": ipywidgets.IntSlider,
             "smooth": ipywidgets.Checkbox, "free": ipywidgets.FloatSlider, "m": ipywidgets.FloatSlider}
    assert {n: type(w) for n, w in m.widgets.items()} == kinds
    assert list(m.entries) == [n for n in kinds if n != "smooth"]
    assert m.values == everything.values
    gain, width, order = (m.widgets[n] for n in ("gain", "width", "order"))
    assert (gain.min, gain.max, gain.tooltip, gain.description) == (0.0, 10.0, "gain", r"$k$ $\mathrm{[v]/[σ]^{1/2}}$")
    assert (width.min, width.max) == (-3.0, 1.0) and width.description == r"$\varepsilon$ $\mathrm{[m^{2}]}$"
    assert (order.min, order.max, order.description) == (1, 5, "$n$")
    assert m.widgets["smooth"].description == "smooth"
    assert m.widgets["free"].min <= -3.0 < m.widgets["free"].max
    assert m.page.names["gain"] == ("gain [v]/[sigma]^1/2", False)


@pytest.mark.parametrize("law", LOOPS)
def test_every_control_reaches_both_ends(law):
    m = mask(LOOPS[law])
    assert set(m.widgets) == set(LOOPS[law].settable())
    for name, w in m.widgets.items():
        meta, _, kind = LOOPS[law].settable()[name]
        ends = (False, True) if kind is bool else (w.min, w.max)
        for end in ends:
            w.value = 10.0**end if isinstance(w, ipywidgets.FloatLogSlider) else end
            value = m.target.settable()[name][1]
            assert value == pytest.approx(float(w.value)) and meta.low <= value <= meta.high
            if kind is not bool:
                assert float(m.entries[name].value) == pytest.approx(value, rel=1e-5)
                lower, upper = meta.slider or (-math.inf, math.inf)
                given = LOOPS[law].settable()[name][1]
                assert min(lower, given) - 1e-9 <= value <= max(upper, given) + 1e-9
        m.reset()
        assert m.values[name] == LOOPS[law].settable()[name][1]


def test_entry_goes_beyond_the_slider():
    m = mask(everything)
    assert typed(m, "gain", "250.5") == ""
    assert m.values["gain"] == 250.5 and m.widgets["gain"].value == 10.0
    assert typed(m, "width", "1e-5") == ""
    assert m.values["width"] == 1e-5 and m.widgets["width"].value == pytest.approx(1e-3)
    assert typed(m, "order", "3") == "" and m.values["order"] == 3 and isinstance(m.values["order"], int)
    m.widgets["gain"].value = 4.0
    assert m.values["gain"] == 4.0 and m.entries["gain"].value == "4"


@pytest.mark.parametrize("text", ["abc", "", " ", "nan", "inf", "1e999", "-5", "1,5", "2**3", "0x10", "<b>", "1 2"])
def test_nonsense_is_refused_in_words(text):
    m = mask(everything)
    said = typed(m, "gain", text)
    assert "gain" in said and "is not allowed" in said and "a finite number, at least 0 [v]" in said and "It stays at 2." in said
    assert "<b>" not in said
    assert m.values["gain"] == 2.0 and m.target is everything
    assert "smcaero-refused" in m._rows["gain"].box._dom_classes
    m.widgets["width"].value = 1.0  # a good value elsewhere: the entry shows again what is in force
    assert m._status.value == "" and m.entries["gain"].value == "2"
    assert "smcaero-refused" not in m._rows["gain"].box._dom_classes


@pytest.mark.parametrize("text", ["2.5", "0", "6", "x"])
def test_whole_numbers_only_where_they_are_meant(text):
    m = mask(everything)
    assert "a whole number from 1 to 5" in typed(m, "order", text) and m.values["order"] == 2


def test_what_was_typed_stays_as_typed():
    m = mask(everything)
    typed(m, "gain", " 0.50 ")
    m.widgets["free"].value = -1.0
    assert m.entries["gain"].value == " 0.50 " and m.values["gain"] == 0.5


def test_set_reset_and_observers():
    m, seen = mask(everything), []
    m.observe(lambda change: seen.append(change.new.values["gain"]), "target")
    m.set(gain=3.0, order=4)
    assert seen == [3.0] and m.values["order"] == 4 and m.widgets["gain"].value == 3.0
    with pytest.raises(ParameterError, match="at least 0"):
        m.set(gain=-1.0)
    with pytest.raises(ParameterError, match="did you mean 'gain'"):
        m.set(gian=1.0)
    assert m.values["gain"] == 3.0
    m._reset.click()
    assert seen == [3.0, 2.0] and m.values == everything.values


def test_page_draws_a_slider_on_its_grid_without_moving_it():
    m = mask(everything)
    m.set(gain=3.017, width=0.123456)
    for name, shown in (("gain", 3.0), ("width", 0.1230)):  # what the page answers, when it draws the sliders
        m.widgets[name].set_state({"value": shown})
    assert m.values["gain"] == 3.017 and m.values["width"] == 0.123456
    m.widgets["gain"].set_state({"value": 3.15})
    m.widgets["width"].set_state({"value": 0.15488166})
    assert m.values["gain"] == 3.15 and m.values["width"] == 0.155


def test_include():
    loop = LOOPS["quasi_smc"]
    assert list(mask(loop, include=("law", "plant__I")).widgets) == ["law__rho", "law__eps", "plant__I"]
    with pytest.raises(ParameterError, match="rho"):
        mask(loop, include=("rho",))


def test_groups_of_a_loop():
    m = mask(LOOPS["quasi_smc"])
    folds = m._body.children
    assert [f.opener.description for f in folds] == [
        "surface: itae", "law: quasi smc", "allocation: gimbal to control", "reference: steps", "perturbation: misalignment",
        "plant: launcher", "initial state"]
    assert [f.opener.value for f in folds] == [True]*3 + [False]*4
    plant = folds[5]
    assert not plant.body.children
    plant.opener.value = True
    assert len(plant.body.children) == len(LOOPS["quasi_smc"].stages["plant"].params) and plant.body in plant.children
    plant.helper.value = True
    assert "ddot" in plant.doc.value and plant.doc in plant.children
    plant.opener.value = plant.helper.value = False
    assert len(plant.children) == 1


def test_choice_of_loops():
    m = mask({"quasi": LOOPS["quasi_smc"], "PD": LOOPS["pd"]})
    m.set(law__rho=3.0, perturbation__f_0=0.1)
    m.choice.value = "PD"
    assert "law__k_p" in m.widgets and "law__rho" not in m.widgets and m.target.stages["law"].name == "pd"
    assert m.values["perturbation__f_0"] == 0.1  # the same world
    m.reset()
    assert m.values["perturbation__f_0"] == 0.2
    m.choice.value = "quasi"
    assert m.values["law__rho"] == 3.0 and m.widgets["law__rho"].value == 3.0


def test_channels_are_grouped_one_by_one():
    m = mask(channels(a=smc.smc1.quasi_smc, b=smc.smc1.sign_smc))
    m.widgets["b__rho"].value = 4.0
    assert m.target.values == {"a__rho": 2.0, "a__eps": 0.1, "b__rho": 4.0}
    assert [f.opener.description for f in m._body.children] == ["a: quasi smc", "b: sign smc"]


def test_words():
    assert symbol(r"C_{N\alpha}") == "C<sub>Nα</sub>" and symbol(r"\dot\theta_r") == "θ\u0307<sub>r</sub>"
    assert symbol(r"\int e") == "∫e" and symbol(r"\bar q") == "q\u0304" and symbol(r"\lambda(0)") == "λ(0)"
    assert unit_html("kg^-1/2/m") == " [kg<sup>−1/2</sup>/m]" and unit_html("1") == "" and unit_html("[lam]/s") == " [λ]/s"
    assert label("gain", Param()) == "gain" and label("k", Param()) == "$k$"
    said = doc_html(everything.__doc__)
    assert r"$$\begin{aligned}a &amp;= b &lt; c \\" in said and r"d &amp;= e\end{aligned}$$" in said
    assert "Sliding variable" not in said and "<b>Notes</b>" in said
    assert r"<code>code</code>, $\|\sigma\|$ and |text|." in said
    for b in (b for loop in LOOPS.values() for b in loop.stages.values() if b):
        assert not [q for q in ("::", ":math:", "----", "`") if q in doc_html(b.__doc__)]


# ---- curves ------------------------------------------------------------------------------------------------------
@block(state=dict(x=0.5, v=0.0))
def cart(x, u, d):
    return x[1], u + d


@block
def line(e, c=1.0):
    return e[1] + c*e[0]


@block
def relay(sigma, rho: Annotated[float, Param(r"\rho", "N", low=0.0)] = 2.0):
    if rho > 50.0:
        raise ValueError("too strong")
    return rho*((sigma > 0.0) - (sigma < 0.0))


RELAY = ClosedLoop(cart, surface=line, law=relay, duration=5.0, dt=1e-3)


def test_chattering_between_rows_is_drawn():
    run = smc.simulate(RELAY, record=50)
    u = next(c for c in panels(run) if c.key == "u")
    tail = u.x > 4.0
    assert u.y[tail].max() == 2.0 and u.y[tail].min() == -2.0
    assert np.all(np.diff(u.x) > 0) and len(u.x) == 3*len(run.t) - 2
    np.testing.assert_allclose(u.y[::3], run.u)
    inside = np.repeat(run.high.u[1:], 2) >= np.delete(u.y, np.s_[::3]) - 1e-6
    assert inside.all()


def test_a_smooth_curve_stays_as_it_is():
    run = smc.simulate(RELAY.with_(law=smc.smc1.quasi_smc.with_(eps=1.0)))
    sigma = next(c for c in panels(run) if c.key == "sigma")
    np.testing.assert_allclose(np.interp(sigma.x, run.t, run.sigma), sigma.y, atol=2e-5)


def test_panels_of_the_launch_vehicle():
    run = smc.simulate(LOOPS["adaptive_super_twisting"])
    curves = {c.key: c for c in panels(run, ("beta", "dbeta"))}
    assert [(c.key, c.row) for c in curves.values()] == [
        ("y", "output"), ("r", "output"), ("dy", "rate"), ("u", "control"), ("x.beta", "control"), ("x.dbeta", "states [rad/s]"),
        ("sigma", "sliding variable"), ("law.lam", "states of the law"), ("law.w", "states of the law")]
    np.testing.assert_allclose(curves["y"].y, np.degrees(run.y[0]), rtol=1e-6)
    np.testing.assert_allclose(curves["x.beta"].y, np.degrees(run.x.beta), rtol=1e-6)
    assert curves["y"].unit == " [deg]" and curves["dy"].unit == " [deg/s]" and curves["law.lam"].label == "λ"
    assert "sigma" not in [c.key for c in panels(smc.simulate(LOOPS["pd"]))]


def test_panels_of_two_channels():
    @block(state=dict(a=0.1, va=0.0, b=-0.2, vb=0.0))
    def two(x, u, d):
        return x[1], u[0], x[3], u[1]

    @block
    def outputs(x) -> ((Param("a", "rad"), Param("v_a", "rad/s")), (Param("b", "m"), Param("v_b", "m/s"))):
        return (x[0], x[1]), (x[2], x[3])

    @block
    def still(t):
        return 0.0, 0.0

    loop = ClosedLoop(two, output=outputs, reference=still, surface=channels(a=line, b=line), duration=2.0, dt=1e-3,
                      law=channels(a=relay, b=smc.smc2.adaptive_super_twisting))
    picture = live(loop)
    picture.wait()
    assert picture.status == ""
    assert [t.meta for t in picture.figure.data] == list(picture.curves)
    keys = {"y[0]", "dy[0]", "y[1]", "dy[1]", "r[0]", "r[1]", "u[0]", "u[1]", "sigma[0]", "sigma[1]", "law.lam[1]", "law.w[1]",
            "xi[0]", "xi[1]"}
    assert set(picture.curves) == keys
    assert {t.meta: t.xaxis for t in picture.figure.data if t.meta in ("y[0]", "y[1]")} == {"y[0]": "x", "y[1]": "x2"}
    assert picture.figure.layout.yaxis.title.text == "a [deg]" and picture.figure.layout.yaxis2.title.text == "b [m]"


def test_plot():
    runs = {law: smc.simulate(LOOPS[law]) for law in ("pd", "quasi_smc")}
    figure = plot(runs["quasi_smc"])
    assert [t.name for t in figure.data if t.showlegend] == ["θ", "reference"]
    both = plot(runs, states=("beta",))
    assert [t.name for t in both.data if t.showlegend] == ["pd", "reference", "quasi_smc", "β"]
    assert len({t.line.color for t in both.data if t.meta == "y"}) == 2
    tops = [both.layout[f"yaxis{i}"].domain for i in ("", 2, 3, 4)]
    assert all(above[0] > below[1] for above, below in zip(tops, tops[1:], strict=False))  # panels do not overlap


# ---- live plots --------------------------------------------------------------------------------------------------
@pytest.fixture
def picture():
    return live(LOOPS["quasi_smc"], states=("beta",))


def test_curves_follow_the_mask(picture):
    before = {k: t.y.copy() for k, t in picture.curves.items()}
    assert set(before) == {"y", "r", "dy", "u", "x.beta", "sigma"}
    picture.mask.widgets["law__rho"].value = 3.0
    picture.wait()
    assert picture.loop.stages["law"].values["rho"] == 3.0 and picture.run.loop is picture.loop
    for k in set(before) - {"r"}:
        assert not np.array_equal(before[k], picture.curves[k].y)
    np.testing.assert_allclose(picture.curves["y"].y, np.degrees(picture.run.y[0]), rtol=1e-6)
    picture.mask.reset()
    picture.wait()
    np.testing.assert_array_equal(before["u"], picture.curves["u"].y)
    assert "J<sub>e</sub> <b>0.005" in picture._metrics.value and "deg" in picture._metrics.value


def test_a_page_loaded_anew_gets_the_curves_of_now(picture):
    picture.set(law__rho=4.0)
    state, u = picture._picture.get_state(), list(picture.curves).index("u")
    assert state["drawing"]["traces"][u]["meta"] == "u" and "y" not in state["drawing"]["traces"][u]
    for n in ("x", "y"):
        np.testing.assert_array_equal(np.frombuffer(state[n][u], np.float32), getattr(picture.curves["u"], n))
    assert picture.mask.widgets["law__rho"].get_state()["value"] == 4.0


def test_diverged_and_refused_settings_keep_the_curves(picture):
    before, run = picture.curves["y"].y.copy(), picture.run
    picture.set(law__rho=0.2)
    assert picture.status.startswith("diverged at ") and "θ left its limit of 573 deg" in picture.status
    assert "the curves are those of the last good setting" in picture.status and "smcaero-bad" in picture.mask._status.value
    assert picture.run is run and picture.loop.stages["law"].values["rho"] == 0.2
    np.testing.assert_array_equal(before, picture.curves["y"].y)
    typed(picture.mask, "law__rho", "much")
    assert "not allowed" in picture.mask._status.value and picture.mask.entries["law__rho"].value == "much"
    with pytest.raises(ParameterError):
        picture.set(law__rho=-1.0)
    picture.set(law__rho=2.5)
    assert picture.status == picture.mask._status.value == "" and not np.array_equal(before, picture.curves["y"].y)


def test_a_loop_that_diverges_from_the_start_is_shown_as_far_as_it_goes():
    picture = live(smc.lv.loop("quasi_smc", "paper"))
    assert picture.status.endswith("the curves end there.") and picture.curves["y"].x[-1] < 30.0


def test_a_failing_block_is_told_in_words():
    picture = live(RELAY)
    before = picture.curves["u"].y.copy()
    picture.set(law__rho=60.0)
    assert "too strong" in picture.status and "the curves are those of the last good setting" in picture.status
    np.testing.assert_array_equal(before, picture.curves["u"].y)
    picture.set(law__rho=3.0)
    assert picture.status == "" and picture.curves["u"].y.max() == 3.0

    @block
    def wrong(sigma, k=1.0):
        return k*nothing  # noqa: F821

    assert "line" in live(RELAY.with_(law=wrong)).status
    assert "dt" in live(RELAY, dt=-1.0).status
    with pytest.raises(ParameterError, match="did you mean 'beta'"):
        live(LOOPS["pd"], states=("bata",))


def test_choice_of_a_loop_changes_the_panels():
    picture = live({"PD": LOOPS["pd"], "adaptive": LOOPS["adaptive_super_twisting"]})
    height = picture.figure.layout.height
    assert "sigma" not in picture.curves
    picture.mask.choice.value = "adaptive"
    picture.wait()
    assert {"sigma", "law.lam"} <= set(picture.curves) and picture.figure.layout.height > height
    assert [t["meta"] for t in picture._picture.drawing["traces"]] == list(picture.curves)
    picture.mask.choice.value = "PD"
    picture.wait()
    assert "sigma" not in picture.curves and picture.figure.layout.height == height


# ---- long runs ---------------------------------------------------------------------------------------------------
@pytest.fixture
def slow(monkeypatch):
    """A live plot whose runs last until they are told to end, or are cancelled."""
    real, gate = board.simulate, threading.Event()

    def simulate(loop, *args, progress, **options):
        while not gate.wait(0.005):
            progress(0.25)
        return real(loop, *args, progress=progress, **options)

    picture = live(LOOPS["quasi_smc"])
    monkeypatch.setattr(board, "simulate", simulate)
    picture.gate = gate
    yield picture
    gate.set()
    picture.wait()


def busy(picture):
    return picture.job.layout.visibility == "visible"


def test_a_long_run_does_not_hold_up_the_page(slow):
    before = slow.curves["u"].y.copy()
    assert not busy(slow)
    slow.mask.widgets["law__rho"].value = 3.0  # returns though the run goes on
    assert busy(slow) and not slow.job.worker.idle.is_set()
    np.testing.assert_array_equal(before, slow.curves["u"].y)
    slow.gate.set()
    slow.wait()
    assert not busy(slow) and slow.job.bar.value > 0 and slow.run.loop.stages["law"].values["rho"] == 3.0
    assert not np.array_equal(before, slow.curves["u"].y)


def test_cancel(slow):
    before, run = slow.curves["u"].y.copy(), slow.run
    slow.mask.widgets["law__rho"].value = 3.0
    slow.job.stop.click()
    slow.wait()
    assert "Cancelled" in slow.status and not busy(slow) and slow.run is run
    np.testing.assert_array_equal(before, slow.curves["u"].y)
    slow.gate.set()
    slow.set(law__rho=3.5)
    assert slow.status == "" and slow.run.loop.stages["law"].values["rho"] == 3.5


def test_newest_setting_wins(slow):
    for rho in (3.0, 3.5, 4.0):
        slow.mask.widgets["law__rho"].value = rho
    slow.gate.set()
    slow.wait()
    assert slow.run.loop.stages["law"].values["rho"] == 4.0 and slow.status == ""


def test_interrupt_cancels(slow):
    threading.Timer(0.5, _thread.interrupt_main).start()
    with pytest.raises(KeyboardInterrupt):
        slow.set(law__rho=3.0)
    slow.wait()
    assert "Cancelled" in slow.status


def test_an_overtaken_job_is_finished_only_if_it_nearly_is():
    done, started = [], threading.Event()

    def do(job, progress):
        try:
            for k in range(1, 1000):
                started.set()
                time.sleep(0.001)
                progress(k/1000 if job == "long" else 0.9999)
                if job != "long" and newest.job is None and k > 3:
                    break
            done.append(job)
        except Dropped as why:
            done.append(f"{job} {why}")

    newest = Newest(do, lambda: None)
    newest.NEARLY = 0.05
    newest.ask("long")
    started.wait()
    newest.ask("second")
    newest.ask("third")
    newest.idle.wait()
    assert done == ["long overtaken", "third"]
