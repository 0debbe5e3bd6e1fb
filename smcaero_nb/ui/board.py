"""Live plots: a mask beside the curves of what it sets."""

import copy
import threading
import time

import ipywidgets as W
import plotly.graph_objects as go

from ..core import BlockError, ParameterError, simulate
from ..core.param import unknown
from .form import Mask
from .panels import draw, metrics_html, panels, structure
from .words import why_diverged
from .worker import Dropped, Newest

__all__ = ["Live", "live"]

ROWS = 1000  # recorded rows of a run: what a screen resolves
PATIENCE = 0.15  # s that a moved slider waits for its run; a longer one goes on by itself
FIRST = 5.0  # s that a new plot waits, so that the next cell finds its curves: compiling takes 1 to 3
EMPTY = dict(template="plotly_white", xaxis_visible=False, yaxis_visible=False, height=300)
KEPT = "the curves are those of the last good setting"


class _Figure(go.FigureWidget):
    """A figure whose curves may change from any thread, and which a page finds as it is now, whenever it loads.

    plotly gives its traces and layout to the page at construction only, loses what is sent before the page has loaded
    its code, and loses an update that is sent while a message of the page is handled in another thread.
    """

    def __init__(self, *args, **kwargs):
        self._turn = threading.RLock()
        super().__init__(*args, **kwargs)
        self._config = {"responsive": True, "displaylogo": False}

    def get_state(self, key=None, drop_defaults=False):
        with self._turn:
            if key is None and getattr(self, "_data", None) is not None:
                self._trait_values["_widget_data"] = copy.deepcopy(self._data)
                self._trait_values["_widget_layout"] = copy.deepcopy(self._layout)
            return super().get_state(key, drop_defaults)

    def set_state(self, sync_data):
        with self._turn:
            super().set_state(sync_data)

    def show_curves(self, curves):
        """Draw other curves in the same panels, in one message."""
        with self._turn, self.batch_update():
            for trace, c in zip(self.data, curves, strict=True):
                if len(trace.x) != len(c.t) or trace.x[-1] != c.t[-1]:
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
        Traces of the figure: ``live.curves["u"].y``; keys `y r dy dr u sigma`, `x.<state>`, `law.<state>`.
    status : str
        What the mask says about the newest run; empty if all is well.
    """

    def __init__(self, loops, duration, dt, tau, states, include):
        self._options = dict(duration=duration, dt=dt, tau=tau, record=ROWS)
        self.mask, self.figure, self._states = Mask(loops, include), _Figure(layout=EMPTY), states
        self._built = []  # the panels of the figure
        self.run, self.status, self._drawn = None, "", None  # _drawn: which of the loops the curves are of
        for loop in self.mask.offered.values():
            for n in states:
                if n not in loop.stages["plant"].states:
                    raise unknown(f"live: the plant {loop.stages['plant'].name}", n, loop.stages["plant"].states)
        self._metrics = W.HTML()
        self._bar = W.FloatProgress(max=1.0, layout=W.Layout(width="auto", flex="1 1 auto"))
        self._stop = W.Button(description="Cancel", icon="stop", tooltip="Stop this run")
        self._stop.on_click(lambda _: self.cancel())
        self._busy = W.HBox([self._bar, self._stop], layout=W.Layout(visibility="hidden"))
        self._busy.add_class("smcaero-busy")
        self.mask.children = [*self.mask.children, self._busy]
        self._side = W.VBox([self._metrics, self.figure])
        self._side.add_class("smcaero-plot")
        super().__init__([self.mask, self._side])
        self.mask.on_drawn(lambda: self.figure.repeat())
        self.add_class("smcaero-live")
        self._worker = Newest(self._work, self._rest)
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
        try:
            while not self._worker.idle.wait(0.05):
                pass
        except KeyboardInterrupt:
            self.cancel()
            raise

    def cancel(self):
        """Stop the run at work; the curves stay those of the last good setting."""
        self._worker.cancel()

    def _ask(self, _=None, patience=PATIENCE):
        """Run the loop as set; wait a moment for it, so that a moved slider never queues, then let it go on by itself."""
        self._worker.ask((self.mask.choice.value, self.loop))
        if self._worker.idle.wait(patience):
            return
        with self._worker.lock:
            if not self._worker.idle.is_set():
                self._busy.layout.visibility = "visible"
                if self._worker.fraction is None:
                    self._say("Compiling; this takes a few seconds, once for each kind of loop.")

    def _rest(self):
        self._busy.layout.visibility = "hidden"

    def _work(self, asked, progress):
        """Simulate and draw, or say why not."""
        (choice, loop), told = asked, [0.0]

        def watched(fraction):
            progress(fraction)
            now = time.perf_counter()
            if now - told[0] > 0.1:
                told[0], self._bar.value = now, fraction
                self._say("")

        try:
            run = simulate(loop, **self._options, progress=watched)
            first, good = choice != self._drawn, run.diverged_at is None
            text = "" if good else f"{why_diverged(run)}; {'the curves end there' if first else KEPT}."
            if good or first:
                self._drawn, self.run, self._metrics.value = choice, run, metrics_html(run)
                self._show(panels(run, self._states))
        except Dropped as why:
            text = f"Cancelled; {KEPT}." if why.args == ("cancelled",) else ""
        except Exception as why:  # a block may raise anything: a person reads it, and the page goes on
            text = f"{why if isinstance(why, (ParameterError, BlockError)) else f'{type(why).__name__}: {why}'}; {KEPT}."
        self._say(text, refused=True)

    def _show(self, curves):
        """Draw the curves; other panels need another figure, because a page may lose traces that are added later."""
        if structure(curves) == self._built:
            self.figure.show_curves(curves)
        else:
            old, self.figure, self._built = self.figure, _Figure(go.Figure(*draw({"": curves}))), structure(curves)
            self._side.children = [self._metrics, self.figure]
            old.close()

    def _say(self, text, refused=False):
        if text != self.status:
            self.status = text
            self.mask.say(text, refused)


def live(loop, duration=None, dt=None, tau=None, states=(), include=None):
    """Show a mask beside the live curves of the loop that it sets.

    Parameters
    ----------
    loop : ClosedLoop or dict of str to ClosedLoop
        ``{name: loop}`` offers a choice.
    duration, dt, tau : float, optional
        As in `simulate`; default: the loop's own.
    states : sequence of str
        Plant states to draw, with the control if they have its unit: ``("beta",)``.
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
    return Live(loop, duration, dt, tau, states, include)
