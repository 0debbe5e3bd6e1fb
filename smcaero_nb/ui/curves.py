"""Figures of runs: which curves are drawn, in which panels, and how."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import zip_longest
from typing import Any, NamedTuple

import numpy as np
import plotly.graph_objects as go

from ..core import Param, Run
from ..core.perturbation import degree, laws
from ..core.signal import flat
from .text import UNKNOWN, measure, plain, reached, said_html, shown, symbol, unit_html

__all__ = ["Curve", "comparison_html", "draw", "metrics_html", "panels", "structure", "verdict_html"]

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")  # of Okabe and Ito, for everybody
SYMBOLS = ("circle", "square", "diamond", "triangle-up", "cross")
DASHES = ("solid", "dash", "dashdot")
NAMED = {"sigma": r"\sigma", "dy": r"\dot y", "xi": r"\xi", "phase": r"\dot\sigma"}
LAW = "states of the law"
PHASE = "phase portrait"  # the row whose abscissa is sigma, not time
ROW, TALL, GAP, TOP, BOTTOM = 112, 260, 28, 30, 44  # px; the phase portrait is a tall row
APART = 0.16  # of the width, between columns
LAYOUT: dict[str, Any] = dict(
    autosize=True, margin=dict(l=72, r=14, t=TOP, b=BOTTOM), template="plotly_white",
    font=dict(size=12, color="#222"), hovermode="x", hoversubplots="axis", hoverlabel_namelength=-1,
    uirevision="kept")
X_AXIS = dict(visible=True, showspikes=True, spikethickness=1, spikecolor="#999")
Y_AXIS = dict(visible=True, nticks=5, exponentformat="e", zerolinecolor="#ccc", title_standoff=6)
LEGEND = dict(orientation="h", xanchor="right", yanchor="bottom", font_size=11, bgcolor="rgba(0,0,0,0)")


class Curve(NamedTuple):
    """A curve: its name in `Live.curves`, panel (row, column), metadata, and data as drawn."""

    key: str
    row: str
    column: int
    meta: Param
    x: np.ndarray
    y: np.ndarray
    reference: bool = False
    across: Param = Param("t", "s")
    held: bool = False  # from point to point

    @property
    def label(self) -> str:
        """Its symbol."""
        meta = _named(self.meta, self.key.partition("[")[0])
        return symbol(meta.symbol).removesuffix("(0)")  # not the start of a law's state

    @property
    def unit(self) -> str:
        """Its unit, as shown."""
        return unit_html(shown(self.meta)[1])

    @property
    def abscissa(self) -> str:
        """Title of the axis below."""
        return symbol(self.across.symbol) + unit_html(shown(self.across)[1])


def _named(meta, name):
    """Metadata with a symbol, by default that of the name."""
    return replace(meta, symbol=meta.symbol or NAMED.get(name, name))


def _channels(signal, meta, many):
    """The channels of a signal, each a list of (array, Param): the output, then its derivatives."""
    metas = list(meta) if isinstance(meta, tuple) else [meta]
    if many and isinstance(signal, tuple):
        return [_channels(s, m, False)[0] for s, m in zip_longest(signal, metas[:len(signal)])]
    parts = flat(signal)
    return [[(s, m or Param()) for s, m in zip_longest(parts, metas[:len(parts)])]]


def _extremes(t, y, low, high):
    """A curve through the rows with two more points for each, where chattering between rows shows."""
    a, b, low, high = y[:-1], y[1:], low[1:], high[1:]
    dips, peaks = low < np.minimum(a, b), high > np.maximum(a, b)
    first = np.where(peaks & ~(dips & (a < b)), high, np.where(dips, low, a + (b - a)/3))
    second = np.where(peaks & dips, np.where(a < b, high, low), a + (b - a)*2/3)
    step = np.diff(t)/3
    return (np.append(t[0], np.column_stack([t[:-1] + step, t[1:] - step, t[1:]])),
            np.append(y[0], np.column_stack([first, second, b])))


def _single(values):
    """Values as drawn; those that are too large become infinite."""
    with np.errstate(over="ignore"):
        return values.astype(np.float32)


def _corners(t, y):
    """A curve without the inner points of its level stretches."""
    keep = np.ones(len(t), bool)
    keep[1:-1] = (y[1:-1] != y[:-2]) | (y[1:-1] != y[2:])
    return t[keep], y[keep]


def panels(run: Run, states: Iterable[str] = (), phase: bool = False) -> list[Curve]:
    """Return the curves of a run.

    These are output against reference, rate, control and states, sliding variable, states of the
    law. An output that has neither metadata nor a reference to follow is not drawn: it only makes
    the error. Where nothing lies between law and plant, the perturbation that the law meets is
    drawn with the control; an observer's estimate of it has a panel of its own.

    Parameters
    ----------
    run : Run
    states : sequence of str
        Plant states to draw, with the control if they have its unit, else in their own panel.
    phase : bool
        With the phase portrait, sigma' over sigma.

    Returns
    -------
    list of Curve
        In the order of the panels; one column for each channel of the output.
    """
    stages, t, curves = run.loop.stages, run.t, []
    about = {s: run.loop.metadata(s) for s in ("y", "u", "sigma")}
    if not stages["output"]:  # y = x
        about["y"] = tuple(replace(m, symbol=m.symbol or n) for n, m in stages["plant"].states.items())
    many = isinstance(run.y, tuple) and any(isinstance(q, tuple) for q in run.y)
    outputs = _channels(run.y, about["y"], many)
    followed = about["y"] or stages["reference"] or not stages["law"]

    samples = len(t) > 1 and np.diff(t).max() < 1.001*run.tau  # each is a row: nothing lies between rows

    def add(key, row, column, meta, y, *between, reference=False, number=None, held=False):
        ts, ys = _corners(t, y) if samples else _extremes(t, y, *between) if between and len(t) > 1 else (t, y)
        key += f"[{column if number is None else number}]"*(many or number is not None)
        curves.append(Curve(key, row, column, meta, _single(ts), _single(shown(meta)[0]*ys), reference, held=held))

    for c, (ys, rs) in enumerate(zip(outputs, _channels(run.r, about["y"], many), strict=True) if followed else ()):
        for row, key, (y, meta), r in zip(("output", "rate"), ("", "d"), ys, [*rs, None], strict=False):
            add(f"{key}y", row, c, meta, y)
            if r:
                add(f"{key}r", row, c, meta, r[0], reference=True)
    controls, = _channels(run.u, about["u"], False)
    for i, ((y, meta), low, high) in enumerate(zip(controls, flat(run.low.u), flat(run.high.u), strict=True)):
        add("u", "control", min(i, len(outputs) - 1), meta, y, low, high, number=i if len(controls) > 1 else None, held=samples)
    if run.xi is not None and not stages["allocation"] and not stages["actuator"]:
        for i, (xi, (_, meta)) in enumerate(zip(flat(run.xi), controls, strict=True)):
            add("xi", "control", min(i, len(outputs) - 1), replace(meta, symbol=r"\xi"), xi, reference=True,
                number=i if len(controls) > 1 else None)
    if stages["allocation"] and "xi" in stages["allocation"].states:  # an observer
        meta = replace(stages["allocation"].states["xi"], symbol=r"\hat\xi")
        add("allocation.xi", "perturbation", 0, meta, run.z.allocation.xi)
    for n in states:
        meta = _named(stages["plant"].states[n], n)
        add(f"x.{n}", "control" if meta.unit == controls[0][1].unit else f"states [{meta.unit}]", 0, meta, getattr(run.x, n))
    if stages["surface"] or not followed:
        s = [_channels(q, about["sigma"], many) for q in (run.sigma, run.low.sigma, run.high.sigma)]
        for c, ((y, meta), (low, _), (high, _)) in enumerate(zip(*([q[0] for q in one] for one in s), strict=True)):
            add("sigma", "sliding variable", c, meta, y, low, high)
    if stages["law"]:
        for c, (name, b) in enumerate(getattr(stages["law"], "parts", {None: stages["law"]}).items()):
            if b.band:
                band = np.array([b.band(q, b.values) for q in t])
                ts, band = _corners(t, band)
                x, y = (_single(np.concatenate(q)) for q in ((ts, [math.nan], ts), (band, [math.nan], -band)))
                curves.append(Curve(f"band{f'[{c}]'*many}", "sliding variable", c, Param(r"\delta", "[sigma]"), x, y, True))
            for n, meta in b.states.items():
                if not meta.hidden:
                    z = getattr(run.z.law, name) if name else run.z.law
                    add(f"law.{n}", LAW, c, _named(meta, n), getattr(z, n))
    for c, (name, x, y) in enumerate(_portraits(run) if phase else ()):
        curves.append(Curve(f"phase{name}", PHASE, min(c, len(outputs) - 1), Param(), _single(x), _single(y),
                            across=Param(r"\sigma")))
    places = list(dict.fromkeys((c.row, c.column) for c in curves))
    return sorted(curves, key=lambda c: places.index((c.row, c.column)))  # the order of the traces in the figure


def _portraits(run):
    """(name, sigma, sigma') of each sliding variable; sigma' = xi - v where a law is for relative degree 1."""
    if run.xi is None:
        return
    many = hasattr(run.loop.stages["law"], "parts")
    for c, ((b, sigma, v, _), xi) in enumerate(zip(laws(run), run.xi if many else (run.xi,), strict=True)):
        s = flat(sigma)
        if isinstance(v, tuple):
            yield from ((f"[{i}]", q, _smooth(a) - w) for i, (q, a, w) in enumerate(zip(s, xi, v, strict=True)))
        else:
            yield f"[{c}]"*many, s[0], s[1] if degree(b, sigma, v) > 1 else _smooth(xi) - v


def _smooth(xi):
    """Remove single-row spikes: a step in the command makes sigma jump, but the plant has not moved."""
    return np.median([np.append(xi[:1], xi[:-1]), xi, np.append(xi[1:], xi[-1:])], axis=0)


def structure(curves: Iterable[Curve]) -> list[tuple]:
    """Return what a figure of the curves depends on besides their numbers."""
    return [(c.key, c.row, c.column, c.label, c.unit, c.held) for c in curves]


def draw(runs: Mapping[str, list[Curve]]) -> tuple[list, dict]:
    """Return traces and layout of a figure.

    Parameters
    ----------
    runs : dict of str to list of Curve
        The result of `panels`, by name of the run.

    Returns
    -------
    list of plotly.graph_objects.Scatter, dict
    """
    places = {}
    for run, (name, curves) in enumerate(runs.items()):
        for c in curves:
            places.setdefault((c.row, c.column), []).append((run, name, c))
    rows, columns = sorted(dict.fromkeys(r for r, _ in places), key=PHASE.__eq__), 1 + max((c for _, c in places), default=0)
    heights, tops = [TALL if r == PHASE else ROW for r in rows], [0]
    for r, h in zip(rows, heights, strict=True):
        tops.append(tops[-1] + h + (GAP + BOTTOM if rows[-1] == PHASE and r != PHASE and r == rows[-2] else GAP))
    height, axes, wide = max(tops[-1] - GAP, ROW), {}, (1.0 + APART)/columns - APART
    traces = []
    for (row, column), here in sorted(places.items(), key=lambda q: q[0][0] == PHASE):
        n = rows.index(row)
        y = str(1 + n*columns + column) if n or column else ""  # plotly writes y, y2, y3
        x = str(1 + column + columns*(row == PHASE)) if column or row == PHASE else ""
        traces += _traces(here, dict(xaxis=f"x{x}", yaxis=f"y{y}", legend=f"legend{y}"), len(runs) > 1, not traces)
        units = {c.label: c.unit for *_, c in here if not c.reference}
        unit = next(iter(units.values())) if len(set(units.values())) == 1 else ""
        title = LAW if len(units) > 3 else ", ".join(units) + unit
        bands = [c.y for *_, c in here if c.key.startswith("band") and len(c.y) > 1]
        room = [round(5.0*float(np.nanmax(q)), 6) for q in bands]  # sigma beside its band
        left, top = column*(wide + APART), 1 - tops[n]/height
        axes |= {f"yaxis{y}": dict(domain=(max(top - heights[n]/height, 0.0), top), anchor=f"x{x}", title_text=title,
                                   range=(-max(room), max(room)) if any(room) else None, **Y_AXIS),
                 f"xaxis{x}": dict(domain=(left, left + wide), anchor=f"y{y}", **X_AXIS | dict(  # below the lowest panel
                     title=dict(text=here[0][2].abscissa, standoff=4))),
                 f"legend{y}": dict(x=left + wide, y=top, **LEGEND)}
    return traces, dict(height=height + TOP + BOTTOM, **LAYOUT, **axes)


def _traces(curves, place, several, first):
    """Traces of one panel: curves of one run differ in dashes and colours, runs in colours."""
    traces, told, ranks = [], set(), {}
    mixed = len({c.unit for *_, c in curves if not c.reference}) > 1
    for run, name, c in curves:
        if c.reference and run:
            continue  # drawn once
        rank = ranks[run] = ranks.get(run, -1) + (not c.reference)
        colour = COLOURS[(run if several else rank) % len(COLOURS)]
        line = dict(color="#444", dash="dot") if c.reference else dict(color=colour, dash=DASHES[rank % len(DASHES)])
        line |= dict(width=1.0, shape="hv") if c.held else dict(width=1.5)
        label = plain(name) if several and not rank else c.label + c.unit*mixed
        if c.reference:
            label = c.label if c.key.startswith(("xi", "band")) else "reference"
        tell = first or rank > 0 or c.reference if several else len(curves) > 1
        traces.append(go.Scatter(x=c.x, y=c.y, mode="lines", name=label, meta=c.key, line=line, **place,
                                 legendgroup=name if several and not c.reference else None, showlegend=tell and label not in told,
                                 hovertemplate=f"{c.label} %{{y:.4g}}{c.unit}"
                                               f"<extra>{plain(name)}</extra>"))
        told.add(label)
    return traces


def _metas(run, signal):
    """Metadata of each channel of a signal."""
    meta = run.loop.metadata(signal) or Param()
    many = signal == "u" or isinstance(run.y, tuple) and any(isinstance(q, tuple) for q in run.y)
    return [flat(q)[0] or Param() for q in (meta if many and isinstance(meta, tuple) else [meta])]


def _plain(meta):
    return 1.0, meta.unit


def _per_second(meta):
    factor, unit = shown(meta)
    return factor, f"{unit}/s".removeprefix("1")


def _measure(values, metas, scale=shown):
    """A figure of merit, each channel in its unit."""
    scales = [scale(m) for m in metas]
    if len(set(scales)) == 1 or not isinstance(values, tuple):
        return measure(values, *scales[0])
    return ", ".join(measure(v, *s) for v, s in zip(values, scales, strict=True))


def verdict_html(run: Run) -> str:
    """Return the verdict of the loop on a run as HTML; nothing if it has none."""
    if run.loop.verdict is None:
        return ""
    said = run.loop.verdict(run)
    return f'<div class="smcaero-verdict">{said_html(str(said), not said)}</div>'


def metrics_html(run: Run) -> str:
    """Return the figures of merit of a run, as one line of HTML."""
    m, (e, u, sigma) = run.metrics(), (_metas(run, s) for s in ("e", "u", "sigma"))
    said = {"J<sub>e</sub>": _measure(m.J_e, e, _plain), "J<sub>u</sub>": _measure(m.J_u, u, _plain),  # as papers give them
            "max |u|": _measure(m.max_u, u), "tail |e|": _measure(m.tail_e, e)}
    if run.loop.stages["surface"]:
        said["tail |σ|"] = _measure(m.tail_sigma, sigma, _plain)
    if m.reaching_time is not None:
        said["reaching time"] = reached(m.reaching_time)
    said["chattering"] = f"{_measure(m.variation_u, u, _per_second)}, {measure(m.turns_u, 1.0, 'reversals/s')}"
    spans = "".join(f"<span>{n} <b>{v}</b></span>" for n, v in said.items()
                    if not v.startswith(UNKNOWN))
    return f'<div class="smcaero-metrics">{spans}</div>'


def comparison_html(runs: Mapping[str, Run]) -> str:
    """Return the figures of merit of several runs, as a table in HTML."""
    judged = any(run.loop.verdict for run in runs.values())
    head = ("reaching time", "tail |σ|", "mean |v|", "variation of u", "reversals of u", *["verdict"]*judged)
    rows = ""
    for name, run in runs.items():
        m, sigma, u = run.metrics(), flat(run.loop.metadata("sigma") or Param())[0], flat(run.loop.metadata("u") or Param())[0]
        v = flat(run.loop.metadata("v") or Param())[0] or Param()
        factor, unit = shown(u or Param())
        values = (reached(m.reaching_time), measure(m.tail_sigma, 1.0, (sigma or Param()).unit),
                  measure(tuple(flat(run.mean_v if run.mean_v is not None else math.nan)), 1.0, v.unit),
                  measure(m.variation_u, factor, f"{unit}/s"), measure(m.turns_u, 1.0, "1/s"), *[verdict_html(run)]*judged)
        cells = "".join(f"<td>{q}</td>" for q in values)
        rows += f'<tr><th scope="row">{plain(name)}</th>{cells}</tr>'
    cells = "".join(f'<th scope="col">{q}</th>' for q in ("law", *head))
    return f'<table class="smcaero-table"><thead><tr>{cells}</tr></thead><tbody>{rows}</tbody></table>'
