"""Live plots: a mask beside the curves of what it sets."""

import copy
import threading

import ipywidgets as W
import plotly.graph_objects as go

from ..core import BlockError, ParameterError, simulate
from ..core.param import unknown
from .form import Mask
from .job import Job
from .panels import PHASE, draw, metrics_html, panels, structure
from .words import why_diverged
from .worker import Dropped

__all__ = ["Figure", "Live", "live"]

ROWS = 1000  # recorded rows of a run: what a screen resolves
PATIENCE = 0.15  # s that a moved slider waits for its run; a longer one goes on by itself
FIRST = 5.0  # s that a new plot waits, so that the next cell finds its curves: compiling takes 1 to 3
EMPTY = dict(template="plotly_white", xaxis_visible=False, yaxis_visible=False, height=300)
COMPILING = "Compiling; this takes a few seconds, once for each kind of loop."
KEPT = "the curves are those of the last good setting"


class Figure(go.FigureWidget):
    """A figure whose curves may change from any thread, and which a page finds as it is now, whenever it loads.

    plotly gives its traces and layout to the page at construction only, loses what is sent before the page has loaded
    its code, and loses an update that is sent while a message of the page is handled in another thread.
    """

    def __init__(self, *args, **kwargs):
        self._turn = threading.RLock()
        super().__init__(*args, **kwargs)
        self._config = {"responsive": True, "displaylogo": False}

    def get_state(self, key=None, drop_defaults=False):
        """As the page gets it: with the traces and layout of now."""
        with self._turn:
            if key is None and getattr(self, "_data", None) is not None:
                self._trait_values["_widget_data"] = copy.deepcopy(self._data)
                self._trait_values["_widget_layout"] = copy.deepcopy(self._layout)
            return super().get_state(key, drop_defaults)

    def set_state(self, sync_data):
        """Take what the page says, in turn with what is sent to it."""
        with self._turn:
            super().set_state(sync_data)

    def show_curves(self, curves):
        """Draw other curves in the same panels, in one message."""
        with self._turn, self.batch_update():
            for trace, c in zip(self.data, curves, strict=True):
                if c.row == PHASE or len(trace.x) != len(c.t) or trace.x[-1] != c.t[-1]:
                    trace.x = c.t
                trace.y = c.y

    def repeat(self):
        """Send the curves again, to a page that may have lost some while it loaded."""
        with self._turn:
            if self.data:
                self._send_restyle_msg({n: [t[n] for t in self.data] for n in ("x", "y")}, list(range(len(self.data))))


class Live(W.Box):
    """A mask beside the live curves of what it sets; made by `live`.

    Attributes
    ----------
    mask : Mask
    figure : plotly.graph_objects.FigureWidget
    loop : ClosedLoop
        As set now.
    run : Run or None
        The last good run, the one drawn.
    curves : dict
        Traces of the figure: ``live.curves["u"].y``; keys `y r dy dr u xi sigma phase`, `x.<state>`, `law.<state>`.
    status : str
        What the mask says about the newest run; empty if all is well.
    times : dict
        duration, dt and tau as given to `live`.
    job : Job
        The thread that simulates, with its progress bar.
    """

    def __init__(self, loops, duration, dt, tau, states, phase, include):
        self.times = dict(duration=duration, dt=dt, tau=tau)
        self.mask, self.figure, self._shown = Mask(loops, include), Figure(layout=EMPTY), (states, phase)
        self._built = []  # the panels of the figure
        self.run, self.status, self._drawn = None, "", None  # _drawn: which of the loops the curves are of
        for loop in self.mask.offered.values():
            for n in states:
                if n not in loop.stages["plant"].states:
                    raise unknown(f"live: the plant {loop.stages['plant'].name}", n, loop.stages["plant"].states)
        self._metrics = W.HTML()
        self.job = Job(self._work)
        self.mask.children = [*self.mask.children, self.job]
        self._side = W.VBox([self._metrics, self.figure])
        self._side.add_class("smcaero-plot")
        super().__init__([self.mask, self._side])
        self.mask.on_drawn(lambda: self.figure.repeat())
        self.add_class("smcaero-live")
        self.mask.observe(self._ask, "target")
        self._ask(patience=FIRST)

    @property
    def loop(self):
        """The loop as set now."""
        return self.mask.target

    @property
    def curves(self):
        """{key: trace} of the figure."""
        return {trace.meta: trace for trace in self.figure.data}

    def set(self, **values):
        """Set values as the mask does, and wait until the curves show them.

        Raises
        ------
        ParameterError
            An unknown name, or a value that its metadata does not allow; nothing has changed then.
        """
        self.mask.set(**values)
        self.wait()

    def wait(self):
        """Wait until the newest setting has been simulated and drawn; Ctrl-C cancels that."""
        self.job.wait()

    def cancel(self):
        """Stop the run at work; the curves stay those of the last good setting."""
        self.job.cancel()

    def _ask(self, _=None, patience=PATIENCE):
        """Run the loop as set; wait a moment for it, so that a moved slider never queues, then let it go on by itself."""
        if not self.job.ask((self.mask.choice.value, self.loop), patience):
            with self.job.worker.lock:
                if not self.job.worker.idle.is_set() and self.job.worker.fraction is None:
                    self._say(COMPILING)

    def _work(self, asked, progress):
        """Simulate and draw, or say why not; a run that the law's theorem does not cover is drawn, and said to be so."""
        (choice, loop), refused = asked, True

        def watched(fraction):
            progress(fraction)
            if self.status == COMPILING:
                self._say("")

        try:
            run = simulate(loop, **self.times, record=ROWS, progress=watched)
            first, good = choice != self._drawn, run.diverged_at is None
            text = "" if good else f"{why_diverged(run)}; {'the curves end there' if first else KEPT}."
            refused = not good
            if good:
                text = "".join(f"{q}: the theorem does not cover this. " for q in run.doubts()).strip()
            if good or first:
                self._drawn, self.run, self._metrics.value = choice, run, metrics_html(run)
                self._show(panels(run, *self._shown))
        except Dropped as why:
            text = f"Cancelled; {KEPT}." if why.args == ("cancelled",) else ""
        except Exception as why:  # a block may raise anything: a person reads it, and the page goes on
            text = f"{why if isinstance(why, (ParameterError, BlockError)) else f'{type(why).__name__}: {why}'}; {KEPT}."
        self._say(text, refused)

    def _show(self, curves):
        """Draw the curves; other panels need another figure, because a page may lose traces that are added later."""
        if structure(curves) == self._built:
            self.figure.show_curves(curves)
        else:
            old, self.figure, self._built = self.figure, Figure(go.Figure(*draw({"": curves}))), structure(curves)
            self._side.children = [self._metrics, self.figure]
            old.close()

    def _say(self, text, refused=False):
        if text != self.status:
            self.status = text
            self.mask.say(text, refused)


def live(loop, duration=None, dt=None, tau=None, states=(), phase=False, include=None):
    """Show a mask beside the live curves of the loop that it sets.

    Parameters
    ----------
    loop : ClosedLoop or dict of str to ClosedLoop
        ``{name: loop}`` offers a choice.
    duration, dt, tau : float, optional
        As in `simulate`; default: the loop's own.
    states : sequence of str
        Plant states to draw, with the control if they have its unit: ``("beta",)``.
    phase : bool
        With the phase portrait, sigma' over sigma.
    include : sequence of str, optional
        Names or stages that the mask shows, as in `mask`.

    Returns
    -------
    Live
        A widget.

    Raises
    ------
    ParameterError
        `states` or `include` names something that does not exist.

    Notes
    -----
    A run of up to 0.15 s is drawn before the control that asked for it returns. A longer one goes on by itself, with a
    progress bar and a button that cancels it; a newer setting takes its place. In a program, `Live.set` waits for the
    curves.

    Examples
    --------
    >>> plot = live(smc.lv.loop("quasi_smc"), states=("beta",))
    >>> plot.set(law__rho=3.0)
    >>> plot.curves["u"].y.max()
    """
    return Live(loop, duration, dt, tau, states, phase, include)
