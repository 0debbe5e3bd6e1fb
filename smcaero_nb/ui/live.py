"""Live plots: a mask beside the curves of what it sets."""

import math
import warnings
from collections.abc import Iterable
from typing import Any, NamedTuple

import ipywidgets as W
import plotly.graph_objects as go
import traitlets

from ..core import Block, ClosedLoop, simulate
from .curves import Curve, draw, metrics_html, panels, structure, verdict_html
from .figures import figure
from .given import Loop, Loops, offered, seconds
from .given import states as known
from .job import Cancelled, Job, Overtaken, interrupted
from .mask import Mask
from .picture import Download, Picture
from .text import doubts_text, result_html, why_diverged, why_not

__all__ = ["Live", "live"]

ROWS = 1000  # recorded rows of a run: what a screen resolves
SAMPLES = 5000  # of a run of up to so many samples, each is a row: every pulse shows
PATIENCE = 0.15  # s that a moved slider waits for its run; a longer run goes on by itself
# s that a new plot waits, so that the next cell finds its curves; compiling takes 1 to 3
FIRST = 5.0
COMPILING = "Compiling; this takes a few seconds, once for each kind of loop."
COMPUTING = "Computing; the first time it may have to compile, which takes a few seconds."
KEPT = "the curves are those of the last good setting"


def rows(loop: ClosedLoop, duration: float | None = None, dt: float | None = None,
         tau: float | None = None) -> int:
    """Return how many rows of a run to record."""
    samples = (duration or loop.duration or 0.0)/(tau or loop.tau or dt or loop.dt or math.inf)
    return round(samples) if ROWS < samples <= SAMPLES else ROWS


class _Drawn(NamedTuple):
    """What a live plot shows.

    The name of the loop, the result, its curves or a drawing, figures of merit as HTML, and the
    name of a file to download.
    """

    choice: str
    run: Any
    curves: list
    drawing: tuple
    figures: str
    file: str


class Live(W.Box):
    """A mask beside the live curves of what it sets; made by `live`.

    Attributes
    ----------
    mask : Mask
    figure : plotly.graph_objects.Figure
        What is drawn, as a figure to save or change.
    loop : ClosedLoop or Block
        As set now.
    run : Run, or what the block returned, or None
        The last good one, the one drawn; ``live.observe(f, "run")`` calls `f` after every new one.
    curves : dict
        What is drawn of a run, in the units shown: ``live.curves["u"].y`` over
        ``live.curves["u"].x``; keys `y r dy dr u xi sigma phase`, `x.<state>`, `law.<state>`.
    status : str
        What the mask says about the newest run; empty if all is well.
    times : dict
        duration, dt and tau as given to `live`.
    job : Job
        The thread that simulates, with its progress bar.
    """

    run: Any = traitlets.Any()

    def __init__(self, loops: Loops, duration: float | None, dt: float | None, tau: float | None,
                 states: Iterable[str], phase: bool, include: Iterable[str] | None):
        self.times = seconds("live", duration=duration, dt=dt, tau=tau)
        loops = offered("live", loops, Block, ClosedLoop)
        self._look = known("live", states, loops.values()), phase
        self.mask, self._picture = Mask(loops, include, tau, dt), Picture()
        self.curves: dict[str, Curve] = {}
        self._drawn: _Drawn | None = None
        self._shown: _Drawn | None = None
        self.status, self._told = "", ("", False)
        self._answered = None  # the setting that _told is about
        self._metrics, self._download = W.HTML(), Download(lambda: self.run.to_csv())
        self.job = Job(self._work)
        self.mask.children = [*self.mask.children, self.job]
        side = W.VBox([self._metrics, self._picture, self._download])
        side.add_class("smcaero-plot")
        super().__init__([self.mask, side])
        self.add_class("smcaero-live")
        self.mask.observe(self._ask, "target")
        self._ask(patience=FIRST)

    @property
    def loop(self) -> Loop:
        """The loop as set now."""
        return self.mask.target

    @property
    def figure(self) -> go.Figure:
        """What is drawn, as a figure of plotly."""
        if self.curves or self.run is None:
            return go.Figure(*draw({"": list(self.curves.values())}))
        return go.Figure(*figure(self.run))

    def set(self, **values: Any) -> None:
        """Set values as the mask does, and wait until the curves show them.

        Raises
        ------
        ParameterError
            An unknown name, or a value that its metadata does not allow; nothing has changed then.

        Notes
        -----
        An observer of `run` may set values too. The plot waits for its observers, so this does not
        wait there: the curves follow when the observer is done.
        """
        before = self.loop
        self.mask.set(**values)
        if self.loop is before and not self.job.here:  # perhaps cancelled before
            self._ask(again=True)
        self.wait()

    def wait(self) -> None:
        """Wait until the newest setting has been simulated and drawn; Ctrl-C cancels that."""
        self.mask.mend()
        self._ask()
        self.job.wait()

    def cancel(self) -> None:
        """Stop the current run; the curves stay those of the last good setting."""
        self.job.cancel()

    def _ask(self, _=None, patience=PATIENCE, again=False):
        """Run the loop as set; wait a moment for it, then let it go on by itself.

        The wait keeps the moves of a slider from queueing.
        """
        asked = self.job.worker.asked
        setting = self.mask.chosen, self.loop, self.mask.method
        if asked and not again and asked[0][0] == setting[0] and asked[0][1] is setting[1]:
            return
        if not self.job.ask(setting, patience) and self.job.worker.fraction is None:
            self._say(COMPILING if isinstance(self.loop, ClosedLoop) else COMPUTING)
            if self._answered is setting:  # just now
                self._say(*self._told)

    def _work(self, asked, progress):
        """Simulate or call, and draw or say why not; say what speaks against a run, too."""
        (choice, loop, method), refused = asked, True

        def watched(fraction):
            progress(fraction)
            if self.status == COMPILING:
                self._say("")

        try:
            self._draw()  # what Ctrl-C left half drawn
            progress()
            if isinstance(loop, ClosedLoop):
                record = rows(loop, **self.times)
                run = simulate(loop, **self.times, method=method, record=record, progress=watched)
                text, refused = self._simulated(choice, run)
            else:
                text, refused = self._called(choice, loop)
        except Cancelled:
            text = f"Cancelled; {KEPT}."
        except Overtaken:
            text = ""
        except BaseException as why:  # a block may raise anything: say it, and the page goes on
            if interrupted(why):
                raise
            text = f"{why_not(why)}; {KEPT}." if self.run else f"{why_not(why)}."
        self._told, self._answered = (text, refused), asked
        self._say(text, refused)

    def _simulated(self, choice, run):
        """Draw a run; return what to say of it, and whether it is refused."""
        good = run.diverged_at is None
        drawn = good or choice != (self._drawn and self._drawn.choice) and len(run.t) > 0
        if drawn:
            figures = verdict_html(run) + metrics_html(run)
            self._drawn = _Drawn(choice, run, panels(run, *self._look), (), figures, "")
            self._draw()
        if not good:
            where = "the curves end there" if drawn else KEPT
            return why_diverged(run) + (f"; {where}." if self.run else "."), True
        return doubts_text(run.doubts()), False

    def _called(self, choice, block):
        """Draw what a block returns, and what it warns of."""
        with warnings.catch_warnings(record=True) as remarks:
            warnings.simplefilter("always")
            result = block()
        name = (choice or block.name).removesuffix(".csv")
        file = f"{name}, estimates.csv" if hasattr(result, "to_csv") else ""
        self._drawn = _Drawn(choice, result, [], figure(result), result_html(result), file)
        self._draw()
        return " ".join(dict.fromkeys(f"{q.message}." for q in remarks)), False

    def _draw(self):
        """Show what is to be drawn, unless it is shown already; doing so twice is harmless."""
        new = self._drawn
        if new is None:
            return
        if self._shown is not new:
            before, self._shown = self._shown, None
            if not new.curves:
                self._picture.show(*new.drawing)
            elif before and structure(new.curves) == structure(before.curves):
                # only the numbers travel
                self._picture.move([c.x for c in new.curves], [c.y for c in new.curves])
            else:
                self._picture.show(*draw({"": new.curves}))
            self.curves, self._metrics.value = {c.key: c for c in new.curves}, new.figures
            self._download.show(new.file)
            self._shown = new
        self.run = new.run

    def _say(self, text, refused=False):
        if text or self.status:  # every change clears the mask's message, so it is repeated
            self.status = text
            self.mask.say(text, refused)


def live(loop: Loops, duration: float | None = None, dt: float | None = None,
         tau: float | None = None, states: Iterable[str] = (), phase: bool = False,
         include: Iterable[str] | None = None) -> Live:
    """Show a mask beside the live curves of what it sets.

    Parameters
    ----------
    loop : ClosedLoop, Block, or dict of str to these
        A loop is simulated; a block without signals, any function of numbers under `block`, is
        called, and what it returns is drawn as by `plot`. ``{name: loop}`` offers a choice.
    duration, dt, tau : float, optional
        Of loops, as in `simulate`; default: the loop's own.
    states : sequence of str
        Of loops: plant states to draw, with the control if they have its unit: ``("beta",)``.
    phase : bool
        Of loops: with the phase portrait, sigma' over sigma.
    include : sequence of str, optional
        Names or stages that the mask shows, as in `mask`.

    Returns
    -------
    Live
        A widget.

    Raises
    ------
    ParameterError
        `loop` is something else, such as a function that makes a loop but was not called, or an
        empty dict, or has a name that is not text; `states` or `include` is not a sequence of
        names, or names something that does not exist; a time is not a finite number.

    Notes
    -----
    A run of up to 0.15 s is drawn before the control that started it returns. A longer one goes on
    by itself, with a progress bar and a Cancel button; a newer setting replaces it. In a program,
    `Live.set` waits for the curves. Where no thread can start, as in a browser's Python, the
    control waits for every run.

    Examples
    --------
    >>> plot = live(smc.lv.loop("quasi_smc"), states=("beta",))
    >>> plot.set(law__rho=3.0)
    >>> plot.curves["u"].y.max()
    >>> live(smc.differentiators.trial())
    """
    return Live(loop, duration, dt, tau, states, phase, include)
