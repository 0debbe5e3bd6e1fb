"""A lander in flight: a side view of a run, moment by moment, with its thrusters firing."""

import math
import threading
from typing import Any

import ipywidgets as W
import numpy as np
import plotly.graph_objects as go

from ..core import ClosedLoop, ParameterError, Run
from ..core.param import refused
from .curves import BOTTOM, COLOURS, LAYOUT, LEGEND, TOP, X_AXIS, Y_AXIS
from .live import Live
from .mask import Page
from .picture import Picture

__all__ = ["Flight", "flight"]

# Shapes are points (across, along) the axis of the lander [m], with gaps between their parts.
GAP = (math.nan, math.nan)
BODY = ((-1.3, -0.9), (1.3, -0.9), (1.6, 0.2), (0.9, 1.5), (-0.9, 1.5), (-1.6, 0.2), (-1.3, -0.9))
LEGS = ((-1.3, -0.9), (-2.4, -2.4), GAP, (-2.8, -2.4), (-2.0, -2.4), GAP,
        (1.3, -0.9), (2.4, -2.4), GAP, (2.0, -2.4), (2.8, -2.4))
NOZZLES = ((1.6, 0.2), (2.8, 0.2), GAP, (2.8, -0.1), (2.8, 0.5), GAP,
           (-0.6, -0.9), (-0.6, -1.3), GAP, (0.6, -0.9), (0.6, -1.3))
FEET = 2.4  # m below the centre of mass
SIGHT, DOWN, UP = 10.0, -13.0, 7.0  # m: what is seen around it
BAR = ((-9.0, 6.0), (-9.0, 5.6), (-4.0, 5.6), (-4.0, 6.0))  # the scale: 5 m
# of a flame: half its length [m], at this thrust [N]
ATTITUDE, DESCENT = (0.7, 15.0), (2.0, 1400.0)
SPAN = 10.0  # s of pulses shown before and after the moment
STEP, FRAME = 0.05, 100  # s a step of the slider; ms between two pictures of the film, at least
SPEEDS = {"0.1 s a picture": 2, "0.5 s a picture": 10, "2 s a picture": 40}  # steps of the slider
POINTS = 300  # of the curves over the whole flight
SKY, SOIL, METAL, FIRE, NOW = "#10141c", "#8a8a86", "#dddddd", "#E69F00", "#D55E00"
STATES = {"theta", "altitude", "velocity"}  # what a lander has


def row(run: Run, t: float) -> int:
    """Return the row of a run at time t."""
    return max(int(np.searchsorted(run.t, t + 1e-9)) - 1, 0)


def flame(across: float, along: float, thrust: float, scale: tuple[float, float]) -> tuple:
    """Return a flame from a nozzle, against the thrust; its length grows with the thrust."""
    length = math.copysign(scale[0]*(1.0 + abs(thrust)/scale[1]), thrust) if thrust else 0.0
    return (across - 0.25, along), (across, along - length), (across + 0.25, along), GAP


def scene(run: Run, t: float) -> list[tuple]:
    """Return abscissas and ordinates of all that is drawn at time t, in the order of `LOOKS`."""
    k, p, x = row(run, t), run.loop.stages["plant"].values, run.x
    height, s, c = float(x.altitude[k]), math.sin(x.theta[k]), math.cos(x.theta[k])
    u_a = p.get("effectiveness", 1.0)*run.u[0][k] + p.get("stuck", 0.0)
    u_d = 0.5*run.u[1][k]
    fire = (*flame(-0.6, -1.3, p.get("left", 6)/6*u_d, DESCENT),
            *flame(0.6, -1.3, p.get("right", 6)/6*u_d, DESCENT),
            *flame(2.8, -0.1 if u_a > 0.0 else 0.5, u_a, ATTITUDE))
    shapes = (np.array(q).T for q in (fire, (*LEGS, GAP, *NOZZLES), BODY))
    lander = [(s*a + c*b, s*b - c*a) for a, b in shapes]
    ground, near = max(-FEET - height, 2*DOWN), abs(run.t - t) < 2*SPAN
    some = np.s_[::max(len(run.t)//POINTS, 1)]
    way = x.altitude[some]
    return [((-20.0, 20.0, 20.0, -20.0), (ground, ground, -30.0, -30.0)), *lander,
            tuple(zip(*BAR, strict=True)), ((0, 1, 1, 0), (0, 0, -height - 1e3, -height - 1e3)),
            ((0.5,), (height,)),
            (run.t[some], run.r[1][0][some]), (run.t[some], way),
            ((run.t[k],)*2, (min(way.min(), 0.0), way.max())),
            *(q for u in run.u
              for q in ((run.t[near] - t, u[near]), ((0.0, 0.0), (u.min(), u.max()))))]


def _look(axes, colour, width=1.5, filled=False, **more):
    return dict(mode="lines", showlegend=False, hoverinfo="skip", xaxis=axes[0], yaxis=axes[1],
                fill="toself" if filled else None, fillcolor=colour if filled else None,
                line=dict(color=colour, width=width, **more))


WAY, VIEW, TAPE = ("x", "y"), ("x2", "y2"), ("x5", "y5")
LOOKS = [_look(VIEW, SOIL, 0, True), _look(VIEW, FIRE, 0, True), _look(VIEW, METAL, 2),
         _look(VIEW, METAL, 1, True), _look(VIEW, METAL, 1.5),
         _look(TAPE, SOIL, 0, True),
         _look(TAPE, FIRE) | dict(mode="markers", cliponaxis=False,
                                  marker=dict(symbol="diamond", size=10, color=FIRE)),
         _look(WAY, "#444", dash="dot") | dict(name="reference", showlegend=True),
         _look(WAY, COLOURS[0]), _look(WAY, NOW, 2),
         *(q for i in (3, 4) for q in (_look(("x3", f"y{i}"), COLOURS[0], shape="hv"),
                                       _look(("x3", f"y{i}"), NOW, 1)))]


def reach(run: Run, t: float) -> float:
    """Return the height that the altitude scale shows [m]: 1, 2 or 5 times a power of ten."""
    height = max(1.1*float(run.x.altitude[row(run, t)]), 10.0)
    power = 10.0**math.floor(math.log10(height))
    return power*next(m for m in (1, 2, 5, 10) if m*power >= height)


def drawing(run: Run, t: float) -> tuple[list, dict[str, Any]]:
    """Return traces and layout of a `scene`."""
    side = dict(constrain="domain", visible=False, fixedrange=True)
    right, top = X_AXIS | dict(domain=(0.6, 1.0)), reach(run, t)
    axes: dict[str, Any] = dict(
        xaxis2=side | dict(range=(-SIGHT, SIGHT), domain=(0.0, 0.38), anchor="y2"),
        yaxis2=side | dict(range=(DOWN, UP), scaleanchor="x2", anchor="x2"),
        xaxis5=side | dict(range=(0, 1), domain=(0.47, 0.5), anchor="y5"),
        yaxis5=Y_AXIS | dict(range=(-0.06*top, top), anchor="x5", fixedrange=True, showgrid=False,
                             zeroline=False, title_text="altitude [m]"),
        xaxis=right | dict(anchor="y", title=dict(text="t [s]", standoff=2)),
        xaxis3=right | dict(anchor="y4", range=(-SPAN, SPAN),
                            title=dict(text="time from now [s]", standoff=2)))
    for i, name, *span in (("", "x [m]", 0.62, 1.0), (3, "u<sub>a</sub> [N]", 0.24, 0.45),
                           (4, "u<sub>d</sub> [N]", 0.0, 0.21)):
        axes[f"yaxis{i}"] = Y_AXIS | dict(domain=span, anchor="x3" if i else "x", nticks=4,
                                          title_text=name)
    skies = [dict(type="rect", xref=f"x{i} domain", yref=f"y{i} domain", x0=0, x1=1, y0=0, y1=1,
                  fillcolor=SKY, line_width=0, layer="below") for i in (2, 5)]
    scale = dict(xref="x2", yref="y2", x=-6.5, y=6.3, text="5 m", showarrow=False,
                 font=dict(color=METAL, size=11))
    layout = LAYOUT | dict(margin=LAYOUT["margin"] | dict(l=10), height=400 + TOP + BOTTOM,
                           hovermode="closest", shapes=skies, annotations=[scale],
                           legend=dict(x=1.0, y=1.0, **LEGEND))
    traces = [go.Scatter(x=x, y=y, **q) for (x, y), q in zip(scene(run, t), LOOKS, strict=True)]
    return traces, layout | axes


class Flight(W.VBox):
    """A lander in flight, to be played or scrubbed in time; made by `flight`.

    Attributes
    ----------
    run : Run or None
        The run shown: the newest of the live plot.
    t : float
        The moment shown [s].
    slider : ipywidgets.FloatSlider
        Its slider.
    said : str
        Time, altitude, velocity, pitch and thrusts of the moment, as text.
    figure : plotly.graph_objects.Figure
        What is drawn, as a figure to save or change.
    """

    def __init__(self, source: Live | Run):
        self.run: Run | None = None
        self._lock, self._picture, self._text = threading.RLock(), Picture(), W.HTML()
        self._reach = 0.0  # of the altitude scale, as drawn
        self.slider = W.FloatSlider(0.0, min=0.0, max=STEP, step=STEP, readout=False,
                                    description="t")
        self._play = W.Play(value=0, min=0, max=1, step=10, interval=FRAME, show_repeat=False)
        self._speed = W.Dropdown(options=SPEEDS, value=self._play.step)
        W.link((self._speed, "value"), (self._play, "step"))
        head = W.HBox([self._play, self.slider, self._speed])
        below = W.VBox([self._text, self._picture])
        page = Page(flight=("time s", False), speed=("speed of the film", False))
        super().__init__([head, below, page])
        for w, name in ((self, "study"), (self, "flight"), (head, "choices"), (below, "plot"),
                        (self._text, "moment"), (self.slider, "set-flight"),
                        (self._speed, "set-speed")):
            w.add_class(f"smcaero-{name}")
        self._play.observe(self._played, "value")
        self._play.observe(lambda _: self._limit(), "step")
        self.slider.observe(self._moved, "value")
        if isinstance(source, Live):
            source.observe(lambda change: self._take(change.new), "run")
        self._take(source.run if isinstance(source, Live) else source)

    @property
    def t(self) -> float:
        """The moment shown [s]."""
        return self.slider.value

    @property
    def said(self) -> str:
        """Text about the moment."""
        return self._text.value

    @property
    def figure(self) -> go.Figure:
        """What is drawn, as a figure of plotly."""
        return go.Figure(*drawing(self.run, self.t)) if self.run else go.Figure()

    def show(self, t: float) -> None:
        """Show another moment [s]."""
        self.slider.value = t

    def _limit(self):
        """Let the last step of the film end at the last moment, which is not a multiple of it."""
        self._play.max = round(self.slider.max/STEP) + self._play.step - 1

    def _played(self, change):
        now = min(change.new, round(self.slider.max/STEP))
        if round(self.slider.value/STEP) != now:  # an answer would pull the handle back
            self.slider.value = now*STEP

    def _moved(self, change):
        try:
            self._play.value = round(change.new/STEP)
            self._draw()
        except BaseException:  # Ctrl-C: the moment is drawn whole
            self._draw()
            raise

    def _take(self, run):
        """Show a run, if it is one of a lander."""
        if isinstance(run, Run) and len(run.t) and STATES <= set(vars(run.x)):
            with self._lock:
                self.run = run
                self.slider.max = max(math.ceil(run.t[-1]/STEP - 1e-9), 1)*STEP
                self._limit()
            self._draw()

    def _draw(self):
        with self._lock:
            if self.run is not None:
                k, x, top = row(self.run, self.t), self.run.x, reach(self.run, self.t)
                if top == self._reach:
                    self._picture.move(*zip(*scene(self.run, self.t), strict=True))
                else:
                    self._picture.show(*drawing(self.run, self.t))
                    self._reach = top
                u = [q[k] for q in self.run.u]
                parts = (f"t = {self.run.t[k]:.2f} s", f"altitude {max(x.altitude[k], 0.0):.1f} m",
                         f"velocity {x.velocity[k]:.2f} m/s",
                         f"pitch {math.degrees(x.theta[k]):.1f} deg",
                         f"u<sub>a</sub> {u[0]:.0f} N", f"u<sub>d</sub> {u[1]:.0f} N",
                         *["<b>touchdown</b>"]*bool(x.altitude[k] <= 0.0))
                spans = "".join(f"<span>{q}</span>" for q in parts)
                self._text.value = f'<div class="smcaero-metrics">{spans}</div>'


def flight(source: Live | Run) -> Flight:
    """Show a lander in flight: a side view with its thrusters firing, played or scrubbed in time.

    Parameters
    ----------
    source : Live or Run
        Of a live plot, always its newest run. With a row for each sample, the flames are the pulses
        themselves.

    Returns
    -------
    Flight
        A widget.

    Raises
    ------
    ParameterError
        `source` is something else, is not of a lander, which has the states theta, altitude and
        velocity, or is a run without rows.

    Notes
    -----
    The descent thrust is drawn as its two sides, (47), the attitude thruster on its arm: for
    u_a > 0, which turns the lander to the left, its flame points down. Failed and stuck thrusters
    of the plant are drawn as they fire.

    Examples
    --------
    >>> film = flight(smc.simulate(smc.rpl.loop(), record=4800))
    >>> film.show(120.0)
    """
    loop = source.loop if isinstance(source, (Live, Run)) else None
    plant = loop.stages["plant"] if isinstance(loop, ClosedLoop) else None
    if plant is None or not STATES <= set(plant.states):
        raise refused("flight", "source", source, "a live plot or a run of a lander")
    if isinstance(source, Run) and not len(source.t):
        raise ParameterError("flight: the run is not allowed; it must have rows, "
                             "but it started beyond the limits of the plant")
    return Flight(source)
