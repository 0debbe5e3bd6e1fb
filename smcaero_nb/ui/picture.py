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
    near = traitlets.Bool(False).tag(sync=True)  # the page says: it is on the machine of the server
    filling = traitlets.Bytes().tag(sync=True)  # so that the message fills a packet


class Picture(anywidget.AnyWidget):
    """Traces and layout, drawn by plotly.js.

    The curves are state, not messages as in plotly's own FigureWidget: a page that loads slowly, or
    is reloaded, draws the current ones. The page changes none, so any thread may change them.
    """

    _esm = HERE / "picture.js"
    code = traitlets.Instance(_Code).tag(sync=True, **W.widget_serialization)
    curves = traitlets.Instance(_Curves).tag(sync=True, **W.widget_serialization)

    def __init__(self):
        super().__init__(code=_plotly(), curves=_Curves())

    def show(self, traces: Sequence[Any], layout: dict[str, Any]) -> None:
        """Draw traces."""
        drawn = go.Figure(traces, layout).to_plotly_json()
        for name, axis in drawn["layout"].items():
            if name.startswith(("xaxis", "yaxis")):  # else it keeps the range of the figure before
                axis.setdefault("autorange", "range" not in axis)
        sent = [{k: _numbers(t[k] if k in t else None) for k in "xy"} for t in traces]
        bare = [{k: v for k, v in t.items() if k != "uid" and not len(numbers.get(k, ()))}
                for t, numbers in zip(drawn["data"], sent, strict=True)]
        with self.curves.hold_sync():
            self.curves.drawing = dict(traces=bare, layout=drawn["layout"])
            self.move(*([numbers[k] for numbers in sent] for k in "xy"))

    def move(self, x: Iterable, y: Iterable) -> None:
        """Draw the same traces with other numbers."""
        with self.curves.hold_sync():
            self.curves.x, self.curves.y = (
                [np.asarray(q, np.float32).tobytes() for q in values] for values in (x, y))
            if self.curves.near:  # another size, or it would not be sent
                self.curves.filling = bytes(FULL + (len(self.curves.filling) == FULL))


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
