"""A closed loop as data: its lines by segment, with a local variable for each leaf of each signal.

`serial` and `step` arrange the same lines in two ways: as a function that runs a loop from step to
step, and as one that takes a single step.
"""

import ast
import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from .block import Block
from .checks import check

__all__ = ["METHODS", "Line", "Meter", "Program", "first", "methods", "parts", "paths", "serial",
           "step"]

LIMIT = 1e12  # sum of |x|, or of |u|, beyond which any run has diverged
#: (node, weight) of each evaluation of the plant
METHODS = dict(euler=[(0.0, 1.0)], midpoint=[(0.0, 0.0), (0.5, 1.0)],
               rk4=[(0.0, 1/6), (0.5, 1/3), (0.5, 1/3), (1.0, 1/6)])


class Line(NamedTuple):
    """A line of the program, with the variables that it reads and writes."""

    text: str
    reads: frozenset[str]
    writes: frozenset[str]


@functools.lru_cache(maxsize=20_000)
def line(source: str) -> Line:
    """Return a line with the variables that it reads and writes."""
    tree = ast.parse(source).body[0]
    names = [n for n in ast.walk(tree) if isinstance(n, ast.Name)]
    writes = frozenset(n.id for n in names if isinstance(n.ctx, ast.Store))
    reads = frozenset(n.id for n in names if isinstance(n.ctx, ast.Load))
    return Line(source, reads | writes if isinstance(tree, ast.AugAssign) else reads, writes)


class Meter(NamedTuple):
    """A figure that the program keeps up to date while it runs, one for each leaf of a signal.

    Attributes
    ----------
    name : str
        Prefix of its variables, name_leaf.
    of : tuple of str
        Signals.
    when : str
        ``"sample"``, before the control acts; ``"watch"``, after it; ``"step"`` and ``"peak"``, at
        every step; ``"act"``, when u changes.
    start : float
    update : tuple of str
        Lines, without branches; ``{q}`` stands for the leaf.
    serial : tuple of str
        The same with a branch, where that is faster in a single run.
    tail : bool
        Whether it restarts at the tail.
    """

    name: str
    of: tuple[str, ...]
    when: str
    start: float
    update: tuple[str, ...]
    serial: tuple[str, ...] = ()
    tail: bool = False


LARGEST = ("max_{q} = abs({q}) if abs({q}) > max_{q} else max_{q}",)
METERS = (
    Meter("integral", ("v",), "sample", 0.0, ("integral_{q} += tau*{q}",)),
    Meter("variation", ("u",), "act", 0.0,
          ("step = {q} - held_{q}", "variation_{q} += abs(step)",
           "turns_{q} += 1.0 if step*last_{q} < 0.0 else 0.0",
           "last_{q} = step if step != 0.0 else last_{q}", "held_{q} = {q}"),
          ("step = {q} - held_{q}", "if step != 0.0:", "    variation_{q} += abs(step)",
           "    if step*last_{q} < 0.0:", "        turns_{q} += 1.0", "    last_{q} = step",
           "held_{q} = {q}")),
    Meter("held", ("u",), "", 0.0, ()), Meter("last", ("u",), "", 0.0, ()),
    Meter("turns", ("u",), "", 0.0, ()),
    Meter("low", ("sigma",), "watch", math.inf, ("low_{q} = {q} if {q} < low_{q} else low_{q}",)),
    Meter("low", ("u",), "act", math.inf, ("low_{q} = {q} if {q} < low_{q} else low_{q}",)),
    Meter("high", ("sigma",), "watch", -math.inf,
          ("high_{q} = {q} if {q} > high_{q} else high_{q}",)),
    Meter("high", ("u",), "act", -math.inf, ("high_{q} = {q} if {q} > high_{q} else high_{q}",)),
    Meter("max", ("sigma",), "watch", 0.0, LARGEST, tail=True),
    Meter("max", ("u",), "act", 0.0, LARGEST, tail=True),
    Meter("max", ("e",), "peak", 0.0, LARGEST, tail=True),
    Meter("sum", ("v",), "watch", 0.0, ("sum_{q} += abs({q})",)),
    Meter("sum", ("e", "u"), "step", 0.0, ("sum_{q} += abs({q})",)),
)


@dataclass(frozen=True, eq=False)
class Program:
    """A closed loop, written out; made by `writer.written`.

    It is text and numbers, and holds nothing of the loop that it was written for but what its lines
    depend on: loops of the same blocks share it, whatever their values, units and names.

    Attributes
    ----------
    segments : dict of str to tuple of Line
        ``command`` (reference and perturbation held between samples), ``measure`` (y, r, e),
        ``disturb``, ``stop``, ``control`` (the sampled stages), ``act`` (a control that acts late),
        ``advance`` (one step of the plant), ``probe``, in the order in which they act.
    places : dict of str to (str, int)
        {name of a function in the lines: (stage, number of its block in it)}.
    params : dict of str to str
        {variable: full name, as `ClosedLoop.with_` takes it}.
    x, z, held : tuple of str
        Variables of the plant's states, of those of blocks, and of signals held between steps.
    shapes : dict of str to nested tuple
        Of the signals; None stands for a number.
    heads : dict of str to tuple of paths
        Where in e, sigma and u the items are that are not derivatives, one for each channel.
    meters : tuple of (Meter, str)
        Each with the variable that it watches.
    state : dict of str to float
        {variable kept from step to step: its initial value}; the states of plant and blocks, whose
        initial values are those of the loop, have 0.
    columns : tuple of str
        Variables of a recorded row.
    inside, driven : str
        Conditions under which a step, and a sample, are within all limits.
    rings : tuple of (str, float)
        Length, a variable or a number, and initial value of each ring buffer in R, in order.
    lag : int
        Steps until a control acts.
    kinds : dict of str to type
        Of the parameters, by variable.
    trial : tuple of str
        The lines tried, in order.
    exact : tuple of str
        Variables of the matrices that advance a linear plant exactly (`exact.constants`), which
        follow the parameters in P; empty for the methods of Runge and Kutta.
    """

    segments: dict[str, tuple[Line, ...]]
    places: dict[str, tuple[str, int]]
    params: dict[str, str]
    x: tuple[str, ...]
    z: tuple[str, ...]
    held: tuple[str, ...]
    shapes: dict[str, Any]
    heads: dict[str, tuple[tuple[int, ...], ...]]
    meters: tuple[tuple[Meter, str], ...]
    state: dict[str, float]
    columns: tuple[str, ...]
    inside: str
    driven: str
    rings: tuple[tuple[str, float], ...]
    lag: int
    kinds: dict[str, type]
    trial: tuple[str, ...]
    exact: tuple[str, ...] = ()

    def updates(self, when: str, serial: bool = False) -> list[str]:
        """Return the lines of the meters at a moment, with branches if `serial`."""
        return [u.format(q=q) for m, q in self.meters if m.when == when
                for u in (serial and m.serial or m.update)]

    @functools.cached_property
    def names(self) -> dict[str, Any]:
        """The variables of each signal, nested as it is."""
        def nested(name, s):
            if s is None:
                return name
            return tuple(nested(f"{name}_{i}", v) for i, v in enumerate(s))

        return {name: nested(name, s) for name, s in self.shapes.items()}

    @functools.cached_property
    def source(self) -> str:
        """The loop as one function, to be run plain or compiled."""
        return serial(self)

    def blocks(self, loop: Any) -> dict[str, Block]:
        """Return the blocks of a loop by the names that their functions have in the lines."""
        stages = {s: parts(b) for s, b in loop.stages.items()}
        return {n: stages[s][i] for n, (s, i) in self.places.items()}

    def functions(self, loop: Any) -> dict[str, Callable]:
        """Return the plain functions of a loop's blocks, by their names in the lines."""
        return {n: b.f for n, b in self.blocks(loop).items()}

    @functools.cached_property
    def _trial(self) -> Any:
        return compile("\n".join(self.trial), "<trial>", "exec")

    def ring(self, values: dict[str, float]) -> list[float]:
        """Return R, the ring buffers one after the other, for given values of the parameters."""
        return [v for size, v in self.rings for _ in range(int(values.get(size) or size))]

    def tried(self, loop: Any, tau: float, m: int) -> dict[str, Any]:
        """Return the variables after the first step of a loop, run line by line."""
        values = dict(zip(self.params, loop.numbers(), strict=True))
        x, z = loop.start()
        made = {"t": 0.0, "tau": tau, "dt": 0.0, "k": 0, "m": m, "R": self.ring(values),
                "check": check, **dict.fromkeys(self.exact, 0.0), **self.functions(loop), **x, **z,
                **values}
        exec(self._trial, made)
        return made

    def stands(self, loop: Any, tau: float, m: int) -> bool:
        """Return whether the trial succeeds for a loop of the same blocks with other values."""
        try:
            self.tried(loop, tau, m)
        except Exception:
            return False
        return True


def methods(loop: Any) -> tuple[str, ...]:
    """Return the integration methods for a loop, its default first.

    A linear plant of python-control (`interop.from_control`) has ``"exact"``, which is its default.
    """
    return ("exact", *METHODS) if hasattr(loop.stages["plant"], "A") else tuple(METHODS)


def parts(b: Any) -> list[Block]:
    """Return the blocks of a stage one by one."""
    if hasattr(b, "parts"):
        return [q for p in b.parts.values() for q in parts(p)]
    return [b] if b else []


def paths(stage: str, b: Any) -> list[tuple[str, Block]]:
    """Return (path, block) of the blocks of a stage: ``law__attitude``."""
    if hasattr(b, "parts"):
        return [q for n, p in b.parts.items() for q in paths(f"{stage}__{n}", p)]
    return [(stage, b)] if b else []


# ---- layouts -------------------------------------------------------------------------------------
SERIAL = '''
def run(S, P, R, rec, dt, tau, m, every, n, k, stop, sample, row, line):
    {load}
    diverged = False
    while k < stop:
        t = k*dt
        {command}
        {measure}
        {disturb}
        if not ({inside}):
            diverged = True
            break
        {stop}
        if k == sample:
            sample += m
            {before}
            {control}
            if not ({driven}):
                diverged = True
                break
            {watch}
        {act}
        {peaks}
        if k == row:
            {record}
            line += 1
            row = min(row + every, n)
            {restart}
            if k == n:
                k += 1
                break
        {sums}
        {advance}
        k += 1
    {store}
    return k, sample, row, line, n, diverged
'''
CAST = {bool: "{} != 0.0", int: "int({})", float: "{}"}


def serial(p: Program) -> str:
    """Return a program as one function that runs from step `k` to step `stop`."""
    watched = dict.fromkeys(q for meter, q in p.meters if meter.name in ("low", "high"))
    filled = _segments(p, True) | {
        "load": _loaded(p) + [f"{q} = S[{i}]" for i, q in enumerate(p.state)],
        "store": [f"S[{i}] = {q}" for i, q in enumerate(p.state)],
        "stop": _texts(p, "stop") and [*_texts(p, "stop"), "if not left > 0.0:", "    n = row = k"],
        "record": _texts(p, "probe") + [f"rec[line, {i}] = {q}" for i, q in enumerate(p.columns)],
        "restart": [f"low_{q} = high_{q} = {q}" for q in watched]}
    return "\n".join(_filled(q, filled, p) for q in SERIAL.strip().split("\n")) + "\n"


def _texts(p: Program, segment: str) -> list[str]:
    return [q.text for q in p.segments.get(segment, ())]


def _loaded(p: Program) -> list[str]:
    return [*(f"{q} = {CAST[p.kinds[q]].format(f'P[{i}]')}" for i, q in enumerate(p.params)),
            *(f"{q} = P[{i}]" for i, q in enumerate(p.exact, len(p.params))),
            *(first(p.rings[:i]) for i in range(len(p.rings)))]


def first(rings: Sequence[tuple[str, float]]) -> str:
    """Return the line that says where the ring after these begins."""
    n = len(rings)
    return f"first_{n} = " + (f"first_{n - 1} + {rings[-1][0]}" if n else "0")


def _segments(p: Program, branches: bool) -> dict[str, list[str]]:
    """The segments and meters common to both layouts."""
    def at(condition, lines):
        return [f"if {condition}:", *("    " + q for q in lines)] if lines else []

    acts = p.updates("act", branches)
    due = at(f"k >= {p.lag} and (k - {p.lag})%m == 0", _texts(p, "act") + acts) if p.lag else []
    return {"command": at("k%m == 0", _texts(p, "command")), "before": p.updates("sample"),
            "act": due, "watch": acts*(not p.lag) + p.updates("watch"),
            "peaks": p.updates("peak"), "sums": p.updates("step"),
            **{n: _texts(p, n) for n in ("measure", "disturb", "control", "advance")}}


def _filled(source: str, filled: dict[str, list[str]], p: Program) -> str:
    """A line of a template, with its segment filled in at its depth."""
    part = filled.get(source.strip().strip("{}"))
    if part is None or not source.strip().startswith("{"):
        return source.format(inside=p.inside, driven=p.driven) if "{" in source else source
    return "\n".join(source[:len(source) - len(source.lstrip())] + q for q in part)


STEP = '''
def step(k, state, P, R, dt, tau, m):
    {load}
    t = k*dt
    {command}
    {measure}
    {disturb}
    if k%m == 0:
        {before}
        {control}
        {watch}
    {act}
    {peaks}
    {sums}
    {advance}
'''


def step(p: Program) -> str:
    """Return a program as one function that takes one step: (k, state, parameters) -> next state.

    `state` is a tuple in the order of ``Program.state``. Limits, stop and records are left out.
    """
    state = ", ".join(p.state)
    filled = _segments(p, False) | {"load": [*_loaded(p), f"{state}, = state"]}
    lines = [_filled(q, filled, p) for q in STEP.strip().split("\n")]
    return "\n".join([*lines, f"    return ({state},)"]) + "\n"
