"""What Python sends to the page as curves and as files.

What changes is kept in plain models beside the widgets of anywidget, in `Picture`, `Download` and
`Page`: a widget whose code took the page longer than 2 s to load is never told anything again by
anywidget, and a page with many pictures is that slow.
"""

import functools
import pathlib
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import anywidget
import ipywidgets as W
import numpy as np
import plotly.graph_objects as go
import traitlets
from plotly.offline import get_plotlyjs

__all__ = ["Download", "Picture"]

HERE = pathlib.Path(__file__).parent
# bytes: on its own machine TCP passes on a packet of up to 64 KiB at once if it is full; a smaller
# one waits, where Jupyter's server is the sender, until the page acknowledges the one before, and
# that takes 40 ms
FULL = 65_536


class _Code(W.Widget):
    """The text of plotly.js: sent to a page once, however many pictures it has."""

    text = traitlets.Unicode().tag(sync=True)


@functools.cache
def _plotly():
    return _Code(text=get_plotlyjs())


class _Curves(W.Widget):
    """What a picture shows now."""

    drawing = traitlets.Dict().tag(sync=True)  # traces and layout, without the numbers
    x = traitlets.List().tag(sync=True)
    y = traitlets.List().tag(sync=True)
    filling = traitlets.Bytes().tag(sync=True)  # so that the message fills a packet
    behind = traitlets.List().tag(sync=True)  # [number of a trace, x, y]: as it was before, in grey
    state = traitlets.Unicode().tag(sync=True)  # of what is drawn: "" as set, "old", "gone"


class _View(W.Widget):
    """What the page tells."""

    span = traitlets.List().tag(sync=True)  # zoomed to: [from, to] on the axis of time, or nothing
    near = traitlets.Bool(False).tag(sync=True)  # it is on the machine of the server


class Picture(anywidget.AnyWidget):
    """Traces and layout, drawn by plotly.js.

    The curves are state, not messages as in plotly's own FigureWidget: a page that loads slowly, or
    is reloaded, draws the current ones. The page answers nothing but where it is and what it has
    zoomed to, in a model of its own, `view`; so any thread may change the curves.
    """

    _esm = HERE / "picture.js"
    code = traitlets.Instance(_Code).tag(sync=True, **W.widget_serialization)
    curves = traitlets.Instance(_Curves).tag(sync=True, **W.widget_serialization)
    view = traitlets.Instance(_View).tag(sync=True, **W.widget_serialization)

    def __init__(self):
        super().__init__(code=_plotly(), curves=_Curves(), view=_View())

    def mark(self, state: str) -> None:
        """Show what is drawn in grey if ``"old"``; ``"gone"`` leaves it to who hides it."""
        self.curves.state = state

    def show(self, traces: Sequence[Any], layout: dict[str, Any],
             behind: Iterable[tuple[int, Any, Any]] = ()) -> None:
        """Draw traces, and behind some of them what they were before: (number, x, y)."""
        drawn = go.Figure(traces, layout).to_plotly_json()
        for name, axis in drawn["layout"].items():
            if name.startswith(("xaxis", "yaxis")):  # else it keeps the range of the figure before
                axis.setdefault("autorange", "range" not in axis)
        sent = [{k: _numbers(t[k] if k in t else None) for k in "xy"} for t in traces]
        bare = [{k: v for k, v in t.items() if k != "uid" and not len(numbers.get(k, ()))}
                for t, numbers in zip(drawn["data"], sent, strict=True)]
        with self.curves.hold_sync():
            self.curves.drawing = dict(traces=bare, layout=drawn["layout"])
            x, y = ([numbers[k] for numbers in sent] for k in "xy")
            self.move(x, y, behind)

    def move(self, x: Iterable, y: Iterable,
             behind: Iterable[tuple[int, Any, Any]] = ()) -> None:
        """Draw the same traces with other numbers."""
        with self.curves.hold_sync():
            self.curves.x, self.curves.y = ([_bytes(q) for q in values] for values in (x, y))
            self.curves.behind = [[n, _bytes(a), _bytes(b)] for n, a, b in behind]
            self.curves.state = ""
            if self.view.near:  # of another size than before, or it would not be sent
                self.curves.filling = bytes(FULL + (len(self.curves.filling) == FULL))


def _bytes(values):
    return np.asarray(values, np.float32).tobytes()


def _numbers(values):
    """What float32 resolves; nothing of other values, such as texts or times since 1970.

    Those stay in the drawing.
    """
    try:
        full = np.asarray(values, float)
    except (TypeError, ValueError):
        return ()
    if full.ndim != 1 or not full.size:
        return ()
    with np.errstate(all="ignore"):
        drawn, there = full.astype(np.float32), full[np.isfinite(full)]
        error = np.abs(there.astype(np.float32) - there).max(initial=0.0)
        coarse = there.size and error > 1e-4*np.ptp(there)
    return () if coarse and getattr(values, "dtype", None) != np.float32 else drawn


class _Saved(W.Widget):
    """What a button saves: the text is sent as a message, when it is asked for."""

    file = traitlets.Unicode().tag(sync=True)  # its name; empty: no button


class Download(anywidget.AnyWidget):
    """A button that saves the text that `make` returns as a file."""

    _esm = HERE / "download.js"
    saved = traitlets.Instance(_Saved).tag(sync=True, **W.widget_serialization)

    def __init__(self, make: Callable[[], str]):
        super().__init__(saved=_Saved())
        self.saved.on_msg(lambda *_: self.saved.send({}, [make().encode()]))

    def show(self, file: str) -> None:
        """Offer the file under this name, or nothing if it is empty."""
        self.saved.file = file
