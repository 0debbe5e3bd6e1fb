"""What a picture shows of a run: what each number is, what lies between rows, planes, windows."""

import re
import types

import numpy as np
import pytest

import smcaero_nb as smc
from smcaero_nb import ClosedLoop, Param, block, channels, simulate, smc1
from smcaero_nb.applications import double_integrator, perturbed_chain
from smcaero_nb.ui import compare, live, plot
from smcaero_nb.ui.between import band, chatters, held, once
from smcaero_nb.ui.curves import draw, metrics_html, panels
from smcaero_nb.ui.rows import joined, thinned, window

SIGN = perturbed_chain(smc1.sign_smc, 1)
MASS = double_integrator("sign_smc")


@block(state=dict(level=(1.0, Param("h", "m")), heat=(300.0, Param("T", "K")), dye=0.2))
def tank(x, u, d):
    return u, -0.1*(x[1] - 280.0), -x[2]


@block
def of_level(e):
    return e[0]


def arrays(run):
    """All recorded arrays of a run, by the title of their column."""
    lines = [line.split(",") for line in run.to_csv().splitlines()]
    return dict(zip(lines[0], np.array(lines[1:], float).T, strict=True))


# ---- what each number is -------------------------------------------------------------------------
def test_without_an_output_each_state_is_drawn_under_its_name_and_none_is_a_rate():
    loop = ClosedLoop(tank, surface=of_level, law=smc1.sign_smc, duration=1.0, dt=1e-3)
    run = simulate(loop)
    curves = {c.key: c for c in panels(run)}
    assert not any(c.row == "rate" for c in curves.values())
    assert [curves[f"y.{n}"].label for n in ("level", "heat", "dye")] == ["h", "T", "dye"]
    assert len({curves[f"y.{n}"].row for n in ("level", "heat", "dye")}) == 3
    np.testing.assert_array_equal(curves["y.heat"].y, run.x.heat.astype(np.float32))
    titles = [plot(run).layout[f"yaxis{i or ''}"].title.text for i in (0, 2, 3)]
    assert titles == ["h [m]", "T [K]", "dye"]


def test_what_a_sensor_measures_is_drawn_beside_the_output():
    @block
    def coarse(y):
        return 0.1*round(y/0.1)

    run = simulate(SIGN.with_(sensor=coarse, reference=block(lambda t: 0.0)), 2.0)
    curves = {c.key: c for c in panels(run)}
    assert curves["y_m"].row == curves["y"].row == "output"
    np.testing.assert_allclose(np.unique(curves["y_m"].y), np.unique(run.y_m), atol=1e-6)
    assert curves["y_m"].label == "y<sub>m</sub>"


def test_what_a_probe_gives_is_drawn():
    @block(output=Param("P", "W"))
    def power(x, u):
        return x[1]*u

    run = simulate(MASS.with_(probe=power), 2.0)
    curve = next(c for c in panels(run) if c.key == "probe.power")
    np.testing.assert_allclose(curve.y, run.probe.power, rtol=1e-6)
    assert (curve.label, curve.unit) == ("P", " [W]")
    two = simulate(MASS.with_(probe=channels(a=power, b=power)), 2.0)
    assert {"probe.a", "probe.b"} <= {c.key for c in panels(two)}


# ---- between rows --------------------------------------------------------------------------------
@pytest.mark.parametrize("record", [2000, 1000, 500, 333])
def test_a_sawtooth_does_not_vanish_from_a_picture_whatever_the_rows(record):
    """x' = 1 below 1/2, -1 above, every 1 ms: rows an even number of steps apart see none."""
    level = block(lambda x, u, d: (u,), state=dict(level=0.0))
    measured = block(lambda x: x[0] - 0.5)
    relay = block(lambda sigma: 1.0 if sigma >= 0.0 else -1.0)
    loop = ClosedLoop(level, output=measured, law=relay, duration=4.0, dt=1e-3)
    run = simulate(loop, record=record)
    followed = simulate(loop.with_(reference=block(lambda t: 0.0)), record=record)
    drawn = {t.meta: np.array(t.y, float)[np.array(t.x) > 2.0]
             for figure in (plot(run), plot(followed)) for t in figure.data}
    for key, span in (("u", 2.0), ("sigma", 1e-3), ("y", 1e-3)):
        values = np.concatenate([v for n, v in drawn.items() if n in (key, f"{key}.range")])
        assert np.nanmax(values) - np.nanmin(values) == pytest.approx(span, rel=1e-3)


def test_a_band_is_what_the_meters_saw_and_nothing_where_the_rows_say_all():
    t = np.arange(101)*0.1
    smooth = np.sin(t)
    low, high = smooth.copy(), smooth.copy()
    low[1:], high[1:] = np.minimum(smooth[1:], smooth[:-1]), np.maximum(smooth[1:], smooth[:-1])
    assert not chatters(smooth, low, high).any()
    assert len(band(t, smooth, low, high, chatters(smooth, low, high))[0]) == 0
    rough_low, rough_high = low - 0.3*(t > 5.55), high + 0.3*(t > 5.55)
    rough = chatters(smooth, rough_low, rough_high)
    assert not rough[:55].any() and rough[55:].all()
    x, y = band(t, smooth, rough_low, rough_high, rough)
    assert np.nanmin(x) == pytest.approx(5.5) and np.nanmax(x) == 10.0
    assert np.nanmax(y) == rough_high.max() and np.nanmin(y) == rough_low.min()


def test_a_held_signal_has_no_slanted_edge():
    rng = np.random.default_rng(3)
    t, y = np.arange(300)*0.01, rng.choice([-1.0, 0.0, 2.0], 300)
    x, drawn = held(t, y, np.ones(299, bool))
    assert np.all((np.diff(x) == 0.0) | (np.diff(drawn) == 0.0))
    after = np.searchsorted(x, t + 1e-6) - 1
    np.testing.assert_array_equal(drawn[after], y)


def test_the_law_beside_the_chattering_ones_is_drawn_over_their_pale_bands():
    runs = {n: simulate(perturbed_chain(getattr(smc1, n), 1), record=1000)
            for n in ("sign_smc", "quasi_smc", "adaptive_smc", "dual_layer_smc")}
    figure = plot(runs)
    control = [t for t in figure.data if t.meta in ("u", "u.range")]
    kinds = [t.meta for t in control]
    assert kinds == sorted(kinds, reverse=True)  # bands beneath lines
    assert all(float(t.fillcolor.split(",")[-1][:-1]) <= 0.3 for t in control if t.fill)
    lines = [t for t in control if t.meta == "u"]
    assert len({(t.line.color) for t in lines}) == len({t.line.dash for t in lines}) == 4
    assert all(a.line.width > b.line.width for a, b in zip(lines, lines[1:], strict=False))
    assert [t.name for t in figure.data if t.showlegend and t.legend == lines[0].legend] == [*runs]
    assert all(t.line.simplify is False for t in figure.data)


def told(run, **how):
    """Keys of the curves in the legends of a figure of a run."""
    return [t.meta for t in draw({"": panels(run, **how)})[0] if t.showlegend]


def test_a_band_that_is_too_thin_to_be_seen_has_no_entry_in_a_legend():
    sign = simulate(SIGN, record=1000)
    fine = simulate(perturbed_chain(smc.smc2.super_twisting, 1), record=1000)
    assert {*told(sign)} == {"u", "u.range", "xi"}  # sigma chatters by 0.3 % of its range
    assert {*told(fine)} == {"u", "xi"}
    every = joined(sign, simulate(SIGN, since=2.0, duration=2.2, record=200))
    assert "u.range" not in told(every, span=(2.0, 2.2))
    assert "u.range" not in told(sign, span=(30.0, 40.0))  # nothing is in view


def test_two_figures_of_two_channels_are_told_apart():
    said = metrics_html(simulate(smc.rpl.loop(), record=1000))
    assert re.search(r"<b>[\d.]+, [\d.]+ N/s; [\d.]+, [\d.]+ reversals/s</b>", said)


# ---- windows -------------------------------------------------------------------------------------
@pytest.mark.parametrize("loop", [SIGN, MASS, smc.rpl.loop(), smc.lv.loop("quasi_smc")],
                         ids=["chain", "mass", "lander", "launch vehicle"])
def test_a_window_is_the_same_run_with_all_its_steps(loop):
    dt = loop.dt
    run = simulate(loop, record=100)
    part = window(run, (run.t[20] + 0.1*dt, run.t[21] - 0.1*dt), dt)
    fine = simulate(loop, **part)
    assert fine.t[0] == run.t[20] and fine.t[-1] == run.t[21]
    steps = round((run.t[21] - run.t[20])/dt)
    assert len(fine.t) == min(steps, 3000) + 1 or len(fine.t) > 1500
    whole = arrays(joined(run, fine))
    for name, values in arrays(run).items():
        np.testing.assert_array_equal(np.delete(whole[name], np.s_[21:20 + len(fine.t)])[:21],
                                      values[:21])
    for name, values in arrays(fine).items():
        np.testing.assert_array_equal(whole[name][21:21 + len(fine.t) - 1], values[1:])
    assert window(joined(run, fine), (run.t[20], run.t[21]), dt) == {} or steps > 3000


def test_thinned_rows_keep_what_lay_between_them():
    fine, coarse = simulate(SIGN, record=20_000), simulate(SIGN, record=1000)
    made = thinned(fine, 1000)
    for name, values in arrays(coarse).items():
        np.testing.assert_array_equal(arrays(made)[name], values)
    for q in ("sigma", "u"):
        for bound in ("low", "high"):
            np.testing.assert_array_equal(getattr(getattr(made, bound), q),
                                          getattr(getattr(coarse, bound), q))
    np.testing.assert_allclose(made.xi, coarse.xi, atol=1e-9)
    assert thinned(coarse, 1000) is coarse


def test_rows_since_a_time_are_those_of_the_whole_run():
    dt = SIGN.dt
    whole, late = (simulate(SIGN, record=round(20.0/dt), since=s) for s in (0.0, 19.5))
    n = round(0.5/dt) + 1
    assert late.t[0] == pytest.approx(19.5) and len(late.t) == n
    np.testing.assert_array_equal(late.sigma, whole.sigma[-n:])
    assert late.tail_sigma == whole.tail_sigma and late.mean_u == whole.mean_u
    with pytest.raises(smc.ParameterError, match="since = 30 s"):
        simulate(SIGN, since=30.0)


def test_what_is_zoomed_in_a_live_plot_is_recorded_at_full_resolution():
    p = live(SIGN)
    p.wait()
    run = p.run
    p._picture.view.span = [2.0, 2.2]  # as the page says it
    p.wait()
    u, whole = p.curves["u"], simulate(SIGN, record=20_000)
    inside = (u.x > 2.0) & (u.x < 2.2)
    there = whole.u[(whole.t > 2.0) & (whole.t < 2.2)]
    assert np.count_nonzero(np.diff(u.y[inside])) == np.count_nonzero(np.diff(there)) > 100
    assert p.run is run  # the same, with more rows in the picture
    p._picture.view.span = []
    p.wait()
    assert np.count_nonzero(np.diff(p.curves["u"].y[(p.curves["u"].x > 2.0)
                                                    & (p.curves["u"].x < 2.2)])) < 12


def test_what_is_zoomed_in_a_comparison_is_recorded_at_full_resolution():
    both = compare({"sign": SIGN, "quasi": perturbed_chain(smc1.quasi_smc, 1)})
    both.wait()
    runs = both.runs
    both._picture.view.span = [2.0, 2.1]
    both.wait()
    u = next(t for t in both.figure.data if t.meta == "u")
    inside = (u.x > 2.0) & (u.x < 2.1)
    assert np.count_nonzero(np.diff(u.y[inside])) > 50
    assert list(both.runs) == ["sign", "quasi"]
    assert all(both.runs[n] is run for n, run in runs.items())
    assert both._picture.curves.drawing["layout"]["uirevision"] == "kept"  # it stays zoomed


# ---- planes --------------------------------------------------------------------------------------
def test_the_error_plane_has_the_sliding_line():
    run = simulate(MASS, record=2000)
    curves = {c.key: c for c in panels(run, phase=True)}
    plane, line = curves["plane"], curves["line"]
    assert plane.row == line.row and line.reference
    np.testing.assert_allclose(plane.x, run.e[0], atol=1e-6)
    np.testing.assert_allclose(plane.y, run.e[1], atol=1e-6)
    surface = MASS.stages["surface"]
    for e, rate in list(zip(line.x, line.y, strict=True))[::10]:
        if np.isfinite(rate):
            sigma = surface.f((float(e), float(rate)), *surface.p)
            assert sigma == pytest.approx(0.0, abs=1e-5)
    late = run.t > 4.0  # it slides along that line
    order = np.argsort(line.x)
    rates = np.interp(run.e[0][late], line.x[order], line.y[order])
    np.testing.assert_allclose(run.e[1][late], rates, atol=0.02)


def test_every_live_plot_of_degree_2_offers_its_planes():
    for loop in (MASS, smc.lv.loop("quasi_smc")):
        p = live(loop)
        p.wait()
        assert "plane" not in p.curves
        p._planes.value = True
        p.wait()
        assert {"plane", "line", "phase"} <= set(p.curves)
        p._planes.value = False
        p.wait()
        assert "plane" not in p.curves


def test_a_portrait_has_no_chord_that_is_no_motion():
    """A step of the command moves sigma, not the plant: the trajectory is not connected there."""
    run = simulate(smc.applications.dc_motor("twisting"), record=1000)
    phase = next(c for c in panels(run, phase=True) if c.key == "phase")
    assert np.isnan(phase.x).any()
    jump = np.abs(np.diff(phase.x))/np.ptp(run.sigma[0])
    assert np.nanmax(jump) < 0.1 < np.abs(np.diff(run.sigma[0])).max()/np.ptp(run.sigma[0])


def test_the_planes_of_a_comparison_are_as_fine_as_those_of_a_live_plot():
    loop = smc.rpl.loop()
    both, alone = compare({"1-SMC": loop}), live(loop, phase=True)
    both.wait()
    alone.wait()
    for key in ("phase[0]", "plane[1]"):
        drawn = next(t for t in both.figure.data if t.meta == key)
        np.testing.assert_array_equal(drawn.x, alone.curves[key].points[0])


def test_what_a_portrait_draws_twice_is_drawn_once():
    s = np.arange(40_000)*2*np.pi/400
    x, y = once(np.cos(s), np.sin(s))
    assert len(x) < 450 and np.nanmax(np.abs(np.hypot(x, y) - 1.0)) < 1e-9
    angles = np.sort(np.arctan2(y[np.isfinite(y)], x[np.isfinite(x)]))
    assert np.diff(angles).max() < 0.02  # the whole circle


# ---- words ---------------------------------------------------------------------------------------
def test_a_figure_says_in_words_what_it_shows():
    run = simulate(MASS, 1.0)
    assert plot(run).layout.meta["alt"] == "Curves of s [m], s\u0307 [m/s], v, σ over t [s]."
    two = plot({"a": run, "b": run}, phase=True).layout.meta["alt"]
    assert two.endswith("; σ\u0307 over σ; e\u0307 [m/s] over e [m], for a, b.")


def test_no_figure_has_a_button_that_uploads_it():
    made = types.SimpleNamespace(figures=[plot(simulate(MASS, 1.0)), live(MASS).figure,
                                          plot(smc.differentiators.trial()())])
    made.figures.append(plot(plot(simulate(MASS, 1.0))))
    both = compare({"a": MASS, "b": SIGN})
    both.wait()
    for figure in (*made.figures, both.figure):
        assert figure.layout.modebar.remove in (["sendChartToCloud"], ("sendChartToCloud",))


def test_the_sliding_line_is_that_of_the_whole_surface_whatever_it_remembers():
    """A chain gives what its last block gives; memory may be tuples; of a buffer none is known."""
    mass = block(state=dict(s=1.0, v=0.0))(lambda x, u: (x[1], u))
    line, lifted = block(lambda e: e[1] + e[0]), block(lambda e: e + 0.25)
    nested = block(state=dict(m=((0.0, 0.0), (0.25, 0.0))))(
        lambda e, z, tau: (e[1] + e[0] + z[0][1][0], (z[0],)))
    late = block(state=dict(old=smc.Buffer(3)))(
        lambda e, z, tau: (e[1] + e[0] + 0.0*z[0], (e[0],)))
    loop = ClosedLoop(mass, output=block(lambda x: (x[0], x[1])), law=smc.smc1.sign_smc,
                      duration=5.0, dt=1e-2)
    for surface, offset in ((line, 0.0), (smc.chain(line=line, lifted=lifted), 0.25),
                            (nested, 0.25), (late, None)):
        run = smc.simulate(loop.with_(surface=surface), jit=False)
        drawn = [(c.x, c.y) for c in panels(run, phase=True) if c.key == "line"]
        assert len(drawn) == (offset is not None)
        for x, y in drawn:
            seen = np.isfinite(y)
            assert seen.sum() > 10
            np.testing.assert_allclose(y[seen], -x[seen] - offset, atol=1e-6)


def test_states_that_are_tuples_are_drawn_entry_by_entry_and_buffers_are_not():
    body = block(state=dict(q=((1.0, 0.0), Param("q", "m")), s=1.0))(
        lambda x, u: ((x[0][1], -x[0][0]), u))
    law = block(state=dict(w=((0.0, 1.0), (2.0, 3.0)), old=smc.Buffer(4), n=0.0))(
        lambda sigma, z, tau: (-sigma + 0.0*z[1], (z[0], sigma, z[2] + tau)))
    loop = ClosedLoop(body, output=block(lambda x: x[1]), law=law, duration=1.0, dt=0.1)
    run = simulate(loop, jit=False)
    drawn = {c.key: c for c in panels(run, ("q", "s"))}
    assert [n for n in drawn if n.startswith("law.")] == [
        "law.w[0][0]", "law.w[0][1]", "law.w[1][0]", "law.w[1][1]", "law.n"]
    assert drawn["law.w[1][0]"].y.max() == 2.0 and drawn["x.q[0]"].label == "q[0]"
    np.testing.assert_allclose(drawn["x.q[1]"].y, run.x.q[1], rtol=1e-6)
    picture = live(loop, states=("q",))
    picture.wait()
    assert picture.status == "" and "x.q[1]" in picture.curves
