"""Live plots: a mask beside the curves of what it sets."""

import math
import warnings
from typing import NamedTuple

import ipywidgets as W
import plotly.graph_objects as go
import traitlets

from ..core import Block, ClosedLoop, simulate
from ..core.param import unknown
from .curves import draw, metrics_html, panels, structure, verdict_html
from .figures import figure
from .files import Download
from .given import names, offered, seconds
from .job import Dropped, Job, interrupted
from .mask import Mask
from .picture import Picture
from .text import result_html, why_diverged, why_not

__all__ = ["Live", "live"]

ROWS = 1000  # recorded rows of a run: what a screen resolves
SAMPLES = 5000  # of a run of up to so many samples, each is a row: every pulse shows
PATIENCE = 0.15  # s that a moved slider waits for its run; a longer one goes on by itself
FIRST = 5.0  # s that a new plot waits, so that the next cell finds its curves: compiling takes 1 to 3
COMPILING = "Compiling; this takes a few seconds, once for each kind of loop."
COMPUTING = "Computing; the first time it may have to compile, which takes a few seconds."
KEPT = "the curves are those of the last good setting"


def rows(loop, duration=None, dt=None, tau=None):
    """How many rows of a run to record."""
    samples = (duration or loop.duration or 0.0)/(tau or loop.tau or dt or loop.dt or math.inf)
    return round(samples) if ROWS < samples <= SAMPLES else ROWS


class _Drawn(NamedTuple):
    """What a live plot shows: of which loop, the result, its curves or a drawing, and texts."""

    choice: str
    run: object
    curves: list
    drawing: tuple
    said: str
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
        What is drawn of a run, in the units shown: ``live.curves["u"].y`` over ``live.curves["u"].x``; keys
        `y r dy dr u xi sigma phase`, `x.<state>`, `law.<state>`.
    status : str
        What the mask says about the newest run; empty if all is well.
    times : dict
        duration, dt and tau as given to `live`.
    job : Job
        The thread that simulates, with its progress bar.
    """

    run = traitlets.Any()

    def __init__(self, loops, duration, dt, tau, states, phase, include):
        self.times = seconds("live", duration=duration, dt=dt, tau=tau)
        loops = offered("live", loops, Block, ClosedLoop)
        states = names("live", "states", states) or ()
        self.mask, self._picture, self._look = Mask(loops, include, tau), Picture(), (states, phase)
        self.curves, self._drawn, self._shown = {}, None, None
        self.status, self._told = "", ("", False)
        self._answered = None  # the setting that _told is about
        for loop in self.mask.offered.values():
            for n in states if isinstance(loop, ClosedLoop) else ():
                if n not in loop.stages["plant"].states:
                    raise unknown(f"live: the plant {loop.stages['plant'].name}", n, loop.stages["plant"].states)
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
    def loop(self):
        """The loop as set now."""
        return self.mask.target

    @property
    def figure(self):
        """What is drawn, as a figure of plotly."""
        if self.curves or self.run is None:
            return go.Figure(*draw({"": list(self.curves.values())}))
        return go.Figure(*figure(self.run))

    def set(self, **values):
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

    def wait(self):
        """Wait until the newest setting has been simulated and drawn; Ctrl-C cancels that."""
        self.mask.mend()
        self._ask()
        self.job.wait()

    def cancel(self):
        """Stop the run at work; the curves stay those of the last good setting."""
        self.job.cancel()

    def _ask(self, _=None, patience=PATIENCE, again=False):
        """Run the loop as set; wait a moment for it, so that a moved slider never queues, then let it go on by itself."""
        setting, asked = (self.mask.chosen, self.loop), self.job.worker.asked
        if asked and not again and asked[0][0] == setting[0] and asked[0][1] is setting[1]:
            return
        if not self.job.ask(setting, patience) and self.job.worker.fraction is None:
            self._say(COMPILING if isinstance(self.loop, ClosedLoop) else COMPUTING)
            if self._answered is setting:  # just now
                self._say(*self._told)

    def _work(self, asked, progress):
        """Simulate or call, and draw, or say why not; what no theorem covers is drawn, and said to be so."""
        (choice, loop), refused = asked, True

        def watched(fraction):
            progress(fraction)
            if self.status == COMPILING:
                self._say("")

        try:
            self._draw()  # what Ctrl-C left half drawn
            progress()
            if isinstance(loop, ClosedLoop):
                record = rows(loop, **self.times)
                text, refused = self._simulated(choice, simulate(loop, **self.times, record=record, progress=watched))
            else:
                text, refused = self._called(choice, loop)
        except Dropped as why:
            text = f"Cancelled; {KEPT}." if why.args == ("cancelled",) else ""
        except BaseException as why:  # a block may raise anything: it is said, and the page goes on
            if interrupted(why):
                raise
            text = f"{why_not(why)}; {KEPT}." if self.run else f"{why_not(why)}."
        self._told, self._answered = (text, refused), asked
        self._say(text, refused)

    def _simulated(self, choice, run):
        """Draw a run; what to say of it, and whether it is refused."""
        good = run.diverged_at is None
        drawn = good or choice != (self._drawn and self._drawn.choice) and len(run.t) > 0
        if drawn:
            said = verdict_html(run) + metrics_html(run)
            self._drawn = _Drawn(choice, run, panels(run, *self._look), (), said, "")
            self._draw()
        if not good:
            said = "the curves end there" if drawn else KEPT
            return why_diverged(run) + (f"; {said}." if self.run else "."), True
        return "".join(f"{q}: the theorem does not cover this. " for q in run.doubts()).strip(), False

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
        """Show what is to be drawn, unless it is shown already; to do so twice does no harm."""
        new = self._drawn
        if self._shown is not new:
            before, self._shown = self._shown, None
            if not new.curves:
                self._picture.show(*new.drawing)
            elif before and structure(new.curves) == structure(before.curves):
                # only the numbers travel
                self._picture.move([c.x for c in new.curves], [c.y for c in new.curves])
            else:
                self._picture.show(*draw({"": new.curves}))
            self.curves, self._metrics.value = {c.key: c for c in new.curves}, new.said
            self._download.show(new.file)
            self._shown = new
        if new:
            self.run = new.run

    def _say(self, text, refused=False):
        if text or self.status:  # the mask takes a message away with every change, so the same one is said anew
            self.status = text
            self.mask.say(text, refused)


def live(loop, duration=None, dt=None, tau=None, states=(), phase=False, include=None):
    """Show a mask beside the live curves of what it sets.

    Parameters
    ----------
    loop : ClosedLoop, Block, or dict of str to these
        A loop is simulated; a block without signals, any function of numbers under `block`, is called, and what it returns is
        drawn as by `plot`. ``{name: loop}`` offers a choice.
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
        `loop` is something else, such as a function that makes a loop but was not called, or offers
        nothing, or under a name that is not a text; `states` or `include` is no sequence of names,
        or names something that does not exist; a time is not a finite number.

    Notes
    -----
    A run of up to 0.15 s is drawn before the control that asked for it returns. A longer one goes on by itself, with a
    progress bar and a button that cancels it; a newer setting takes its place. In a program, `Live.set` waits for the
    curves. Where no thread can start, as in a browser's Python, the control waits for every run.

    Examples
    --------
    >>> plot = live(smc.lv.loop("quasi_smc"), states=("beta",))
    >>> plot.set(law__rho=3.0)
    >>> plot.curves["u"].y.max()
    >>> live(smc.differentiators.trial())
    """
    return Live(loop, duration, dt, tau, states, phase, include)
