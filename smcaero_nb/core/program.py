"""A closed loop as data: every leaf of every signal a local variable, its lines by segment.

`written` tries each line at t = 0 to learn the shapes of the signals. `serial` and `step` lay the
same lines out: as one function that runs a loop from step to step, and as one that does a step.
"""

import ast
import functools
import linecache
import math
import re
import types
import zlib
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from .block import Block, BlockError, Channels
from .cache import draws
from .leaves import Leaf, found
from .param import Param, listed, number, real, said
from .signal import flat, leaves, shape, text
from .stages import OWN, SAMPLED, SIGNALS, STAGES

__all__ = ["METHODS", "Line", "Meter", "Program", "inputs", "parts", "serial", "step", "written"]

LIMIT = 1e12  # sum of |x|, or of |u|, beyond which any run has diverged
INPUTS = 8  # most inputs that a plant is tried with
METHODS = dict(euler=[(0.0, 1.0)], midpoint=[(0.0, 0.0), (0.5, 1.0)],
               rk4=[(0.0, 1/6), (0.5, 1/3), (0.5, 1/3), (1.0, 1/6)])  # (node, weight) of each evaluation
ESTIMATED = ("surface", "law", "allocation")  # for them e is what the differentiator gives


class Line(NamedTuple):
    """A line of the program, with the variables that it reads and writes."""

    text: str
    reads: frozenset[str]
    writes: frozenset[str]


@functools.lru_cache(maxsize=20_000)
def line(source: str) -> Line:
    """Return a line with what it reads and writes."""
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
        Its variables are called name_leaf.
    of : tuple of str
        Signals.
    when : str
        ``"sample"``, before the control acts; ``"watch"``, after it; ``"step"``, at every step;
        ``"act"``, when u changes.
    start : float
    update : tuple of str
        Lines, without branches; ``{q}`` stands for the leaf.
    serial : tuple of str
        The same with a branch, where that is faster in a single run.
    tail : bool
        Whether it starts anew with the tail.
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
    """A closed loop, written out; made by `written`.

    Attributes
    ----------
    segments : dict of str to tuple of Line
        ``command`` (what the world holds between samples), ``measure`` (y, r, e), ``disturb``,
        ``stop``, ``control`` (the sampled stages), ``act`` (a control that acts late), ``advance``
        (one step of the plant), ``probe``, in the order in which they act.
    functions : dict of str to (function, str)
        {name in the lines: (the plain function of a block, what it is)}.
    places : dict of str to (str, int)
        {name in the lines: (stage, number of the block in it)}.
    params : dict of str to str
        {variable: full name, as `ClosedLoop.with_` takes it}.
    x, z, held : tuple of str
        Variables of the plant's states, of those of blocks, and of signals held between steps.
    shapes : dict of str to nested tuple
        Of the signals; None stands for a number.
    leaves : dict of str to tuple of Leaf
        Of the signals.
    meters : tuple of (Meter, str)
        Each with the variable that it watches.
    state : dict of str to float
        {variable that lives from step to step: its start}, blocks' own states with that of the trial.
    columns : tuple of str
        Variables of a recorded row.
    inside, driven : str
        Conditions under which a step, and a sample, are within all limits.
    rings : tuple of float
        Start of the ring buffers.
    lag : int
        Steps until a control acts.
    kinds : dict of str to type
        Of the parameters, by variable.
    trial : tuple of str
        What was tried, in its order.
    values : dict
        The variables at the end of the trial.
    """

    segments: dict[str, tuple[Line, ...]]
    functions: dict[str, tuple[types.FunctionType, str]]
    places: dict[str, tuple[str, int]]
    params: dict[str, str]
    x: tuple[str, ...]
    z: tuple[str, ...]
    held: tuple[str, ...]
    shapes: dict[str, Any]
    leaves: dict[str, tuple[Leaf, ...]]
    meters: tuple[tuple[Meter, str], ...]
    state: dict[str, float]
    columns: tuple[str, ...]
    inside: str
    driven: str
    rings: tuple[float, ...]
    lag: int
    kinds: dict[str, type]
    trial: tuple[str, ...]
    values: dict[str, Any]

    def updates(self, when: str, serial: bool = False) -> list[str]:
        """Return the lines of the meters at a moment, with branches where `serial`."""
        return [u.format(q=q) for m, q in self.meters if m.when == when
                for u in (serial and m.serial or m.update)]

    @functools.cached_property
    def source(self) -> str:
        """The loop as one function: what runs, plain or compiled."""
        return serial(self)

    @functools.cached_property
    def _tried(self) -> types.CodeType:
        return compile("\n".join(self.trial), "<trial>", "exec")

    def stands(self, loop: Any, tau: float, m: int) -> bool:
        """Return whether the trial goes well for a loop of the same blocks with other values."""
        functions = {n: parts(loop.stages[s])[i].f for n, (s, i) in self.places.items()}
        values = dict(zip(self.params, (v for p in loop.p.values() for v in p), strict=True))
        x, z = loop.start()
        try:
            exec(self._tried, {"t": 0.0, "tau": tau, "dt": 0.0, "k": 0, "m": m, "R": [*self.rings],
                               "check": _check, **functions, **x, **z, **values})
        except Exception:
            return False
        return True


def parts(b: Any) -> list[Block]:
    """Return the blocks of a stage one by one."""
    return [q for p in b.parts.values() for q in parts(p)] if hasattr(b, "parts") else [b] if b else []


def paths(stage: str, b: Any) -> list[tuple[str, Block]]:
    """Return (path, block) of the blocks of a stage: ``law__attitude``."""
    if hasattr(b, "parts"):
        return [q for n, p in b.parts.items() for q in paths(f"{stage}__{n}", p)]
    return [(stage, b)] if b else []


def inputs(plant: Block) -> tuple[Any, Any]:
    """Return zero input and perturbation of the shapes that a plant takes: the fewest it works with."""
    for m in range(1, INPUTS + 1):
        for d in (0.0, (0.0,)*m):
            given = {"t": 0.0, "x": plant.z0, "u": (0.0,)*m if m > 1 else 0.0, "d": d}
            try:
                plant.f(*(given[n] for n in plant.signals), *plant.p)
                return given["u"], d
            except Exception as reason:
                why = reason
    raise BlockError(f"plant '{plant.name}' could not be evaluated at its initial state with any number of "
                     f"inputs from 1 to {INPUTS}; with {INPUTS}: {type(why).__name__}: {why}") from why


def _local(name: str, path: str = "") -> str:
    """Return the variable of a leaf: sigma, e_0, x_3."""
    return name + path.replace("][", "_").replace("[", "_").replace("]", "")


def _error(r: Any, y: Any, p: str = "", q: str = "", name: str = "y") -> str:
    """Return the text of r - y.

    A reference without derivatives is piecewise constant, and its derivatives are zero.
    """
    if y is None:
        return f"{_local('r', p)} - {_local(name, q)}"
    if r is None:
        if any(v is not None for v in y):
            raise BlockError(f"the reference is one number, but y has {len(y)} channels; give one for each")
        rest = "".join(f"-{_local(name, f'{q}[{i}]')}, " for i in range(1, len(y)))
        return f"({_local('r', p)} - {_local(name, q + '[0]')}, {rest})"
    inner = (_error(r[i], v, f"{p}[{i}]", f"{q}[{i}]", name) + ", " for i, v in enumerate(y))
    return "(" + "".join(inner) + ")"


def _zero(y: Any) -> str:
    """Return the text of a zero reference: one zero for each channel of y."""
    return "0.0" if y is None or not any(y) else "(" + "".join(f"{_zero(v)}, " for v in y) + ")"


def _limits(name: str, s: Any, meta: Any) -> list[str]:
    """Return the text of the limits that the metadata of a signal declare."""
    if isinstance(meta, tuple) and s is not None:
        return [q for i, (v, m) in enumerate(zip(s, meta, strict=False))
                for q in _limits(_local(name, f"[{i}]"), v, m)]
    if not isinstance(meta, Param) or s is not None:
        return []
    low = [f"{name} >= {meta.low!r}"] if meta.low > -math.inf else []
    return low + ([f"{name} <= {meta.high!r}"] if meta.high < math.inf else [])


class _Writer:
    """Writes the program of a loop, trying each line to learn the shapes of the signals."""

    def __init__(self, loop: Any, method: str, tau: float, m: int, lag: int):
        self.loop, self.stages, self.m, self.lag = loop, loop.stages, m, lag
        self.functions, self.places, self.shapes, self.trial = {}, {}, {}, []
        self.params = {f"p_{s}_{i}": v for s, p in loop.p.items() for i, v in enumerate(p)}
        x, z = loop.start()
        self.x, self.z, self.rings = tuple(x), tuple(z), []
        self.shapes["x"] = (None,)*len(x)
        self.start = {**x, **z}
        self.values = {"t": 0.0, "tau": tau, "dt": 0.0, "k": 0, "m": m, "R": self.rings,
                       "float": float, **self.params, **self.start}
        self.held_world = [s for s in ("reference", "perturbation") if any(b.states for b in parts(self.stages[s]))]
        self.command = "c" if lag else "u"  # what the control gives; u is what acts
        self.segments = self.write_all(method)

    # ---- segments --------------------------------------------------------------------------------------
    def write_all(self, method):
        """The lines of all segments."""
        stages = self.stages
        asked = [s for s in ("output", "differentiator", "surface", "law", "allocation")
                 if any("u" in b.signals for b in parts(stages[s]))]
        if asked or self.lag:  # as few zeros as the plant works with, before the stages that give it
            self.written(self.assign, "u", repr(inputs(stages["plant"])[0]))
        taken = self.shapes.get("u")
        early = any("d" in b.signals for b in parts(stages["output"]))
        made = {"command": self.written(self.hold), "measure": self.written(self.measure, early),
                "control": self.written(self.control)}
        if self.lag:
            made["act"] = self.written(self.act)
        held = early or "perturbation" in self.held_world
        made["disturb"] = [] if held else self.written(self.stage, "perturbation", "d")
        made["advance"] = self.written(self.advance, METHODS[method])
        if (asked or self.lag) and self.shapes["u"] != taken:
            who = asked[0] if asked else "latency"
            raise BlockError(f"the {who} asks for u, of which the plant takes {len(taken) if taken else 'one number'}, "
                             f"but the loop gives it u = {said(self.values_of('u'))}")
        made["stop"] = self.written(self.stage, "stop", "left") if stages["stop"] else []
        made["probe"] = self.written(self.stage, "probe", "probe") if stages["probe"] else []
        return made

    def count(self):
        """The number of the sample, where a block or a ring asks for it."""
        needs = self.lag or any("k" in b.signals for s in STAGES for b in parts(self.stages[s]))
        if needs:
            self.write("count = k//m")

    def hold(self):
        """Reference and perturbation with memory, evaluated at samples."""
        if self.held_world:
            self.count()
        for s in self.held_world:
            self.stage(s, STAGES[s].gives)

    def measure(self, early):
        """Reference, output and error; before them, where the output asks for it, the perturbation."""
        if early and "perturbation" not in self.held_world:
            self.stage("perturbation", "d")
        if self.stages["output"] or len(self.x) > 1:
            self.stage("output", "y", "x")
        else:
            self.assign("y", "x_0")
        if not self.stages["reference"]:
            self.assign("r", _zero(self.shapes["y"]))
        elif "reference" not in self.held_world:
            self.stage("reference", "r")
        self.error("e", "y")

    def error(self, gives, of):
        """The difference of reference and output, or of reference and what the sensor gives."""
        try:
            self.assign(gives, _error(self.shapes["r"], self.shapes[of], name=of))
        except (BlockError, TypeError, IndexError) as why:
            told = f": {why}" if isinstance(why, BlockError) and "fails at" not in str(why) else ""
            raise BlockError(f"reference and output do not fit: e = r - {of} with r = {said(self.values_of('r'))}, "
                             f"{of} = {said(self.values_of(of))}{told}") from None

    def control(self):
        """The sampled stages."""
        self.count()
        for s in SAMPLED:
            gives, passes = STAGES[s].gives, STAGES[s].passes
            if s == "sensor":
                if self.stages[s]:
                    self.stage(s, gives)
                    self.error("e_m", gives)
                continue
            passes = {"e": "e_m"}.get(passes, passes) if self.stages["sensor"] else passes
            names = {"u": self.command}
            self.stage(s, names.get(gives, gives), names.get(passes, passes))
        if self.lag:
            self.ring(write=True)

    def ring(self, write):
        """Lines that put the command into its ring, or take u out of it."""
        names = [_local("c", q) for q in leaves(self.shapes["c"])]
        size = -(-self.lag//self.m) + 1
        if write:
            self.rings += [0.0]*(size*len(names))
        else:
            self.shapes["u"] = self.shapes["c"]
        at = f"count%{size}*{len(names)}" if write else f"(k - {self.lag})//m%{size}*{len(names)}"
        for i, q in enumerate(names):
            where = f"R[{at} + {i}]"
            self.write(f"{where} = {q}" if write else f"u{q[1:]} = {where}")

    def act(self):
        """The control that is due now."""
        self.ring(write=False)

    def advance(self, nodes):
        """One Runge-Kutta step of the plant; u is held, a perturbation without memory is not."""
        n = range(len(self.x))
        for j, (c, _) in enumerate(nodes):
            alias = {}
            if j:
                alias = {"t": "t_node", "x": "h"}
                self.write(f"t_node = t + {c!r}*dt")
                for i in n:
                    self.write(f"h_{i} = x_{i} + {c!r}*dt*rate_{j - 1}[{i}]")
                if "perturbation" not in self.held_world:
                    self.stage("perturbation", "d", alias=alias)
            self.write(f"rate_{j} = {self.call('plant', alias)}")
        for i in n:
            terms = [f"{w!r}*rate_{j}[{i}]" if w != 1.0 else f"rate_{j}[{i}]" for j, (_, w) in enumerate(nodes) if w]
            self.write(f"x_{i} = x_{i} + dt*" + (f"({' + '.join(terms)})" if len(terms) > 1 else terms[0]))

    # ---- lines -----------------------------------------------------------------------------------------
    def written(self, write, *args):
        """The lines that a method writes."""
        self.lines = []
        write(*args)
        return self.lines

    def write(self, source, where="", given=()):
        """Append a line and try it; an error names the block, its line and what it was given."""
        try:
            exec(source, self.values)
        except Exception as why:
            shapes = {n: self.values_of(n) for n in given if n in self.shapes}
            told = ", ".join(f"{n} = {said(v)} ({_kind(v)})" for n, v in shapes.items())
            raise BlockError(f"{where} fails at t = 0{_place(why)}: {type(why).__name__}: {why}."
                             + (f" It was given {told}" if told else "") + _way_out(why, shapes)) from why
        self.lines.append(source)
        self.trial.append(source)

    def values_of(self, name):
        """Value of a signal in the trial."""
        return eval(self.text(name), self.values)

    def text(self, name, channel=None, alias=None):
        """Text of a signal, or of one channel of it."""
        s = self.shapes[name] if channel is None else self.shapes[name][channel]
        path = "" if channel is None else f"[{channel}]"
        return text(s, (_local(alias or name, path + q) for q in leaves(s)))

    def assign(self, name, source):
        """Set the leaves of a signal from the text of an expression."""
        self.write(f"out = {source}")
        self.shapes[name] = shape(self.values["out"])
        for q in leaves(self.shapes[name]):
            self.write(f"{_local(name, q)} = float(out{q})")

    def stage(self, stage, gives, passes="", alias=None):
        """One stage: `gives` = block(...), or the signal `passes`, or zero, where there is no block."""
        if self.stages[stage]:
            self.assign(gives, self.call(stage, alias or {}))
        elif gives != passes:
            self.assign(gives, self.text(passes) if passes else "0.0")

    # ---- blocks ----------------------------------------------------------------------------------------
    def call(self, stage, alias):
        """Call the blocks of a stage; return the text of its output."""
        self.numbers = {"part": 0, "p": 0, "z": 0}
        return self.called(stage, self.stages[stage], stage, None, alias)

    def called(self, stage, b, path, channel, alias):
        """Call a block, or channels of blocks; return the text of what they give."""
        if not isinstance(b, Channels):
            return self.block(stage, b, path, channel, alias)
        results = [self.called(stage, part, f"{path}__{name}", None if stage == "probe" else i, alias)
                   for i, (name, part) in enumerate(b.parts.items())]
        return "(" + "".join(f"{q}, " for q in results) + ")"

    def seen(self, stage, signal):
        """The name under which a stage finds a signal: the control sees what the sensor gives."""
        if stage in SAMPLED and self.stages["sensor"] and stage != "sensor":
            signal = {"y": "y_m", "e": "e_m"}.get(signal, signal)
        if signal in ("e", "e_m") and self.stages["differentiator"] and stage in ESTIMATED:
            return "e_hat"
        return self.command if signal == "u" and stage == "actuator" else signal

    def block(self, stage, b, path, channel, alias):
        """Call one block; return the text of what it gives."""
        where, numbers = f"{stage} '{b.name}'", self.numbers
        name = re.sub(r"\W", "_", f"{stage}_{b.name}") + (f"_{numbers['part']}" if hasattr(self.stages[stage], "parts") else "")
        states = self.memory(stage, b, where)
        asked = [self.seen(stage, n) for n in b.signals]
        own = {"z": "(" + "".join(f"{q}, " for q in states) + ")", "tau": "tau", "t": alias.get("t", "t"),
               "k": "count", "salt": str(zlib.crc32(path.encode()))}
        try:
            args = [own.get(n) or self.text(n, channel if n != "x" else None, alias.get(n)) for n in asked]
        except (TypeError, IndexError):
            raise BlockError(f"{where}: a signal it asks for has no channel {channel}: "
                             + ", ".join(f"{n} = {said(self.values_of(n))}" for n in asked if n in self.shapes)) from None
        args += [f"p_{stage}_{numbers['p'] + j}" for j in range(len(b.params))]
        if name not in self.functions and (source := draws(b.f)):
            raise BlockError(f"{where} draws random numbers with {source}, which no run repeats; draw them once "
                             "(noise = np.random.default_rng(1).standard_normal(1000)) and read noise[...] in the block")
        self.functions[name], self.places[name] = (b.f, where), (stage, numbers["part"])
        self.values[name] = b.f
        result = f"out_{stage}" + f"_{numbers['part']}"*hasattr(self.stages[stage], "parts")
        self.write(f"{result} = {name}({', '.join(args)})", where, asked)
        _check(where, self.values[result], tuple(b.states), stage)
        self.trial.append(f"check({where!r}, {result}, {tuple(b.states)!r}, {stage!r})")
        for j, q in enumerate(states):
            self.write(f"{q} = float({result}[1][{j}])")
        numbers["part"], numbers["p"] = numbers["part"] + 1, numbers["p"] + len(b.params)
        numbers["z"] += len(b.states)
        return f"{result}[0]" if states else result

    def memory(self, stage, b, where):
        """The variables of the states of a block, which has to ask for what its stage offers."""
        s = STAGES[stage]
        memory = s.memory and stage != "plant"
        offered = s.asks + OWN*(memory and (s.when == "tau" or bool(b.states)))
        if wrong := [n for n in b.signals if n not in offered]:
            allowed = ", ".join((*s.asks, *OWN*(memory and s.when == "tau")))
            raise BlockError(f"{where} asks for {listed(wrong)}; it may ask for {allowed}")
        if stage == "plant" and not b.states:
            raise BlockError(f"{where} names no state: @block(state=dict(...))")
        if b.states and stage != "plant" and not (memory and "z" in b.signals):
            raise BlockError(f"{where} names a state ({listed(b.states)}), but "
                             + ("does not ask for z" if memory else "this stage has no memory"))
        return [f"z_{stage}_{self.numbers['z'] + j}" for j in range(len(b.states))] if memory else []


def written(loop: Any, method: str, tau: float, m: int, lag: int = 0) -> Program:
    """Write the program of a loop.

    Parameters
    ----------
    loop : ClosedLoop
    method : str
        Of integration, one of `METHODS`.
    tau : float
        Sampling step [s].
    m : int
        Integration steps in a sampling step.
    lag : int
        Integration steps until a control acts.

    Raises
    ------
    BlockError
        A block that does not fit its stage or fails at t = 0.
    """
    w = _Writer(loop, method, tau, m, lag)
    names = {s: [_local(s, q) for q in leaves(w.shapes[s])] for s in w.shapes}
    law = loop.stages["law"] is not None
    recorded = [s for s in SIGNALS[1:] if s in w.shapes]
    meters = [(meter, q) for meter in METERS for s in meter.of if s != "v" or law for q in names[s]]
    held = [q for s in SAMPLED if STAGES[s].gives in w.shapes for q in names[STAGES[s].gives]]
    held += [q for s in w.held_world for q in names[STAGES[s].gives]]
    held += [q for s in ("e_m",) if s in names for q in names[s]]
    watched = names["sigma"] + names["u"]
    state = dict.fromkeys([*w.x, *w.z, *dict.fromkeys(held)], 0.0) | w.start
    state |= {f"{meter.name}_{q}": meter.start for meter, q in meters}
    columns = ["t", *(q for s in recorded for q in names[s]), *w.x, *w.z,
               *(f"{b}_{q}" for q in watched for b in ("low", "high")),
               *(f"integral_{q}" for q in names["v"] if law), *names.get("probe", [])]
    limits = _limits("y", w.shapes["y"], loop.metadata("y"))
    limits += [q for n, meta in zip(w.x, loop.stages["plant"].states.values(), strict=True) for q in _limits(n, None, meta)]
    seen = [*(names["e_hat"] if loop.stages["differentiator"] else []), *names.get("y_m", [])]
    driven = dict.fromkeys([*seen, *names["sigma"], *names["v"], *names[w.command], *w.z])  # a NaN ends the run unrecorded
    every = [*w.x, *names["e"], *names["d"]]
    full = [f"{path}__{n}" for s, b in loop.stages.items() for path, p in paths(s, b) for n in p.params]
    kinds = [k for b in loop.stages.values() if b for k in b.kinds.values()]
    return Program(
        segments={n: tuple(map(line, q)) for n, q in w.segments.items()}, functions=w.functions, places=w.places,
        params=dict(zip(w.params, full, strict=True)), x=w.x, z=w.z, held=tuple(dict.fromkeys(held)), shapes=w.shapes,
        leaves=_leaves(loop, w.shapes), meters=tuple(meters), state=state, columns=tuple(columns),
        inside=" and ".join([f"{' + '.join(f'abs({q})' for q in every)} <= {LIMIT!r}", *limits]),
        driven=f"{' + '.join(f'abs({q})' for q in driven)} <= {LIMIT!r}", rings=tuple(w.rings), lag=lag,
        kinds=dict(zip(w.params, kinds, strict=True)), trial=tuple(w.trial), values=w.values)


def _leaves(loop: Any, shapes: dict[str, Any]) -> dict[str, tuple[Leaf, ...]]:
    """The leaves of all signals of a loop."""
    plant, nested = loop.stages["plant"], shapes["e"] is not None and any(v is not None for v in shapes["e"])
    names = () if loop.stages["output"] else tuple(plant.states)
    own = tuple(plant.states.values())
    channels = nested or loop.stages["law"] is not None and shapes["v"] is not None
    made = {}
    for s in (*SIGNALS[1:], "e_m", "probe"):
        if s not in shapes:
            continue
        of_states = names if s in ("y", "r", "e", "y_m", "e_m") and shapes[s] == shapes["x"] and len(names) > 1 else ()
        metas = own if of_states or not loop.stages["output"] and s in ("y", "e", "r") else loop.metadata(s)
        many = bool(of_states) or s in ("v", "u", "d", "probe") or s == "sigma" and channels
        made[s] = found(s, shapes[s], metas, many, of_states)
    return made


def _check(where: str, got: Any, states: tuple[str, ...], stage: str) -> None:
    """Raise `BlockError` unless a block returned what its stage needs."""
    names = listed(states)
    if stage != "plant" and states:
        if not (isinstance(got, tuple) and len(got) == 2 and shape(got[1]) == (None,)*len(states)):
            raise BlockError(f"{where} must return (output, next z), next z a tuple of {len(states)} ({names}); "
                             f"it returned {said(got)}")
        got = got[0]
    if stage == "plant" and shape(got) != (None,)*len(states):
        raise BlockError(f"{where} must return dx/dt as a tuple of {len(states)} ({names}); it returned {said(got)}")
    if stage == "stop" and isinstance(got, tuple):
        raise BlockError(f"{where} must return a float, what is left until the run ends; it returned {said(got)}")
    if (isinstance(got, tuple) and not got) or not all(map(_float, flat(got))):
        raise BlockError(f"{where} must return a float or a tuple of floats; it returned {said(got)}")


def _float(value: Any) -> bool:
    """Whether a number is one that numba and float64 take as well."""
    if type(value) is float:
        return True
    fits = not isinstance(value, int) or math.isfinite(number(value))
    return isinstance(value, (float, int, np.number)) and real(value) and fits


def _kind(value: Any) -> str:
    """Shape of a signal, in words."""
    if not isinstance(value, tuple):
        return "a number"
    nested = any(isinstance(v, tuple) for v in value)
    return f"{len(value)} channels: {', '.join(map(_kind, value))}" if nested else f"a tuple of {len(value)}"


def _way_out(why: Exception, given: dict[str, Any]) -> str:
    """What to do about an error that comes from the shape of a signal."""
    words, tuples = str(why), [n for n, v in given.items() if isinstance(v, tuple)]
    numbers = [n for n in given if n not in tuples]
    if re.search("subscript|iterable", words) and numbers:
        return (f". A number has no components: write {' or '.join(numbers)}, without an index, or let a "
                "stage before this one (output, surface) give several")
    if re.search("unpack|out of range", words) and tuples:
        return "".join(f". {n} has {len(given[n])} components, {n}[0] to {n}[{len(given[n]) - 1}]" for n in tuples)
    if re.search("tuple|sequence", words) and tuples:
        return "".join(f". {n}[0] is the first component of {n}; a stage before this one (output, surface) may make one "
                       "number of all" for n in tuples[:1])
    return ""


def _place(why: BaseException) -> str:
    """Line of the block in which an exception arose, in words."""
    at = why.__traceback__
    while at and at.tb_next:
        at = at.tb_next
    file, number = (at.tb_frame.f_code.co_filename, at.tb_lineno) if at else ("", 0)
    return f", line {number} ({linecache.getline(file, number).strip()})" if linecache.getline(file, number) else ""


# ---- layouts -----------------------------------------------------------------------------------------
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
    """Return a program as one function that goes from step to step, from `k` to `stop`."""
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
    return [f"{q} = {CAST[p.kinds[q]].format(f'P[{i}]')}" for i, q in enumerate(p.params)]


def _segments(p: Program, branches: bool) -> dict[str, list[str]]:
    """The segments and meters that both layouts have."""
    def at(condition, lines):
        return [f"if {condition}:", *("    " + q for q in lines)] if lines else []

    acts = p.updates("act", branches)
    due = at(f"k >= {p.lag} and (k - {p.lag})%m == 0", _texts(p, "act") + acts) if p.lag else []
    return {"command": at("k%m == 0", _texts(p, "command")), "before": p.updates("sample"), "act": due,
            "watch": acts*(not p.lag) + p.updates("watch"), "peaks": p.updates("peak"), "sums": p.updates("step"),
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
    """Return a program as one function that does one step: (k, state, parameters) -> next state.

    `state` is a tuple in the order of ``Program.state``. Limits, stop and records are left out.
    """
    state = ", ".join(p.state)
    filled = _segments(p, False) | {"load": [*_loaded(p), f"{state}, = state"]}
    lines = [_filled(q, filled, p) for q in STEP.strip().split("\n")]
    return "\n".join([*lines, f"    return ({state},)"]) + "\n"
