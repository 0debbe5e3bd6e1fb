"""Live plots: a mask beside the curves of what it sets."""

import math
import time
import warnings
from collections.abc import Iterable
from typing import Any, NamedTuple

import ipywidgets as W
import plotly.graph_objects as go
import traitlets

from ..core import Block, ClosedLoop, simulate
from .curves import Curve, before, draw, metrics_html, panels, structure, verdict_html
from .figures import figure
from .given import Loop, Loops, offered, seconds
from .given import states as known
from .job import Cancelled, Job, Overtaken, interrupted
from .mask import Mask
from .picture import Download, Picture
from .rows import thinned, zoomed
from .text import doubts_text, result_html, why_diverged, why_not

__all__ = ["Live", "live"]

ROWS = 1000  # recorded rows of a run: what a screen resolves
SAMPLES = 5000  # of a run of up to so many samples, each is a row: every pulse shows
PLANE = 20_000  # rows of a run whose phase planes are drawn
REST = 1.0  # s after which a setting has been seen: it stays as a shadow of the next
PATIENCE = 0.15  # s that a moved slider waits for its run; a longer run goes on by itself
# s that a new plot waits, so that the next cell finds its curves; compiling takes 1 to 3
FIRST = 5.0
COMPILING = "Compiling; this takes a few seconds, once for each kind of loop."
COMPUTING = "Computing; the first time it may have to compile, which takes a few seconds."
KEPT = "the curves are those of the last good setting"
ENDED = "the curves end there"
SHADOW = ", those of the last good setting are grey"


def rows(loop: ClosedLoop, duration: float | None = None, dt: float | None = None,
         tau: float | None = None, *, phase: bool = False) -> int:
    """Return how many rows of a run to record."""
    samples = (duration or loop.duration or 0.0)/(tau or loop.tau or dt or loop.dt or math.inf)
    return round(samples) if ROWS < samples <= SAMPLES else PLANE if phase else ROWS


class _Drawn(NamedTuple):
    """What a live plot shows.

    The name of the loop, the loop, the result, its curves or a drawing, figures of merit as HTML,
    the name of a file to download, and the curves of the setting before.
    """

    choice: str
    loop: Loop
    run: Any
    curves: list
    drawing: tuple
    figures: str
    file: str
    shadow: dict[str, Curve]


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
        The last good one; ``live.observe(f, "run")`` calls `f` after every new one.
    curves : dict
        What is drawn of a run, in the units shown: ``live.curves["u"].y`` over
        ``live.curves["u"].x``; keys `y r dy dr y_m u xi sigma phase plane`, `x.<state>`,
        `law.<state>`, `probe.<name>`; `u.range` and `sigma.range` are what they fill between rows.
        They are those of a run that was lost, up to its end; none if another loop was chosen and
        has none yet.
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
        self._states = known("live", states, loops.values())
        self.mask, self._picture = Mask(loops, include, tau, dt), Picture()
        self._planes = W.ToggleButton(bool(phase), description="Phase planes",
                                      tooltip="Show sigma' over sigma, and e' over e")
        self._drawn: _Drawn | None = None
        self._shown: _Drawn | None = None
        # loop, times and whether with planes, the run with more rows for these, and the run
        self._stored: tuple | None = None
        self._zoom = ()
        self._good: _Drawn | None = None
        self._rested = 0.0  # when the last setting was drawn
        self.status, self._told = "", ("", False, "")
        self._answered = None  # the setting that _told is about
        self._metrics, self._download = W.HTML(), Download(lambda: self.run.to_csv())
        self.job = Job(self._work)
        self.mask.children = [*self.mask.children, self.job]
        simulated = any(isinstance(q, ClosedLoop) for q in self.mask.offered.values())
        below = W.HBox([*[self._planes]*simulated, self._download])
        self._side = W.VBox([self._metrics, self._picture, below])
        self._side.add_class("smcaero-plot")
        super().__init__([self.mask, self._side])
        self.add_class("smcaero-live")
        self.mask.observe(self._ask, "target")
        self._planes.observe(self._ask, "value")
        self._picture.view.observe(self._ask, "span")
        self._ask(patience=FIRST)

    @property
    def loop(self) -> Loop:
        """The loop as set now."""
        return self.mask.target

    @property
    def curves(self) -> dict[str, Curve]:
        """What is drawn of a run, by key."""
        new = self._shown
        if new is None or self._picture.curves.state == "gone":
            return {}
        return {c.key: c for c in new.curves}

    @property
    def figure(self) -> go.Figure:
        """What is drawn, as a figure of plotly."""
        new = self._shown
        if new is None or self._picture.curves.state == "gone":
            return go.Figure()
        traces, layout = draw({"": new.curves}) if new.curves else new.drawing
        return go.Figure(traces, layout)

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
        simulated = isinstance(self.loop, ClosedLoop)
        how = self._planes.value, tuple(self._picture.view.span), self.mask.method
        how = how if simulated else ()
        setting, asked = (self.mask.chosen, self.loop, how), self.job.worker.asked
        if asked and not again and asked[0][1] is setting[1] and asked[0][::2] == setting[::2]:
            return
        if not self.job.ask(setting, patience):
            answered = self._answered or setting
            if self._drawn and (self._drawn.loop is not self.loop or answered[2][2:] != how[2:]):
                self._mark(self._without(self.mask.chosen))
            if self.job.worker.fraction is None:
                self._say(COMPILING if simulated else COMPUTING)
            if self._answered is setting:  # just now
                text, refused, state = self._told
                self._say(text, refused)
                self._mark(state)

    def _without(self, choice):
        """How curves of another setting are shown: grey, or not at all if of another loop."""
        return "old" if self._drawn and self._drawn.choice == choice else "gone"

    def _kept(self, choice):
        return f"; {KEPT}" if self._without(choice) == "old" else ""

    def _mark(self, state):
        self._picture.mark(state)
        self._side.layout.visibility = "hidden" if state == "gone" else "visible"

    def _work(self, asked, progress):
        """Simulate or call, and draw or say why not; say what speaks against a run, too."""
        (choice, loop, how), refused, lost = asked, True, True

        def watched(fraction):
            progress(fraction)
            if self.status == COMPILING:
                self._say("")

        try:
            self._draw()  # what Ctrl-C left half drawn
            progress()
            if isinstance(loop, ClosedLoop):
                text, refused, lost = self._simulated(choice, loop, how, watched)
            else:
                text, refused = self._called(choice, loop)
                lost = False
        except Cancelled:
            text = f"Cancelled{self._kept(choice)}."
        except Overtaken:
            text, lost = "", False
        except BaseException as why:  # a block may raise anything: say it, and the page goes on
            if interrupted(why):
                raise
            text = f"{why_not(why)}{self._kept(choice)}."
        if lost:
            self._mark(self._without(choice) if self._drawn else "")
        self._told = text, refused, self._picture.curves.state
        self._answered = asked
        self._say(text, refused)

    def _simulated(self, choice, loop, how, progress):
        """Draw a run; return what to say, whether it is refused, and whether it has no curves."""
        phase, span, method = how
        times = self.times | dict(method=method)
        what = loop, times, phase
        stored = self._stored  # what is only zoomed is not simulated again
        if stored is None or stored[0] is not loop or stored[1:3] != what[1:] or self._zoom == span:
            record = rows(loop, **self.times, phase=phase)
            fine = simulate(loop, **times, record=record, progress=progress)
            run = thinned(fine, ROWS) if record == PLANE else fine
            self._stored = stored = *what, fine, run
        self._zoom, (fine, run) = span, stored[3:]
        good, made = run.diverged_at is None, None
        if len(run.t):
            shown = zoomed(loop, run, span, times, simulate, progress)
            curves = panels(shown, self._states, phase, fine=fine, span=span or None)
            kept = good or not (self._good and self._good.choice == choice)
            figures = verdict_html(run) + metrics_html(run)
            shadow = self._shadow(choice, loop, good)
            made = _Drawn(choice, loop, run if kept else self.run, curves, (), figures, "", shadow)
            self._drawn = made
            self._good = made if good else self._good
            self._draw()
        if good:
            return doubts_text(run.doubts()), False, False
        end = f"; {ENDED}" + SHADOW*bool(made.shadow) if made else self._kept(choice)
        return f"{why_diverged(run)}{end}.", True, made is None

    def _shadow(self, choice, loop, good):
        """The curves of the setting before, or of the last good one if either run was lost."""
        last, now = self._drawn, time.monotonic()
        if not (last and last.choice == choice and last.curves):
            return {}
        if not good or last is not self._good:  # a lost run would set the scale
            return before(self._good.curves) if self._good and self._good.choice == choice else {}
        if last.loop is loop or now - self._rested < REST:
            return last.shadow  # zoomed; or a slider on its way
        self._rested = now
        return before(last.curves)

    def _called(self, choice, block):
        """Draw what a block returns, and what it warns of."""
        with warnings.catch_warnings(record=True) as remarks:
            warnings.simplefilter("always")
            result = block()
        name = (choice or block.name).removesuffix(".csv")
        file = f"{name}, estimates.csv" if hasattr(result, "to_csv") else ""
        self._drawn = _Drawn(choice, block, result, [], figure(result), result_html(result), file,
                             {})
        self._draw()
        return " ".join(dict.fromkeys(f"{q.message}." for q in remarks)), False

    def _draw(self):
        """Show what is to be drawn, unless it is shown already; doing so twice is harmless."""
        new = self._drawn
        if new is None:
            return
        if self._shown is not new:
            last, self._shown = self._shown, None
            shadow = [(i, *new.shadow[c.key].points)
                      for i, c in enumerate(new.curves) if c.key in new.shadow]
            if not new.curves:
                self._picture.show(*new.drawing)
            elif last and structure(new.curves) == structure(last.curves):
                # only the numbers travel
                x, y = zip(*(c.points for c in new.curves), strict=True)
                self._picture.move(x, y, shadow)
            else:
                self._picture.show(*draw({"": new.curves}), shadow)
            self._metrics.value = new.figures
            self._download.show(new.file)
            self._side.layout.visibility = "visible"
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
