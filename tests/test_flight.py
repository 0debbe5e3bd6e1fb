"""What a live plot says and draws of a lander: verdict, dead band, every pulse, film."""

import math

import numpy as np
import pytest

import smcaero_nb as smc
from smcaero_nb import ParameterError, rpl, simulate
from smcaero_nb.ui import flight, live, plot
from smcaero_nb.ui.curves import comparison_html, panels
from smcaero_nb.ui.live import rows


@pytest.fixture(scope="module")
def run():
    return simulate(rpl.loop(), record=4800)


@pytest.fixture(scope="module")
def picture():
    shown = live(rpl.loop())
    shown.wait()
    return shown


# ---- live plot -----------------------------------------------------------------------------------
def test_the_verdict_stands_above_the_curves_and_follows_the_mask(picture):
    assert "smcaero-good" in picture._metrics.value
    assert "Landed softly after 2" in picture._metrics.value
    picture.set(plant__offset=-0.015)
    assert "smcaero-bad" in picture._metrics.value
    assert "it hit the ground after 20" in picture._metrics.value
    picture.mask.reset()
    picture.wait()
    assert "Landed softly" in picture._metrics.value
    assert picture.loop.verdict is rpl.landing and picture.loop.with_(verdict=None).verdict is None
    said = picture._metrics.value
    # each channel in its unit
    assert " deg, " in said and "15, 2800 N" in said and " rad, 53" in said


def test_a_loop_without_verdict_has_none():
    assert "verdict" not in comparison_html({"a": simulate(smc.lv.loop("pd"), 1.0)})
    assert "Landed softly" in comparison_html({"a": simulate(rpl.loop())})


def test_every_pulse_is_drawn(picture, run):
    assert rows(rpl.loop()) == 4800 and rows(smc.lv.loop("pd")) == 1000
    assert rows(rpl.loop(), duration=30.0) == 1000
    assert rows(rpl.loop(), tau=0.01) == 1000 and rows(rpl.loop(), duration=480.0, tau=0.1) == 4800
    curves = {c.key: c for c in panels(run)}
    for i in (0, 1):
        u = curves[f"u[{i}]"]
        # held till the next point
        np.testing.assert_allclose(u.y[np.searchsorted(u.x, run.t + 1e-3) - 1], run.u[i], rtol=1e-6)
        assert u.held and picture.curves[f"u[{i}]"].held and len(u.x) < 0.75*len(run.t)
        assert np.all((np.diff(u.x) == 0.0) | (np.diff(u.y) == 0.0))  # level, or upright
    coarse = panels(simulate(rpl.loop(), record=1000))
    assert not any(c.held for c in coarse if not c.filled)


def test_sigma_is_drawn_with_its_dead_band(run):
    curves = {c.key: c for c in panels(run)}
    assert "law.held[0]" not in curves and {"law.rho[0]", "law.rho[1]"} <= set(curves)
    for i, table in enumerate(rpl.TABLE_1.values()):
        band = curves[f"band[{i}]"]
        assert band.row == "sliding variable" and band.reference and band.label == "band"
        for begin, end, delta in table:
            inside = (band.x >= begin) & (band.x < end - 0.01)
            assert {round(float(q), 6) for q in band.y[inside]} == {-delta, delta}
    figure = plot(run)
    axis = next(t.yaxis for t in figure.data if t.meta == "band[1]").replace("y", "yaxis")
    assert figure.layout[axis].range == (-0.5, 0.5)
    assert not any("band" in c.key for c in panels(simulate(rpl.loop("hosm"))))


# ---- the film ------------------------------------------------------------------------------------
def shapes(film):
    """{what: array of points} of the side view, without gaps."""
    names = ("ground", "fire", "legs", "body")
    return {n: np.array([q for q in zip(t.x, t.y, strict=True) if not math.isnan(q[0])])
            for n, t in zip(names, film.figure.data, strict=False)}


def test_the_lander_is_where_and_how_the_run_says(run):
    film = flight(run)
    for t in (0.0, 17.3, 120.0, 239.0):
        film.show(t)
        k = np.searchsorted(run.t, t - 1e-9)
        seen = shapes(film)
        assert seen["ground"][0, 1] == pytest.approx(max(-2.4 - run.x.altitude[k], -26.0))
        across = seen["body"][1] - seen["body"][0]  # along the floor of the body
        angle = math.atan2(across[1], across[0])
        assert angle == pytest.approx(run.x.theta[k] - math.pi/2, abs=1e-9)
        assert f"altitude {run.x.altitude[k]:.1f} m" in film.said and f"t = {t:.2f} s" in film.said


def test_flames_are_the_pulses(run):
    film = flight(run)
    for k in (40, 1000, 2401, 4700):
        film.show(run.t[k])
        left, right, attitude = shapes(film)["fire"].reshape(3, 3, 2)
        sizes = [np.linalg.norm(q[1] - (q[0] + q[2])/2) for q in (left, right, attitude)]
        assert (sizes[0] > 1e-9) == (sizes[1] > 1e-9) == (run.u[1][k] > 0.0)
        assert (sizes[2] > 1e-9) == (run.u[0][k] != 0.0)
        if run.u[0][k]:
            down = (attitude[1] - (attitude[0] + attitude[2])/2)[1] < 0.0
            assert down == (run.u[0][k] > 0.0)
    failed = simulate(rpl.loop().with_(plant__left=0, plant__stuck=5.0), record=4800)
    film = flight(failed)
    film.show(60.0)
    left, right, attitude = shapes(film)["fire"].reshape(3, 3, 2)
    assert np.ptp(left[:, 1]) == pytest.approx(0.0, abs=0.1) and np.ptp(attitude[:, 1]) > 0.5


def test_the_film_follows_the_newest_run(picture):
    film = flight(picture)
    film.show(200.0)
    before = film._picture.curves.y
    picture.set(plant__offset=0.03)
    assert film.run is picture.run
    assert film.t == film.slider.max == pytest.approx(picture.run.t[-1], abs=0.05)
    assert film.t < 200.0
    assert film._picture.curves.y != before
    picture.mask.reset()
    picture.wait()
    assert film.slider.max > 239.0


def test_play_and_slider_are_one(run):
    film = flight(run)
    film._play.value = 1200
    assert film.t == pytest.approx(60.0) and "t = 60.00 s" in film.said
    film.slider.value = 12.35
    assert film._play.value == 247
    film._speed.value = 40
    assert film._play.step == 40


@pytest.mark.parametrize("step", [2, 10, 40])
def test_play_ends_at_touchdown_at_any_speed(run, step):
    """The page adds `step` while the sum is at most `max`, whatever is left over."""
    film = flight(run)
    film._speed.value = step
    while film._play.value + film._play.step <= film._play.max:
        film._play.value += film._play.step
    assert film.t == film.slider.max and film.t - run.stopped_at < 0.05
    assert f"t = {run.t[-1]:.2f} s" in film.said and "touchdown" in film.said
    film.show(run.t[-1] - 0.1)
    assert "touchdown" not in film.said


def test_ground_and_lander_are_on_the_altitude_scale(run):
    """It shows the ground and the lander at any height, and so does the view at touchdown."""
    film, tops = flight(run), set()
    for t in np.linspace(0.0, run.t[-1], 60):
        film.show(t)
        layout = film._picture.curves.drawing["layout"]
        bottom, top = layout["yaxis5"]["range"]
        height = run.x.altitude[np.searchsorted(run.t, film.t + 1e-9) - 1]
        assert film.figure.data[6].y == (height,)
        assert bottom < 0.0 < top and height < 0.92*top and (height > 0.3*top or top == 10.0)
        tops.add(top)
    assert tops >= {10000.0, 1000.0, 100.0, 10.0}
    window = film._picture.curves.drawing["layout"]["yaxis2"]["range"]
    assert window[0] < -2.4 < window[1]  # the ground, at touchdown


@pytest.mark.parametrize("source", [1.0, rpl.loop()])
def test_bad_sources(source):
    with pytest.raises(ParameterError, match="it must be a live plot or a run of a lander"):
        flight(source)


def test_another_vehicle_is_refused():
    with pytest.raises(ParameterError, match="flight: source = .*Run.* is not allowed"):
        flight(simulate(smc.lv.loop("pd"), 1.0))


def test_a_choice_of_another_vehicle_leaves_the_last_lander():
    shown = live({"lander": rpl.loop(), "launcher": smc.lv.loop("pd")})
    shown.wait()
    film = flight(shown)
    last = film.run
    shown.mask.choice.value = "launcher"
    shown.wait()
    assert film.run is last


@pytest.mark.parametrize("off", ["surface__attitude__conditional", "surface__descent__limited"])
def test_an_extension_switched_off_in_the_mask_shows_what_it_is_for(picture, off):
    """Without the reset of the attitude's integral it tumbles, without the limit it crashes."""
    picture.mask.widgets[off].value = False
    picture.wait()
    assert "smcaero-bad" in picture._metrics.value
    assert "it hit the ground after" in picture._metrics.value
    turned = np.ptp(picture.curves["y[0]"].y)  # deg
    assert turned > 360.0 if off.endswith("conditional") else turned < 10.0
    picture.mask.reset()
    picture.wait()
    assert "Landed softly" in picture._metrics.value


def test_a_start_beyond_the_limits_is_said(picture):
    far = rpl.loop().with_(plant__altitude=2e6)
    before = picture.curves["y[1]"].y.copy()
    picture.set(plant__altitude=2e6)
    assert picture.status == ("diverged at 0 s: the start is beyond the limits of the plant; "
                              "the curves are those of the last "
                              "good setting.")
    np.testing.assert_array_equal(picture.curves["y[1]"].y, before)
    picture.mask.reset()
    alone, both = live(far), smc.ui.compare({"far": far, "near": rpl.loop()})
    assert alone.status == "diverged at 0 s: the start is beyond the limits of the plant."
    assert alone.run is None
    assert flight(alone).figure.data == () and not plot(simulate(far)).data[0].x.size
    both.wait()
    assert both.status == "far diverged at 0 s: the start is beyond the limits of the plant"
    assert both.figure.data
    with pytest.raises(ParameterError, match="flight: the run is not allowed; it must have rows"):
        flight(simulate(far))
    far = smc.lv.loop("pd").with_(plant__theta=20.0)
    assert live(far).status.startswith("diverged at 0 s: the start is beyond")


def test_tail_figures_of_a_flight_that_ended_before_its_tail_are_unknown():
    """Not the greatest values of the flight; whether sigma rests, its own last fifth says."""
    run = simulate(rpl.loop("adaptive_smc", "paper"))
    m = run.metrics()
    assert run.stopped_at < 100.0 and run.tail == 0.0
    assert np.isnan([*m.tail_e, *m.tail_sigma, *m.variation_u]).all()
    assert np.isfinite([*m.J_e, *m.max_u]).all()
    assert m.reaching_time == (math.inf, math.inf)
    assert "reaching time <b>not reached, not reached</b>" in smc.ui.curves.metrics_html(run)
    assert "tail" not in smc.ui.curves.metrics_html(run)
    assert "–" in comparison_html({"paper": run})
    assert smc.core.reaching_time(run, 1e9) == [0.0, 0.0]
