"""Figures of trials, identifications and accuracy: their traces hold the numbers of the result."""

import json
import warnings

import control
import numpy as np
import plotly.graph_objects as go
import pytest

import smcaero_nb as smc
from smcaero_nb import prd
from smcaero_nb.applications import perturbed_chain
from smcaero_nb.core import Accuracy
from smcaero_nb.differentiators import Signal, trial
from smcaero_nb.ui import plot
from smcaero_nb.ui.text import result_html

BLUE, ORANGE, GREY = "#0072B2", "#D55E00", "#444"
WORDS = {"confirmed": "circle", "not confirmed": "circle-open", "unresolved": "x-thin-open"}


@pytest.fixture(scope="module")
def probe():
    return prd.experiment(control.tf([1.0], np.poly([-1.0]*3)))()


@pytest.fixture(scope="module")
def two_axes():
    """Input 1 acts on output 1 through a lag, input 2 on output 2; nothing acts across."""
    sys = control.tf([[[1.0], [0.0]], [[0.0], [1.0]]],
                     [[[0.1, 1.0, 0.0, 0.0], [1.0]], [[1.0], [1.0, 0.0, 0.0]]])
    return prd.experiment(sys)()


def named(figure, name):
    return [t for t in figure.data if t.name == name]


def axis(figure, trace, letter):
    place = getattr(trace, f"{letter}axis") or letter
    return figure.layout[place.replace(letter, f"{letter}axis")]


def told(figure):
    return [t.name for t in figure.data if t.showlegend is not False]


def sound(figure):
    """JSON, and so the page, knows all of it; panels and charts are inside the picture, apart."""
    drawn = figure.to_plotly_json()
    bare = [{k: v for k, v in t.items() if k not in ("x", "y")} for t in drawn["data"]]
    json.dumps([bare, drawn["layout"]], allow_nan=False, default=lambda q: np.asarray(q).tolist())
    boxes = {tuple(tuple(axis(figure, t, q).domain or (0.0, 1.0)) for q in "xy")
             for t in figure.data}
    assert all(0.0 <= low < high <= 1.0 + 1e-9 for box in boxes for low, high in box)
    boxes = sorted(boxes)
    for i, (x, y) in enumerate(boxes):
        assert not any(x[0] < q[1] and q[0] < x[1] and y[0] < r[1] and r[0] < y[1] for q,
                       r in boxes[i + 1:])
    return figure


# ---- differentiators -----------------------------------------------------------------------------
def test_trial():
    found = trial().with_(n_d=3, tau=0.02)()
    figure = sound(plot(found))
    estimates, truths = named(figure, "estimate"), named(figure, "truth")
    assert len(estimates) == len(truths) == 4
    for i, (z, f) in enumerate(zip(estimates, truths, strict=True)):
        np.testing.assert_array_equal(z.x, found.t)
        np.testing.assert_array_equal(z.y, found.estimates[i])
        np.testing.assert_array_equal(f.y, found.truth[i])
        assert z.yaxis == f.yaxis and z.line.color == BLUE and f.line.dash == "dot"
        low, high = axis(figure, z, "y").range
        assert low < found.truth[i].min() and high > found.truth[i].max()
    np.testing.assert_array_equal(named(figure, "samples")[0].y, found.f)
    assert [q.text for q in figure.layout.annotations] == ["f", "f'", "f''", "f<sup>(3)</sup>"]
    bars, = (t for t in figure.data if t.type == "bar")
    np.testing.assert_array_equal(bars.y, found.errors)
    assert axis(figure, bars, "y").type == "log"
    assert list(axis(figure, bars, "x").ticktext)[3] == "z<sub>3</sub>"
    for i, (size, slope) in enumerate(zip(found.sizes, found.slopes, strict=True)):
        dots, = named(figure, f"z<sub>{i}</sub>: slope {slope:.2f}")
        line, = (t for t in figure.data if t.legendgroup == f"z<sub>{i}</sub>"
                 and t.mode == "lines")
        np.testing.assert_array_equal(dots.y, size)
        np.testing.assert_array_equal(dots.x, found.tau)
        assert np.polyfit(np.log(line.x), np.log(line.y), 1)[0] == pytest.approx(slope)
        # through the middle of the points
        assert np.log(line.y).mean() == pytest.approx(np.log(size).mean())
    slopes = [f"z<sub>{i}</sub>: slope {s:.2f}" for i, s in enumerate(found.slopes)]
    assert told(figure) == ["samples", "estimate", "truth", *slopes]


def test_trial_of_a_record_has_no_truth_and_no_errors():
    t = np.arange(400)*0.01
    figure = sound(plot(trial((t, np.sin(t)))()))
    assert {q.name for q in figure.data} == {"samples", "estimate"}
    assert not [q for q in figure.data if q.type == "bar"]
    assert plot(trial()()).layout.height > figure.layout.height


def test_a_long_record_keeps_its_extremes():
    t, f = np.arange(60_000)*1e-3, np.zeros(60_000)
    f[31_234], f[47_003] = 5.0, -3.0
    drawn = named(plot(trial(Signal(t, f, "a", "b")).with_(n_d=0, found=False)()), "samples")[0]
    assert len(drawn.x) < 2500 and drawn.x[0] == 0.0 and drawn.x[-1] > 59.9
    assert np.all(np.diff(drawn.x) >= 0.0)
    assert drawn.x[np.argmax(drawn.y)] == t[31_234] and drawn.x[np.argmin(drawn.y)] == t[47_003]


def test_many_orders_and_exact_ones():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        many = sound(plot(trial().with_(n_d=12, tau=0.1)()))
    # no room for 13 slopes
    assert len(named(many, "estimate")) == 13 and told(many) == ["samples", "estimate", "truth"]
    exact = sound(plot(trial().with_(method="implicit", n_d=1)()))
    assert "z<sub>0</sub>" in told(exact)  # rounding has no slope
    still = sound(plot(trial().with_(a_1=0.0, a_2=0.0)()))
    assert named(still, "truth")[0].y.max() == 0.0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sound(plot(trial().with_(n_d=12, omega_1=5.0, a_1=1e300, tau=0.1)()))


# ---- practical relative degree -------------------------------------------------------------------
def test_identification(probe):
    found = probe.result
    assert found.prd == 3
    for figure in (plot(found), plot(probe)):
        sound(figure)
        rows = {t.name: t for t in figure.data
                if t.name in ("y", "y'", "y''", "y<sup>(3)</sup>", "y<sup>(4)</sup>",
                                                             "y<sup>(5)</sup>")}
        np.testing.assert_array_equal(rows["y"].y, found.y)
        for k, row in enumerate(list(rows.values())[1:], 1):
            np.testing.assert_array_equal(row.y, found.analyser.derivatives[k - 1])
            assert row.line.color == (ORANGE if k == 3 else BLUE)  # the one that steps
        star, = (t for t in figure.data if t.meta == "jump")
        assert star.yaxis == rows["y<sup>(3)</sup>"].yaxis
        assert star.x[0] == found.analyser.jump_times[2]
        bands = [q for q in figure.layout.shapes if q.type == "rect"]
        assert len(bands) == 6
        assert {(q.x0, q.x1)
                for q in bands} == {(found.step_time, found.step_time + found.time_scale)}
        law, = named(figure, f"slope {found.power.slope:.2f}")
        assert np.polyfit(np.log(law.x), np.log(law.y), 1)[0] == pytest.approx(found.power.slope)
        assert axis(figure, law, "x").type == axis(figure, law, "y").type == "log"


def test_an_unresolved_identification_has_no_orange_row_and_no_star():
    found = prd.identify(control.tf([1.0, 2.0], [1.0, 3.0]))
    assert found.prd is None
    figure = sound(plot(found))
    rows = [t for t in figure.data if t.name and t.name.startswith("y")]
    assert len(rows) == 6 and ORANGE not in {t.line.color for t in rows}
    assert not [t for t in figure.data if t.meta == "jump"]
    silent = sound(plot(prd.identify((np.arange(400)*1e-3, np.zeros(400), 0.1, 1.0), window=0.05)))
    assert not [t for t in silent.data if t.name and t.name.startswith("slope")]


def dots(figure, prefix=""):
    """{window: (PRD, kind)} as drawn."""
    return {x: (y, kind) for kind in WORDS for t in named(figure, prefix + kind) for x,
            y in zip(t.x, t.y, strict=True)}


def test_sweep():
    swept = prd.sweep(smc.lv.transfer_function(), (0.005, 0.02, 0.1, 0.3, 0.6, 3.0))
    figure = sound(plot(swept))
    assert dots(figure) == {w: (q.prd or 0, "unresolved" if not q.prd else "confirmed"
                                if q.confirmed else "not confirmed")
                            for w, q in zip(swept.windows, swept.results, strict=True)}
    assert len({kind for _, kind in dots(figure).values()}) > 1
    assert {t.name: t.marker.symbol for t in figure.data} == {n: WORDS[n] for n in told(figure)}
    assert figure.layout.xaxis.type == "log" and figure.layout.yaxis.ticktext[0] == "–"
    assert sound(plot(prd.PRDSweep((), ()))).data == ()


def test_the_sweep_of_a_probe_is_that_of_its_numbers_and_shows_the_window(probe):
    figure = plot(probe)
    assert set(dots(figure)) == set(probe.sweep.windows)
    here, = (t for t in figure.data if t.x is not None and len(t.x) == 2 and t.x[0] == t.x[1])
    assert here.x[0] == probe.result.time_scale


def test_vector_relative_degree(two_axes):
    found = two_axes.result
    assert found.prd == (3, 2)
    for figure in (plot(found), plot(two_axes)):
        sound(figure)
        assert [q.text for q in figure.layout.annotations] == [
            "y<sub>1</sub><sup>(3)</sup>", "y<sub>1</sub>'", "y<sub>2</sub>'", "y<sub>2</sub>''"]
        rows = list(figure.data)[:4]
        assert [t.name for t in rows] == ["input 1 to output 1: PRD 3",
                                          "input 2 to output 1: no response",
                                          "input 1 to output 2: no response",
                                          "input 2 to output 2: PRD 2"]
        assert [t.line.color for t in rows] == [ORANGE, BLUE, BLUE, ORANGE]
        np.testing.assert_array_equal(rows[3].y, found.results[1][1].analyser.derivatives[1])
    for i in (0, 1):
        drawn = dots(plot(two_axes), f"output {i + 1}: ")
        # beside the first
        assert {w: r for w, (r, _) in drawn.items()} == {w: (q[i] or 0) + 0.2*i for w, q in zip(
            two_axes.sweep.windows, two_axes.sweep.prd, strict=True)}


# ---- the others ----------------------------------------------------------------------------------
def test_accuracy():
    tau = np.array([4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4])
    sizes = np.array([3.0*tau**2, 2.0*tau])
    sizes[1, 0] = np.nan
    figure = sound(plot(Accuracy(tau, ("sigma", "sigma'"), sizes, (2.0, 1.0), 2, "", None)))
    assert figure.layout.showlegend and told(figure) == ["|σ|: slope 2.00", "|σ'|: slope 1.00"]
    points = [t for t in figure.data if t.mode == "markers"]
    np.testing.assert_array_equal([t.y for t in points], sizes)
    line = next(t for t in figure.data if t.mode == "lines")
    np.testing.assert_allclose(line.y, sizes[0])


def test_runs_and_figures():
    run = smc.simulate(perturbed_chain(smc.smc1.quasi_smc, 1), 1.0, 1e-3)
    one, named_one = plot(run), plot({"a": run})
    u = next(t for t in one.data if t.meta == "u")
    assert u.y.max() == np.float32(run.high.u.max())
    assert [t.meta for t in one.data] == [t.meta for t in named_one.data]
    mine = go.Figure(go.Scatter(x=[1.0, 2.0], y=[3.0, 4.0]), dict(title_text="mine"))
    assert plot(mine).data == mine.data and plot(mine).layout.title == mine.layout.title
    assert plot(mine) is not mine


@pytest.mark.parametrize("wrong", [None, 3.0, "run", [1, 2], {"a": 3.0}, {"a": trial()()}, trial(),
                                   np.zeros(3)],
                         ids=lambda q: type(q).__name__)
def test_something_else_is_refused_in_words(wrong):
    with pytest.raises(TypeError,
                       match=f"plot: {type(wrong).__name__} cannot be drawn; it must be a Run"):
        plot(wrong)


# ---- the sentence above a picture ----------------------------------------------------------------
def test_what_a_result_says_of_itself(probe):
    words = "The experimentally determined PRD is equal to 3"
    assert result_html(probe) == f'<div class="smcaero-result">{words}</div>'
    said = result_html(trial().with_(n_d=3)())
    assert "|z<sub>0</sub> - f| " in said and "|z<sub>1</sub> - f'| " in said
    assert "|z<sub>2</sub> - f''| " in said
    assert "|z<sub>3</sub> - f<sup>(3)</sup>| " in said
    assert result_html(go.Figure()) == result_html(object()) == ""

    class Rude:
        def __str__(self):
            return "<script>alert(1)</script> & x_1"

    words = "&lt;script&gt;alert(1)&lt;/script&gt; &amp; x<sub>1</sub>"
    assert result_html(Rude()) == f'<div class="smcaero-result">{words}</div>'
