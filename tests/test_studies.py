"""Phase portrait, comparison, certificate of the order of sliding, runs no theorem covers."""

import threading

import numpy as np
import pytest

import smcaero_nb as smc
from smcaero_nb import ParameterError, block, smc1, smc2
from smcaero_nb.applications import perturbed_chain
from smcaero_nb.ui import certificate, compare, live, plot, studies
from smcaero_nb.ui.curves import comparison_html

CHAINS = {name: perturbed_chain(law, 1).with_(duration=5.0) for name, law in (
    ("sign", smc1.sign_smc), ("quasi", smc1.quasi_smc), ("saturation", smc1.saturation_smc),
    ("tanh", smc1.tanh_smc),
    ("super-twisting", smc2.super_twisting))}


@pytest.fixture
def picture():
    p = live(CHAINS, phase=True)
    p.wait()
    return p


# ---- phase portrait ------------------------------------------------------------------------------
def test_phase_portrait_moves_with_the_sliders(picture):
    before = picture.curves["phase"]
    x, y = before.x.copy(), before.y.copy()
    assert x[0] == 1.0 and y[0] == pytest.approx(0.8 - 2.0, abs=0.01)  # sigma' = xi - rho
    picture.set(law__rho=4.0)
    after = picture.curves["phase"]
    assert after.y[0] == pytest.approx(0.8 - 4.0, abs=0.01) and not np.array_equal(x, after.x)
    assert picture.figure.layout.height > live(CHAINS).figure.layout.height


def test_panels_of_the_chain(picture):
    assert set(picture.curves) == {"u", "xi", "sigma", "phase"}  # y = -sigma says nothing more
    assert picture.curves["xi"].y == pytest.approx(0.8*np.cos(1.2*picture.curves["xi"].x), abs=0.02)
    xi = next(t for t in picture.figure.data if t.meta == "xi")
    assert xi.name == "ξ" and xi.line.dash == "dot"


def test_phase_portrait_of_higher_order_is_sigma_and_its_derivative():
    run = smc.simulate(perturbed_chain(smc.hosmc.quasi_continuous(3), 3), 3.0, record=200)
    figure = plot({"a": run, "b": run}, phase=True)
    portrait = next(t for t in figure.data if t.meta == "phase")
    np.testing.assert_allclose(portrait.y, run.sigma[1].astype(np.float32))
    assert figure.layout.xaxis2.title.text == "σ" and figure.layout.xaxis.title.text == "t [s]"
    assert sum(t.meta == "xi" for t in figure.data) == 1  # once for both


def test_phase_portraits_of_two_channels():
    from chain import loop_of_two, signs

    for law in (signs(), smc1.unit_vector):
        figure = plot(smc.simulate(loop_of_two(law, a=0.5), 3.0, 1e-3), phase=True)
        portraits = [t.meta for t in figure.data if t.meta.startswith("phase")]
        assert portraits == ["phase[0]", "phase[1]"]


# ---- the theorem ---------------------------------------------------------------------------------
def test_a_perturbation_beyond_the_bound_is_simulated_and_said(picture):
    before = picture.curves["sigma"].y.copy()
    picture.set(perturbation__xi_1=3.0)
    assert picture.status.startswith("In doubt: |xi| reaches 3, more than rho = 2 [v]; sigma does ")
    assert not np.array_equal(before, picture.curves["sigma"].y) and picture.run.diverged_at is None
    assert "smcaero-good" in picture.mask._status.value
    picture.set(law__rho=4.0)
    assert picture.status == ""


def test_many_doubts_are_lines_of_which_the_last_fold_away(picture, monkeypatch):
    doubts = [f"q{i} <is> 1, more than rho" for i in range(5)]
    monkeypatch.setattr(smc.Run, "doubts", lambda run: doubts)
    picture.set(law__rho=3.5)
    assert picture.status == "In doubt: " + "\n".join(f"{q}." for q in doubts)
    said = picture.mask._status.value
    shown, more = said.split("<details>")
    assert shown.count("<br>") == 2 and "q2 &lt;is&gt; 1" in shown and "q3" not in shown
    assert "<summary>and 2 more</summary>" in more and "q3" in more and "q4" in more
    monkeypatch.undo()
    picture.mask.reset()
    picture.wait()
    assert picture.status == ""


# ---- comparison ----------------------------------------------------------------------------------
def test_a_comparison_says_the_doubts_of_each_run_and_integrates_as_the_mask_says():
    strong = CHAINS["sign"].with_(perturbation__xi_1=1.5)
    two = {"weak": strong.with_(law__rho=1.0), "strong": strong}
    shown = live(two)
    shown.wait()
    shown.set(method="rk4")
    both = compare(shown)
    both.wait()
    assert both.status.startswith("weak: |xi| reaches 1.5, more than rho = 1 [v]; sigma does not ")
    assert "smcaero-good" in both._message.value
    shown.set(method="midpoint")
    said, changed = both.status.split("\n")
    assert said.startswith("weak: |xi|") and changed.startswith("The mask has changed since")
    shown.set(method="rk4")
    assert both.status == said
    exact = smc.simulate(strong, method="rk4", record=1000)
    np.testing.assert_array_equal(both.runs["strong"].sigma, exact.sigma)


def test_comparison_of_up_to_four(picture):
    c = compare(picture)
    c.wait()
    assert list(c.runs) == ["sign", "quasi", "saturation", "tanh"]
    for name, run in c.runs.items():
        assert f'<th scope="row">{name}</th>' in c._above.value
        assert f"<td>{run.metrics().tail_sigma:.3g}</td><td>{run.mean_v:.3g}</td>" in c._above.value
    assert {t.name for t in c.figure.data} >= set(c.runs)
    fifth = c._toggles["super-twisting"]
    fifth.value = True
    c.wait()
    assert not fifth.value and "At most 4 laws" in c.status and len(c.runs) == 4
    c.set("super-twisting", "sign")
    assert list(c.runs) == ["sign", "super-twisting"]
    smooth, rough = (c.runs[law].metrics().variation_u for law in ("super-twisting", "sign"))
    assert smooth < 0.01*rough
    with pytest.raises(ParameterError, match="one to 4 of sign, quasi"):
        c.set("twisting")
    with pytest.raises(ParameterError, match="one to 4"):
        c.set()


def test_comparison_takes_the_settings_of_the_mask(picture):
    c = compare(picture)
    c.wait()
    picture.set(law__rho=5.0, perturbation__xi_1=0.2)
    assert "Refresh uses its settings" in c.status
    picture.mask.reset()
    assert c.status == ""  # all is again as it is drawn
    picture.set(law__rho=5.0, perturbation__xi_1=0.2)
    c._again.click()
    c.wait()
    assert c.status == ""
    assert c.runs["sign"].loop.stages["law"].values["rho"] == 5.0
    assert c.runs["quasi"].loop.stages["law"].values["rho"] == 2.0
    # one world for all
    assert {r.loop.stages["perturbation"].values["xi_1"] for r in c.runs.values()} == {0.2}


def test_comparison_of_loops_that_fail():
    @block
    def broken(sigma):
        return math.nothing  # noqa: F821

    loops = {"held": smc.lv.loop("quasi_smc"), "lost": smc.lv.loop("quasi_smc", "paper")}
    c = compare(loops)
    c.wait()
    assert "lost diverged at" in c.status and "smcaero-bad" in c._message.value
    c = compare({"broken": CHAINS["sign"].with_(law=broken)})
    c.wait()
    assert "broken" in c.status and c.runs == {}


def test_bad_sources():
    with pytest.raises(ParameterError, match="compare: {'a': 7} is not allowed"):
        compare({"a": 7})
    for f, message in ((compare,
                        "compare: source = 7 is not allowed; "
                         "it must be a live plot or {name: loop}"),
                       (certificate,
                        "certificate: source = 7 is not allowed; "
                         "it must be a live plot or a closed loop")):
        with pytest.raises(ParameterError, match=message):
            f(7)


# ---- certificate ---------------------------------------------------------------------------------
def test_certificate_is_of_the_loop_as_set(picture):
    c = certificate(picture)
    assert c.result is None and c.status == ""
    c._button.click()
    c.wait()
    assert c.result.order == 1 and c.status.startswith("sign: Sliding of order 1: |sigma| ~ tau^")
    assert [t.name for t in c.figure.data
            if t.mode == "markers"] == [f"|σ|: slope {c.result.slopes[0]:.2f}"]
    np.testing.assert_array_equal(c.figure.data[1].x, c.result.tau)
    picture.set(law__rho=3.0)
    assert c.status.endswith("The mask has changed since.")
    picture.mask.reset()
    assert "changed" not in c.status
    picture.mask.choice.value = "quasi"
    assert "changed" in c.status
    assert c.measure().order is None and c.status.startswith("quasi: No order of sliding")
    assert certificate(perturbed_chain(smc2.super_twisting, 1)).measure().order == 2


def test_a_failed_measurement_leaves_none():
    c = certificate(CHAINS["sign"])
    assert c.measure().order == 1
    c._given = {"": CHAINS["sign"].with_(dt=None)}
    assert c.measure() is None and "dt [s] is not given" in c.status and c._below.children == ()


def test_certificate_says_why_not():
    c = certificate(CHAINS["sign"].with_(law=None))
    c.measure()
    assert c.result is None
    assert c.status == "accuracy: the loop has no law, so there is no sliding to measure"


def test_certificate_is_cancelled(monkeypatch):
    gate = threading.Event()

    def endless(loop, *, progress, **times):
        while not gate.wait(0.005):
            progress(0.3)

    monkeypatch.setattr(studies, "accuracy", endless)
    c = certificate(CHAINS["sign"])
    c._button.click()
    for _ in range(400):
        if c.job.worker.fraction and c.job.layout.visibility == "visible":
            break
        gate.wait(0.005)
    c.job.stop.click()
    c.wait()
    assert c.status == "Cancelled." and c.job.layout.visibility == "hidden"


def test_picture_of_an_accuracy_without_any_order():
    figure = plot(smc.accuracy(perturbed_chain(smc.hosmc.quasi_continuous(3), 3), 3.0))
    assert all(t.mode == "markers" for t in figure.data) or figure.data
    assert figure.layout.xaxis.type == figure.layout.yaxis.type == "log"


def test_a_table_says_what_never_slid_and_why():
    lag = block(state=dict(y=0.0))(lambda x, u, d: (-x[0] + u + d,))
    loop = smc.ClosedLoop(lag, output=block(lambda x: x[0]), duration=10.0, dt=1e-2,
                          reference=block(lambda t: 1.0), law=smc1.sign_smc.with_(rho=2.0),
                          perturbation=block(lambda t, size=0.5: size))
    study = smc.ui.compare({"holds": loop, "weak": loop.with_(perturbation__size=-4.0),
                            "PD": smc.lv.loop("pd")})
    study.wait()
    rows = [q.split("</tr>")[0] for q in comparison_html(study.runs).split("<tr>")[1:]]
    told = {n: next(q for q in rows if n in q) for n in ("holds", "weak", "PD")}
    assert "not reached" in told["weak"] and "no sliding" in told["PD"]
    assert "not reached" not in told["holds"]
    assert "weak: |xi| reaches" in study.status and "holds:" not in study.status
