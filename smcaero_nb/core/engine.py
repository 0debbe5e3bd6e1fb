"""The closed loop and its simulation.

The loop is written out as one Python function for the given blocks and the shapes of their signals, every leaf of
every signal a local variable (`_Writer`); it runs as it is or compiled by numba: the same text, the same numbers.
"""

import hashlib
import linecache
import math
import re
import threading
import time
import types

import numpy as np

from .block import Block, BlockError, Channels, routed, wanted
from .cache import compiled, draws, kept, remembered
from .metrics import channel_figures, metrics
from .param import (
    Param,
    ParameterError,
    chosen,
    function,
    given,
    listed,
    number,
    positive,
    real,
    refused,
    said,
    switch,
    texted,
)
from .signal import flat, leaves, shape, text
from .theorem import doubts, perturbation

__all__ = ["ClosedLoop", "Run", "simulate"]

LIMIT = 1e12  # sum of |x|, or of |u|, beyond which any run has diverged
LOOPS = 64  # kept in memory; the others come back from disk
CHUNK = 0.02  # s of machine time between two looks at Ctrl-C, cancel and progress

ASKS = dict(reference=("t",), output=("t", "x", "u", "d"), differentiator=("t", "r", "y", "e"),
            surface=("t", "r", "y", "e"), law=("t", "r", "y", "e", "sigma"), allocation=("t", "r", "y", "e", "sigma", "v"),
            actuator=("t", "y", "u"), perturbation=("t", "x"), plant=("t", "x", "u", "d"),
            stop=("t", "x"))
GIVES = dict(differentiator=("e_hat", "e"), surface=("sigma", "e_hat"), law=("v", "sigma"), allocation=("u", "v"),
             actuator=("u", "u"))  # what a sampled stage gives, and what it passes on where there is none
ESTIMATED = ("surface", "law", "allocation")  # for them e is what the differentiator gives, where there is one
SIGNALS = ("t", "r", "y", "e", "e_hat", "sigma", "v", "u", "d")
METHODS = dict(euler=[(0.0, 1.0)], midpoint=[(0.0, 0.0), (0.5, 1.0)],
               rk4=[(0.0, 1/6), (0.5, 1/3), (0.5, 1/3), (1.0, 1/6)])  # (node, weight) of each evaluation
ROWS = 100_000_000  # most rows of a run
INPUTS = 8  # most inputs that a plant is tried with


class ClosedLoop:
    """A plant under sampled control: what `simulate` runs.

    Parameters
    ----------
    plant : Block
        ``x' = plant(t, x, u, d)``, integrated with `dt`.
    reference, output, differentiator, surface, law, allocation, actuator, perturbation : Block, Channels or None
        The stages of the pipeline; one left out is the identity (reference and perturbation: zero), free of cost.
        Without `output`, y is the tuple of the plant's states, or, of a plant with one state, that number.
        A parameter of `output` that the plant has too follows the plant. It may ask for u and d as they act on the plant when
        y is measured: at a sample, u is still that of the sample before (zero before the first), so that no loop is algebraic.
    stop : Block or None
        What is left until the run ends: it ends at the first step at which ``stop(t, x)`` is no longer positive.
    duration, dt, tau : float, optional
        What `simulate` uses unless told otherwise [s].
    name : str
        For titles.
    verdict : callable, optional
        ``verdict(run)`` says what became of a run: an object with its words as text, true if all went well. Masks show it.

    Raises
    ------
    BlockError
        A stage is not a block.
    ParameterError
        An unknown stage, or a time, name or verdict that is not allowed.
    """

    def __init__(self, plant, *, duration=None, dt=None, tau=None, name="", verdict=None, **stages):
        for n, v in dict(duration=duration, dt=dt, tau=tau).items():
            setattr(self, n, v if v is None else positive("ClosedLoop", n, v))
        self.name = texted("ClosedLoop", "name", name)
        self.verdict = function("ClosedLoop", "verdict", verdict)
        self.stages = routed("ClosedLoop", dict.fromkeys(ASKS), {"plant": plant, **stages})
        for stage, b in self.stages.items():
            wanted(stage, b, *((Block,) if stage == "plant" else (Block, Channels, type(None))))
            if texts := [n for n, k in (b.kinds if b else {}).items() if k not in (float, int, bool)]:
                raise BlockError(f"{stage} '{b.name}': {texts[0]} is a choice of texts; a stage has numbers and switches only")

    def with_(self, **changes):
        """Return a copy with changes.

        ``law=other_block`` replaces a stage, ``law__lam=2.0`` sets a parameter in it, ``plant__theta=0.1`` an initial
        state, ``law__attitude__lam=2.0`` reaches into channels; `duration`, `dt`, `tau`, `name`, `verdict` as in `ClosedLoop`.

        Raises
        ------
        ParameterError
            An unknown stage or name, or a value that its metadata does not allow.
        BlockError
            A stage is not a block.
        """
        own = {k: changes.pop(k, getattr(self, k)) for k in ("duration", "dt", "tau", "name", "verdict")}
        for name in getattr(changes.get("plant", self.stages["plant"]), "params", ()):
            if f"output__{name}" in changes:
                raise ParameterError(f"ClosedLoop: {name} of the output follows the plant; set plant__{name}")
        return ClosedLoop(**routed("ClosedLoop", self.stages, changes), **own)

    def settable(self):
        """{name: (Param, value, kind)} of all that `with_` accepts in the stages: what a mask shows."""
        tied = self.stages["plant"].params
        return {f"{s}__{n}": (m, values[n], kinds.get(n, float)) for s, b in self.stages.items() if b
                for values, kinds in [(b.values, b.kinds)] for n, m in b.settable.items() if not (s == "output" and n in tied)}

    @property
    def p(self):
        """The parameters, stage by stage; the output takes the plant's value of any name they share."""
        plant, b = self.stages["plant"], dict(self.stages)
        if b["output"]:
            b["output"] = b["output"].with_(**{n: plant.values[n] for n in b["output"].params if n in plant.params})
        return {s: v.p for s, v in b.items() if v}

    def start(self):
        """Initial states {local variable: value} of the plant and of the sampled stages."""
        z = {f"z_{s}_{i}": v for s in GIVES if self.stages[s] for i, v in enumerate(self.stages[s].z0)}
        return {f"x_{i}": v for i, v in enumerate(self.stages["plant"].z0)}, z

    def metadata(self, signal):
        """Metadata of a signal: a `Param`, a (nested) tuple of them, or None where no block declares any."""
        by = dict(r=("output",), y=("output",), e=("output",), e_hat=("output",), sigma=("surface",), v=("law",),
                  u=("actuator", "allocation") if self.stages["allocation"] else ("actuator", "law"), d=("perturbation",))[signal]
        return next((self.stages[s].output for s in by if self.stages[s] and self.stages[s].output), None)

    def __repr__(self):
        return "\n".join([f"ClosedLoop {self.name}".rstrip(), *(f"  {s:<15}{b!r}" for s, b in self.stages.items() if b)])


# ---- the loop as text --------------------------------------------------------------------------------------------
TEXT = '''
def run(S, P, rec, dt, tau, m, every, n, k, stop, sample, row, line):
    {load}
    diverged = False
    while k < stop:
        t = k*dt
        {measure}
        {disturb}
        if not ({inside}):
            diverged = True
            break
        {touch}
        if k == sample:
            sample += m
            {held}
            {control}
            if not ({driven}):
                diverged = True
                break
            {watch}
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


def _local(name, path=""):
    """Local variable of a leaf: sigma, e_0, x_3."""
    return name + path.replace("][", "_").replace("[", "_").replace("]", "")


def _error(r, y, p="", q=""):
    """Text of e = r - y; a reference without derivatives is piecewise constant, and its derivatives are zero."""
    if y is None:
        return f"{_local('r', p)} - {_local('y', q)}"
    if r is None:
        rest = "".join(f"-{_local('y', f'{q}[{i}]')}, " for i in range(1, len(y)))
        return f"({_local('r', p)} - {_local('y', q + '[0]')}, {rest})"
    return "(" + "".join(_error(r[i], v, f"{p}[{i}]", f"{q}[{i}]") + ", " for i, v in enumerate(y)) + ")"


def _zero(y):
    """Text of a zero reference: one zero for each channel of y."""
    return "0.0" if y is None or not any(y) else "(" + "".join(f"{_zero(v)}, " for v in y) + ")"


def _inside(name, s, meta):
    """Text of the limits that the metadata of a signal declare."""
    if isinstance(meta, tuple) and s is not None:
        return [q for i, (v, m) in enumerate(zip(s, meta, strict=False)) for q in _inside(_local(name, f"[{i}]"), v, m)]
    low, high = (meta.low, meta.high) if isinstance(meta, Param) and s is None else (-math.inf, math.inf)
    return ([f"{name} >= {low!r}"] if low > -math.inf else []) + ([f"{name} <= {high!r}"] if high < math.inf else [])


def _parts(b):
    """The blocks of a stage: those of channels, or the one."""
    return list(b.parts.values()) if isinstance(b, Channels) else [b]


def inputs(plant):
    """Zero input and zero perturbation of the shapes that a plant block takes: the fewest inputs with which it works."""
    for m in range(1, INPUTS + 1):
        for d in (0.0, (0.0,)*m):
            given = {"t": 0.0, "x": plant.z0, "u": (0.0,)*m if m > 1 else 0.0, "d": d}
            try:
                plant.f(*(given[n] for n in plant.signals), *plant.p)
                return given["u"], d
            except Exception as reason:
                why = reason
    raise BlockError(f"plant '{plant.name}' works with no number of inputs from 1 to {INPUTS} at its initial state; with "
                     f"{INPUTS}: {type(why).__name__}: {why}") from why


class _Writer:
    """Writes the loop of a `ClosedLoop`, trying each line at t = 0 to learn the shapes of the signals.

    Attributes: `source`; `functions`, {name in it: (function, what it is)}; `shapes` of the signals; `columns`, the leaves of
    a recorded row; `state`, the locals that live from step to step, and `start`, those of them that blocks declare;
    `trial`, what was tried, in its order.
    """

    def __init__(self, loop, method, tau):
        self.stages, self.functions, self.places, self.shapes, self.trial = loop.stages, {}, {}, {}, []
        self.values = {"t": 0.0, "tau": tau, "dt": 0.0, "float": float}
        params = {f"p_{s}_{i}": v for s, p in loop.p.items() for i, v in enumerate(p)}
        self.x, self.z = loop.start()
        self.shapes["x"] = (None,)*len(self.x)
        self.values.update({**params, **self.x, **self.z})
        self.params = list(params)

        asked = getattr(self.stages["output"], "signals", ())
        if "u" in asked:  # before the stages that give it: as few zeros as the plant works with
            self.written(self.assign, "u", repr(inputs(loop.stages["plant"])[0]))
        taken = self.shapes.get("u")
        parts = {"measure": self.written(self.measure, "d" in asked), "control": self.written(self.control),
                 "disturb": self.written(self.stage, "perturbation", "d") if "d" not in asked else [],
                 "advance": self.written(self.advance, METHODS[method])}
        if "u" in asked and self.shapes["u"] != taken:
            raise BlockError(f"the output asks for u, of which the plant takes {len(taken) if taken else 'one number'}, but the "
                             f"loop gives it u = {said(self.values_of('u'))}")
        parts["touch"] = []
        if loop.stages["stop"]:  # the last row is this one
            parts["touch"] = [*self.written(self.stage, "stop", "left"), "if not left > 0.0:", "    n = row = k"]
        names = {s: [_local(s, q) for q in leaves(self.shapes[s])] for s in self.shapes}
        e, u, watched = names["e"], names["u"], names["sigma"] + names["u"]
        held = [q for s, _ in GIVES.values() for q in names[s]]
        v = names["v"] if self.stages["law"] else []
        self.columns = ["t", *(q for s in SIGNALS[1:] for q in names[s]), *self.x, *self.z,
                        *(f"{b}_{q}" for q in watched for b in ("low", "high")), *(f"integral_{q}" for q in v)]
        self.state = list(dict.fromkeys([
            *self.x, *self.z, *held, *(f"{b}_{q}" for q in v for b in ("integral", "sum")),
            *(f"{b}_{q}" for q in u for b in ("held", "last", "variation", "turns")),
            *(f"{b}_{q}" for q in watched for b in ("low", "high")), *(f"sum_{q}" for q in e + u),
            *(f"max_{q}" for q in e + watched)]))

        limits = _inside("y", self.shapes["y"], loop.metadata("y"))
        limits += [q for n, m in zip(self.x, loop.stages["plant"].states.values(), strict=True) for q in _inside(n, None, m)]
        estimates = names["e_hat"] if loop.stages["differentiator"] else []
        driven = dict.fromkeys([*estimates, *names["sigma"], *names["v"], *u, *self.z])  # a NaN ends the run unrecorded
        parts["inside"] = " and ".join([f"{' + '.join(f'abs({q})' for q in [*self.x, *e, *names['d']])} <= {LIMIT!r}", *limits])
        parts["driven"] = f"{' + '.join(f'abs({q})' for q in driven)} <= {LIMIT!r}"
        parts["held"] = [f"integral_{q} += tau*{q}" for q in v]
        parts["watch"] = [line for q in u for line in (
            f"step = {q} - held_{q}", "if step != 0.0:", f"    variation_{q} += abs(step)", f"    if step*last_{q} < 0.0:",
            f"        turns_{q} += 1.0", f"    last_{q} = step", f"held_{q} = {q}")]
        parts["watch"] += [f"{b}_{q} = {q} if {q} {than} {b}_{q} else {b}_{q}"
                           for q in watched for b, than in (("low", "<"), ("high", ">"))]
        parts["watch"] += [f"max_{q} = abs({q}) if abs({q}) > max_{q} else max_{q}" for q in watched]
        parts["watch"] += [f"sum_{q} += abs({q})" for q in v]
        parts["sums"] = [f"sum_{q} += abs({q})" for q in e + u]
        parts["peaks"] = [f"max_{q} = abs({q}) if abs({q}) > max_{q} else max_{q}" for q in e]
        parts["record"] = [f"rec[line, {i}] = {q}" for i, q in enumerate(self.columns)]
        parts["restart"] = [f"low_{q} = high_{q} = {q}" for q in watched]
        cast = {bool: "P[{}] != 0.0", int: "int(P[{}])", float: "P[{}]"}
        kinds = [k for b in loop.stages.values() if b for k in b.kinds.values()]
        parts["load"] = [f"{q} = {cast[k].format(i)}" for i, (q, k) in enumerate(zip(params, kinds, strict=True))]
        parts["load"] += [f"{q} = S[{i}]" for i, q in enumerate(self.state)]
        parts["store"] = [f"S[{i}] = {q}" for i, q in enumerate(self.state)]
        self.source = "\n".join(self.filled(line, parts) for line in TEXT.strip().split("\n")) + "\n"
        self.tried = compile("\n".join(self.trial), "<trial>", "exec")

    def stands(self, loop, tau):
        """Whether the trial goes well for a loop of the same blocks with other values."""
        functions = {name: _parts(loop.stages[stage])[i].f for name, (stage, i) in self.places.items()}
        values = dict(zip(self.params, (v for p in loop.p.values() for v in p), strict=True))
        x, z = loop.start()
        try:
            exec(self.tried, {"t": 0.0, "tau": tau, "dt": 0.0, "check": self.check, **functions,
                              **x, **z, **values})
        except Exception:
            return False
        return True

    def filled(self, line, parts):
        """A line of the template, with its part filled in at its depth."""
        part = parts.get(line.strip().strip("{}"))
        return line.format(**parts) if not isinstance(part, list) else "\n".join(
            line[:len(line) - len(line.lstrip())] + q for q in part)

    def written(self, write, *args):
        """The lines that a method writes."""
        self.lines = []
        write(*args)
        return self.lines

    def write(self, line, where="", given=()):
        """Append a line and try it; an error names the block, its line and what it was given."""
        try:
            exec(line, self.values)
        except Exception as why:
            shapes = {n: self.values_of(n) for n in given if n in self.shapes}
            told = ", ".join(f"{n} = {said(v)} ({_kind(v)})" for n, v in shapes.items())
            raise BlockError(f"{where} fails at t = 0{_place(why)}: {type(why).__name__}: {why}."
                             + (f" It was given {told}" if told else "") + _way_out(why, shapes)) from why
        self.lines.append(line)
        self.trial.append(line)

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

    def call(self, stage, alias):
        """Call the block of a stage, channel by channel; return the text of its output."""
        block, results, p, z = self.stages[stage], [], 0, 0
        memory = ("z", "tau") if stage in GIVES else ()
        many = isinstance(block, Channels)
        for i, b in enumerate(_parts(block)):
            where, name = f"{stage} '{b.name}'", re.sub(r"\W", "_", f"{stage}_{b.name}") + f"_{i}"*many
            if wrong := [n for n in b.signals if n not in ASKS[stage] + memory]:
                raise BlockError(f"{where} asks for {listed(wrong)}; it may ask for {', '.join(ASKS[stage] + memory)}")
            if stage == "plant" and not b.states:
                raise BlockError(f"{where} names no state: @block(state=dict(...))")
            if b.states and stage != "plant" and not (memory and "z" in b.signals):
                raise BlockError(f"{where} names a state ({listed(b.states)}), but "
                                 + ("does not ask for z" if memory else "this stage has no memory"))
            states = [f"z_{stage}_{z + j}" for j in range(len(b.states))] if memory else []
            estimated = self.stages["differentiator"] and stage in ESTIMATED
            asked = ["e_hat" if n == "e" and estimated else n for n in b.signals]
            own = {"z": "(" + "".join(f"{q}, " for q in states) + ")", "tau": "tau", "t": alias.get("t", "t")}
            try:
                args = [own.get(n) or self.text(n, i if many and n != "x" else None, alias.get(n)) for n in asked]
            except (TypeError, IndexError):
                raise BlockError(f"{where}: a signal it asks for has no channel {i}: "
                                 + ", ".join(f"{n} = {said(self.values_of(n))}" for n in asked if n in self.shapes)) from None
            args += [f"p_{stage}_{p + j}" for j in range(len(b.params))]
            if source := draws(b.f):
                raise BlockError(f"{where} draws random numbers with {source}, which no run repeats; draw them once "
                                 "(noise = np.random.default_rng(1).standard_normal(1000)) and read noise[...] in the block")
            self.functions[name], self.places[name], self.values[name] = (b.f, where), (stage, i), b.f
            result = f"out_{stage}" + f"_{i}"*many
            self.write(f"{result} = {name}({', '.join(args)})", where, asked)
            self.check(where, self.values[result], b.states, stage)
            self.trial.append(f"check({where!r}, {result}, {tuple(b.states)!r}, {stage!r})")
            for j, q in enumerate(states):
                self.write(f"{q} = float({result}[1][{j}])")
            results.append(f"{result}[0]" if states else result)
            p, z = p + len(b.params), z + len(b.states)
        return "(" + "".join(f"{q}, " for q in results) + ")" if many else results[0]

    def check(self, where, got, states, stage):
        """Raise `BlockError` unless a block returned what its stage needs."""
        names = listed(states)
        if stage in GIVES and states:
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

    def stage(self, stage, gives, passes=None, alias=None):
        """One stage: `gives` = block(...), or the signal `passes`, or zero, where there is no block."""
        if self.stages[stage]:
            self.assign(gives, self.call(stage, alias or {}))
        elif gives != passes:
            self.assign(gives, self.text(passes) if passes else "0.0")

    def measure(self, early):
        """Reference, output and error; before them, where the output asks for it, the perturbation."""
        if early:
            self.stage("perturbation", "d")
        if self.stages["output"] or len(self.x) > 1:
            self.stage("output", "y", "x")
        else:
            self.assign("y", "x_0")
        if self.stages["reference"]:
            self.stage("reference", "r")
        else:
            self.assign("r", _zero(self.shapes["y"]))
        try:
            self.assign("e", _error(self.shapes["r"], self.shapes["y"]))
        except (BlockError, TypeError, IndexError):
            raise BlockError("reference and output do not fit: e = r - y with "
                             f"r = {said(self.values_of('r'))}, y = {said(self.values_of('y'))}") from None

    def control(self):
        """The sampled stages."""
        for stage, (gives, passes) in GIVES.items():
            self.stage(stage, gives, passes)

    def advance(self, nodes):
        """One Runge-Kutta step of the plant; u is held, the perturbation is not."""
        n = range(len(self.x))
        for j, (c, _) in enumerate(nodes):
            alias = {}
            if j:
                alias = {"t": "t_node", "x": "h"}
                self.write(f"t_node = t + {c!r}*dt")
                for i in n:
                    self.write(f"h_{i} = x_{i} + {c!r}*dt*rate_{j - 1}[{i}]")
                self.stage("perturbation", "d", alias=alias)
            self.write(f"rate_{j} = {self.call('plant', alias)}")
        for i in n:
            terms = [f"{w!r}*rate_{j}[{i}]" if w != 1.0 else f"rate_{j}[{i}]" for j, (_, w) in enumerate(nodes) if w]
            self.write(f"x_{i} = x_{i} + dt*" + (f"({' + '.join(terms)})" if len(terms) > 1 else terms[0]))


def _float(value):
    """Whether a number is one that numba and float64 take as well."""
    fits = not isinstance(value, int) or math.isfinite(number(value))
    return isinstance(value, (float, int, np.number)) and real(value) and fits


def _kind(value):
    """Shape of a signal, in words."""
    if not isinstance(value, tuple):
        return "a number"
    nested = any(isinstance(v, tuple) for v in value)
    return f"{len(value)} channels: {', '.join(map(_kind, value))}" if nested else f"a tuple of {len(value)}"


def _way_out(why, given):
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


def _place(why):
    """Line of the block in which an exception arose, in words."""
    at = why.__traceback__
    while at.tb_next:
        at = at.tb_next
    file, line = at.tb_frame.f_code.co_filename, at.tb_lineno
    return f", line {line} ({linecache.getline(file, line).strip()})" if linecache.getline(file, line) else ""


def _uncompilable(writer, why):
    """The error that names the block, and its line, which numba cannot compile."""
    from numba import njit, typeof
    from numba.core.errors import NumbaError, UnsupportedBytecodeError

    for line in writer.source.split("\n"):
        for name, (f, where) in writer.functions.items():
            if f" = {name}(" in line:
                args = eval(f"({line.split(f' = {name}(')[1][:-1]},)", writer.values)
                try:
                    alone = compiled(f).py_func
                    njit(nogil=True, error_model="numpy")(alone).compile(tuple(map(typeof, args)))
                except (NumbaError, UnsupportedBytecodeError) as reason:
                    found = re.findall(r'(?:File "|Raised from )(.*?)(?:", line | \()(\d+)', str(reason))
                    file, number = found[-1] if found else ("", 0)
                    at = f", line {number} ({linecache.getline(file, int(number)).strip()})" if found else ""
                    return BlockError(f"{where} cannot be compiled{at}: {_first(reason)}. A block may use floats, tuples, math "
                                      "and plain functions; simulate(..., jit=False) runs it as plain Python")
    return BlockError(f"the loop cannot be compiled: {_first(why)}")


def _first(reason):
    """What numba says, in one line."""
    lines = [q.strip() for q in re.sub(r"\x1b\[\d*m", "", str(reason)).split("\n")]
    return next((q for q in lines if q and not q.startswith(("Failed in", "-", "File"))), "numba gives no reason")


_made, _lock = {}, threading.RLock()  # masks simulate in threads


def _made_loop(loop, method, tau, jit):
    """The loop for these blocks, from memory, from disk, or compiled now; and its writer."""
    asked = "u" in getattr(loop.stages["output"], "signals", ())
    shapes = shape(inputs(loop.stages["plant"])[0]) if asked else ()
    key = repr((method, shapes, [(s, b and b.content()) for s, b in loop.stages.items()]))
    known = jit and (key, jit) in _made
    if known and not _made[key, jit][1].stands(loop, tau):  # say why, as if it were new
        _Writer(loop, method, tau)
    if not known:  # plain: these very functions, which a debugger knows
        writer = _Writer(loop, method, tau)
        names = {n: compiled(f) if jit else f for n, (f, _) in writer.functions.items()}
        names["__name__"] = __name__  # numba asks for it when it loads from disk
        file = f"<loop {hashlib.sha256(writer.source.encode()).hexdigest()[:8]}>"
        linecache.cache[file] = len(writer.source), None, writer.source.splitlines(True), file  # for debuggers
        exec(compile(writer.source, file, "exec"), names)
        f = names["run"]
        if jit:
            from numba import float64, int64, njit
            from numba.core.errors import NumbaError, UnsupportedBytecodeError

            f = kept(njit(nogil=True, error_model="numpy", no_cfunc_wrapper=True)(f), key + writer.source)
            try:
                f.compile((float64[::1], float64[::1], float64[:, ::1], float64, float64, *[int64]*8))
            except (NumbaError, UnsupportedBytecodeError) as why:
                raise _uncompilable(writer, why) from why
        _made[key, jit] = f, writer
    return remembered(_made, (key, jit), LOOPS)


# ---- runs --------------------------------------------------------------------------------------------------------
def _named(states, arrays):
    """States by name, those of channels by channel and name."""
    return types.SimpleNamespace(**{k: _named(v, arrays) if isinstance(v, dict) else next(arrays) for k, v in states.items()})


class Run:
    r"""What a simulation gives; arrays with one value a recorded row, nested as the signals are.

    Attributes
    ----------
    t : ndarray
        Times of the rows [s].
    r, y, e, e_hat, sigma, v, u, d : ndarray or nested tuple of ndarray
        Signals of the pipeline; the sampled ones as held at that time. At a sample, y and e are as measured: an output that
        asks for u saw the u of the sample before, not the one that the row gives, which acts from then on.
    x, z : namespace
        Named states: ``run.x.theta``, ``run.z.law.lam``, ``run.z.law.attitude.rho``; `z` as the latest sample left it.
    low, high : namespace
        Least and greatest value of `sigma` and `u` since the row before: what chattering reaches between rows.
    xi : ndarray, nested tuple of ndarray, or None
        The perturbation as the law meets it, sigma^(r) + v, averaged since the row before: all that the law does not know.
        Nested as `v`; None where there is no law, or its v does not belong to sigma.
    integral_v : ndarray, nested tuple of ndarray, or None
        Running integral of `v` up to the latest sample.
    mean_e, mean_v, mean_u : float or nested tuple
        Means of \|e\|, \|v\|, \|u\| over all steps; mean_v is None where there is no law.
    max_e, max_sigma, max_u : float or nested tuple
        Greatest absolute values over all steps.
    tail_e, tail_sigma, tail_u : float or tuple
        Greatest absolute values over the tail (the last fifth unless told; NaN if the run ended before it), without those of
        derivatives: a number, or one for each channel, as in `metrics`.
    tail_peaks : namespace
        The same of all leaves of `e`, `sigma` and `u`, nested as the signals are.
    variation_u, tail_variation_u : float or nested tuple
        Total variation of `u`, from rest, over the run; and in the tail.
    tail_turns_u : float or nested tuple
        Reversals of direction of `u` in the tail.
    tail : float
        Length of the tail [s].
    stopped_at : float or None
        Time at which the loop's `stop` ended the run before its duration was over [s]; the tail is still that of the duration.
    diverged_at : float or None
        Time at which a state or signal was not finite, or a state or output left the limits that its metadata declare [s].
    steps : int
        Steps done.
    tau : float
        Sampling step [s].
    loop : ClosedLoop
    """

    metrics = metrics
    doubts = doubts

    def _repr_html_(self):
        return self.metrics()._repr_html_()


def _result(loop, writer, rec, S, before, k, k_tail, dt, m, stopped, diverged):
    """The `Run` of what the loop left in its arrays."""
    columns = dict(zip(writer.columns, rec.T, strict=True))
    now = dict(zip(writer.state, S.tolist(), strict=True))

    def signal(name, values, prefix=""):
        s = writer.shapes[name]
        names = iter([prefix + _local(name, q) for q in leaves(s)])
        return nested(s, names, values)

    def nested(s, names, values):
        return values(next(names)) if s is None else tuple(nested(v, names, values) for v in s)

    run = Run()
    run.loop, run.steps, run.tau, run.t = loop, k, m*dt, columns["t"]
    run.stopped_at, run.diverged_at = k*dt if stopped else None, k*dt if diverged else None
    for n in SIGNALS[1:]:
        setattr(run, n, signal(n, columns.get))
    for b in ("low", "high"):
        setattr(run, b, types.SimpleNamespace(**{n: signal(n, columns.get, f"{b}_") for n in ("sigma", "u")}))
    arrays = iter(columns[q] for q in (*writer.x, *writer.z))
    run.x = _named(loop.stages["plant"].states, arrays)
    run.z = types.SimpleNamespace(**{s: _named(loop.stages[s].states, arrays) for s in GIVES if loop.stages[s]})
    for n in ("e", "u"):
        setattr(run, f"mean_{n}", signal(n, lambda q: now[q]/max(k, 1), "sum_"))
    ended_before = k < k_tail + diverged
    tails = {n: signal(n, now.get if not ended_before else lambda q: math.nan, "max_") for n in ("e", "sigma", "u")}
    run.tail_peaks = types.SimpleNamespace(**tails)
    for n in tails:
        setattr(run, f"max_{n}", signal(n, lambda q: max(now[q], before[q]), "max_"))
    run.tail_e, run.tail_sigma, run.tail_u = channel_figures(run, *tails.values())
    run.mean_v = run.integral_v = None
    if loop.stages["law"]:
        run.mean_v = signal("v", lambda q: now[q]/max(k//m + 1, 1), "sum_")
        run.integral_v = signal("v", columns.get, "integral_")
    run.xi = perturbation(run, m*dt)
    run.tail = max(k - k_tail, 0)*dt
    run.variation_u = signal("u", now.get, "variation_")
    for n in ("variation", "turns"):
        setattr(run, f"tail_{n}_u", signal("u", lambda q: now[q] - before[q], f"{n}_"))
    return run


def timed(owner, loop, duration, dt, tau):
    """Duration or None, dt and tau [s]: those given, else the loop's own."""
    given(owner, "loop", loop, ClosedLoop, "a ClosedLoop, such as lv.loop() makes")
    duration, dt, tau = (getattr(loop, n) if v is None else positive(owner, n, v)
                         for n, v in dict(duration=duration, dt=dt, tau=tau).items())
    if dt is None:
        raise ParameterError(f"{owner}: dt [s] is not given, and the loop has none of its own")
    return duration, dt, dt if tau is None else tau


def simulate(loop, duration=None, dt=None, tau=None, *, method="euler", record=2000, tail=0.2, jit=True, progress=None):
    """Run a closed loop: the controller acts every `tau`, the plant is integrated with `dt`.

    Parameters
    ----------
    loop : ClosedLoop
    duration, dt, tau : float
        Simulated time (to the nearest step), integration step, sampling step (a multiple of `dt`; default `dt`) [s];
        what the loop itself says, where not given.
    method : str
        ``"euler"``, ``"midpoint"`` or ``"rk4"``.
    record : int
        About how many rows are kept, at least 1; sums, maxima and variations use every step all the same.
    tail : float
        Fraction of the run, at its end, over which the tail figures are taken.
    jit : bool
        False runs the same loop as plain Python: slow, for breakpoints in blocks.
    progress : callable, optional
        Called with the fraction done (0 to 1) at least every 50 ms of machine time or so; what it raises ends the run.

    Returns
    -------
    Run
        Its valid part, with `Run.diverged_at` set, if it diverged.

    Raises
    ------
    ParameterError
        Something other than a `ClosedLoop`; a time, method, switch or number of rows that is not
        allowed.
    BlockError
        A block that does not fit its stage, fails at t = 0 or cannot be compiled.

    Notes
    -----
    Ctrl-C acts between two chunks of steps, about every 20 ms. The result does not depend on the chunks.
    """
    duration, dt, tau = timed("simulate", loop, duration, dt, tau)
    if duration is None:
        raise ParameterError("simulate: duration [s] is not given, and the loop has none of its "
                             "own")
    jit, progress = switch("simulate", "jit", jit), function("simulate", "progress", progress)
    if not max(tau, duration)/dt < 1e15:
        raise ParameterError(f"simulate: dt = {dt:g} s is not allowed; {max(tau, duration):g} s must take less than 1e15 steps")
    m, n = round(tau/dt), round(duration/dt)
    if m < 1 or abs(m*dt - tau) > 1e-9*tau:
        raise ParameterError(f"simulate: tau = {tau:g} s is not allowed; it must be a multiple of dt = {dt:g} s")
    if duration < tau*(1 - 1e-9):
        raise ParameterError(f"simulate: duration = {duration:g} s is not allowed; it must be at least tau = {tau:g} s")
    for name, (meta, value, _) in loop.settable().items():
        count = value/tau if meta.samples else 1.0
        if not 0.5 < count < 1e15 or abs(count - round(count)) >= 1e-9*count:
            raise ParameterError(f"simulate: {name} = {value:g} s is not allowed; it must be a multiple of tau = {tau:g} s")
    chosen("simulate", "method", method, METHODS)
    record = Param(low=1).check("simulate", "record", record, int)
    tail = Param(low=0.0, high=1.0).check("simulate", "tail", tail)
    if min(record, n) > ROWS:
        raise refused("simulate", "record", record, f"at most {ROWS:g}, as there are {n:g} steps")

    if jit:
        from numba import config

        jit = not config.DISABLE_JIT
    with _lock:
        f, writer = _made_loop(loop, method, m*dt, jit)
    P = np.array([v for p in loop.p.values() for v in p], float)
    x, z = loop.start()
    start = {**x, **z}
    S = np.array([start.get(q, {"low": math.inf, "high": -math.inf}.get(q.partition("_")[0], 0.0)) for q in writer.state])
    every, k_tail = -(-n//record), n - round(n*tail)
    rec = np.empty((-(-n//every) + 1, len(writer.columns)))
    peaks = [i for i, q in enumerate(writer.state) if q.startswith("max_")]
    before = dict.fromkeys(writer.state, 0.0)
    k = sample = row = line = 0
    chunk, diverged, planned = 1000 if jit else 20, False, n
    while k <= n and not diverged:
        stop = min(k + chunk, k_tail if k < k_tail else n + 1)
        began, at = time.perf_counter(), k
        k, sample, row, line, n, diverged = f(S, P, rec, dt, m*dt, m, every, n, k, stop, sample, row, line)
        if k == k_tail and at < k:
            before = dict(zip(writer.state, S.tolist(), strict=True))
            S[peaks] = 0.0
        chunk = max(1, int((k - at)*min(8.0, CHUNK/max(time.perf_counter() - began, 1e-6))))
        if progress:
            progress(min(k/n, 1.0) if n else 1.0)
    return _result(loop, writer, rec[:line], S, before, min(k, n), k_tail, dt, m, n < planned, diverged)
