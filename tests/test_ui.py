"""Masks and live plots, without a browser: the page's part is in tests/browser."""

import _thread
import math
import signal
import subprocess
import sys
import threading
import time
import warnings
from typing import Annotated, Literal

import ipywidgets
import numpy as np
import plotly.graph_objects as go
import pytest

import smcaero_nb as smc
from smcaero_nb import ClosedLoop, Param, ParameterError, block, channels
from smcaero_nb.applications.double_integrator import mass, position
from smcaero_nb.ui import live, mask, plot, transfer_function, upload
from smcaero_nb.ui.curves import panels
from smcaero_nb.ui.job import Newest, Overtaken
from smcaero_nb.ui.text import doc_html, label, symbol, unit_html

LOOPS = {law: smc.lv.loop(law) for law in smc.lv.PRESETS}


@block(state=dict(m=(0.5, Param("m_0", "kg"))))
def everything(sigma, z, tau,
               gain: Annotated[float, Param("k", "[v]/[sigma]^1/2", low=0.0, help="gain",
                                            slider=(0.0, 10.0))] = 2.0,
               width: Annotated[float, Param(r"\varepsilon", "m^2", low=1e-9, log=True,
                                             slider=(1e-3, 10.0))] = 0.1,
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
    code = ("import sys, smcaero_nb as smc; few = {'plotly', 'ipywidgets', 'anywidget'};"
            "assert not few & set(sys.modules);"
            "smc.ui.mask; assert few <= set(sys.modules)")
    subprocess.run([sys.executable, "-c", code], check=True)


# ---- masks ---------------------------------------------------------------------------------------
def test_a_remark_on_what_was_typed_is_said():
    m = mask(smc.smc1.decoupling(((2.0, 1.0), (1.0, 1.0))))
    m.entries["G0_11"].value = "1.00001"
    assert m.target.values["G0_11"] == 1.00001 and "nearly singular" in m._status.value
    assert "smcaero-good" in m._status.value
    m.entries["G0_11"].value = "1"
    assert "is singular" in m._status.value and "It stays at 1.00001" in m._status.value


def test_form_follows_the_metadata():
    m = mask(everything)
    kinds = {"gain": ipywidgets.FloatSlider, "width": ipywidgets.FloatLogSlider,
             "order": ipywidgets.IntSlider,
             "smooth": ipywidgets.Checkbox, "free": ipywidgets.FloatSlider,
             "m": ipywidgets.FloatSlider}
    assert {n: type(w) for n, w in m.widgets.items()} == kinds
    assert list(m.entries) == [n for n in kinds if n != "smooth"]
    assert m.values == everything.values
    gain, width, order = (m.widgets[n] for n in ("gain", "width", "order"))
    assert (gain.min, gain.max, gain.tooltip) == (0.0, 10.0, "gain")
    assert gain.description == r"$k$ $\mathrm{[v]/[σ]^{1/2}}$"
    assert (width.min, width.max) == (-3.0, 1.0)
    assert width.description == r"$\varepsilon$ $\mathrm{[m^{2}]}$"
    assert (order.min, order.max, order.description) == (1, 5, "$n$")
    assert m.widgets["smooth"].description == "smooth"
    assert m.widgets["free"].min <= -3.0 < m.widgets["free"].max
    assert m.page.told.names["gain"] == ("gain [v]/[sigma]^1/2", False)


def test_sliders_are_fit_for_their_values():
    """Sliders are useful for thrusters of 15 N and of 2800 N, and for pulses of whole samples."""
    m = mask(smc.rpl.loop())
    for name, w in m.widgets.items():
        if isinstance(w, ipywidgets.FloatSlider) and m.values[name]:
            assert w.step <= abs(m.values[name])/(1 if name.endswith("pulse") else 2), name
    high, pulse = m.widgets["actuator__attitude__high"], m.widgets["actuator__descent__pulse"]
    assert (high.min, high.max) == (0.0, 60.0) and (pulse.min, pulse.step) == (0.05, 0.05)
    for w in (m.widgets["actuator__descent__high"], pulse):
        w.value = w.max
        assert m._status.value == "" and smc.simulate(m.target, 1.0).steps == 1000
    fast = mask(smc.rpl.loop().with_(tau=0.02)).widgets["actuator__descent__pulse"]
    assert (fast.min, fast.step) == (0.02, 0.02)
    slow = mask(smc.rpl.loop().with_(tau=0.7)).widgets["actuator__descent__pulse"]
    assert (slow.min, slow.max) == (0.7, 0.7)
    given = live(smc.rpl.loop(), duration=1.0, tau=0.1).mask.widgets["actuator__descent__pulse"]
    assert (given.min, given.step) == (0.1, 0.1)


def test_sliders_of_odd_ranges():
    @block(state=dict(held=(0.0, Param("h", hidden=True))))
    def odd(u, z, tau, one: Annotated[float, Param(slider=(1.0, 1.0))] = 3.0,
            only: Annotated[float, Param(low=2.0, high=2.0)] = 2.0,
            pulse: Annotated[float, Param("T", "s", low=0.0, samples=True)] = 0.2, below=-1e-3,
            far: Annotated[float, Param(slider=(-200.0, 200.0))] = 1.0):
        return u, z

    m = mask(smc.rpl.loop().with_(actuator=smc.channels(attitude=odd, descent=odd)),
             include=["actuator__attitude"])
    low, high = ([getattr(m.widgets[f"actuator__attitude__{n}"], q) for n in odd.params]
                 for q in ("min", "max"))
    assert low == [1.0, 2.0, 0.05, -0.004, -4.0] and high == [3.0, 2.0, 0.8, 0.0, 4.0]
    with pytest.raises(ParameterError, match="include"):
        mask(smc.rpl.loop(), include=["actuator__attitude__held"])


def test_no_two_controls_of_a_group_look_alike():
    m = mask(smc.rpl.loop())
    titles = [fold.opener.description for fold in m._body.children]
    assert len(set(titles)) == len(titles)
    assert {"initial state: attitude", "initial state: descent", "initial state"} <= {*titles}
    for fold in m._body.children:
        said = [getattr(row, "description", None) or row.children[0].description
                for row in fold.rows]
        assert len(set(said)) == len(said), (fold.opener.description, said)
    assert "actuator__attitude__held" not in m.widgets and "law__attitude__held" not in m.widgets


@pytest.mark.parametrize("law", LOOPS)
def test_every_control_reaches_both_ends(law):
    m = mask(LOOPS[law])
    assert set(m.widgets) == {*LOOPS[law].settable(), "method", "latency"}
    for name, w in m.widgets.items():
        if name not in LOOPS[law].settable():
            continue
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
    assert typed(m, "order", "3") == "" and m.values["order"] == 3
    assert isinstance(m.values["order"], int)
    m.widgets["gain"].value = 4.0
    assert m.values["gain"] == 4.0 and m.entries["gain"].value == "4"


@pytest.mark.parametrize("text", ["abc", "", " ", "nan", "inf", "1e999", "-5", "1,5", "2**3",
                                  "0x10", "<b>", "1 2"])
def test_nonsense_is_refused_in_words(text):
    m = mask(everything)
    said = typed(m, "gain", text)
    assert "gain" in said and "is not allowed" in said and "a finite number, at least 0 [v]" in said
    assert "It stays at 2." in said
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
    # what the page answers, when it draws the sliders
    for name, shown in (("gain", 3.0), ("width", 0.1230)):
        m.widgets[name].set_state({"value": shown})
    assert m.values["gain"] == 3.017 and m.values["width"] == 0.123456
    m.widgets["gain"].set_state({"value": 3.15})
    m.widgets["width"].set_state({"value": 0.15488166})
    assert m.values["gain"] == 3.15 and m.values["width"] == 0.155


def test_include():
    loop = LOOPS["quasi_smc"]
    some = mask(loop, include=("law", "plant__I"))
    assert list(some.widgets) == ["law__rho", "law__eps", "plant__I"]
    with pytest.raises(ParameterError, match="rho"):
        mask(loop, include=("rho",))


def test_groups_of_a_loop():
    m = mask(LOOPS["quasi_smc"])
    folds = m._body.children
    assert [f.opener.description for f in folds] == [
        "surface: itae", "law: quasi smc", "allocation: gimbal to control", "reference: steps",
        "perturbation: misalignment",
        "plant: launcher", "simulation", "initial state"]
    assert [f.opener.value for f in folds] == [True]*3 + [False]*5
    plant = folds[5]
    assert not plant.body.children
    plant.opener.value = True
    assert len(plant.body.children) == len(LOOPS["quasi_smc"].stages["plant"].params)
    assert plant.body in plant.children
    plant.helper.value = True
    assert "ddot" in plant.doc.value and plant.doc in plant.children
    plant.opener.value = plant.helper.value = False
    assert len(plant.children) == 1


def test_every_stage_has_a_group_the_design_before_the_world():
    @block
    def scaled(y, gain=1.0):
        return y[0]*gain, y[1]*gain

    @block
    def left(t, end=4.0):
        return end - t

    m = mask(RELAY.with_(sensor=scaled, stop=left))
    assert {"sensor__gain", "stop__end"} <= set(m.widgets)
    folds = {f.opener.description: f.opener.value for f in m._body.children}
    assert list(folds) == ["sensor: scaled", "surface: line", "law: relay", "stop: left",
                           "simulation", "initial state"]
    assert folds["sensor: scaled"] and not folds["stop: left"]


def test_a_mask_offers_latency_and_method_of_its_loop():
    """Both are in force in the live plot, and come along to another loop of the same world."""
    picture = live({"line": RELAY, "relay": RELAY.with_(law=relay.with_(rho=3.0))})
    picture.wait()
    m, before = picture.mask, picture.run
    assert m.widgets["method"].options == ("euler", "midpoint", "rk4") and m.method == "euler"
    slider = m.widgets["latency"]
    assert (slider.min, slider.max, slider.step, slider.value) == (0.0, 0.01, 1e-3, 0.0)
    slider.value = 0.002
    picture.wait()
    assert picture.run.loop == RELAY.with_(latency=0.002) and picture.status == ""
    assert picture.run.metrics().tail_sigma > 1.5*before.metrics().tail_sigma
    m.widgets["method"].value = "rk4"
    picture.wait()
    assert m.method == m.values["method"] == "rk4"
    exact = smc.simulate(RELAY.with_(latency=0.002), method="rk4", record=5000)
    np.testing.assert_array_equal(picture.run.x.x, exact.x.x)
    m.choice.value = "relay"
    picture.wait()
    assert m.method == "rk4" and m.target.latency == 0.002
    m.reset()
    assert m.method == "euler" and m.target.latency == 0.0
    with pytest.raises(ParameterError, match="mask: method = 'exact' is not allowed; it must be "
                                             "one of 'euler', 'midpoint', 'rk4'"):
        picture.set(method="exact")
    typed(m, "latency", "1e-4")
    picture.wait()
    assert "latency = 0.0001 s is not allowed; it must be a multiple of dt" in picture.status
    assert "method" not in mask(everything).widgets and mask(everything).method is None


def test_a_linear_plant_of_python_control_may_be_advanced_exactly():
    import control

    @block
    def free(y):
        return 0.0*y[0]

    plant = smc.interop.from_control(control.tf([1.0], [1.0, 2e-3, 1.0]))
    loop = ClosedLoop(plant, law=free, duration=20.0, dt=0.5).with_(plant__x0=1.0)
    picture = live(loop)
    assert picture.mask.method == picture.mask.widgets["method"].options[0] == "exact"
    picture.wait()
    assert max(picture.run.x.x0) <= 1.0
    picture.set(method="euler")
    assert picture.mask.method == "euler" and max(picture.run.x.x0) > 2.0


def test_a_row_is_called_by_the_last_part_of_its_name():
    """Its group says the rest; only where two are alike, the row says which is which."""
    @block
    def offset(y, by=0.1):
        return y[0] + by, y[1]

    @block(state=dict(w=0.0))
    def integrating(sigma, z, tau):
        return sigma + z[0], (z[0] + tau*sigma,)

    m = mask(RELAY.with_(sensor=smc.chain(first=offset, second=offset.with_(by=-0.1)),
                         law=integrating, differentiator=integral))
    assert m.widgets["sensor__first__by"].description == "by"
    assert m.widgets["sensor__first__by"].tooltip == "sensor first by"
    assert {"sensor first: offset", "sensor second: offset"} <= {
        f.opener.description for f in m._body.children}
    assert m.widgets["law__w"].description == "$w$ (law)"
    assert m.widgets["differentiator__w"].description == "$w$ (differentiator)"
    assert m.widgets["plant__v"].description == "$v$"


# ---- rows of tuples and matrices -----------------------------------------------------------------
@block(state=dict(q=((1.0, 0.0, 0.0, 0.0), Param("q", low=-1.0, high=1.0)),
                  late=smc.core.Buffer(5)))
def body(sigma, z, tau, J: Annotated[tuple, Param("J", "kg m^2", low=0.0)] =
         ((2.0, 0.0, 0.0), (0.0, 3.0, 0.0), (0.0, 0.0, 4.0)),
         axis=(0.0, 1.0), on: Annotated[bool, Param()] = (True, False)):
    return J[1][1]*sigma*axis[1], (z[0], sigma)


def text_at(m, name, *at):
    return m._rows[name].texts[at]


def test_a_tuple_is_a_row_of_entries_and_a_matrix_rows_of_them():
    m, seen = mask(body), []
    m.observe(lambda change: seen.append(change.new), "target")
    assert [len(m._rows[n].texts) for n in ("J", "axis", "on", "q")] == [9, 2, 2, 4]
    lines = m.widgets["J"].children[1].children
    assert [[text.value for text in line.children] for line in lines] == [
        ["2", "0", "0"], ["0", "3", "0"], ["0", "0", "4"]]
    assert "J" not in m.entries and m.widgets["J"].children[0].value.startswith("$J$")
    text_at(m, "J", 1, 1).value = " 2.50 "
    assert m.values["J"] == ((2.0, 0.0, 0.0), (0.0, 2.5, 0.0), (0.0, 0.0, 4.0))
    assert text_at(m, "J", 1, 1).value == " 2.50 " and len(seen) == 1
    text_at(m, "q", 3).value = "1e-3"
    assert m.target.values["q"] == (1.0, 0.0, 0.0, 1e-3)
    text_at(m, "on", 1).value = "1"
    assert m.target.values["on"] == (True, True)
    m.set(axis=[1.0, 2.0])
    assert [text_at(m, "axis", i).value for i in (0, 1)] == ["1", "2"]
    m.reset()
    assert m.target == body and text_at(m, "J", 1, 1).value == "3"
    assert m.page.told.names["J-0-2"] == ("J 1, 3 kg m^2", False) and "J" not in m.page.told.names


@pytest.mark.parametrize("text, said", [("x", "'x'"), ("-1", "-1 kg m^2"), ("nan", "nan kg m^2"),
                                        ("", "''"), ("1,5", "'1,5'")])
def test_nonsense_in_an_entry_of_a_matrix_is_refused_in_words(text, said):
    m = mask(body)
    text_at(m, "J", 0, 2).value = text
    assert f"J[0][2] = {said} is not allowed; it must be a finite number, at least 0" in (
        m._status.value)
    assert "It stays at ((2, 0, 0), (0, 3, 0), (0, 0, 4))." in m._status.value
    assert m.target is body and text_at(m, "J", 0, 2).value == text
    assert [at for at, q in m._rows["J"].texts.items()
            if "smcaero-refused" in q._dom_classes] == [(0, 2)]
    text_at(m, "J", 0, 2).value = "0.5"
    assert m.values["J"][0] == (2.0, 0.0, 0.5) and m._status.value == ""
    assert "smcaero-refused" not in text_at(m, "J", 0, 2)._dom_classes


def test_a_buffer_has_a_row_with_the_parameters_of_its_block():
    m = mask(body)
    assert [f.opener.description for f in m._body.children] == ["body", "initial state"]
    assert (m.widgets["late"].min, m.widgets["late"].max) == (1, 20)
    assert typed(m, "late", "50") == "" and m.target.values["late"] == 50
    assert "a whole number from 1 to 1e+07 samples" in typed(m, "late", "0.5")


def test_a_mask_of_entries_is_mended_after_ctrl_c():
    m = mask(body)
    m._rows["J"].texts[0, 0].unobserve_all()
    text_at(m, "J", 0, 0).value = "7"  # which nobody heard of
    m.mend()
    assert text_at(m, "J", 0, 0).value == "2"


def test_choice_of_loops():
    m = mask({"quasi": LOOPS["quasi_smc"], "PD": LOOPS["pd"]})
    m.set(law__rho=3.0, perturbation__f_0=0.1)
    m.choice.value = "PD"
    assert "law__k_p" in m.widgets and "law__rho" not in m.widgets
    assert m.target.stages["law"].name == "pd"
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
    assert symbol(r"C_{N\alpha}") == "C<sub>Nα</sub>"
    assert symbol(r"\dot\theta_r") == "θ\u0307<sub>r</sub>"
    assert symbol(r"\int e") == "∫e" and symbol(r"\bar q") == "q\u0304"
    assert symbol(r"\lambda(0)") == "λ(0)"
    assert unit_html("kg^-1/2/m") == " [kg<sup>−1/2</sup>/m]" and unit_html("1") == ""
    assert unit_html("[lam]/s") == " [λ]/s"
    assert label("gain", Param()) == "gain" and label("k", Param()) == "$k$"
    said = doc_html(everything.__doc__)
    assert r"$$\begin{aligned}a &amp;= b &lt; c \\" in said and r"d &amp;= e\end{aligned}$$" in said
    assert "Sliding variable" not in said and "<b>Notes</b>" in said
    assert r"<code>code</code>, $\|\sigma\|$ and |text|." in said
    for b in (b for loop in LOOPS.values() for b in loop.stages.values() if b):
        assert not [q for q in ("::", ":math:", "----", "`") if q in doc_html(b.__doc__)]


# ---- curves --------------------------------------------------------------------------------------
@block(state=dict(x=0.5, v=0.0))
def cart(x, u, d):
    return x[1], u + d


@block
def line(e, c=1.0):
    return e[1] + c*e[0]


@block(state=dict(w=0.0))
def integral(e, z, tau):
    return e, (z[0] + tau*e[0],)


@block
def relay(sigma, rho: Annotated[float, Param(r"\rho", "N", low=0.0)] = 2.0):
    if rho > 50.0:
        raise ValueError("too strong")
    return rho*((sigma > 0.0) - (sigma < 0.0))


RELAY = ClosedLoop(cart, surface=line, law=relay, duration=5.0, dt=1e-3)


def test_chattering_between_rows_is_a_band_around_its_mean():
    run = smc.simulate(RELAY, record=50)
    curves = {c.key: c for c in panels(run)}
    u, band = curves["u"], curves["u.range"]
    assert np.isin(band.x[np.isfinite(band.x)], run.t.astype(np.float32)).all()
    assert set(band.y[np.isfinite(band.y)].tolist()) == {-2.0, 2.0}  # as the meters say
    assert np.nanmin(band.x) < 1.0 and np.nanmax(band.x) == 5.0
    for t, mean in zip(u.x[u.x > 1.0], u.y[u.x > 1.0], strict=True):
        k = int(np.argmin(np.abs(run.t - t)))
        a, b = k - 1, min(k + 1, 50)  # the rows are further apart than 1 % of the run
        v = run.integral_v[b] - run.integral_v[a]
        assert mean == pytest.approx(v/(run.t[b] - run.t[a]), abs=1e-6)
    sigma, middle = curves["sigma"], 0.5*(run.low.sigma + run.high.sigma)
    late = sigma.x > 1.0
    np.testing.assert_allclose(sigma.y[late], middle[-np.count_nonzero(late):], atol=1e-7)


def test_a_smooth_curve_stays_as_it_is():
    run = smc.simulate(RELAY.with_(law=smc.smc1.quasi_smc.with_(eps=1.0)))
    sigma = next(c for c in panels(run) if c.key == "sigma")
    np.testing.assert_allclose(np.interp(sigma.x, run.t, run.sigma), sigma.y, atol=2e-5)


def test_panels_of_the_launch_vehicle():
    run = smc.simulate(LOOPS["adaptive_super_twisting"])
    curves = {c.key: c for c in panels(run, ("beta", "dbeta"))}
    assert [(c.key, c.row) for c in curves.values()] == [
        ("y", "output"), ("r", "output"), ("dy", "rate"), ("u.range", "control"),
        ("u", "control"), ("x.beta", "control"),
        ("x.dbeta", "states [rad/s]"),
        ("sigma", "sliding variable"), ("band", "sliding variable"),
        ("law.lam", "states of the law"), ("law.w", "states of the law")]
    np.testing.assert_allclose(curves["y"].y, np.degrees(run.y[0]), rtol=1e-6)
    np.testing.assert_allclose(curves["x.beta"].y, np.degrees(run.x.beta), rtol=1e-6)
    assert curves["y"].unit == " [deg]" and curves["dy"].unit == " [deg/s]"
    assert curves["law.lam"].label == "λ"
    assert "sigma" not in [c.key for c in panels(smc.simulate(LOOPS["pd"]))]


def test_panels_of_two_channels():
    @block(state=dict(a=0.1, va=0.0, b=-0.2, vb=0.0))
    def two(x, u, d):
        return x[1], u[0], x[3], u[1]

    @block(output=((Param("a", "rad"), Param("v_a", "rad/s")),
                   (Param("b", "m"), Param("v_b", "m/s"))))
    def outputs(x):
        return (x[0], x[1]), (x[2], x[3])

    @block
    def still(t):
        return 0.0, 0.0

    loop = ClosedLoop(two, output=outputs, reference=still, surface=channels(a=line, b=line),
                      duration=2.0, dt=1e-3,
                      law=channels(a=relay, b=smc.smc2.adaptive_super_twisting))
    picture = live(loop)
    picture.wait()
    assert picture.status == ""
    assert [t.meta for t in picture.figure.data] == list(picture.curves)
    keys = {"y[0]", "dy[0]", "y[1]", "dy[1]", "r[0]", "r[1]", "u[0]", "u[1]", "sigma[0]",
            "sigma[1]", "band[1]", "law.lam[1]", "law.w[1]",
            "xi[0]", "xi[1]"}
    assert set(picture.curves) == keys
    assert {t.meta: t.xaxis for t in picture.figure.data
            if t.meta in ("y[0]", "y[1]")} == {"y[0]": "x", "y[1]": "x2"}
    assert picture.figure.layout.yaxis.title.text == "a [deg]"
    assert picture.figure.layout.yaxis2.title.text == "b [m]"


def test_plot():
    runs = {law: smc.simulate(LOOPS[law]) for law in ("pd", "quasi_smc")}
    figure = plot(runs["quasi_smc"])
    assert [t.name for t in figure.data if t.showlegend] == ["θ", "reference", "σ", "band"]
    both = plot(runs, states=("beta",))
    assert [t.name for t in both.data if t.showlegend] == ["pd", "reference", "quasi_smc"]
    for look in "color", "dash", "width":  # told apart in grey print, too
        assert len({t.line[look] for t in both.data if t.meta == "y"}) == 2
    beta, u = ({t.yaxis for t in both.data if t.meta == n} for n in ("x.beta", "u"))
    assert len(beta) == 1 and beta.isdisjoint(u)  # a dash is a run, not a quantity
    tops = [both.layout[f"yaxis{i}"].domain for i in ("", 2, 3, 4, 5)]
    # panels do not overlap
    assert all(above[0] > below[1] for above, below in zip(tops, tops[1:], strict=False))


# ---- live plots ----------------------------------------------------------------------------------
@pytest.fixture
def picture():
    p = live(LOOPS["quasi_smc"], states=("beta",))
    p.wait()
    return p


def test_curves_follow_the_mask(picture):
    before = {k: t.y.copy() for k, t in picture.curves.items()}
    assert set(before) - {"u.range"} == {"y", "r", "dy", "u", "x.beta", "sigma", "band"}
    picture.mask.widgets["law__rho"].value = 3.0
    picture.wait()
    assert picture.loop.stages["law"].values["rho"] == 3.0 and picture.run.loop is picture.loop
    for k in set(before) - {"r", "u.range"}:
        assert not np.array_equal(before[k], picture.curves[k].y)
    np.testing.assert_allclose(picture.curves["y"].y, np.degrees(picture.run.y[0]), rtol=1e-6)
    picture.mask.reset()
    picture.wait()
    np.testing.assert_array_equal(before["u"], picture.curves["u"].y)
    assert "J<sub>e</sub> <b>0.005" in picture._metrics.value and "deg" in picture._metrics.value


def test_a_page_loaded_anew_gets_the_curves_of_now(picture):
    picture.set(law__rho=4.0)
    state, u = picture._picture.curves.get_state(), list(picture.curves).index("u")
    assert state["drawing"]["traces"][u]["meta"] == "u" and "y" not in state["drawing"]["traces"][u]
    for n in ("x", "y"):
        np.testing.assert_array_equal(np.frombuffer(state[n][u], np.float32),
                                      getattr(picture.curves["u"], n))
    assert picture.mask.widgets["law__rho"].get_state()["value"] == 4.0


def test_a_lost_run_is_drawn_to_its_end_before_the_last_good_one_in_grey(picture):
    before, run = picture.curves["y"], picture.run
    picture.set(law__rho=0.2)
    assert picture.status.startswith("diverged at ")
    assert "θ left its limit of 573 deg" in picture.status
    assert picture.status.endswith("the curves end there, those of the last good setting are grey.")
    assert "smcaero-bad" in picture.mask._status.value
    assert picture.run is run and picture.loop.stages["law"].values["rho"] == 0.2
    assert picture.curves["y"].x[-1] < 30.0 and abs(picture.curves["y"].y[-1]) > 500.0
    shadow = shadows(picture)
    assert {"y", "dy", "u", "sigma"} <= set(shadow)
    np.testing.assert_array_equal(shadow["y"], (before.x, before.y))
    typed(picture.mask, "law__rho", "much")
    assert "not allowed" in picture.mask._status.value
    assert picture.mask.entries["law__rho"].value == "much"
    with pytest.raises(ParameterError):
        picture.set(law__rho=-1.0)
    picture.set(law__rho=2.5)
    assert picture.status == picture.mask._status.value == ""
    assert not np.array_equal(before.y, picture.curves["y"].y)


def shadows(picture):
    """{key: (x, y)} of the curves in grey behind the others."""
    drawn = [*picture.curves]
    return {drawn[n]: tuple(np.frombuffer(q, np.float32) for q in xy)
            for n, *xy in picture._picture.curves.behind}


def test_the_setting_before_stays_as_a_shadow(picture):
    first = picture.curves["y"].y
    assert shadows(picture) == {}
    picture.set(law__rho=3.0)
    second = picture.curves["y"].y
    np.testing.assert_array_equal(shadows(picture)["y"][1], first)
    picture._rested -= 10.0  # as if it had been looked at
    for rho in (3.1, 3.2, 3.3):  # a slider on its way
        picture.set(law__rho=rho)
        np.testing.assert_array_equal(shadows(picture)["y"][1], second)


def test_a_lost_run_leaves_no_shadow_behind_the_next_good_one(picture):
    good = picture.curves["y"].y
    picture.set(law__rho=0.2)
    assert picture.status.startswith("diverged")
    picture.set(law__rho=2.5)
    np.testing.assert_array_equal(shadows(picture)["y"][1], good)  # it does not set the scale


def test_while_a_run_is_going_the_curves_are_grey_and_those_of_another_law_are_gone(monkeypatch):
    picture = live({"quasi": LOOPS["quasi_smc"], "adaptive": LOOPS["adaptive_super_twisting"]})
    picture.wait()
    module, gate = sys.modules[live.__module__], threading.Event()
    real = module.simulate

    def slow(*args, progress, **options):
        while not gate.wait(0.005):
            progress(0.5)
        return real(*args, progress=progress, **options)

    monkeypatch.setattr(module, "simulate", slow)
    state = picture._picture.curves
    picture.mask.widgets["law__rho"].value = 3.0
    assert state.state == "old" and picture.curves
    gate.set()
    picture.wait()
    assert state.state == ""
    gate.clear()
    picture.mask.choice.value = "adaptive"
    assert state.state == "gone" and picture.curves == {} and picture.figure.data == ()
    picture.cancel()
    picture.job.wait()
    assert state.state == "gone" and picture.status.startswith("Cancelled")
    picture.mask.choice.value = "quasi"
    gate.set()
    picture.wait()
    assert state.state == "" and {"y", "sigma"} <= set(picture.curves)


def test_a_loop_that_diverges_from_the_start_is_shown_as_far_as_it_goes():
    picture = live(smc.lv.loop("quasi_smc", "paper"))
    picture.wait()
    assert picture.status.endswith("the curves end there.") and picture.curves["y"].x[-1] < 30.0


def test_a_failing_block_is_told_in_words():
    picture = live(RELAY)
    before = picture.curves["u"].y.copy()
    picture.set(law__rho=60.0)
    assert picture._picture.curves.state == "old"
    assert "too strong" in picture.status
    assert "the curves are those of the last good setting" in picture.status
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
    picture.wait()
    height = picture.figure.layout.height
    assert "sigma" not in picture.curves
    picture.mask.choice.value = "adaptive"
    picture.wait()
    assert {"sigma", "law.lam"} <= set(picture.curves) and picture.figure.layout.height > height
    assert [t["meta"] for t in picture._picture.curves.drawing["traces"]] == list(picture.curves)
    picture.mask.choice.value = "PD"
    picture.wait()
    assert "sigma" not in picture.curves and picture.figure.layout.height == height


# ---- long runs -----------------------------------------------------------------------------------
@pytest.fixture
def slow(monkeypatch):
    """A live plot whose runs last until they are told to end, or are cancelled."""
    module, gate = sys.modules[live.__module__], threading.Event()
    real = module.simulate

    def simulate(loop, *args, progress, **options):
        while not gate.wait(0.005):
            progress(0.25)
        return real(loop, *args, progress=progress, **options)

    picture = live(LOOPS["quasi_smc"])
    picture.wait()
    monkeypatch.setattr(module, "simulate", simulate)
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
    assert not busy(slow) and slow.job.bar.value > 0
    assert slow.run.loop.stages["law"].values["rho"] == 3.0
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
    interrupted = threading.Event()
    # a shell may start what runs in its background without it
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)

    def press():
        # Python drops an interrupt that comes while it clears up objects
        while not interrupted.wait(1.0):
            _thread.interrupt_main()

    threading.Thread(target=press, daemon=True).start()
    with pytest.raises(KeyboardInterrupt):
        slow.set(law__rho=3.0)
    interrupted.set()
    signal.signal(signal.SIGINT, handler)
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
        except Overtaken:
            done.append(f"{job} overtaken")

    newest = Newest(do, lambda: None)
    newest.NEARLY = 0.05
    newest.ask("long")
    started.wait()
    newest.ask("second")
    newest.ask("third")
    newest.idle.wait()
    assert done == ["long overtaken", "third"]


# ---- choices -------------------------------------------------------------------------------------
@block(check=lambda v: "mode fast needs k > 1" if v["mode"] == "fast" and v["k"] <= 1.0 else None)
def moded(mode: Annotated[Literal["slow", "fast"], Param("mode", help="how")] = "slow",
          k: Annotated[float, Param(r"k", "V", low=0.0, high=100.0)] = 2.0,
          n: Annotated[int, Param("n", low=1, high=5)] = 1):
    """A curve."""
    if k > 90.0:
        raise ZeroDivisionError("no k so large")
    if k > 80.0:
        sys.exit("leaving")
    if k > 70.0:
        return object()
    if k > 60.0:
        warnings.warn("k is large", UserWarning, stacklevel=2)
        warnings.warn("k is large", UserWarning, stacklevel=2)
    return go.Figure(go.Scatter(x=[0.0, 1.0], y=[0.0, k*(1 + (mode == "fast"))], name=mode))


def test_a_choice_is_a_list():
    m = mask(moded)
    w = m.widgets["mode"]
    assert isinstance(w, ipywidgets.Dropdown) and w.options == ("slow", "fast")
    assert w.value == "slow"
    assert (w.description, w.tooltip) == ("mode", "how") and "mode" not in m.entries
    w.set_state({"index": 1})  # as the page sends it
    assert m.target.values["mode"] == "fast" and m._status.value == ""
    m.set(mode="slow")
    assert w.value == "slow" and w.index == 0
    w.value = "fast"
    m.reset()
    assert w.value == "slow" and m.values == moded.values


def test_a_refused_choice_is_said():
    m = mask(moded)
    m.set(k=0.5)
    m.widgets["mode"].value = "fast"
    assert "mode fast needs k &gt; 1. It stays at slow." in m._status.value
    assert m.values["mode"] == "slow"
    assert "smcaero-refused" in m._rows["mode"].box._dom_classes
    m.set(k=2.0)
    assert m.widgets["mode"].value == "slow" and m._status.value == ""


# ---- sliders and their page ----------------------------------------------------------------------
def test_late_answers_of_the_page_move_nothing():
    m = mask(everything)
    gain, width = m.widgets["gain"], m.widgets["width"]
    for a, b in ((3.0, 1.0), (7.0, 0.01), (5.0, 0.1)):
        m.set(gain=a, width=b)
    for answer in (3.0, 7.0):  # to values set before; the page had them when it drew
        gain.set_state({"value": answer})
        assert m.values["gain"] == 5.0 and gain.value == 5.0
    width.set_state({"value": 1.0})
    assert m.values["width"] == 0.1 and width.value == pytest.approx(0.1)
    gain.set_state({"value": 3.0})  # answered already: now it is a person
    assert m.values["gain"] == 3.0
    gain.set_state({"value": 6.0})  # never told
    assert m.values["gain"] == 6.0


def test_told_values_are_forgotten_in_the_end():
    m = mask(everything)
    for k in range(200):
        m.set(gain=0.05*k)
    assert len(m._rows["gain"].told) < 40


# ---- several targets -----------------------------------------------------------------------------
@block
def narrow(mode: Annotated[Literal["slow", "fast"], Param("mode")] = "slow",
           k: Annotated[float, Param("k", high=10.0)] = 2.0,
           n: Annotated[int, Param("n", low=1, high=5)] = 3, own: float = 1.0):
    """Another curve: n begins at another value, and k ends earlier."""
    return go.Figure(go.Scatter(x=[0.0, 1.0], y=[k, n]))


def test_what_was_changed_comes_along_to_another_block():
    m = mask({"a": moded, "b": narrow})
    m.set(mode="fast", k=7.0, n=5)
    m.choice.value = "b"
    assert m.values == dict(mode="fast", k=7.0, n=3, own=1.0)  # n is meant to differ
    assert m.widgets["mode"].value == "fast" and m.entries["k"].value == "7"
    m.reset()
    assert m.values == narrow.values


def test_what_is_not_allowed_there_stays_behind():
    m = mask({"a": moded, "b": narrow})
    m.set(mode="fast", k=50.0)
    m.choice.value = "b"
    assert m.values == dict(mode="fast", k=2.0, n=3, own=1.0) and "own" in m.widgets
    m.choice.value = "a"
    assert m.values["k"] == 50.0


def test_offer():
    m, seen = mask(moded), []
    assert m.choice not in m._head.children
    m.observe(lambda change: seen.append(change.new.name), "target")
    m.set(k=5.0)
    m.offer("more", narrow)
    assert m.choice in m._head.children and m.choice.value == "more"
    assert m.choice.options == ("moded", "more")
    assert seen == ["moded", "narrow"] and m.values["k"] == 5.0 and "own" in m.widgets
    m.set(own=4.0)
    m.offer("more", narrow.with_(own=9.0))  # under the same name: it takes the place of the other
    assert m.choice.options == ("moded", "more") and m.values["own"] == 9.0
    assert m.entries["own"].value == "9"
    m.set(own=1.0)
    m.reset()
    assert m.values["own"] == 9.0
    m.choice.value = "moded"
    assert m.target.name == "moded" and m.values["k"] == 5.0


# ---- live plots of a block -----------------------------------------------------------------------
@pytest.fixture
def drawn():
    p = live(moded)
    p.wait()
    return p


def sent(picture):
    """[(x, y)] as the page gets them."""
    pairs = zip(picture._picture.curves.x, picture._picture.curves.y, strict=True)
    return [tuple(np.frombuffer(q, np.float32).tolist() for q in pair) for pair in pairs]


def test_a_block_is_called_and_drawn(drawn):
    assert drawn.status == "" and drawn.loop is drawn.mask.target and drawn.curves == {}
    assert sent(drawn) == [([0.0, 1.0], [0.0, 2.0])]
    drawn.mask.widgets["k"].value = 5.0
    drawn.mask.widgets["mode"].value = "fast"
    drawn.wait()
    assert sent(drawn) == [([0.0, 1.0], [0.0, 10.0])]
    assert drawn._picture.curves.drawing["traces"][0]["name"] == "fast"
    assert drawn.figure.data[0].y == (0.0, 10.0) and drawn.run.data[0].name == "fast"
    # a picture has no numbers to take away
    assert drawn._metrics.value == "" and drawn._download.saved.file == ""


@pytest.mark.parametrize("k, said",
                         [(95.0, "ZeroDivisionError: no k so large"), (85.0, "SystemExit: leaving"),
                                     (75.0, "TypeError: plot: object cannot be drawn")])
def test_whatever_a_block_raises_is_said_and_the_curves_stay(drawn, k, said):
    run, before = drawn.run, sent(drawn)
    drawn.set(k=k)
    assert drawn.status.startswith(said)
    assert drawn.status.endswith("; the curves are those of the last good setting.")
    assert "smcaero-bad" in drawn.mask._status.value and drawn.run is run and sent(drawn) == before
    drawn.set(k=4.0)
    assert drawn.status == drawn.mask._status.value == ""
    assert sent(drawn) == [([0.0, 1.0], [0.0, 4.0])]


def test_warnings_are_remarks_and_said_as_long_as_they_hold(drawn):
    for k in (65.0, 66.0):
        drawn.set(k=k)
        assert drawn.status == "k is large."
        assert drawn.mask._status.value == '<span class="smcaero-good">k is large.</span>'
        assert sent(drawn)[0][1][1] == k
    drawn.set(k=1.0)
    assert drawn.mask._status.value == ""


def test_a_block_that_never_succeeded():
    @block
    def broken(k=1.0):
        raise ValueError("<b>no</b>")

    p = live(broken)
    p.wait()
    assert p.status.startswith("ValueError: <b>no</b>") and "<b>" not in p.mask._status.value
    assert p.run is None and p.figure.data == ()

    @block
    def asks(x, k=1.0):
        return x

    p = live(asks)
    p.wait()
    assert "TypeError" in p.status and "'x'" in p.status


def test_any_figure_of_plotly_is_drawn_as_it_is():
    made = [go.Scatter(y=[1.0, 2.0]), go.Pie(values=[1, 2]), go.Bar(x=["a", "b"], y=[3, 4]),
            go.Heatmap(z=[[1, 2], [3, 4]]),
            go.Scatter(x=1.7e9 + np.arange(3.0), y=[0, 1, 2]),
            go.Scatter(x=np.arange(3.0), y=101325.0 + 1e-3*np.arange(3)),
            go.Scatter(x=[0.0, 1.0, 2.0], y=[1.0, np.nan, 3.0]),
            go.Scatter(x=[0.0, 1.0], y=[np.nan, np.nan]),
            go.Scatter(x=[0.0, 1.0, 2.0], y=[0.0, 1e39, -2e39])]

    @block
    def figures(k: Annotated[int, Param("k", low=0, high=8)] = 0):
        return go.Figure(made[k])

    p = live(figures)
    for k, trace in enumerate(made):
        p.set(k=k)
        assert p.status == ""
        here, (x, y) = p._picture.curves.drawing["traces"][0], sent(p)[0]
        for q, numbers in (("x", x), ("y", y)):
            wanted = trace[q] if q in trace else None
            if numbers:  # as float32
                assert q not in here and numbers == pytest.approx(list(wanted), nan_ok=True)
            else:  # in the trace, as plotly writes it
                assert here.get(q) == go.Figure(trace).to_plotly_json()["data"][0].get(q)
            assert bool(numbers) == (wanted is not None
                                     and (k, q) not in {(2, "x"), (4, "x"), (5, "y"), (8, "y")})


def test_a_trial_is_drawn_said_and_saved():
    p = live({"two tones": smc.differentiators.trial(), "loop": LOOPS["pd"]})
    p.set(n_d=1, tau=0.02)
    assert p.run.estimates.shape == (2, 1001) and p.status == ""
    np.testing.assert_array_equal(sent(p)[1][1], p.run.estimates[0].astype(np.float32))
    assert "L = 2; maximum errors in the second half: |z<sub>0</sub> - f|" in p._metrics.value
    button, messages = p._download.saved, []
    assert button.file == "two tones, estimates.csv"
    button.send = lambda content, buffers: messages.append(buffers)
    button._handle_custom_msg({}, [])  # pressed
    assert messages == [[p.run.to_csv().encode()]]
    p.set(L=0.5)
    assert "L = 0.5 is less than the 1.12" in p.status
    assert "the theorem does not cover this" in p.mask._status.value
    before = p.run
    p.set(tau=0.9)
    assert "tau = 0.9 s is not allowed" in p.status and p.run is before
    p.mask.choice.value = "loop"
    p.wait()
    assert set(p.curves) - {"u.range"} == {"y", "r", "dy", "u"} and p.status == ""
    assert button.file == ""  # a run is not what the button would save
    p.mask.choice.value = "two tones"
    p.wait()
    assert "tau = 0.9 s is not allowed" in p.mask._status.value
    assert p.curves == {} and p.figure.data == ()  # those of the loop are not the trial's
    p.set(tau=0.02, L=2.0)
    assert p.curves == {} and p.status == "" and button.file == "two tones, estimates.csv"


# ---- one's own files -----------------------------------------------------------------------------
def csv(head="t,f", rows=200, sep=",", start=0):
    return "\n".join([head, *(sep.join(f"{v:.6g}"
                                       for v in (0.01*k, np.sin(0.01*k), k)[:len(head.split(sep))])
                              for k in range(start, start + rows))]).encode()


@pytest.fixture
def own():
    p = live(smc.differentiators.trial())
    p.wait()
    return upload(p, smc.differentiators.read_csv, smc.differentiators.trial)


def test_a_file_of_ones_own(own):
    assert list(own.entries) == ["t", "f"] and own._head.children == (own.button,)
    for first, piece in ((True, csv()[:500]), (False, csv()[500:])):  # as the page sends it
        own.button._handle_custom_msg({"name": "mine.csv", "first": first, "last": not first},
                                      [memoryview(piece)])
    own.live.wait()
    assert own.status.startswith("mine.csv: 200 rows, 2 columns, delimiter comma; "
                                 "t = 't' [s], f = 'f'")
    assert own.live.mask.choice.value == "mine.csv" and own.live.status == ""
    assert "smcaero-good" in own._message.value
    np.testing.assert_allclose(own.live.run.f, np.sin(0.01*np.arange(200)), atol=1e-6)
    assert own.live._download.saved.file == "mine, estimates.csv"
    assert own._head.children == (own.button, *own.entries.values())
    columns = ("–", "t", "f")
    assert [(w.options, w.value) for w in own.entries.values()] == [(columns, "t"), (columns, "f")]


def test_another_column_is_another_signal(own):
    own.take("mine.csv", csv("t,f,g"))
    own.live.set(n_d=1)
    own.entries["f"].value = "g"
    own.live.wait()
    np.testing.assert_allclose(own.live.run.f, np.arange(200))
    assert "f = 'g'" in own.status
    own.entries["t"].value = "f"  # goes up, then down
    assert "'f'" in own.status and "times must increase" in own.status
    assert "smcaero-bad" in own._message.value
    assert own.live.run.f[-1] == 199.0  # still the last good one
    own.take("mine.csv", csv(start=100))  # the same name again
    own.live.wait()
    assert own.live.run.t[0] == 1.0
    assert own.live.mask.choice.options == ("differentiation", "mine.csv")


@pytest.mark.parametrize("head, chosen", [("t,f", "tf"), ("F,T", "TF"), ("row,t,y", "ty"),
                                          ("y,t", "ty"), (",t,y", "ty"),
                                          ("time [s],x", ("time", "x")), ("f,x", ("x", "f")),
                                          ("time [s],T [K]", ("time", "T")),
                                          ("T,Time", ("Time", "T")),
                                          ("t,y – filtered", ("t", "y – filtered")),
                                          ("F,t,f", "tf")])
def test_columns_are_guessed_by_name_then_by_place_and_none_twice(own, head, chosen):
    own.take("a.csv", (head + "\n" + "".join(",".join([str(k)]*len(head.split(","))) + "\n"
                                             for k in range(150))).encode())
    assert [w.value for w in own.entries.values()] == list(chosen)
    assert own.live.mask.choice.value == "a.csv"


@pytest.mark.parametrize("content, said", [
    (b"", "a line of names and lines of numbers are needed"),
    (b"0,1\n1,2\n", "line 1: the first line must hold the names of the columns, not numbers"),
    (b"f\n1\n2\n", "only one column"),
    (b"t,f\n0,1\n1,nan\n", "line 3: column 2 ('f'): 'nan' is not a finite number"),
    (b"t,f\n0,1\n1,two\n", "line 3: column 2 ('f'): 'two' is not a finite number"),
    (b"t,f\n1,1\n1,2\n", "line 3: column 1 ('t'): 1 after 1; times must increase"),
    (b"t,f\n0,1\n1\n", "line 3: 1 columns, but 2 names"),
    (b"t,f,f\n0,1,1\n1,2,2\n", "f = 'f' names 2 columns"),
    (b"\x89PNG\r\n\x1a\n\x00", "only one column"),
    (b't,f\n0,"' + b"x"*200_000 + b'"\n', "is not a finite number"),
])
def test_a_bad_file_is_said_and_the_plot_stays(own, content, said):
    own.take("good.csv", csv())
    own.live.wait()
    run = own.live.run
    own.take("<b>bad.csv", content)
    assert said in own.status and "<b>bad.csv" in own.status
    assert "<b>" not in own._message.value and "smcaero-bad" in own._message.value
    assert own.live.mask.choice.value == "good.csv" and own.live.run is run
    assert own.live.status == ""
    own.take("good.csv", csv())
    assert "smcaero-good" in own._message.value


def test_names_with_html_are_only_text(own):
    own.take("<img src=x onerror=alert(1)>.csv", csv("t,<script>f</script>"))
    own.live.wait()
    assert "<img" not in own._message.value
    assert "<script" not in own._message.value + own.live._metrics.value
    assert "<img src=x onerror=alert(1)>.csv: 200 rows" in own.status and own.live.run is not None


def test_a_record_that_cannot_be_differentiated_is_said_below_the_mask(own):
    own.take("short.csv", csv(rows=5))
    own.live.wait()
    assert "are too few" in own.live.status and own.live.figure.data == ()
    own.live.set(n_d=0)
    assert own.live.status == "" and len(own.live.run.t) == 5


def test_what_is_found_and_not_used_is_said(own):
    """L and the window of a record are chosen automatically; a value that is set is ignored."""
    own.take("a.csv", csv())
    own.live.wait()
    assert own.live.status == ""
    own.live.set(L=80.0)
    assert own.live.status == (
        "L is chosen automatically, so the value you set is ignored; turn off 'find L' to use it.")
    own.live.set(found=False)
    assert own.live.run.L == 80.0 and own.live.status == ""
    t = np.arange(800)*1e-3
    p = live(smc.prd.experiment((t, (t - 0.3).clip(0.0)**2, 0.3, 1.0)))
    p.wait()
    assert p.status == ""
    p.set(window=0.1)
    assert p.status == (
        "w is chosen automatically, so the value you set is ignored; turn off 'find w' to use it.")
    p.set(found=False)
    assert p.status == "" and p.run.result.time_scale == 0.1


def test_a_log_of_a_step_response():
    p = live(smc.prd.experiment(mass, output=position))
    p.wait()
    log = upload(p, smc.prd.read_csv, smc.prd.experiment)
    assert [type(w).__name__ for w in log.entries.values()] == ["Dropdown"]*3 + ["Text"]*2
    t = np.arange(800)*1e-3
    y = (t - 0.3).clip(0.0)**2
    rows = "".join(f"{a:.3f},{b:.8g}\n" for a, b in zip(t, y, strict=True)).encode()
    log.take("log.csv", b"t,y\n" + rows)
    assert "there is no column of the input: give step_time [s]" in log.status
    assert p.mask.choice.value == ""
    log.entries["step_time"].value = "0,3"
    assert "step time: '0,3' is not a finite number" in log.status
    log.entries["step_time"].value = "5"
    assert "step_time = 5 s is not allowed; it must be inside the record" in log.status
    log.entries["step_time"].value = " 0.3 "
    p.wait()
    assert "step of 1 at 0.3 s" in log.status and p.mask.choice.value == "log.csv"
    assert p.run.result.prd == 2
    assert p.run.result.gain == pytest.approx(2.0, rel=0.01)
    log.entries["amplitude"].value = "4"
    p.wait()
    assert p.run.result.gain == pytest.approx(0.5, rel=0.01)
    log.entries["amplitude"].value = "0"
    assert "amplitude = 0 [u] is not allowed" in log.status and p.run.result.amplitude == 4.0
    log.take("other.csv", b"t,y\n" + rows)
    # of the file before
    assert log.entries["step_time"].value == log.entries["amplitude"].value == ""
    assert "give step_time" in log.status
    rows = "".join(f"{a:.3f},{b:.8g},{4.0*(a >= 0.3)}\n" for a,
                   b in zip(t, y, strict=True)).encode()
    log.take("three.csv", b"t,y,push\n" + rows)
    p.wait()
    assert "step of 4 at 0.3 s" in log.status and log.entries["u"].value == "push"
    log.entries["u"].value = "–"
    assert "there is no column of the input: give step_time [s]" in log.status


# ---- one's own transfer function -----------------------------------------------------------------
@pytest.fixture
def typed_in():
    p = live(smc.prd.experiment(mass))
    p.wait()
    return transfer_function(p, smc.prd.experiment)


def identify(own, numerator, denominator):
    own.entries["numerator"].value, own.entries["denominator"].value = numerator, denominator
    own.button.click()
    own.live.wait()
    return own.status


@pytest.mark.parametrize("numerator, denominator, name, order", [
    ("1", "1 3 3 1", "(1)/(s^3 + 3s^2 + 3s + 1)", 3),
    ("1", "2, 5,5", "(1)/(2s + 5.5)", 1), ("1", "1,3,3", "(1)/(s^2 + 3s + 3)", 2),
    (" 2, 1 ", "1;0\t-4", "(2s + 1)/(s^2 - 4)", 1),
    ("-1 0", "0 1 0 1 0", "(-s)/(s^3 + s)", 2),
    ("1e-3", "1 0.5 0", "(0.001)/(s^2 + 0.5s)", 2),
])
def test_a_transfer_function_of_ones_own(typed_in, numerator, denominator, name, order):
    assert identify(typed_in, numerator, denominator) == f"{name} is chosen in the mask."
    assert typed_in.live.mask.choice.value == name and typed_in.live.run.result.prd == order
    assert typed_in.live.status == ""


@pytest.mark.parametrize("numerator, denominator, said", [
    ("", "1 1", "numerator: '' is not a finite number"),
    ("1", "  ", "denominator: '' is not a finite number"),
    ("0,5", "1 0",
     "numerator: '0,5' may be one number or two; "
     "put blanks between coefficients, a point in a number"),
    ("a", "1", "numerator: 'a' is not a finite number"),
    ("1", "1 nan", "denominator: 'nan' is not a finite number"),
    ("1", "1 1e999", "denominator: '1e999' is not a finite number"),
    ("s+1", "1 1", "numerator: 's+1' is not a finite number"),
    ("0 0", "1 1", "numerator: '0 0' is not allowed; at least one coefficient must not be 0"),
    ("1", "0", "denominator: '0' is not allowed; at least one coefficient must not be 0"),
    ("1 0 0", "1 1", "improper from input 1 to output 1: degree 2 over 1"),
    ("<b>", "1 1", "numerator: '<b>' is not a finite number"),
])
def test_a_bad_transfer_function_is_said_and_the_plot_stays(typed_in, numerator, denominator, said):
    run = typed_in.live.run
    assert said in identify(typed_in, numerator, denominator)
    assert "smcaero-bad" in typed_in._message.value and "<b>" not in typed_in._message.value
    assert typed_in.live.run is run and typed_in.live.mask.choice.options == ("",)


def test_a_long_text_is_shortened_where_it_is_refused(typed_in):
    said = identify(typed_in, "1", "x"*5000)
    assert said.startswith("denominator: 'xxx") and said.endswith("is not a finite number")
    assert len(said) < 200


# ---- an observer ---------------------------------------------------------------------------------
def test_an_observers_estimate_has_a_panel_of_its_own():
    loop = smc.applications.dc_motor("quasi_continuous").with_(
        differentiator=smc.differentiators.differentiator(1, of="y").with_(L=4000.0),
        allocation=smc.differentiators.observer(2).with_(G0=307.5, L=1e4))
    run = smc.simulate(loop, 0.05, record=200)
    curves = {c.key: c for c in panels(run)}
    xi = curves["allocation.xi"]
    np.testing.assert_array_equal(xi.y, run.z.allocation.xi.astype(np.float32))
    assert [c.key for c in curves.values() if c.row == xi.row] == ["allocation.xi"]
    assert "xi" not in curves
    figure = plot(run)
    drawn = next(t for t in figure.data if t.meta == "allocation.xi")
    place = f"yaxis{drawn.yaxis[1:]}"
    assert figure.layout[place].title.text.startswith("ξ\u0302")
    assert [t.meta for t in figure.data if t.yaxis == drawn.yaxis] == ["allocation.xi"]


def test_whatever_goes_wrong_with_an_own_file_is_said(drawn):
    def make(signal):
        raise RuntimeError("no such thing")

    own = upload(drawn, smc.differentiators.read_csv, make)
    own.take("a.csv", b"t,f\n0,1\n1,2\n")
    assert own.status == "RuntimeError: no such thing" and drawn.mask.choice.value != "a.csv"
