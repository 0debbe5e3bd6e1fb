"""Masks and live plots: Ctrl-C at any moment, blocks that raise anything, hosts without threads."""

import inspect
import math
import random
import sys
import threading
import time

import comm
import numpy as np
import plotly.graph_objects as go
import pytest

import smcaero_nb as smc
from smcaero_nb import ClosedLoop, ParameterError, block
from smcaero_nb.applications import perturbed_chain
from smcaero_nb.ui import certificate, compare, flight, live, mask, plot, transfer_function, upload
from smcaero_nb.ui.curves import panels


@block(state=dict(x=0.5, v=0.0))
def cart(x, u, d):
    return x[1], u + d


@block
def line(e, c=1.0):
    return e[1] + c*e[0]


@block
def weak(sigma, rho=2.0, eps=0.1):
    return rho*sigma/(abs(sigma) + eps)


@block
def strong(sigma, rho=5.0, k=1.0):
    return rho*(sigma > 0.0) - rho*(sigma < 0.0) + k*sigma


# a widget of ipywidgets that is interrupted while it is made cannot be closed either
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")

LOOPS = {law.name: ClosedLoop(cart, surface=line, law=law, duration=0.2, dt=1e-3, tau=1e-2)
         for law in (weak, strong)}
UI = smc.ui.__path__[0]
OURS = (UI, "traitlets", "ipywidgets", "threading")


# ---- Ctrl-C --------------------------------------------------------------------------------------
class CtrlC:
    """Raises KeyboardInterrupt at the n-th moment at which Python may deliver a signal:
    before a line of `ui`, or as a function of it or of what it stands on begins; in this thread."""

    def __init__(self, n=math.inf):
        self.n, self.seen = n, 0

    def __enter__(self):
        sys.settrace(self.called)
        return self

    def __exit__(self, *_):
        sys.settrace(None)

    def called(self, frame, event, _):
        code = frame.f_code
        if code.co_flags & inspect.CO_GENERATOR or not any(q in code.co_filename for q in OURS):
            return None  # it may be one that is cleared up, where Python drops what is raised
        self.moment()
        return self.line if code.co_filename.startswith(UI) else None

    def line(self, frame, event, _):
        if event == "line" and not within(frame):
            self.moment()
        return self.line

    def moment(self):
        self.seen += 1
        if self.seen == self.n:
            sys.settrace(None)
            raise KeyboardInterrupt


def within(frame):
    """Whether a `with` is at its end, where a signal waits until it is left."""
    code = frame.f_code
    if code not in WITHS:
        with open(code.co_filename, encoding="utf-8") as f:
            WITHS[code] = {i for i, q in enumerate(f, 1) if q.lstrip().startswith("with ")}
    return frame.f_lineno in WITHS[code]


WITHS = {}


@pytest.fixture
def page(monkeypatch):
    """What the page knows of each widget: {comm_id: state}."""
    known = {}

    def publish(self, msg_type, data=None, **_):
        if data and data.get("method") == "update":
            known.setdefault(self.comm_id, {}).update(data["state"])

    monkeypatch.setattr(comm.DummyComm, "publish_msg", publish)
    return known


def settle(p):
    p.wait()
    while not p.job.worker.idle.is_set():
        time.sleep(0.001)


def agree(p, page):
    """Mask, loop, picture and page say the same."""
    assert p.job.layout.visibility == "hidden"
    m, values = p.mask, {n: v for n, (_, v, _) in p.loop.settable().items()}
    values |= dict(method=m.method, latency=p.loop.latency)
    assert m.values == {n: values[n] for n in m.widgets} and p.loop is m.offered[m.choice.value]
    assert set(m.widgets) == set(values) and list(m._body.children) == m._forms[m.choice.value][-1]
    for n, w in m.widgets.items():
        assert not w._property_lock
        if n == "method":
            assert w.value == m.method
            continue
        assert float(m.entries[n].value) == pytest.approx(values[n], rel=1e-5), n
        assert w.value == pytest.approx(min(max(values[n], w.min), w.max), abs=0.51*w.step), n
        for q in (w, m.entries[n]):
            assert page.get(q.comm.comm_id, {}).get("value", q.value) == q.value, n
    index = page.get(m.choice.comm.comm_id, {}).get("index", m.choice.index)
    assert m.choice.options[index] == m.choice.value
    gone = p._picture.curves.state == "gone"  # cancelled before the loop chosen had curves
    kept = "; the curves are those of the last good setting"
    if p.status:
        assert p.status == f"Cancelled{'' if gone else kept}."
    else:
        assert p.run.loop is p.loop
    if gone:
        assert p.status and p.curves == {} and p._side.layout.visibility == "hidden"
        return
    assert p._picture.curves.state == "old"*(p.status != "")
    for c in panels(p.run):
        np.testing.assert_array_equal(p.curves[c.key].y, c.y)
    drawn = [np.frombuffer(q, np.float32) for q in p._picture.curves.y]
    for a, c in zip(drawn, p.curves.values(), strict=True):
        np.testing.assert_array_equal(a, c.y)


def drag(w, v, page):
    """Move a slider in the page; if Ctrl-C comes before the message is read, nobody hears of it."""
    page.setdefault(w.comm.comm_id, {}).pop("value", None)
    try:
        w.set_state({"value": v})
    finally:  # ipywidgets keeps its lock if interrupted as it takes it; the next message frees it
        w.set_state({})


ACTIONS = {
    "set": lambda p, v: p.mask.set(law__rho=v, plant__x=0.1*v),
    "live.set": lambda p, v: p.set(law__rho=v, surface__c=v),
    "reset": lambda p, v: p.mask.reset(),
    "type": lambda p, v: setattr(p.mask.entries["law__rho"], "value", f"{v:.4g}"),
    "slide": lambda p, v: setattr(p.mask.widgets["law__rho"], "value", v),
    "drag": lambda p, v: drag(p.mask.widgets["law__rho"], v, p.page),
    "choose": lambda p, v: setattr(p.mask.choice, "value", *(set(LOOPS) - {p.mask.choice.value})),
    "offer": lambda p, v: p.mask.offer("weak", LOOPS["weak"].with_(law__rho=v)),
    "wait": lambda p, v: p.wait(),
}


def interrupt(p, page, times, seed, actions=tuple(ACTIONS)):
    """Press Ctrl-C at random moments of each action in turn; then all agrees, the plot lives."""
    rng, moments, pressed, p.page = random.Random(seed), {}, 0, page
    for k in range(times):
        act, v = actions[k % len(actions)], round(rng.uniform(1.0, 6.0), 1)
        if act not in moments:
            with CtrlC() as counted:
                ACTIONS[act](p, v)
            moments[act] = counted.seen
            settle(p)
        moment = rng.randint(1, moments[act])
        try:
            with CtrlC(moment):
                ACTIONS[act](p, v)
        except KeyboardInterrupt:
            pressed += 1
        settle(p)
        agree(p, page)
        if k % 3 == 0 or p.status:
            v = round(rng.uniform(1.0, 6.0), 1)
            p.set(law__rho=v)
            assert p.status == "" and p.run.loop.stages["law"].values["rho"] == v, (act, moment)
            agree(p, page)
    return pressed


def test_a_live_plot_that_is_interrupted_300_times_is_whole_and_lives(page):
    p = live(LOOPS)
    settle(p)
    assert interrupt(p, page, 300, seed=1) > 200


@pytest.fixture
def no_threads(monkeypatch):
    """A host where no thread can start."""
    def start(self):
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", start)


def test_without_threads_a_live_plot_that_is_interrupted_is_whole_and_lives(page, no_threads):
    p = live(LOOPS)
    settle(p)
    assert interrupt(p, page, 100, seed=2) > 60


# ---- what a block or an observer does ------------------------------------------------------------
def done(p, patience=20.0):
    """Wait with a limit: a plot that waits for itself must not hold up the tests."""
    end = time.monotonic() + patience
    while not p.job.worker.idle.is_set() and time.monotonic() < end:
        time.sleep(0.005)
    assert p.job.worker.idle.is_set()


@pytest.mark.parametrize("host", ["threads", "no_threads"])
def test_an_observer_of_run_may_set_the_same_plot(host, request):
    if host == "no_threads":
        request.getfixturevalue(host)
    p, seen = live(LOOPS["weak"]), []

    def at_least_three(change):
        seen.append(change.new.loop.stages["law"].values["rho"])
        p.set(law__rho=max(seen[-1], 3.0))

    settle(p)
    p.observe(at_least_three, "run")
    p.mask.set(law__rho=1.0)
    done(p)
    assert seen == [1.0, 3.0] and p.run.loop is p.loop and p.mask.values["law__rho"] == 3.0
    p.mask.set(law__rho=4.0)
    done(p)
    assert seen == [1.0, 3.0, 4.0] and p.status == ""


def test_setting_what_is_set_is_heard_by_nobody_but_done_again_by_a_plot():
    p, heard, runs = live(LOOPS["weak"]), [], []
    settle(p)
    p.mask.observe(heard.append, "target")
    p.observe(runs.append, "run")
    p.mask.set(law__rho=2.0)
    settle(p)
    assert heard == [] and runs == []
    p.set(law__rho=2.0)
    assert heard == [] and len(runs) == 1


RAISES = {"error": ZeroDivisionError("no check"), "exit": SystemExit("leaving"),
          "closed": GeneratorExit("over"), "ctrl-c": KeyboardInterrupt("mine")}


@pytest.mark.parametrize("how", RAISES)
def test_a_check_that_raises_leaves_the_mask_at_the_value_of_the_block(how):
    def check(values):
        if values["k"] > 5.0:
            raise RAISES[how]

    @block(check=check)
    def checked(k=2.0, n=1.0):
        return go.Figure(go.Scatter(y=[0.0, k]))

    m = mask(checked)
    for ask in (lambda: setattr(m.widgets["k"], "value", 7.0),
                lambda: setattr(m.entries["k"], "value", "7"),
                lambda: m.widgets["k"].set_state({"value": 7.0})):
        if how == "ctrl-c":  # in the main thread it is a person's
            with pytest.raises(KeyboardInterrupt):
                ask()
        else:
            ask()
            assert f"{type(RAISES[how]).__name__}: {RAISES[how]}. It stays at 2." in m._status.value
        assert (m.widgets["k"].value, m.entries["k"].value, m.target.values["k"]) == (2.0, "2", 2.0)
    m.widgets["k"].value = 3.0
    assert m.target.values["k"] == 3.0 and m._status.value == ""
    with pytest.raises(type(RAISES[how])):
        m.set(k=8.0)
    assert m.values["k"] == 3.0 and m.widgets["k"].value == 3.0


@pytest.mark.parametrize("error", RAISES.values(), ids=RAISES)
def test_whatever_a_block_raises_in_the_thread_is_said_and_the_plot_lives(error):
    @block
    def raising(k=2.0):
        if k > 5.0:
            raise error
        return go.Figure(go.Scatter(y=[0.0, k]))

    p = live(raising)
    settle(p)
    p.mask.set(k=7.0)
    done(p)
    said = f"{type(error).__name__}: {error}"
    assert p.status == f"{said}; the curves are those of the last good setting."
    p.set(k=3.0)
    assert p.status == "" and p.figure.data[0].y == (0.0, 3.0)


# ---- no threads ----------------------------------------------------------------------------------
def test_where_no_thread_can_start_all_is_done_in_place(no_threads):
    p = live(LOOPS)
    assert p.status == "" and p.run.loop is p.loop and p.job.layout.visibility == "hidden"
    p.mask.widgets["law__rho"].value = 3.0
    assert p.run.loop is p.loop and p.loop.stages["law"].values["rho"] == 3.0
    both = compare(p)
    assert list(both.runs) == ["weak", "strong"] and both.status == ""
    both.set("strong")
    assert list(both.runs) == ["strong"]
    assert certificate(perturbed_chain(smc.smc2.super_twisting, 1)).measure().order == 2


def test_a_thread_that_is_interrupted_as_it_starts_is_started_again(monkeypatch):
    p, real = live(LOOPS["weak"]), threading.Thread.start
    settle(p)

    def start(self):
        monkeypatch.setattr(threading.Thread, "start", real)
        raise KeyboardInterrupt

    monkeypatch.setattr(threading.Thread, "start", start)
    with pytest.raises(KeyboardInterrupt):
        p.set(law__rho=3.0)
    p.wait()
    assert p.run.loop is p.loop and p.loop.stages["law"].values["rho"] == 3.0 and p.status == ""


# ---- odd arguments -------------------------------------------------------------------------------
PD = LOOPS["weak"]
ODD = [
    (lambda: live(smc.lv.loop), "live: loop is a function: call it, loop()"),
    (lambda: mask(smc.lv.loop), "mask: loop is a function: call it, loop()"),
    (lambda: live({"a": PD, "b": smc.lv.loop}), "live: 'b': loop is a function: call it"),
    (lambda: live({}), "live: {} is not allowed; name at least one"),
    (lambda: mask({}), "mask: {} is not allowed"),
    (lambda: live({1: PD}), "live: name = 1 is not allowed; it must be text: {'name': loop}"),
    (lambda: live([PD]), "it must be a block or a closed loop, or several by name"),
    (lambda: live(smc.channels(a=weak)), "it must be a block or a closed loop"),
    (lambda: mask(None),
     "mask: None is not allowed; it must be a block, channels or a closed loop"),
    (lambda: live(PD, include="law"),
     r"include = 'law' is not allowed; it must be a sequence of names: \('law',\)"),
    (lambda: mask(PD, include=[1]), r"include\[0\] = 1 is not allowed; it must be text"),
    (lambda: live(PD, include=5), "include = 5 is not allowed"),
    (lambda: live(PD, states="x"),
     r"states = 'x' is not allowed; it must be a sequence of names: \('x',\)"),
    (lambda: live(PD, states=[3]), r"states\[0\] = 3"),
    (lambda: live(PD, states=3), "states = 3 is not allowed"),
    (lambda: live(PD, duration="30"),
     "live: duration = '30' is not allowed; it must be a finite number, in s"),
    (lambda: live(PD, dt=[1]), "live: dt = "),
    (lambda: live(PD, tau=math.nan), "live: tau = nan"),
    (lambda: compare({}), "compare: {} is not allowed"),
    (lambda: compare({1: PD}), "compare: name = 1 is not allowed"),
    (lambda: compare(PD),
     "compare: source = .* is not allowed; it must be a live plot or {name: loop}"),
    (lambda: compare({"a": smc.lv.loop}), "compare: 'a': loop is a function: call it"),
    (lambda: compare(live(smc.differentiators.trial())),
     "compare: .* is not allowed; it must be a closed loop"),
    (lambda: certificate(smc.lv.loop), "certificate: source = .* is not allowed"),
    (lambda: certificate(live(smc.differentiators.trial())), "certificate: .* offers only blocks"),
    (lambda: flight(smc.rpl.loop), "flight: source = .* is not allowed"),
    (lambda: plot(smc.simulate(PD), states="x"), "plot: states = 'x' is not allowed"),
    (lambda: plot(smc.simulate(PD), states=["y"]), "plot: the plant cart has no 'y'"),
    (lambda: upload(PD, smc.prd.read_csv, smc.prd.experiment),
     "upload: live = .* is not allowed; it must be a live plot"),
    (lambda: upload(live(PD), "f.csv", smc.prd.experiment),
     "upload: read = 'f.csv' is not allowed; it must be a function"),
    (lambda: upload(live(PD), smc.prd.read_csv, None), "upload: make = None is not allowed"),
    (lambda: transfer_function(7, smc.prd.experiment),
     "transfer_function: live = 7 is not allowed"),
    (lambda: transfer_function(live(PD), 3), "transfer_function: make = 3 is not allowed"),
    (lambda: mask(PD).offer(3, PD), "mask: name = 3 is not allowed; it must be text"),
    (lambda: mask(PD).offer(["a"], PD), r"name = \['a'\] is not allowed"),
    (lambda: compare({"a": PD}).set(["a"]),
     r"compare: names = \(\['a'\],\) is not allowed; .* of a$"),
    (lambda: upload(live(PD), int, len), "upload: read = .* is not allowed; it must be a function"),
    (lambda: mask(PD, include="x"*10_000), "include = 'x{5,30}[.]{3}x{5,30}' is not allowed"),
    (lambda: live(PD, states=10**5000), "states = 1e5000 or so is not allowed"),
    (lambda: live(10**5000), "live: 1e5000 or so is not allowed"),
    (lambda: compare({"a": 10**5000}), "compare: {'a': 1e5000 or so} is not allowed"),
    (lambda: mask(PD).offer("a", 3), "{'a': 3} is not allowed"),
]


@pytest.mark.parametrize("call, said", ODD, ids=[said[:40] for _, said in ODD])
def test_what_is_no_loop_no_name_or_no_time_is_refused_with_the_way_out(call, said):
    with pytest.raises(ParameterError, match=said):
        call()


@pytest.mark.parametrize("given", [{}, {1: 2}, 7, smc.simulate])
def test_what_cannot_be_drawn_is_a_type_error(given):
    with pytest.raises(TypeError, match="plot: .* cannot be drawn; it must be a Run"):
        plot(given)
