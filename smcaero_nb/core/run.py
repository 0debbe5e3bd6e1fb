"""The result of a simulation."""

import csv
import functools
import io
import math
import os
import types
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TextIO

import numpy as np

from .assumptions import doubts
from .leaves import Leaf, at, named
from .metrics import Metrics, metrics
from .param import refused
from .perturbation import perturbation, true_sigma
from .program import Program
from .signal import filled, shape
from .sliding import Motion, motions
from .stages import SIGNALS, STAGES

if TYPE_CHECKING:
    from .loop import ClosedLoop

__all__ = ["Run", "result"]


@dataclass(frozen=True, eq=False, repr=False)
class Run:
    r"""Result of a simulation: arrays with one value per recorded row, nested as the signals are.

    Attributes
    ----------
    loop : ClosedLoop
    t : ndarray
        Times of the rows [s].
    r, y, y_m, e, e_hat, sigma, v, u, d : ndarray or nested tuple of ndarray
        Signals of the pipeline; the sampled ones as held at that time. At a sample, y and e are as
        measured: an output that asks for u saw the u of the previous sample, not the one in the
        row, which acts from then on. `e` is r - y; `y_m` is what the control sees as y, `u` the
        control that acts.
    x, z : namespace
        Named states: ``run.x.theta``, ``run.z.law.lam``, ``run.z.law.attitude.rho``; `z` as left
        by the latest sample.
    probe : namespace
        Output of the loop's `probe`, by name.
    low, high : namespace
        Minimum and maximum of `sigma` and `u` since the previous row: how far chattering goes
        between rows.
    integral_v : ndarray, nested tuple of ndarray, or None
        Running integral of `v` up to the latest sample.
    mean_e, mean_v, mean_u : float or nested tuple
        Means of \|e\|, \|v\|, \|u\| over all steps; mean_v is None where there is no law.
    max_e, max_sigma, max_u : float or nested tuple
        Maximum absolute values over all steps.
    tail_e, tail_sigma, tail_u : float or tuple
        Maximum absolute values over the tail (by default the last fifth; NaN if the run ended
        before it), derivatives left out: a number, or one per channel, as in `metrics`.
    tail_peaks : namespace
        The same for all leaves of `e`, `sigma` and `u`, nested as the signals are.
    variation_u, tail_variation_u : float or nested tuple
        Total variation of `u`, from rest, over the run; and in the tail.
    tail_turns_u : float or nested tuple
        Reversals of direction of `u` in the tail.
    tail : float
        Length of the tail [s].
    ended : str
        ``"done"``, ``"stopped"`` or ``"diverged"``.
    stopped_at : float or None
        Time at which the loop's `stop` ended the run before its full duration [s]; the tail is
        still that of the full duration.
    diverged_at : float or None
        Time at which a state or signal was not finite, or a state or output left the limits
        declared in its metadata [s].
    steps : int
        Number of steps taken.
    tau, dt : float
        Sampling step and integration step [s].
    method : str
        Integration method.
    """

    loop: "ClosedLoop"
    t: np.ndarray
    r: Any
    y: Any
    y_m: Any
    e: Any
    e_hat: Any
    sigma: Any
    v: Any
    u: Any
    d: Any
    x: Any
    z: Any
    probe: Any
    low: Any
    high: Any
    integral_v: Any
    mean_e: Any
    mean_v: Any
    mean_u: Any
    max_e: Any
    max_sigma: Any
    max_u: Any
    tail_e: Any
    tail_sigma: Any
    tail_u: Any
    tail_peaks: Any
    variation_u: Any
    tail_variation_u: Any
    tail_turns_u: Any
    tail: float
    ended: Literal["done", "stopped", "diverged"]
    stopped_at: float | None
    diverged_at: float | None
    steps: int
    tau: float
    dt: float
    method: str
    _shapes: dict[str, Any]

    @functools.cached_property
    def _leaves(self) -> dict[str, tuple[Leaf, ...]]:
        # not those of the program: loops that differ in units alone share it
        return named(self.loop, self._shapes)

    @functools.cached_property
    def _perturbation(self) -> tuple[Any, str, list[float]]:
        return perturbation(self)

    @functools.cached_property
    def _true(self) -> tuple[Any, str]:
        return true_sigma(self)

    @functools.cached_property
    def _motions(self) -> list[Motion]:
        return motions(self)

    @property
    def true_sigma(self) -> Any:
        """`sigma` of the true error r - y, where the control sees estimates or a sensor.

        Derivatives that are not measured are differences of recorded rows. Elsewhere it is `sigma`;
        None where it cannot be found.
        """
        return self._true[0]

    @property
    def xi(self) -> Any:
        """The perturbation that the law faces, sigma^(r) + v: all that the law does not know.

        Nested as `v`, and averaged since the previous row; where the control sees estimates or a
        sensor, it is found of the true error r - y, and averaged over 1 % of the rows: what they
        add to sigma is not a motion of the plant. None where there is no law, or for the reason in
        `no_xi`.
        """
        return self._perturbation[0]

    @property
    def no_xi(self) -> str:
        """Why there is no `xi`; empty where there is one, or no law."""
        return self._perturbation[1]

    def leaves(self, signal: str) -> tuple[Leaf, ...]:
        """Describe each number of a signal: ``run.leaves("e")``.

        Raises
        ------
        KeyError
            The signal is not recorded.
        """
        same = signal == "y_m" and signal not in self._leaves  # without a sensor
        return self._leaves["y" if same else signal]

    def metrics(self) -> Metrics:
        """Return the figures of merit of the run."""
        return metrics(self)

    def doubts(self) -> list[str]:
        """Return the assumptions of the law's theorem that this run violates; see `doubts`."""
        return doubts(self)

    def to_csv(self, path: "str | os.PathLike | TextIO | None" = None) -> str | None:
        """Write what is recorded as text: names and units, then one line per row.

        The columns are t, the signals, the states of the plant (``x.theta``) and of the blocks with
        memory (``z.law.w``), and what the probe gives (``probe.power``).

        Parameters
        ----------
        path : str, path-like or text file, optional

        Returns
        -------
        str or None
            The text if no path is given.

        Raises
        ------
        ParameterError
            A path that is neither a path nor a file.
        """
        columns = {"t [s]": self.t}
        for signal in SIGNALS[1:]:
            for q in self._leaves.get(signal, ()):
                columns[_titled(q.key, q.meta)] = at(getattr(self, signal), q.path)
        for name, meta in self.loop.stages["plant"].states.items():
            x = _columns(f"x.{name}", getattr(self.x, name))
            columns |= {_titled(q, meta): v for q, v in x}
        columns |= dict([*_columns("z", self.z), *_columns("probe", self.probe)])
        made = io.StringIO()
        writer = csv.writer(made, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(np.column_stack([*columns.values()]).tolist())
        if path is None:
            return made.getvalue()
        if isinstance(path, (str, os.PathLike)):
            with open(path, "w", encoding="utf-8", newline="") as f:
                f.write(made.getvalue())
        elif not hasattr(path, "write"):
            raise refused("Run.to_csv", "path", path, "a path or an open text file")
        else:
            path.write(made.getvalue())
        return None

    def __repr__(self) -> str:
        name = self.loop.name or self.loop.stages["plant"].name
        end = {"stopped": self.stopped_at, "diverged": self.diverged_at}.get(self.ended)
        at = "" if end is None else f", {self.ended} at {end:g} s"
        return f"Run({name}: {self.steps} steps, {len(self.t)} rows{at})"

    def _repr_html_(self) -> str:
        return self.metrics()._repr_html_()


def _titled(key: str, meta: Any) -> str:
    return key + (f" [{meta.unit}]" if meta.unit != "1" else "")


def _columns(name: str, values: Any) -> Iterator[tuple[str, np.ndarray]]:
    """(name, array) of each array in a namespace or tuple, nested as they may be."""
    if isinstance(values, types.SimpleNamespace):
        for n, v in vars(values).items():
            yield from _columns(f"{name}.{n}", v)
    elif isinstance(values, tuple):
        for i, v in enumerate(values):
            yield from _columns(f"{name}[{i}]", v)
    else:
        yield name, values


def _named(b: Any, arrays: Any) -> types.SimpleNamespace:
    """Recorded states of a block by name, those of channels by channel and name."""
    if hasattr(b, "parts"):
        return types.SimpleNamespace(**{n: _named(q, arrays) for n, q in b.parts.items()})
    return types.SimpleNamespace(**{
        n: filled(shape(b.values[n]), arrays) for n in b.states if n not in b.buffers})


def _nested(names: Any, values: Callable[[str], Any], prefix: str = "") -> Any:
    """The result of `values` for each variable, nested as the names are."""
    if isinstance(names, str):
        return values(prefix + names)
    return tuple([_nested(q, values, prefix) for q in names])


def result(loop: "ClosedLoop", program: Program, rec: np.ndarray, end: dict[str, float],
           before: dict[str, float], k: int, k_tail: int, dt: float, m: int, method: str,
           stopped: bool, diverged: bool) -> Run:
    """Make a `Run` of the records, the figures at the end and the figures before the tail."""
    columns = dict(zip(program.columns, rec.T, strict=True))
    law = loop.stages["law"] is not None

    def signal(name, values, prefix=""):
        return _nested(program.names[name], values, prefix)

    def both(name):
        return types.SimpleNamespace(
            **{n: signal(n, columns.__getitem__, f"{name}_") for n in ("sigma", "u")})

    def mean(name, count):
        return signal(name, lambda q: end[q]/max(count, 1), "sum_")

    ended_before = k < k_tail + diverged
    tails = {n: signal(n, lambda q: math.nan if ended_before else end[q], "max_")
             for n in ("e", "sigma", "u")}
    signals = {n: signal(n, columns.__getitem__) for n in SIGNALS[1:] if n in program.shapes}
    signals.setdefault("y_m", signals["y"])
    integral = signal("v", columns.__getitem__, "integral_") if law else None
    arrays = iter(columns[q] for q in (*program.x, *program.z))
    memory = [s for s, q in STAGES.items() if q.memory and s != "plant" and loop.stages[s]]
    figures = {n: [at(v, path) for path in program.heads[n]] for n, v in tails.items()}
    made = dict(
        x=_named(loop.stages["plant"], arrays),
        z=types.SimpleNamespace(**{s: _named(loop.stages[s], arrays) for s in memory}),
        probe=_probed(loop, program, columns), low=both("low"), high=both("high"),
        integral_v=integral, mean_e=mean("e", k), mean_u=mean("u", k),
        mean_v=mean("v", k//m + 1) if law else None,
        tail_peaks=types.SimpleNamespace(**tails),
        **{f"tail_{n}": v[0] if len(v) == 1 else tuple(v) for n, v in figures.items()},
        **{f"max_{n}": signal(n, lambda q: max(end[q], before[q]), "max_") for n in tails},
        **{f"tail_{n}_u": signal("u", lambda q: end[q] - before[q], f"{n}_")
           for n in ("variation", "turns")},
        variation_u=signal("u", end.__getitem__, "variation_"))
    t, tau = columns["t"], m*dt
    return Run(loop=loop, t=t, tau=tau, dt=dt, method=method, steps=k,
               tail=max(k - k_tail, 0)*dt,
               ended="diverged" if diverged else "stopped" if stopped else "done",
               stopped_at=k*dt if stopped else None, diverged_at=k*dt if diverged else None,
               _shapes=program.shapes, **signals, **made)


def _probed(loop: "ClosedLoop", program: Program,
            columns: dict[str, np.ndarray]) -> types.SimpleNamespace:
    """Output of the probe, by the name of its block, or of each of its channels."""
    b = loop.stages["probe"]
    if b is None:
        return types.SimpleNamespace()
    signal = _nested(program.names["probe"], columns.__getitem__)
    if not hasattr(b, "parts"):
        return types.SimpleNamespace(**{b.name: signal})
    return types.SimpleNamespace(**dict(zip(b.parts, signal, strict=True)))
