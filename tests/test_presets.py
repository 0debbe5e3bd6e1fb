"""The presets that raise a doubt, each with a proof of its own that it holds; no other one does.

``python tests/designs.py`` holds the second half of that, on all presets.
"""

import numpy as np
import pytest
from test_made import LOOPS

from smcaero_nb import simulate
from smcaero_nb.core.rows import taken
from smcaero_nb.core.signal import flat
from smcaero_nb.surface import coefficients


def motion(run, k, *path):
    """Rate of a measured number at a row: the slope of the output along the plant's own x'."""
    loop, p = run.loop, run.loop.p
    plant, output = loop.stages["plant"], loop.stages["output"]
    at = {"t": float(run.t[k]), "u": taken(run.u, k), "d": taken(run.d, k),
          "x": tuple(q[k] for q in vars(run.x).values())}
    rates = plant.f(*(at[n] for n in plant.signals), *p["plant"])
    h, moved = 1e-6, []
    for sign in (1.0, -1.0):
        x = tuple(q + sign*h*w for q, w in zip(at["x"], rates, strict=True))
        y = output.f(*({**at, "x": x}[n] for n in output.signals), *p["output"])
        for i in path:
            y = y[i]
        moved.append(y)
    return (moved[0] - moved[1])/(2.0*h)


def late(run):
    """200 rows of the second half."""
    return np.unique(np.linspace(len(run.t)//2, len(run.t) - 2, 200).astype(int))


def exceeds(bound, *path, channel=None):
    """xi = sigma^(r) + v, straight from the plant: its law is for relative degree r, and the output
    has r - 1 derivatives."""
    def proof(run):
        rows = late(run)
        v = run.v if channel is None else run.v[channel]
        r = run.r if channel is None else run.r[channel]
        ahead = np.gradient(flat(r)[-1], run.t) if channel is not None else 0.0*run.t
        xi = np.array([ahead[k] - motion(run, k, *path) + v[k] for k in rows])
        return np.mean(np.abs(xi) > bound) > 0.01

    return proof


def swings(run):
    """sigma swings for hundreds of samples between two changes of its sign."""
    s = flat(run.sigma)[0][4*len(run.t)//5:]
    gaps = np.diff(np.flatnonzero(np.diff(np.sign(s))))*(run.t[1] - run.t[0])/run.tau
    return len(gaps) > 2 and gaps.max() > 200


def beyond_on_the_surface(run):
    """sigma' = e'' + c e' + c_int e of `lv.loop("sign_smc")`, whose law has rho = 0.6."""
    c, c_int = coefficients(2, 10.0)
    e = run.e
    xi = [-motion(run, k, 1) + c*e[1][k] + c_int*e[0][k] + run.v[k] for k in late(run)]
    return np.mean(np.abs(xi) > 0.6) > 0.01


def at(i, *limits):
    """An input is at one of its limits for a tenth of the tail or more."""
    def proof(run):
        u = flat(run.u)[i][4*len(run.t)//5:]
        return np.mean(np.isin(np.round(u, 9), limits)) > 0.1

    return proof


def lost(run):
    """It ends as no landing and no flight does."""
    return run.diverged_at is not None or run.stopped_at is not None and not run.loop.verdict(run)


#: {preset: [(words, proof)]}
DOUBTS = {
    "smcaero_nb.lv sign_smc recommended": [
        ("|xi| reaches 1.11, more than rho = 0.6", beyond_on_the_surface),
        ("does not come to rest", swings)],
    "smcaero_nb.lv quasi_smc paper": [("more than rho = 0.45", lost)],
    "smcaero_nb.lv hosm raised": [
        ("more than L = 0.035", exceeds(0.035, 2)),
        ("does not come to rest", swings)],
    "smcaero_nb.rpl adaptive_smc paper": [
        ("attitude: sigma[0] does not come to rest", lost), ("rho still grows", lost),
        ("u[0] is at the limit", at(0, -15.0, 15.0)), ("u[1] is at the limit", lost)],
    "smcaero_nb.rpl hosm recommended": [
        ("attitude: |xi| reaches", exceeds(0.04, 0, 1, channel=0)),
        ("descent: |xi| reaches", exceeds(0.81, 1, 1, channel=1))],
}


@pytest.mark.parametrize("name", DOUBTS)
def test_a_doubt_on_a_preset_holds(name):
    run = simulate(LOOPS[name])
    said = run.doubts()
    for words, proof in DOUBTS[name]:
        assert any(words in q for q in said), said
        assert proof(run), words


@pytest.mark.parametrize("name, limits", [
    ("smcaero_nb.rpl adaptive_smc recommended", (1, 0.0, 2800.0)),
    ("smcaero_nb.rpl adaptive_smc governed", (1, 0.0, 2800.0)),
    ("motor adaptive_smc angle", (0, -10.0, 10.0)), ("motor adaptive_smc speed", (0, -10.0, 10.0))])
def test_an_actuator_that_a_relay_switches_from_limit_to_limit_is_not_accused(name, limits):
    """The engine gives 0 or 2800 N, the motor gets 10 or -10 V, and sigma rests."""
    run = simulate(LOOPS[name])
    assert at(*limits)(run) and not lost(run) and run.doubts() == []


@pytest.mark.parametrize("name", [n for n in LOOPS if n.startswith("integrator")])
def test_the_double_integrator_raises_none(name):
    assert simulate(LOOPS[name], dt=1e-3, jit=False).doubts() == []
