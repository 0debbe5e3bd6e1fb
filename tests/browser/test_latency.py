"""From a key press to the redrawn curve, with the simulation and with a stored result."""

import json
import statistics

import pytest

pytestmark = pytest.mark.browser

CELL = """import sys, time, ipywidgets, smcaero_nb as smc
picture = smc.ui.live(smc.lv.loop("quasi_smc"), states=("beta",))
module = sys.modules[type(picture).__module__]
real, stored, took, moments = module.simulate, {}, [], {}

def key(loop, dt):
    return loop.stages["law"].values["rho"], dt

def timed(loop, dt, **options):
    began = time.perf_counter()
    stored[key(loop, dt)] = run = real(loop, dt=dt, **options)
    took.append(1e3*(time.perf_counter() - began))
    return run

def replayed(loop, dt, **options):
    moments["simulation"] = 1e3*time.time()
    return stored[key(loop, dt)]

def sent(*curves):
    move(*curves)
    moments["sent"] = 1e3*time.time()

move, picture._picture.move = picture._picture.move, sent
slider = picture.mask.widgets["law__rho"]
slider.comm.on_msg(lambda m: (moments.update(kernel=1e3*time.time()), slider._handle_msg(m)))
picture"""
# what the page was doing when, on the clock that the kernel has, too [ms]
SCRIPT = """window.moments = {};
window.mark = name => { moments[name] ??= performance.timeOrigin + performance.now() };
window.WebSocket = new Proxy(WebSocket, { construct(target, given) {
  const socket = new target(...given);
  socket.addEventListener('message', e => { if (e.data.byteLength > 20_000) mark('received') });
  return socket } });"""
WATCH = """async () => { window.redrawn = []; let pressed = 0;
  const plotly = await globalThis.smcaeroPlotly, react = plotly.react;
  plotly.react = (...given) => { if (pressed) mark('drawing'); return react(...given) };
  document.addEventListener('keydown', e => { pressed = e.timeStamp;
    window.moments = { key: performance.timeOrigin + pressed } }, true);
  document.querySelector('.js-plotly-plot').on('plotly_afterplot', () => {
    if (!pressed) return;
    mark('drawn');
    requestAnimationFrame(() => setTimeout(() => mark('painted')));
    redrawn.push(performance.now() - pressed);
    pressed = 0 }) }"""
PARTS = {"key to kernel": ("key", "kernel"), "mask": ("kernel", "simulation"),
         "curves": ("simulation", "sent"), "message": ("sent", "received"),
         "decoding": ("received", "drawing"), "layout and drawing": ("drawing", "drawn"),
         "painting, after that": ("drawn", "painted")}
KEYS = 8
ROUNDS = 5


def presses(nb, simulate, dt, keys=KEYS, parts=None):
    """Latencies of some key presses, and into `parts` what each took of a stored result [ms]."""
    nb.ask(f"module.simulate, picture.times['dt'] = {simulate}, {dt}")
    handle, seen = nb.slider("law__rho"), []
    for i in range(keys):
        nb.page.evaluate("() => { redrawn.length = 0 }")
        handle.press("ArrowLeft" if i % 2 else "ArrowRight")
        nb.page.wait_for_function("() => redrawn.length")
        seen += nb.page.evaluate("() => redrawn")[:1]
        nb.page.wait_for_timeout(100)  # what follows a redraw is over
        if parts is not None:
            at = nb.page.evaluate("() => moments") | json.loads(
                nb.ask("import json; print(json.dumps(moments))"))
            for n, (begin, end) in PARTS.items():
                parts[n].append(at[end] - at[begin])
    return seen


def test_redraw_costs_little_more_than_the_simulation(notebook):
    nb = notebook(CELL, script=SCRIPT)
    assert nb.run() == []
    nb.curve("y")
    nb.page.evaluate(WATCH)
    steps = {300_000: 1e-4, 3_000_000: 1e-5}
    with_simulation, without, simulation = ({n: [] for n in steps} for _ in range(3))
    parts = {n: [] for n in PARTS}
    for dt in steps.values():
        presses(nb, "timed", dt, 4)  # warm, and both results stored
    for _ in range(ROUNDS):  # side by side, so that whatever else the machine does hits all alike
        for n, dt in steps.items():
            nb.ask("took.clear()")
            with_simulation[n] += presses(nb, "timed", dt)
            simulation[n] += json.loads(nb.ask("print(took)"))
            without[n] += presses(nb, "replayed", dt, parts=parts)

    def p95(values):
        return sorted(values)[int(0.95*(len(values) - 1))]

    print("\n   steps   key press to redrawn curve [ms]   stored result   simulation   difference"
          "   goals: stored median < 50 ms; p95 < 100 ms, of the long run simulation + 15 ms")
    print("            median     p95                  median   p95       median       of medians")
    for n in steps:
        median, bare, own = (statistics.median(v[n])
                             for v in (with_simulation, without, simulation))
        short = n == min(steps)
        good = bare < 50 and (p95(with_simulation[n]) < 100 if short else median - bare <= own + 15)
        goal = "met" if good else "missed on this machine"
        print(f"{n:>8}   {median:7.1f} {p95(with_simulation[n]):7.1f} {bare:23.1f} "
              f"{p95(without[n]):5.1f} {own:12.1f} "
              f"{median - bare:13.1f}            {goal}")
    shares = {n: statistics.median(v) for n, v in parts.items()}
    print("   of a stored result [ms]: " + ", ".join(f"{n} {v:.1f}" for n, v in shares.items()))
    # TCP between server and page would hold back a small message for 40 ms
    assert shares["message"] < 30
    for n in steps:
        median, bare, own = (statistics.median(v[n])
                             for v in (with_simulation, without, simulation))
        assert median - bare <= own + 15
    assert nb.errors == []
