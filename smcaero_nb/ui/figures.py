"""Pictures of what is no run: slopes of accuracy, trials of differentiators, identifications of relative degree."""

import math

import numpy as np
import plotly.graph_objects as go

from ..core import Accuracy, Run
from ..core.param import unknown
from ..differentiators import Trial
from ..prd import PRDResult, PRDSweep, Probe, VectorPRD
from .curves import BOTTOM, COLOURS, GAP, LAYOUT, LEGEND, SYMBOLS, TOP, X_AXIS, Y_AXIS, draw, panels
from .given import names as checked

__all__ = ["figure", "plot"]

POINTS = 1500  # of a curve: what a screen resolves
STACK, LEAST, BELOW, TITLES = 520, 36, 230, 76  # px: all rows over time, one of them, the charts below, what lies between
GREY = "#444"


def plot(result, states=(), phase=False):
    """Draw what the kit computes.

    Parameters
    ----------
    result : Run, dict of str to Run, Accuracy, Trial, PRDResult, PRDSweep, VectorPRD, Probe or plotly Figure
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
        Something else, or runs under names that are no texts.
    ParameterError
        `states` is not a sequence of names, or names a state that the plant of a run does not have.

    Examples
    --------
    >>> plot({law: smc.simulate(smc.lv.loop(law)) for law in ("pd", "quasi_smc")}, states=("beta",))
    """
    states = checked("plot", "states", states) or ()
    for run in result.values() if isinstance(result, dict) else [result]:
        plant = run.loop.stages["plant"] if isinstance(run, Run) else None
        for n in states if plant else ():
            if n not in plant.states:
                raise unknown(f"plot: the plant {plant.name}", n, plant.states)
    return go.Figure(*figure(result, states, phase))


def figure(result, states=(), phase=False):
    """Traces and layout of what `plot` draws."""
    if isinstance(result, Run):
        result = {"": result}
    match result:
        case dict() if result and all(isinstance(n, str) and isinstance(run, Run)
                                      for n, run in result.items()):
            return draw({name: panels(run, states, phase) for name, run in result.items()})
        case Accuracy():
            names = [f"|{n.replace('sigma', 'σ')}|" for n in result.names]
            traces, x, y = _slopes(result.tau, names, result.sizes, result.slopes)
            return traces, dict(LAYOUT, height=380, hovermode="closest", showlegend=True, xaxis=x,
                                yaxis=dict(y, title_text="greatest size in the second half"))
        case Trial():
            return _trial(result)
        case Probe(VectorPRD() as found, swept):
            return _beside(_vector(found), [_sweep(swept, found.time_scale)])
        case Probe(found, swept):
            return _beside(_derivatives(found), [_power(found), _sweep(swept, found.time_scale)])
        case PRDResult():
            return _beside(_derivatives(result), [_power(result)])
        case VectorPRD():
            return _beside(_vector(result), [])
        case PRDSweep():
            return _beside(([], {}, 0), [_sweep(result)])
        case go.Figure():
            return list(result.data), result.layout.to_plotly_json()
    raise TypeError(f"plot: {type(result).__name__} cannot be drawn; it must be a Run, {{name: Run}}, Accuracy, Trial, "
                    "PRDResult, PRDSweep, VectorPRD, Probe or a plotly Figure")


# ---- the parts of a figure -------------------------------------------------------------------------------------------
def _thin(t, y):
    """The curve by the extremes of as many pieces as a screen resolves."""
    k = len(t)//(POINTS//2)
    if k < 2:
        return t, y
    n = len(t)//k*k
    pieces = y[:n].reshape(-1, k)
    at = np.sort(np.column_stack([pieces.argmin(1), pieces.argmax(1)]), 1) + np.arange(0, n, k)[:, None]
    at = np.append(at.ravel(), np.arange(n, len(t)))
    return t[at], y[at]


def _line(t, y, name, colour, place="", legend=False, **look):
    """A curve in the panel whose axes end with `place`."""
    x, y = _thin(t, y)
    return go.Scatter(x=x, y=y, mode="lines", name=name, line=dict(color=colour, width=1.4, **look), showlegend=legend,
                      xaxis="x", yaxis=f"y{place}", legend=f"legend{place}", hovertemplate=f"{name} %{{y:.4g}}<extra></extra>")


def _reach(y, *others):
    """Range of an axis that shows y, and room around it; what the others do at the start may leave it."""
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
    height, axes = n*tall + (n - 1)*gap, dict(annotations=[])
    for i, (title, reach) in enumerate(zip(titles, ranges, strict=True)):
        at, top = str(i + 1) if i else "", 1.0 - i*(tall + gap)/height
        axes[f"yaxis{at}"] = dict(Y_AXIS, domain=(max(top - tall/height, 0.0), top), nticks=3 if n > 7 else 4, range=reach)
        axes[f"legend{at}"] = dict(x=1.0, y=top, **LEGEND)
        axes["annotations"].append(dict(text=title, xref="paper", yref=f"y{at} domain", x=0.0, y=0.5, xshift=-58,
                                        xanchor="right", showarrow=False, font_size=13))
    axes["xaxis"] = dict(X_AXIS, domain=(0.0, 1.0), anchor=f"y{n if n > 1 else ''}", range=span,
                         title=dict(text=across, standoff=4))
    return axes, height


def _beside(stack, charts):
    """Traces and layout of panels over time, and of charts side by side below them."""
    traces, axes, height = list(stack[0]), dict(stack[1]), stack[2]
    full, n = height + (BELOW + TITLES*(height > 0) if charts else 0), sum(k.startswith("yaxis") for k in axes)
    for k, axis in axes.items():
        if k.startswith("yaxis"):
            axis["domain"] = tuple(1.0 - (1.0 - q)*height/full for q in axis["domain"])
        elif k.startswith("legend"):
            axis["y"] = 1.0 - (1.0 - axis["y"])*height/full
    for i, (drawn, x, y) in enumerate(charts):  # two at most
        at, left, right = str(n + i + 1) if n + i else "", (i + 0.13*(i > 0))/len(charts), (i + 1)/len(charts)
        for trace in drawn:
            traces.append(trace.update(xaxis=f"x{at}", yaxis=f"y{at}", legend=f"legend{at}"))
        axes |= {f"xaxis{at}": X_AXIS | dict(domain=(left, right), anchor=f"y{at}") | x,
                 f"yaxis{at}": Y_AXIS | dict(domain=(0.0, BELOW/full), anchor=f"x{at}") | y,
                 f"legend{at}": dict(LEGEND, x=right, y=BELOW/full)}
        if i < len(charts) - 1:  # inside, where a line that rises leaves room
            axes[f"legend{at}"] |= dict(orientation="v", x=left + 0.01, xanchor="left", yanchor="top")
    margin = dict(LAYOUT["margin"], l=96)  # room for f^(12) beside the numbers
    return traces, dict(LAYOUT, height=full + TOP + BOTTOM, margin=margin, hovermode="closest", hoversubplots="single", **axes)


def _shown(values):
    """A logarithmic axis from the least to the greatest of the values."""
    low, high = np.log10([values.min(), values.max()]) if len(values) else (-1.0, 0.0)
    return dict(type="log", exponentformat="e", range=(float(low), float(high)))


def _decades(values):
    """A logarithmic axis of whole decades that shows the values."""
    drawn = np.asarray(values, float)
    drawn = drawn[np.isfinite(drawn) & (drawn > 0.0)]
    low, high = (math.floor(np.log10(drawn.min())), math.ceil(np.log10(drawn.max()))) if drawn.size else (-1, 0)
    high = max(high, low + 1)
    return dict(type="log", exponentformat="e", range=(low - 0.1, high + 0.1), dtick=1 + (high - low)//9)


# ---- accuracy --------------------------------------------------------------------------------------------------------
def _slopes(tau, names, sizes, fitted):
    """Points over the sampling step, both logarithmic, and the lines fitted."""
    traces = []
    for i, (name, size, slope) in enumerate(zip(names, sizes, fitted, strict=True)):
        look = dict(x=tau, legendgroup=name, hovertemplate=f"{name} %{{y:.3g}}<br>tau %{{x:.3g}} s<extra></extra>")
        colour, good, label = COLOURS[i % len(COLOURS)], np.isfinite(size) & (size > 0.0), name
        if math.isfinite(slope):
            middle = np.exp(np.log(size[good]).mean() + slope*(np.log(tau) - np.log(tau[good]).mean()))
            traces.append(go.Scatter(y=middle, mode="lines", line=dict(color=colour, width=1), showlegend=False, **look))
            label += f": slope {slope:.2f}"
        traces.append(go.Scatter(y=np.where(good, size, np.nan), mode="markers", name=label,
                                 marker=dict(color=colour, size=9, symbol=SYMBOLS[i % len(SYMBOLS)]), **look))
    steps = dict(type="log", tickvals=tau, ticktext=[f"{t:.3g}" for t in tau], title_text="sampling step τ [s]")
    return traces, steps, _decades(sizes)


# ---- differentiators -------------------------------------------------------------------------------------------------
def _trial(trial):
    """Samples, estimates and truth; the errors, and how they fall with the sampling step."""
    t, known, ranges = trial.t, trial.truth is not None, []
    traces = [_line(t, trial.f, "samples", "#bbb", "", True)]
    for i, z in enumerate(trial.estimates):
        at, first = str(i + 1) if i else "", i == 0
        traces.append(_line(t, z, "estimate", COLOURS[0], at, first))
        if known:
            traces.append(_line(t, trial.truth[i], "truth", GREY, at, first, dash="dot"))
        ranges.append(_reach(trial.truth[i] if known else trial.f if first else z[len(z)//4:], z))
    stack = traces, *_stack([_order(i) for i in range(len(ranges))], ranges, "t [s]")
    if not known:
        return _beside(stack, [])
    names = [f"z<sub>{i}</sub>" for i in range(len(ranges))]
    bars = go.Bar(x=np.arange(len(names)), y=trial.errors, marker_color=[COLOURS[i % len(COLOURS)] for i in range(len(names))],
                  showlegend=False, hovertemplate="greatest error of z<sub>%{x}</sub>: %{y:.3g}<extra></extra>")
    points, x, y = _slopes(trial.tau, names, trial.sizes, trial.slopes)
    for q in points:
        if q.mode == "markers" and len(names) > 7:
            q.showlegend = False  # no room for so many
    errors = [bars], dict(tickvals=np.arange(len(names)), ticktext=names), dict(
        _decades(trial.errors), title_text="greatest error, second half")
    return _beside(stack, [errors, (points, x, y)])


# ---- practical relative degree ---------------------------------------------------------------------------------------
def _derivatives(found):
    """The output and its derivatives over time, the step, the window, and the derivative that steps."""
    a, t, start, end = found.analyser, found.t, found.step_time, found.step_time + found.time_scale
    traces, ranges = [_line(t, found.y, "y", GREY)], [_reach(found.y)]
    for k, z in enumerate(a.derivatives, 1):
        traces.append(_line(t, z, _order(k, "y"), COLOURS[1] if k == found.prd else COLOURS[0], str(k + 1)))
        ranges.append(_reach(z))
    if a.prd and a.prd == found.prd:
        k, at = a.prd, a.jump_times[a.prd - 1]
        traces.append(go.Scatter(x=[at], y=[np.interp(at, t, a.derivatives[k - 1])], xaxis="x", yaxis=f"y{k + 1}", meta="jump",
                                 mode="markers+text", text=["steps"], textposition="middle right", showlegend=False,
                                 marker=dict(color=COLOURS[1], size=11, symbol="star"),
                                 hovertemplate="steps at %{x:.5g} s<extra></extra>"))
    axes, height = _stack([_order(k, "y") for k in range(len(ranges))], ranges, "t [s]", (
        max(t[0], start - 0.3*found.time_scale), t[-1]))
    band = dict(xref="x", yref="y domain", y0=0.0, y1=1.0, layer="below")
    axes["shapes"] = [shape for k in range(len(ranges)) for at in [f"y{k + 1 if k else ''} domain"] for shape in (
        band | dict(type="rect", x0=start, x1=end, line_width=0, fillcolor="#0072B2", opacity=0.07, yref=at),
        band | dict(type="line", x0=start, x1=start, line=dict(color="#888", width=1), yref=at))]
    return traces, axes, height


def _power(found):
    """The first motion, both axes logarithmic, with its power law."""
    t, y, p = found.t - found.step_time, np.abs(found.y - np.median(found.y[found.t < found.step_time])), found.power
    m = (t > 0.0) & (y > 0.0)
    traces = [go.Scatter(x=t[m], y=y[m], mode="lines", line=dict(color=GREY, width=1.4), showlegend=False,
                         hovertemplate="%{y:.3g} at %{x:.3g} s<extra></extra>")]
    if math.isfinite(p.slope):
        a, b = p.octave
        inside = m & (t >= a) & (t <= b)
        level = np.exp(np.mean(np.log(y[inside]) - p.slope*np.log(t[inside])))
        x = np.array([a/3.0, b])
        traces.append(go.Scatter(x=x, y=level*x**p.slope, mode="lines", name=f"slope {p.slope:.2f}", showlegend=True,
                                 line=dict(color=COLOURS[1], width=2), hovertemplate="power law<extra></extra>"))
    if found.noise_floor > 1e-12:
        x = t[m][[0, -1]] if m.any() else np.array([1e-3, 1.0])
        traces.append(go.Scatter(x=x, y=[p.noise]*2, mode="lines", name="noise", showlegend=True,
                                 line=dict(color="#999", width=1, dash="dot"), hovertemplate="noise %{y:.2g}<extra></extra>"))
    seen = m & (t > found.time_scale/50)
    return (traces, dict(_shown(t[seen]), title_text="t after the step [s]"),
            dict(_decades(y[seen]), title_text="|y − y<sub>0</sub>|"))


def _sweep(sweep, here=None):
    """The answers over the time scale: full where confirmed, open where not, crosses where there is none."""
    answers = [q if isinstance(q, tuple) else (q,) for q in sweep.prd]
    traces = []
    for i in range(max(map(len, answers), default=0)):
        many = len(answers[0]) > 1
        kinds = ["unresolved" if not r[i] else "confirmed" if q.confirmed else "not confirmed"
                 for r, q in zip(answers, sweep.results, strict=True)]
        shape = SYMBOLS[i % len(SYMBOLS)]
        look = {"confirmed": shape, "not confirmed": f"{shape}-open", "unresolved": "x-thin-open"}
        for kind, mark in look.items():
            at = [j for j, q in enumerate(kinds) if q == kind]
            name = f"output {i + 1}: {kind}" if many else kind
            if at:
                dot = dict(color=COLOURS[i % len(COLOURS)], size=9, symbol=mark, line_width=2*(kind != "confirmed"))
                traces.append(go.Scatter(x=[sweep.windows[j] for j in at], y=[(answers[j][i] or 0) + 0.2*i for j in at],
                                         name=name, mode="markers", marker=dot, showlegend=True,
                                         customdata=[answers[j][i] or kind for j in at],
                                         hovertemplate="w %{x:.3g} s: PRD %{customdata}<extra></extra>"))
    if here:
        traces.append(go.Scatter(x=[here, here], y=[-0.4, 5.4], mode="lines", line=dict(color="#0072B2", width=1, dash="dot"),
                                 showlegend=False, hoverinfo="skip"))
    return traces, dict(type="log", title_text="window w [s]", exponentformat="e"), dict(
        title_text="PRD", range=(-0.5, 5.5), tickvals=list(range(6)), ticktext=["–", *"12345"])


def _vector(found):
    """Of each input and output: the derivative that decides, or the first."""
    traces, titles, ranges = [], [], []
    for i, row in enumerate(found.results, 1):
        for j, q in enumerate(row, 1):
            k, at = q.prd or 1, str(len(titles) + 1) if titles else ""
            z = q.analyser.derivatives[k - 1]
            said = f"PRD {q.prd}" if q.prd else "unresolved" if z.any() else "no response"
            traces.append(_line(q.t, z, f"input {j} to output {i}: {said}", COLOURS[1] if q.prd else COLOURS[0], at, True))
            titles.append(_order(k, f"y<sub>{i}</sub>"))
            ranges.append(_reach(z))
    return traces, *_stack(titles, ranges, "t [s]")
