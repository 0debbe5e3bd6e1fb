"""Curves in the page.

What changes is kept in plain models beside the widgets of anywidget, here and in `Page` and `Download`: anywidget tells a widget
whose code took the page longer than 2 s to load nothing ever after, and a page with many pictures is that slow.
"""

import functools
import pathlib

import anywidget
import ipywidgets as W
import numpy as np
import plotly.graph_objects as go
import traitlets
from plotly.offline import get_plotlyjs

__all__ = ["Picture"]


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


class Picture(anywidget.AnyWidget):
    """Traces and layout, drawn by plotly.js.

    The curves are state, not messages as in plotly's own FigureWidget: a page that loads slowly, or anew, draws what is there
    now; and the page answers nothing, so that they may change from any thread.
    """

    _esm = pathlib.Path(__file__).parent / "picture.js"
    code = traitlets.Instance(W.Widget).tag(sync=True, **W.widget_serialization)
    curves = traitlets.Instance(W.Widget).tag(sync=True, **W.widget_serialization)

    def __init__(self):
        super().__init__(code=_plotly(), curves=_Curves())

    def show(self, traces, layout):
        """Draw traces."""
        drawn = go.Figure(traces, layout).to_plotly_json()
        for name, axis in drawn["layout"].items():  # else one that was given a range before stays without any
            if name.startswith(("xaxis", "yaxis")):
                axis.setdefault("autorange", "range" not in axis)
        x, y = ([_numbers(t[k] if k in t else None) for t in traces] for k in "xy")
        bare = [{k: v for k, v in t.items() if k != "uid" and not (k == "x" and len(a) or k == "y" and len(b))}
                for t, a, b in zip(drawn["data"], x, y, strict=True)]
        with self.curves.hold_sync():
            self.curves.drawing = dict(traces=bare, layout=drawn["layout"])
            self.move(x, y)

    def move(self, x, y):
        """Draw the same traces with other numbers."""
        with self.curves.hold_sync():
            self.curves.x, self.curves.y = ([np.asarray(q, np.float32).tobytes() for q in values] for values in (x, y))


def _numbers(values):
    """What float32 tells apart; nothing for other values, such as texts or times since 1970: they stay in the drawing."""
    try:
        full = np.asarray(values, float)
    except (TypeError, ValueError):
        return ()
    if full.ndim != 1 or not full.size:
        return ()
    with np.errstate(all="ignore"):
        drawn, there = full.astype(np.float32), full[np.isfinite(full)]
        coarse = there.size and np.abs(there.astype(np.float32) - there).max() > 1e-4*np.ptp(there)
    return () if coarse and getattr(values, "dtype", None) != np.float32 else drawn
