"""Figures of whatever the kit computes; those of runs are drawn by `curves`."""

import functools
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import plotly.graph_objects as go

from ..core import Accuracy, Run
from ..differentiators import Trial
from ..prd import PRDResult, PRDSweep, Probe, VectorPRD
from .curves import (
    BOTTOM,
    COLOURS,
    GAP,
    LAYOUT,
    LEGEND,
    LINE,
    SYMBOLS,
    TOP,
    X_AXIS,
    Y_AXIS,
    draw,
    lines,
    panels,
)
from .given import states as known

__all__ = ["figure", "plot"]

POINTS = 1500  # of a curve: what a screen resolves
# px: all rows over time, one of them, the charts below, what lies between
STACK, LEAST, BELOW, TITLES = 520, 36, 230, 76
GREY = "#444"


def plot(result: Any, states: Iterable[str] = (), phase: bool = False) -> go.Figure:
    """Draw what the kit computes.

    Parameters
    ----------
    result : Run, dict, Accuracy, Trial, PRDResult, PRDSweep, VectorPRD, Probe or plotly Figure
        ``{name: run}`` draws runs over one another, each in its colour.
    states : sequence of str
        Of runs: plant states to draw, with the control if they have its unit.
    phase : bool
        Of runs: with the phase portrait, sigma' over sigma.

    Returns
    -------
    plotly.graph_objects.Figure
        The panels of `live`, as they are.

    Raises
    ------
    TypeError
        Something else, or runs whose names are not text.
    ParameterError
        `states` is not a sequence of names, or names a state that the plant of a run does not have.

    Examples
    --------
    >>> plot({law: smc.simulate(smc.lv.loop(law)) for law in ("pd", "quasi_smc")}, states=("beta",))
    """
    runs = result.values() if isinstance(result, Mapping) else [result]
    states = known("plot", states, [run.loop for run in runs if isinstance(run, Run)])
    made = go.Figure(*figure(result, states, phase))
    return made.update_layout(modebar=LAYOUT["modebar"])


def figure(result: Any, states: Iterable[str] = (), phase: bool = False) -> tuple[list, dict]:
    """Return the traces and the layout of what `plot` draws."""
    runs = {"": result} if isinstance(result, Run) else result
    if isinstance(runs, Mapping) and runs and all(
            isinstance(n, str) and isinstance(run, Run) for n, run in runs.items()):
        several = len(runs) > 1
        return draw({name: panels(run, states, phase, compared=several)
                     for name, run in runs.items()})
    return _drawn(result)


@functools.singledispatch
def _drawn(result, *charts) -> tuple[list, dict]:
    """Traces and layout of a result other than runs, and of more charts beside it."""
    kinds = ", ".join(q.__name__ for q in _drawn.registry if q is not object)
    raise TypeError(f"plot: {type(result).__name__} cannot be drawn; "
                    f"it must be a Run, {{name: Run}}, or one of {kinds}")


# ---- the parts of a figure -----------------------------------------------------------------------
def _thin(t, y):
    """The curve by the extremes of as many pieces as a screen resolves."""
    k = len(t)//(POINTS//2)
    if k < 2:
        return t, y
    n = len(t)//k*k
    pieces = y[:n].reshape(-1, k)
    extremes = np.column_stack([pieces.argmin(1), pieces.argmax(1)])
    at = np.sort(extremes, 1) + np.arange(0, n, k)[:, None]
    at = np.append(at.ravel(), np.arange(n, len(t)))
    return t[at], y[at]


def _line(t, y, name, colour, place="", legend=False, **look):
    """A curve in the panel whose axes end with `place`."""
    x, y = _thin(t, y)
    line = dict(color=colour, width=1.4, simplify=False, **look)
    return go.Scatter(x=x, y=y, mode="lines", name=name, line=line,
                      showlegend=legend, xaxis="x", yaxis=f"y{place}", legend=f"legend{place}",
                      hovertemplate=f"{name} %{{y:.4g}}<extra></extra>")


def _reach(y, *others):
    """Range of an axis that shows y, with a margin; of others, all but their first quarter."""
    low, high = (f([f(q) for q in (y, *(q[len(q)//4:] for q in others))]) for f in (np.min, np.max))
    room = 0.08*(high - low) or 0.1*abs(high) or 1.0
    return (float(low - room), float(high + room)) if math.isfinite(high - low) else None


def _order(i, name="f"):
    """f, f', f'', f⁽³⁾, ..."""
    return name + ("'"*i if i < 3 else f"<sup>({i})</sup>")


def _stack(titles, ranges, across, span=None):
    """Layout of rows over one another that share their abscissa, and its height."""
    n, gap = len(titles), GAP/2
    tall = max((STACK - (n - 1)*gap)/n, LEAST)
    height, annotations, axes = n*tall + (n - 1)*gap, [], {}
    for i, (title, reach) in enumerate(zip(titles, ranges, strict=True)):
        at, top = str(i + 1) if i else "", 1.0 - i*(tall + gap)/height
        axes[f"yaxis{at}"] = Y_AXIS | dict(domain=(max(top - tall/height, 0.0), top),
                                           nticks=3 if n > 7 else 4, range=reach)
        axes[f"legend{at}"] = dict(x=1.0, y=top, **LEGEND)
        annotations.append(dict(text=title, xref="paper", yref=f"y{at} domain", x=0.0, y=0.5,
                                xshift=-58, xanchor="right", showarrow=False, font_size=13))
    axes["xaxis"] = X_AXIS | dict(domain=(0.0, 1.0), anchor=f"y{n if n > 1 else ''}", range=span,
                                  title=dict(text=across, standoff=4))
    return dict(annotations=annotations, **axes), height


def _beside(stack, charts):
    """Traces and layout of panels over time, and of charts side by side below them."""
    traces, axes, height = list(stack[0]), dict(stack[1]), stack[2]
    n = sum(k.startswith("yaxis") for k in axes)
    full = height
    if charts:
        told = [t.name for t in charts[-1][0] if t.showlegend]  # above the last
        full += BELOW + TITLES*(height > 0) + LINE*max(lines(told, 1/len(charts)) - 1, 0)
    for k, axis in axes.items():
        if k.startswith("yaxis"):
            axis["domain"] = tuple(1.0 - (1.0 - q)*height/full for q in axis["domain"])
        elif k.startswith("legend"):
            axis["y"] = 1.0 - (1.0 - axis["y"])*height/full
    for i, (drawn, x, y) in enumerate(charts):  # two at most
        at = str(n + i + 1) if n + i else ""
        left, right = (i + 0.17*(i > 0))/len(charts), (i + 1)/len(charts)
        for trace in drawn:
            traces.append(trace.update(xaxis=f"x{at}", yaxis=f"y{at}", legend=f"legend{at}"))
        axes |= {f"xaxis{at}": X_AXIS | dict(domain=(left, right), anchor=f"y{at}") | x,
                 f"yaxis{at}": Y_AXIS | dict(domain=(0.0, BELOW/full), anchor=f"x{at}") | y,
                 f"legend{at}": dict(LEGEND, x=right, y=BELOW/full)}
        if i < len(charts) - 1:  # inside, where a line that rises leaves room
            axes[f"legend{at}"] |= dict(orientation="v", x=left + 0.01, xanchor="left",
                                        yanchor="top")
    margin = LAYOUT["margin"] | dict(l=96)  # room for f^(12) beside the numbers
    return traces, LAYOUT | dict(height=full + TOP + BOTTOM, margin=margin, hovermode="closest",
                                 hoversubplots="single", **axes)


def _shown(values):
    """A logarithmic axis from the smallest to the largest of the values."""
    low, high = np.log10([values.min(), values.max()]) if len(values) else (-1.0, 0.0)
    return dict(type="log", exponentformat="e", range=(float(low), float(high)))


def _decades(values):
    """A logarithmic axis of whole decades that shows the values."""
    drawn = np.asarray(values, float)
    drawn = drawn[np.isfinite(drawn) & (drawn > 0.0)]
    low, high = -1, 0
    if drawn.size:
        low, high = math.floor(np.log10(drawn.min())), math.ceil(np.log10(drawn.max()))
    high = max(high, low + 1)
    return dict(type="log", exponentformat="e", range=(low - 0.1, high + 0.1),
                dtick=1 + (high - low)//9)


# ---- accuracy ------------------------------------------------------------------------------------
@_drawn.register
def _(result: Accuracy):
    names = [f"|{n.replace('sigma', 'σ')}|" for n in result.names]
    traces, x, y = _slopes(result.tau, names, result.sizes, result.slopes)
    y |= dict(title_text="maximum in the second half")
    return traces, LAYOUT | dict(height=380, hovermode="closest", showlegend=True, xaxis=x, yaxis=y)


def _slopes(tau, names, sizes, fitted):
    """Points over the sampling step, both logarithmic, and the lines fitted."""
    traces = []
    for i, (name, size, slope) in enumerate(zip(names, sizes, fitted, strict=True)):
        look = dict(x=tau, legendgroup=name,
                    hovertemplate=f"{name} %{{y:.3g}}<br>tau %{{x:.3g}} s<extra></extra>")
        colour, symbol = COLOURS[i % len(COLOURS)], SYMBOLS[i % len(SYMBOLS)]
        good, label = np.isfinite(size) & (size > 0.0), name
        if math.isfinite(slope):
            shift = slope*(np.log(tau) - np.log(tau[good]).mean())
            middle = np.exp(np.log(size[good]).mean() + shift)
            traces.append(go.Scatter(y=middle, mode="lines", line=dict(color=colour, width=1),
                                     showlegend=False, **look))
            label += f": slope {slope:.2f}"
        traces.append(go.Scatter(y=np.where(good, size, np.nan), mode="markers", name=label,
                                 marker=dict(color=colour, size=9, symbol=symbol), **look))
    steps = dict(type="log", tickvals=tau, ticktext=[f"{t:.3g}" for t in tau],
                 title_text="sampling step τ [s]")
    return traces, steps, _decades(sizes)


# ---- differentiators -----------------------------------------------------------------------------
@_drawn.register
def _(trial: Trial):
    """Samples, estimates and truth; the errors, and how they fall with the sampling step."""
    t, truth, ranges = trial.t, trial.truth, []
    traces = [_line(t, trial.f, "samples", "#bbb", "", True)]
    for i, z in enumerate(trial.estimates):
        at, first = str(i + 1) if i else "", i == 0
        traces.append(_line(t, z, "estimate", COLOURS[0], at, first))
        if truth is not None:
            traces.append(_line(t, truth[i], "truth", GREY, at, first, dash="dot"))
            ranges.append(_reach(truth[i], z))
        else:
            ranges.append(_reach(trial.f if first else z[len(z)//4:], z))
    stack = traces, *_stack([_order(i) for i in range(len(ranges))], ranges, "t [s]")
    return _beside(stack, [] if truth is None else _errors(trial, len(ranges)))


def _errors(trial, many):
    """Charts of the errors, and of how they fall with the sampling step."""
    names, colours = zip(*((f"z<sub>{i}</sub>", COLOURS[i % len(COLOURS)]) for i in range(many)),
                         strict=True)
    bars = go.Bar(x=np.arange(many), y=trial.errors, marker_color=colours, showlegend=False,
                  hovertemplate="max. error of z<sub>%{x}</sub>: %{y:.3g}<extra></extra>")
    points, x, y = _slopes(trial.tau, names, trial.sizes, trial.slopes)
    for q in points:
        if q.mode == "markers" and many > 7:
            q.showlegend = False  # no room for so many
    errors = dict(_decades(trial.errors), title_text="max. error, second half")
    return [([bars], dict(tickvals=np.arange(many), ticktext=names), errors), (points, x, y)]


# ---- practical relative degree -------------------------------------------------------------------
@_drawn.register
def _(found: PRDResult, *charts):
    return _beside(_derivatives(found), [_power(found), *charts])


@_drawn.register
def _(found: VectorPRD, *charts):
    return _beside(_vector(found), charts)


@_drawn.register
def _(probe: Probe):
    return _drawn(probe.result, _sweep(probe.sweep, probe.result.time_scale))


@_drawn.register
def _(sweep: PRDSweep):
    return _beside(([], {}, 0), [_sweep(sweep)])


def _derivatives(found):
    """The output and its derivatives over time, with the step, the window, and what steps."""
    a, t = found.analyser, found.t
    start, end = found.step_time, found.step_time + found.time_scale
    traces, ranges = [_line(t, found.y, "y", GREY)], [_reach(found.y)]
    for k, z in enumerate(a.derivatives, 1):
        colour = COLOURS[1] if k == found.prd else COLOURS[0]
        traces.append(_line(t, z, _order(k, "y"), colour, str(k + 1)))
        ranges.append(_reach(z))
    if a.prd and a.prd == found.prd:
        k, at = a.prd, a.jump_times[a.prd - 1]
        traces.append(go.Scatter(
            x=[at], y=[np.interp(at, t, a.derivatives[k - 1])], xaxis="x", yaxis=f"y{k + 1}",
            meta="jump", mode="markers+text", text=["steps"], textposition="middle right",
            showlegend=False, marker=dict(color=COLOURS[1], size=11, symbol="star"),
            hovertemplate="steps at %{x:.5g} s<extra></extra>"))
    axes, height = _stack([_order(k, "y") for k in range(len(ranges))], ranges, "t [s]",
                          (max(t[0], start - 0.3*found.time_scale), t[-1]))
    band = dict(type="rect", x0=start, x1=end, line_width=0, fillcolor="#0072B2", opacity=0.07)
    line = dict(type="line", x0=start, x1=start, line=dict(color="#888", width=1))
    place = dict(xref="x", y0=0.0, y1=1.0, layer="below")
    axes["shapes"] = [shape | place | dict(yref=f"y{k + 1 if k else ''} domain")
                      for k in range(len(ranges)) for shape in (band, line)]
    return traces, axes, height


def _power(found):
    """The first motion, both axes logarithmic, with its power law."""
    t, p = found.t - found.step_time, found.power
    y = np.abs(found.y - np.median(found.y[found.t < found.step_time]))
    m = (t > 0.0) & (y > 0.0)
    look = dict(mode="lines", showlegend=True)
    traces = [go.Scatter(x=t[m], y=y[m], mode="lines", line=dict(color=GREY, width=1.4),
                         showlegend=False, hovertemplate="%{y:.3g} at %{x:.3g} s<extra></extra>")]
    if math.isfinite(p.slope):
        a, b = p.octave
        inside = m & (t >= a) & (t <= b)
        level = np.exp(np.mean(np.log(y[inside]) - p.slope*np.log(t[inside])))
        x = np.array([a/3.0, b])
        traces.append(go.Scatter(x=x, y=level*x**p.slope, name=f"slope {p.slope:.2f}",
                                 line=dict(color=COLOURS[1], width=2),
                                 hovertemplate="power law<extra></extra>", **look))
    if found.noise_floor > 1e-12:
        x = t[m][[0, -1]] if m.any() else np.array([1e-3, 1.0])
        traces.append(go.Scatter(x=x, y=[p.noise]*2, name="noise",
                                 line=dict(color="#999", width=1, dash="dot"),
                                 hovertemplate="noise %{y:.2g}<extra></extra>", **look))
    seen = m & (t > found.time_scale/50)
    return (traces, dict(_shown(t[seen]), title_text="t after the step [s]"),
            dict(_decades(y[seen]), title_text="|y − y<sub>0</sub>|"))


def _sweep(sweep, here=None):
    """The answers over the time scale: full if confirmed, open if not, crosses if there is none."""
    answers = [q if isinstance(q, tuple) else (q,) for q in sweep.prd]
    traces = []
    for i in range(max(map(len, answers), default=0)):
        many = len(answers[0]) > 1
        kinds = ["unresolved" if not r[i] else "confirmed" if q.confirmed else "not confirmed"
                 for r, q in zip(answers, sweep.results, strict=True)]
        shape, colour = SYMBOLS[i % len(SYMBOLS)], COLOURS[i % len(COLOURS)]
        look = {"confirmed": shape, "not confirmed": f"{shape}-open", "unresolved": "x-thin-open"}
        for kind, mark in look.items():
            at = [j for j, q in enumerate(kinds) if q == kind]
            if at:
                dot = dict(color=colour, size=9, symbol=mark, line_width=2*(kind != "confirmed"))
                traces.append(go.Scatter(
                    x=[sweep.windows[j] for j in at],
                    y=[(answers[j][i] or 0) + 0.2*i for j in at],
                    name=f"output {i + 1}: {kind}" if many else kind, mode="markers", marker=dot,
                    showlegend=True, customdata=[answers[j][i] or kind for j in at],
                    hovertemplate="w %{x:.3g} s: PRD %{customdata}<extra></extra>"))
    if here:
        traces.append(go.Scatter(x=[here, here], y=[-0.4, 5.4], mode="lines", showlegend=False,
                                 line=dict(color="#0072B2", width=1, dash="dot"), hoverinfo="skip"))
    return traces, dict(type="log", title_text="window w [s]", exponentformat="e"), dict(
        title_text="PRD", range=(-0.5, 5.5), tickvals=list(range(6)), ticktext=["–", *"12345"])


def _vector(found):
    """Of each input and output: the derivative that decides, or the first."""
    traces, titles, ranges = [], [], []
    for i, row in enumerate(found.results, 1):
        for j, q in enumerate(row, 1):
            k, at = q.prd or 1, str(len(titles) + 1) if titles else ""
            z = q.analyser.derivatives[k - 1]
            answer = f"PRD {q.prd}" if q.prd else "unresolved" if z.any() else "no response"
            traces.append(_line(q.t, z, f"input {j} to output {i}: {answer}",
                                COLOURS[1] if q.prd else COLOURS[0], at, True))
            titles.append(_order(k, f"y<sub>{i}</sub>"))
            ranges.append(_reach(z))
    return traces, *_stack(titles, ranges, "t [s]")


# ---- figures of plotly ---------------------------------------------------------------------------
@_drawn.register
def _(figure: go.Figure):
    return list(figure.data), figure.layout.to_plotly_json()
