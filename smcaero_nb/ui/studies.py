"""Studies beside a live plot: several laws over one another, and the measured order of sliding."""

from collections.abc import Mapping
from typing import Any

import ipywidgets as W
import plotly.graph_objects as go

from ..core import Accuracy, Block, ClosedLoop, ParameterError, Run, accuracy, simulate
from ..core.param import given, listed, refused
from .curves import LAW, comparison_html, draw, panels
from .figures import figure
from .given import offered
from .job import Cancelled, Job, Overtaken, interrupted
from .live import FIRST, ROWS, Live, rows
from .mask import Page
from .picture import Picture
from .rows import thinned, zoomed
from .text import said_html, why_diverged, why_not

__all__ = ["Certificate", "Compare", "certificate", "compare"]

MOST = 4  # laws that can be told apart in one picture


class Study(W.VBox):
    """A study of the loops of a mask as set at its start: message, progress bar, picture.

    Attributes
    ----------
    status : str
        Text of the message.
    figure : plotly.graph_objects.Figure or None
        What is drawn, as a figure to save or change.
    job : Job
        The thread that computes, with its progress bar.
    """

    def __init__(self, source: Live | ClosedLoop | Mapping[str, ClosedLoop], head: W.Box):
        self._mask = source.mask if isinstance(source, Live) else None
        self._given: dict[str, Any] = dict(source) if isinstance(source, Mapping) else {"": source}
        self._times = source.times if isinstance(source, Live) else {}
        self._message, self._below, self.job = W.HTML(), W.VBox(), Job(self._work)
        self.figure: go.Figure | None = None
        self._above, self._picture = W.HTML(), Picture()
        below = W.HBox([self._message, self.job])
        super().__init__([head, below, self._below, Page()])
        for w, name in ((self, "study"), (head, "choices"), (below, "said"),
                        (self._message, "status"), (self._below, "plot")):
            w.add_class(f"smcaero-{name}")
        self._say("")

    @property
    def loops(self) -> dict[str, Any]:
        """{name: loop} as set now, all in the same world."""
        return self._mask.in_this_world() if self._mask else self._given

    def _settings(self):
        """{name: (loop, integration method)} as set now; None is the loop's own method."""
        given = {n: (q, None) for n, q in self._given.items()}
        return self._mask.settings() if self._mask else given

    def wait(self) -> None:
        """Wait until the picture is there; Ctrl-C cancels it."""
        self.job.wait()

    def _study(self, asked, progress) -> tuple[str, bool]:
        """Compute and draw; return what to say, and whether it is refused."""
        raise NotImplementedError

    def _work(self, asked, progress):
        """Compute and draw, or say why not."""
        text, bad = "", True
        try:
            progress()
            text, bad = self._study(asked, progress)
        except Cancelled:
            text = "Cancelled."
        except Overtaken:
            pass
        except BaseException as why:  # a block may raise anything: say it, and the page goes on
            if interrupted(why):
                raise
            text = why_not(why)
        self._say(text, bad)

    def _say(self, text, refused=False):
        self.status = text
        self._message.value = said_html(text, refused)

    def _show(self, figure, above=""):
        self.figure, self._above.value = go.Figure(*figure), above
        self._picture.show(*figure)
        self._below.children = [self._above, self._picture]


class Compare(Study):
    """Up to four loops over one another, with a table; made by `compare`.

    Attributes
    ----------
    runs : dict of str to Run
        What is shown.
    """

    def __init__(self, source: Live | Mapping[str, ClosedLoop]):
        names = list(source.mask.offered if isinstance(source, Live) else source)
        self.runs: dict[str, Run] = {}
        self._fine: dict[str, Run] = {}  # the same with more rows, for the planes
        self._told, self._lost = "", False  # what there is to say of them, whether one was lost
        self._span: tuple = ()
        self._picked = frozenset(names[:MOST])
        self._toggles = {n: W.ToggleButton(i < MOST, description=n, tooltip=f"Show {n}")
                         for i, n in enumerate(names)}
        self._again = W.Button(description="Refresh", icon="refresh",
                               tooltip="Use the current settings of the mask")
        self._again.on_click(lambda _: self._ask())
        buttons = [*self._toggles.values(), *[self._again]*isinstance(source, Live)]
        super().__init__(source, W.HBox(buttons))
        for t in self._toggles.values():
            t.observe(self._toggled, "value")
        if self._mask:
            self._mask.observe(self._stale, "target")
        self._picture.view.observe(self._zoomed, "span")
        self._ask(FIRST)

    def set(self, *names: str) -> None:
        """Show these loops, as set now, and wait until they are drawn.

        Raises
        ------
        ParameterError
            An unknown name, or more than four.
        """
        known = all(isinstance(n, str) and n in self._toggles for n in names)
        if not 1 <= len(names) <= MOST or not known:
            raise refused("compare", "names", names, f"one to {MOST} of {listed(self._toggles)}")
        self._pick(names)
        self.wait()

    def _toggled(self, change):
        name = change.owner.description
        if change.new == (name in self._picked):  # a program set it
            return
        if len(self._picked ^ {name}) > MOST:
            change.owner.value = False
            self._say(f"At most {MOST} laws can be told apart: switch another one off first.", True)
        else:
            self._pick(self._picked ^ {name})

    def _pick(self, names):
        """Compare these; the names are one attribute, assigned once: the buttons follow it."""
        try:
            self._picked = frozenset(names)
            self._follow()
            self._ask()
        except BaseException:
            self._follow()
            asked = self.job.worker.asked
            if asked is None or set(asked[0]) != self._picked:
                self._ask()
            raise

    def _follow(self):
        for n, t in self._toggles.items():
            t.value = n in self._picked

    def _stale(self, _):
        if self.job.worker.idle.is_set():
            now, text = self._settings(), [*filter(None, [self._told])]
            if not all(now[n] == (r.loop, r.method) for n, r in self.runs.items()):
                text.append("The mask has changed since: Refresh uses its settings.")
            self._say("\n".join(text), self._lost)

    def _ask(self, patience=0.0):
        now = self._settings()
        self.job.ask({n: now[n] for n in self._toggles if n in self._picked}, patience)

    def _zoomed(self, _):
        """Draw what is zoomed to with all its rows; the loops are those compared."""
        asked = self.job.worker.asked
        if asked and (self.runs or self.job.worker.job):
            self.job.ask({**asked[0]}, 0.0)

    def _study(self, asked, progress):
        span = tuple(self._picture.view.span)
        same = len(asked) == len(self.runs) and all(
            n in self.runs and self.runs[n].loop is q and method in (None, self.runs[n].method)
            for n, (q, method) in asked.items())
        runs, shown = (self.runs if same and span != self._span else {}), {}
        self.runs = {}
        for i, (name, (loop, method)) in enumerate(asked.items()):
            def part(q, i=i):
                progress((i + q)/len(asked))

            times: dict[str, Any] = self._times | dict(method=method)
            if name not in runs:
                record = rows(loop, **self._times, phase=True)
                self._fine[name] = simulate(loop, **times, record=record, progress=part)
                runs[name] = thinned(self._fine[name], ROWS)
            if len(runs[name].t):
                shown[name] = zoomed(loop, runs[name], span, times, simulate, part)
        self.runs, self._span = runs, span
        # without the states of the laws: each has its own
        several = len(shown) > 1
        curves = {n: [c for c in panels(r, phase=True, fine=self._fine[n], span=span or None,
                                        compared=several)
                      if c.row != LAW] for n, r in shown.items()}
        self._show(draw(curves), comparison_html(runs))
        lost = [f"{n} {why_diverged(r)}" for n, r in runs.items() if r.diverged_at is not None]
        doubtful = [f"{n}: {q}." for n, r in runs.items() for q in r.doubts()]
        self._told, self._lost = "\n".join([*lost, *doubtful]), bool(lost)
        return self._told, self._lost


class Certificate(Study):
    """The order of sliding, measured for the loop as set; made by `certificate`.

    Attributes
    ----------
    result : Accuracy or None
        The last one measured.
    """

    def __init__(self, source: Live | ClosedLoop):
        self.result: Accuracy | None = None
        self._button = W.Button(description="Measure the order of sliding", icon="line-chart",
                                tooltip="Simulate the loop as set now with five sampling steps")
        self._button.on_click(lambda _: self._ask())
        super().__init__(source, W.HBox([self._button]))
        if self._mask:
            self._mask.observe(self._stale, "target")

    def _stale(self, change):
        if self.result and self.job.worker.idle.is_set():
            same = change.new == self.result.loop
            self._say(self._told if same else f"{self._told} The mask has changed since.")

    def measure(self) -> Accuracy | None:
        """Measure the loop as set now, wait for it, and return the `Accuracy`."""
        self._ask()
        self.wait()
        return self.result

    def _ask(self):
        if self._mask:
            self.job.ask((self._mask.chosen, self._mask.target, self._mask.method), 0.0)
        else:
            self.job.ask((*next(iter(self._given.items())), None), 0.0)

    def _study(self, asked, progress):
        name, loop, method = asked
        self.result, self._below.children = None, []
        self.result = accuracy(loop, **self._times, method=method, progress=progress)
        self._show(figure(self.result))
        self._told = f"{name}: "*(name != "") + self.result.explain()
        return self._told, False


def compare(source: Live | Mapping[str, ClosedLoop]) -> Compare:
    r"""Show up to four loops over one another: their curves and phase portraits, and a table.

    The table has the reaching time, the tail accuracy, the mean control \|v\| and the chattering of
    each.

    Parameters
    ----------
    source : Live or dict of str to ClosedLoop
        Of a live plot, the loops that its mask offers, each as set when the comparison is made;
        Refresh makes it again.

    Returns
    -------
    Compare
        A widget.

    Raises
    ------
    ParameterError
        `source` is something else, or offers nothing, something other than a closed loop, or a name
        that is not text.

    Examples
    --------
    >>> laws = "sign_smc", "super_twisting"
    >>> both = compare({law: smc.applications.double_integrator(law) for law in laws})
    >>> both.runs["sign_smc"].metrics().turns_u
    """
    given("compare", "source", source, (Live, Mapping), "a live plot or {name: loop}")
    offered("compare", source.mask.offered if isinstance(source, Live) else source, ClosedLoop)
    return Compare(source)


def certificate(source: Live | ClosedLoop) -> Certificate:
    """Show a button that measures the order of sliding of a loop as set.

    The order is the slope of the loop's accuracy over the sampling step. It is shown from this
    start and under this perturbation, not proved for others.

    Parameters
    ----------
    source : Live or ClosedLoop
        Of a live plot, the loop that its mask shows when the button is pressed.

    Returns
    -------
    Certificate
        A widget; its `result` is the `Accuracy`.

    Raises
    ------
    ParameterError
        `source` is something else, or offers no closed loop.

    Examples
    --------
    >>> certificate(smc.applications.perturbed_chain(smc.smc2.super_twisting, 1)).measure().order
    2
    """
    given("certificate", "source", source, (Live, ClosedLoop), "a live plot or a closed loop")
    if isinstance(source, Live) and all(isinstance(q, Block) for q in source.mask.offered.values()):
        raise ParameterError("certificate: the live plot is not allowed; "
                             "it offers only blocks, and must offer a closed loop")
    return Certificate(source)
