"""Figures of runs: which curves are drawn, in which panels, and how."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import plotly.graph_objects as go

from ..core import Param, Run
from ..core.leaves import at
from ..core.signal import flat, shape
from ..core.signal import leaves as paths
from .between import band, chatters, coarse, corners, held, mean, once, reversals
from .planes import ERRORS, PHASE, planes
from .text import (
    UNKNOWN,
    alternative,
    measure,
    plain,
    reached,
    said_html,
    shown,
    symbol,
    unit_html,
    unmarked,
)

__all__ = ["Curve", "before", "comparison_html", "draw", "lines", "metrics_html", "panels", "structure", "verdict_html"]

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")  # of Okabe and Ito, for everybody
SYMBOLS = ("circle", "square", "diamond", "triangle-up", "cross")
DASHES = ("solid", "dash", "dashdot")
# of runs drawn over one another: told apart in grey, and the lower ones seen beside and through the upper
RUNS = (("solid", 2.8), ("12px,4px", 2.2), ("5px,3px", 1.7), ("10px,3px,2px,3px", 1.2))
NAMED = {"sigma": r"\sigma", "dy": r"\dot y", "xi": r"\xi"}
SENSED = "y_m"
LAW = "states of the law"
TALL_ROWS = PHASE, ERRORS
SHADOWS = "output", "rate", "control", "sliding variable", *TALL_ROWS
MANY = 2500  # points of a trajectory
RESOLVED = 2000  # rows in view up to which sampled signals are drawn held; u always is
THIN = 0.02  # of the range in view: a band that is thinner is a line to the eye
PIECES, TURNS = 400, 150  # a signal with so many reversals in view, compared with others, is a band of so many pieces
ROW, TALL, GAP, TOP, BOTTOM = 112, 260, 28, 30, 44  # px; a plane is a tall row
LINE, ENTRY, LETTER, WIDTH = 18, 42, 6, 420  # px: of a legend, about; of the narrowest picture
APART = 0.16  # of the width, between columns
LAYOUT: dict[str, Any] = dict(
    autosize=True, margin=dict(l=72, r=14, t=TOP, b=BOTTOM), template="plotly_white",
    paper_bgcolor="#fffffe",  # white, by which page.css knows figures of the kit
    font=dict(size=12, color="#222"), hovermode="x", hoversubplots="axis", hoverlabel_namelength=-1,
    uirevision="kept", modebar=dict(remove=["sendChartToCloud"]))  # "Share chart" uploads a person's data
X_AXIS = dict(type="linear", visible=True, showspikes=True, spikethickness=1, spikecolor="#999")
Y_AXIS = dict(type="linear", visible=True, nticks=5, exponentformat="e", zerolinecolor="#ccc", title_standoff=6)
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
    held: bool = False  # each sample has a row; of a band: it chatters and is seen to, not at a few peaks

    @property
    def label(self) -> str:
        """Its symbol."""
        meta = _named(self.meta, self.key.removesuffix(".range").partition("[")[0])
        return symbol(meta.symbol).removesuffix("(0)")  # not the start of a law's state

    @property
    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Its data as the page gets them: what a long trajectory draws twice is drawn once."""
        many = self.row in TALL_ROWS and len(self.x) > MANY
        return once(self.x, self.y) if many else (self.x, self.y)

    @property
    def filled(self) -> bool:
        """Whether it is a band."""
        return self.key.endswith(".range")

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


def _entries(name, meta, values):
    """(name, metadata, values) of a state; of each entry of one that is a tuple."""
    if not isinstance(values, tuple):
        return [(name, _named(meta, name), values)]
    return [(name + q, replace(meta, symbol=name + q), v)
            for q, v in zip(paths(shape(values)), flat(values), strict=True)]


def _single(values):
    """Values as drawn; those that are too large become infinite."""
    with np.errstate(over="ignore"):
        return np.asarray(values).astype(np.float32)


class _Panels:
    """The curves of a run, added one by one."""

    def __init__(self, run: Run, span: tuple[float, float] | None, compared: bool):
        self.run, self.compared, self.curves = run, compared, []
        self.outputs = run.leaves("y")
        self.named = any(q.derivative is None for q in self.outputs)  # states, without an output
        self.many = isinstance(run.y, tuple) and any(isinstance(q, tuple) for q in run.y)
        self.columns = 1 + max((q.channel for q in self.outputs), default=0) if self.many else 1
        self.single = np.diff(run.t) < 1.001*run.tau  # of one sample: nothing lies between the rows
        self.span = span or (-math.inf, math.inf)
        self.view = self.within(run.t)
        self.resolved = np.count_nonzero(self.view) <= RESOLVED

    def within(self, t):
        """Which of these times are in view."""
        return (t >= self.span[0]) & (t <= self.span[1])

    def wide(self, t, y, heights):
        """Whether a band of these heights before its rows is more than a line in view."""
        view = self.within(t)
        seen = y[view]
        with np.errstate(over="ignore", invalid="ignore"):
            return len(seen) > 1 and bool(heights[view][1:].max() > THIN*np.ptp(seen))

    def add(self, key, row, column, meta, y, t=None, **look):
        """Add a curve, by default through the rows; those without a column of their own share the last."""
        if t is None:
            t, y = corners(self.run.t, y) if self.single.all() and len(y) > 1 else (self.run.t, y)
        x, y = _single(t), _single(shown(meta)[0]*y)
        self.curves.append(Curve(key, row, min(column, self.columns - 1), meta, x, y, **look))

    def sampled(self, key, row, column, meta, y, t=None, always=False):
        """Add a signal that is held from sample to sample, where the rows resolve that."""
        whole = t is None and len(y) > 1 and bool(self.single.all())
        if t is None and len(y) > 1 and (always or self.resolved):
            t, y = held(self.run.t, y, self.single)
        self.add(key, row, column, meta, y, t, held=whole and always)

    def between(self, key, row, column, meta, y, low, high, integral=None, always=False, held=True):
        """Add a signal, `held` from sample to sample, with the band that it fills between rows.

        Amid that, the curve is the mean if the running integral is known. The middle of the band is none
        of u, which may be at one limit most of the time; of sigma, which moves between them, it is.
        """
        t, pieces = self.run.t, self.compared and reversals(y[self.view]) > TURNS
        if pieces:
            t, y, low, high, integral = coarse(PIECES, t, y, low, high, integral)
        if len(y) > 2 and (pieces or not self.single.all()):
            chattering = chatters(y, low, high) & (True if pieces else ~self.single)
            x, edge = band(t, y, low, high, chattering)
            if len(x):
                heights = np.append(0.0, np.where(chattering, (high - low)[1:], 0.0))
                self.add(f"{key}.range", row, column, meta, edge, x, held=self.wide(t, y, heights))
            blurred = np.append(False, chattering) & np.append(chattering, chattering[-1])  # rows amid that
            inner = np.full(len(y), math.nan) if always else 0.5*(low + high)
            y = y.copy()
            y[blurred] = inner[blurred] if integral is None else mean(t, integral, blurred)
        if held:
            self.sampled(key, row, column, meta, y, t if pieces else None, always)
        else:
            self.add(key, row, column, meta, y, t if pieces else None)

    def beside(self, signal, q):
        """What belongs to a number of y in r or y_m, which may come without derivatives; or None."""
        for i, inner in enumerate(q.path):
            if isinstance(signal, tuple):
                signal = signal[inner] if inner < len(signal) else None
            elif inner and not (self.many and i == 0):
                return None
        return signal

    def bounds(self, q):
        """How far a number of y went between rows, where sigma is e and the reference stays; or None."""
        stages, r = self.run.loop.stages, self.beside(self.run.r, q)
        if stages["surface"] or stages["differentiator"] or stages["sensor"] or r is None:
            return None
        y, low, high = (at(s, q.path) for s in (self.run.y, self.run.low.sigma, self.run.high.sigma))
        rests = np.append(False, r[1:] == r[:-1])
        return (np.where(rests, np.minimum(y, r - high), y), np.where(rests, np.maximum(y, r - low), y))

    # ---- panels ------------------------------------------------------------------------------
    def followed(self):
        """Output against reference, and rate; states by name where there is no output."""
        for q in self.outputs:
            if q.derivative not in (None, 0, 1):
                continue
            rate = "d"*(q.derivative == 1)
            row = f"output {q.key}" if self.named else "rate" if rate else "output"
            mark = q.key.removeprefix("y") if self.named else f"[{q.channel}]"*self.many
            c = 0 if self.named else q.channel
            meta = _named(q.meta, q.key.removeprefix("y.")) if self.named else q.meta
            y, bounds = at(self.run.y, q.path), self.bounds(q)
            if bounds is None:
                self.add(f"{rate}y{mark}", row, c, meta, y)
            else:
                self.between(f"{rate}y{mark}", row, c, meta, y, *bounds, held=False)
            sensed = self.beside(self.run.y_m, q) if self.run.loop.stages["sensor"] else None
            if sensed is not None:
                seen = replace(meta, symbol=rf"\dot {SENSED}" if rate else SENSED)
                self.sampled(f"{rate}y_m{mark}", row, c, seen, sensed)
            reference = self.beside(self.run.r, q)
            if reference is not None:
                self.add(f"{rate}r{mark}", row, c, meta, reference, reference=True)

    def controls(self, states):
        """The control; with it, the perturbation that the law meets, if nothing lies between them."""
        run, stages, leaves = self.run, self.run.loop.stages, self.run.leaves("u")
        bare = not (stages["allocation"] or stages["actuator"] or run.loop.latency)
        sums = flat(run.integral_v) if bare and run.integral_v is not None else [None]*len(leaves)
        for i, q in enumerate(leaves):
            mark = f"[{i}]"*(len(leaves) > 1)
            u, low, high = (at(s, q.path) for s in (run.u, run.low.u, run.high.u))
            self.between(f"u{mark}", "control", i, q.meta, u, low, high, sums[i], always=True)
        if run.xi is not None and not stages["allocation"] and not stages["actuator"]:
            for i, (xi, q) in enumerate(zip(flat(run.xi), leaves, strict=True)):
                self.add(f"xi{f'[{i}]'*(len(leaves) > 1)}", "control", i, replace(q.meta, symbol=r"\xi"), xi, reference=True)
        if stages["allocation"] and "xi" in stages["allocation"].states:  # an observer
            meta = replace(stages["allocation"].states["xi"], symbol=r"\hat\xi")
            self.sampled("allocation.xi", "perturbation", 0, meta, run.z.allocation.xi)
        for n in states:
            for q, meta, x in _entries(n, stages["plant"].states[n], getattr(run.x, n)):
                row = "control" if meta.unit == leaves[0].meta.unit else f"states [{meta.unit}]"
                self.add(f"x.{q}", row, 0, meta, x)

    def sliding(self):
        """The sliding variable."""
        leaves = [q for q in self.run.leaves("sigma") if not q.derivative]
        for i, q in enumerate(leaves):
            sigma, low, high = (at(s, q.path) for s in (self.run.sigma, self.run.low.sigma, self.run.high.sigma))
            mark = f"[{i}]"*(self.many or len(leaves) > 1)
            self.between(f"sigma{mark}", "sliding variable", i, q.meta, sigma, low, high)

    def memory(self):
        """The band of the law, and its states."""
        law = self.run.loop.stages["law"]
        parts = getattr(law, "parts", {None: law})
        for c, (name, b) in enumerate(parts.items()):
            mark = f"[{c}]"*(self.many or len(parts) > 1)
            if b.band:
                edge = np.array([b.band(q, b.values) for q in self.run.t])
                t, edge = corners(self.run.t, edge)
                t, edge = (np.concatenate(q) for q in ((t, [math.nan], t), (edge, [math.nan], -edge)))
                self.add(f"band{mark}", "sliding variable", c, Param(r"\mathrm{band}", "[sigma]"), edge, t, reference=True)
            z = getattr(self.run.z.law, name) if name else getattr(self.run.z, "law", None)
            for n, meta in b.states.items():
                if not (meta.hidden or n in b.buffers):
                    for q, about, values in _entries(n, meta, getattr(z, n)):
                        self.sampled(f"law.{q}{mark}", LAW, c, about, values)

    def probed(self):
        """What the probe gives."""
        probe = self.run.loop.stages["probe"]
        if probe:
            leaves = self.run.leaves("probe")
            values = tuple(vars(self.run.probe).values())
            values = values if hasattr(probe, "parts") else values[0]
            for i, q in enumerate(leaves):
                name = [*vars(self.run.probe)][q.path[0]] if hasattr(probe, "parts") else probe.name
                mark = f"[{i}]"*(len(leaves) > 1 and not hasattr(probe, "parts"))
                self.add(f"probe.{name}{mark}", f"probe [{q.meta.unit}]", 0, _named(q.meta, name), at(values, q.path))


def panels(run: Run, states: Iterable[str] = (), phase: bool = False, *, fine: Run | None = None,
           span: tuple[float, float] | None = None, compared: bool = False) -> list[Curve]:
    """Return the curves of a run.

    These are output against reference, rate, control and states, sliding variable, states of the
    law, and what the probe gives. An output that has neither metadata nor a reference to follow is
    not drawn: it only makes the error. Without an output, each state of the plant has a panel.
    Where nothing lies between law and plant, the perturbation that the law meets is drawn with the
    control; an observer's estimate of it has a panel of its own.

    Where sigma or u chatter between rows, they are a band, ``u.range``, from the minimum to the
    maximum of each interval; amid that, sigma is its middle, and u its mean, or a gap if an allocation or an
    actuator leaves that unknown.

    Parameters
    ----------
    run : Run
    states : sequence of str
        Plant states to draw, with the control if they have its unit, else in their own panel.
    phase : bool
        With the phase portrait, sigma' over sigma, and e' over e with the line sigma = 0 where the
        output comes with its first derivative and a surface makes sigma of both.
    fine : Run, optional
        The same run with more rows, for the planes.
    span : (float, float), optional
        Times in view [s]; default: all.
    compared : bool
        Whether others are drawn over it: what chatters is then a band in any case.

    Returns
    -------
    list of Curve
        In the order of the panels; one column for each channel of the output.
    """
    stages, made = run.loop.stages, _Panels(run, span, compared)
    followed = not stages["output"] or run.loop.metadata("y") or stages["reference"] or not stages["law"]
    if followed:
        made.followed()
    made.controls(states)
    if stages["surface"] or not followed:
        made.sliding()
    if stages["law"]:
        made.memory()
    made.probed()
    for row, key, channel, x, y, about in planes(fine or run) if phase else ():
        meta, across = about
        made.add(key, row, channel, meta, y, shown(across)[0]*x, across=across, reference=key.startswith("line"))
    places = list(dict.fromkeys((c.row, c.column) for c in made.curves))
    return sorted(made.curves, key=lambda c: places.index((c.row, c.column)))  # the order of the traces in the figure


def structure(curves: Iterable[Curve]) -> list[tuple]:
    """Return what a figure of the curves depends on besides their numbers."""
    return [(c.key, c.row, c.column, c.label, c.unit, c.held) for c in curves]


def before(curves: Iterable[Curve]) -> dict[str, Curve]:
    """Return the curves that stay as a shadow when the setting changes."""
    return {c.key: c for c in curves if c.row in SHADOWS and not c.reference and not c.filled}


def draw(runs: Mapping[str, list[Curve]]) -> tuple[list, dict]:
    """Return traces and layout of a figure.

    Parameters
    ----------
    runs : dict of str to list of Curve
        The result of `panels`, by name of the run. Of several, each quantity has a panel, and each
        run a colour, a dash and a width.

    Returns
    -------
    list of plotly.graph_objects.Scatter, dict
    """
    several, places = len(runs) > 1, {}
    first: dict[tuple, str] = {}  # label of the first quantity of a panel
    for run, (name, curves) in enumerate(runs.items()):
        for c in curves:
            own = several and not c.reference and first.setdefault((c.row, c.column), c.label) != c.label
            places.setdefault((f"{c.row}: {c.label}" if own else c.row, c.column), []).append((run, name, c))
    rows = sorted(dict.fromkeys(r for r, _ in places), key=_plane)
    columns = 1 + max((c for _, c in places), default=0)
    wide, laws = (1.0 + APART)/columns - APART, f"legend{len(rows)*columns + 1}"  # the legend of the runs
    drawn, told = {}, set()
    for place, here in places.items():
        y = 1 + rows.index(place[0])*columns + place[1]
        x = 1 + place[1] + columns*_plane(place[0])
        drawn[place] = (x, y, _traces(here, x, y, laws if several else "", told))
    above = {r: max(lines([t.name for t in traces if t.showlegend and t.legend != laws], wide)
                    for (row, _), (*_, traces) in drawn.items() if row == r) for r in rows}
    tops, heights, base = [], [TALL if r in TALL_ROWS else ROW for r in rows], 0
    for i, (r, h) in enumerate(zip(rows, heights, strict=True)):
        base += LINE*max(above[r] - 1, 0) + (BOTTOM if i and r in TALL_ROWS else 0)
        tops.append(base)
        base += h + GAP
    height, axes = max(base - GAP, ROW), {}
    for (row, column), here in sorted(places.items(), key=lambda q: rows.index(q[0][0])):
        n, (x, y, _) = rows.index(row), drawn[row, column]
        left, top = column*(wide + APART), 1 - tops[n]/height
        bottom = max(top - heights[n]/height, 0.0)
        axes |= _axes([c for *_, c in here], x, y, (left, left + wide), (bottom, top))
    margin = LAYOUT["margin"] | dict(t=TOP + (12 + LINE*lines(runs, 1.0))*several)
    if several:
        axes[laws] = LEGEND | dict(x=0.0, xanchor="left", y=1.0 + TOP/height)
    layout = LAYOUT | axes | dict(height=height + margin["t"] + BOTTOM, margin=margin,
                                  meta=dict(alt=alternative(places, runs), columns=columns, apart=APART))
    return [t for place in sorted(drawn, key=lambda q: rows.index(q[0]) if several else 0) for t in drawn[place][2]], layout


def _plane(row):
    """Number of a row whose abscissa is not time; 0 for the others."""
    return TALL_ROWS.index(row) + 1 if row in TALL_ROWS else 0


def lines(names: Iterable[str], wide: float) -> int:
    """Return how many lines a legend takes, about, in so much of the narrowest picture."""
    room, entries = wide*WIDTH, [ENTRY + LETTER*len(unmarked(n)) for n in names]
    if sum(entries) <= room:
        return min(len(entries), 1)
    return math.ceil(len(entries)/max(room//max(entries), 1))  # plotly makes columns of one width


def _number(n):
    """Of an axis or a legend, as plotly writes it: none for the first."""
    return str(n) if n > 1 else ""


def _axes(curves, x, y, across, up):
    """Axes and legend of a panel."""
    units = {c.label: c.unit for c in curves if not c.reference}
    unit = next(iter(units.values())) if len(set(units.values())) == 1 else ""
    title = LAW if len(units) > 3 else ", ".join(units) + unit
    bands = [c.y for c in curves if c.key.startswith("band") and len(c.y) > 1]
    room = [round(5.0*float(np.nanmax(q)), 6) for q in bands]  # sigma beside its band
    x_axis = X_AXIS | dict(title=dict(text=curves[0].abscissa, standoff=4))  # below the lowest panel
    if 1 < x and curves[0].row not in TALL_ROWS:
        x_axis["matches"] = "x"  # columns are zoomed together
    return {f"yaxis{_number(y)}": dict(domain=up, anchor=f"x{_number(x)}", title_text=title,
                                       range=(-max(room), max(room)) if any(room) else None, **Y_AXIS),
            f"xaxis{_number(x)}": dict(domain=across, anchor=f"y{_number(y)}", **x_axis),
            f"legend{_number(y)}": dict(x=across[1], y=up[1], **LEGEND)}


def _ink(q):
    """How much a curve in a plane covers: the more of it lies beneath."""
    x, y = (v/((np.nanmax(v) - np.nanmin(v)) or 1.0) if np.isfinite(v).any() else v for v in (q[2].x, q[2].y))
    return -float(np.nansum(np.hypot(np.diff(x), np.diff(y))))


def _faint(colour, alpha):
    """A colour with less than full opacity."""
    return "rgba({},{},{},{})".format(*(int(colour[i:i + 2], 16) for i in (1, 3, 5)), alpha)


def _traces(curves, x, y, laws, told):
    """Traces of one panel: curves of one run differ in colours and dashes; so do runs, and in widths.

    `laws` is the legend of the runs, if there are several; `told` holds those named in it.
    """
    traces, here, ranks, several = [], set(), {}, bool(laws)
    mixed = len({c.unit for *_, c in curves if not c.reference}) > 1
    alone = len({c.label for *_, c in curves if not c.reference}) == 1
    many = sum(c.held or not c.filled for *_, c in curves) > 1  # a few peaks need no word
    if several:
        key = _ink if curves[0][2].row in TALL_ROWS else lambda q: not q[2].filled
        curves = sorted(curves, key=key)
    for run, name, c in curves:
        if c.reference and run:
            continue  # drawn once
        rank = ranks.get((run, c.label), len([q for q in ranks if q[0] == run]))
        if not c.reference:
            ranks[run, c.label] = rank
        kind = run if several else rank
        colour, label = COLOURS[kind % len(COLOURS)], c.label + c.unit*mixed
        look: dict[str, Any] = dict(hovertemplate=f"{c.label} %{{y:.4g}}{c.unit}<extra>{plain(name)}</extra>")
        if c.reference:
            line = dict(color="#444", dash="dot", width=1.5)
            label = c.label if c.key.startswith(("xi", "band", "line")) else "reference"
        elif c.filled:
            line = dict(color=_faint(colour, 0.6), width=0.8)
            look = dict(fill="toself", fillcolor=_faint(colour, 0.2 if several else 0.3), hoverinfo="skip")
            label = "min to max" if alone else f"{c.label}: min to max"
        elif several:
            dash, width = RUNS[run % len(RUNS)]
            line = dict(color=colour, dash=dash, width=width)
        else:
            line = dict(color=colour, dash=DASHES[rank % len(DASHES)], width=1.0 if c.held else 1.5)
        points = dict(zip("xy", c.points, strict=True))
        is_run = several and not c.reference and not c.filled
        tell = name not in told if is_run else label not in here and (c.held if c.filled else c.reference or many)
        (told if is_run else here).add(name if is_run else label)
        traces.append(go.Scatter(
            **points, mode="lines", name=plain(name) if is_run else label, meta=c.key,
            line=line | dict(simplify=False), xaxis=f"x{_number(x)}", yaxis=f"y{_number(y)}",
            legend=laws if is_run else f"legend{_number(y)}", showlegend=tell,
            legendgroup=name if several and not c.reference else None, **look))
    return traces


def _metas(run, signal):
    """Metadata of each channel of a signal."""
    return [q.meta for q in run.leaves(signal) if not q.derivative]


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
    said["chattering"] = f"{_measure(m.variation_u, u, _per_second)}; {measure(m.turns_u, 1.0, 'reversals/s')}"
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
