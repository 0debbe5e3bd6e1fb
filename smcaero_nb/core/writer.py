"""Writes the program of a loop, trying each line at t = 0 to find the shapes of the signals."""

from typing import Any

from .block import Block, BlockError, Channels
from .chain import Chain
from .checks import check, kind, place, way_out
from .content import draws
from .expressions import error, limits, local, nested, zero
from .leaves import leaves_of
from .param import listed, said
from .program import LIMIT, METERS, METHODS, Program, first, line, parts
from .signal import leaves, shape, text, tuples
from .stages import OWN, SAMPLED, SIGNALS, STAGES, salt

__all__ = ["asking", "inputs", "written"]

INPUTS = 8  # maximum number of inputs that a plant is tried with
ESTIMATED = ("surface", "law", "allocation")  # to them e is the output of the differentiator


def asking(stages: dict[str, Any]) -> list[str]:
    """Return the stages with a block that asks for u before the control gives it."""
    return [s for s in ("output", "differentiator", "surface", "law", "allocation")
            if any("u" in b.signals for b in parts(stages[s]))]


def inputs(plant: Block) -> tuple[Any, Any]:
    """Return a zero input and a zero perturbation of the smallest shapes that a plant takes."""
    why: Exception | None = None
    for m in range(1, INPUTS + 1):
        for d in (0.0, (0.0,)*m):
            given = {"t": 0.0, "x": plant.z0, "u": (0.0,)*m if m > 1 else 0.0, "d": d}
            try:
                plant.f(*(given[n] for n in plant.signals), *plant.p)
                return given["u"], d
            except Exception as reason:
                why = reason
    raise BlockError(f"plant '{plant.name}' could not be evaluated at its initial state with any "
                     f"number of inputs from 1 to {INPUTS}; with {INPUTS}: "
                     f"{type(why).__name__}: {why}") from why


class _Writer:
    """Writes the program of a loop, trying each line to find the shapes of the signals."""

    def __init__(self, loop: Any, method: str, tau: float, m: int, lag: int):
        self.loop, self.stages, self.m, self.lag = loop, loop.stages, m, lag
        self.places, self.shapes, self.trial = {}, {}, []
        self.params = {q: v for q, (_, v, _) in loop.parameters().items()}
        x, z = loop.start()
        self.x, self.z, self.rings = tuple(x), tuple(z), []
        self.exact: list[str] = []  # entries of the matrices of an exact step
        self.between = {}  # what the next block of a chain sees in place of a signal
        self.shown = {}  # its name in messages
        self.shapes["x"] = shape(self.stages["plant"].z0)
        self.start = {**x, **z}
        self.values = {"t": 0.0, "tau": tau, "dt": 0.0, "k": 0, "m": m, "R": [], "float": float,
                       **self.params, **self.start}
        self.held_world = [s for s in ("reference", "perturbation")
                           if any(b.states for b in parts(self.stages[s]))]
        self.command = "c" if lag else "u"  # the output of the control; u is what acts
        self.segments = self.write_all(method)

    # ---- segments --------------------------------------------------------------------------
    def write_all(self, method):
        """The lines of all segments."""
        stages = self.stages
        asked = asking(stages)
        if asked or self.lag:  # the fewest zeros that the plant takes, until u is given
            self.written(self.assign, "u", repr(inputs(stages["plant"])[0]))
        taken = self.shapes.get("u")
        early = any("d" in b.signals for b in parts(stages["output"]))
        made = {"command": self.written(self.hold), "measure": self.written(self.measure, early),
                "control": self.written(self.control)}
        if self.lag:
            made["act"] = self.written(self.act)
        held = early or "perturbation" in self.held_world
        made["disturb"] = [] if held else self.written(self.stage, "perturbation", "d")
        made["advance"] = (self.written(self.advance_exactly) if method == "exact" else
                           self.written(self.advance, METHODS[method]))
        if (asked or self.lag) and self.shapes["u"] != taken:
            who = asked[0] if asked else "latency"
            count = len(taken) if taken else "one number"
            raise BlockError(f"the {who} asks for u, of which the plant takes {count}, but the "
                             f"loop gives it u = {said(self.values_of('u'))}")
        for s in ("stop", "probe"):
            made[s] = self.written(self.stage, s, STAGES[s].gives) if stages[s] else []
        return made

    def count(self):
        """The number of the sample, if a block or a ring asks for it."""
        blocks = [b for q in self.stages.values() for b in parts(q)]
        if self.lag or any("k" in b.signals or b.buffers for b in blocks):
            self.write("count = k//m")

    def hold(self):
        """Reference and perturbation with memory, evaluated at samples."""
        if self.held_world:
            self.count()
        for s in self.held_world:
            self.stage(s, STAGES[s].gives)

    def measure(self, early):
        """Reference, output and error; before them the perturbation, if the output asks for it."""
        if early and "perturbation" not in self.held_world:
            self.stage("perturbation", "d")
        if self.stages["output"] or self.shapes["x"] != (None,):
            self.stage("output", "y", "x")
        else:
            self.assign("y", "x_0")
        if not self.stages["reference"]:
            self.assign("r", zero(self.shapes["y"]))
        elif "reference" not in self.held_world:
            self.stage("reference", "r")
        self.miss("e", "y")

    def miss(self, gives, of):
        """The difference of reference and output, or of reference and measurement."""
        try:
            self.assign(gives, error(self.shapes["r"], self.shapes[of], name=of))
        except (BlockError, TypeError, IndexError) as why:
            if of == "y_m":
                raise BlockError(
                    f"sensor '{self.stages['sensor'].name}' gives y_m = "
                    f"{said(self.values_of(of))} ({kind(self.values_of(of))}), which does not fit "
                    f"r = {said(self.values_of('r'))} ({kind(self.values_of('r'))}) in e = r - "
                    f"y_m, as y = {said(self.values_of('y'))} does; let it give as many numbers "
                    "as y has, or the reference fewer") from None
            told = f": {why}" if isinstance(why, BlockError) and "fails at" not in str(why) else ""
            raise BlockError(f"reference and output do not fit: e = r - {of} with "
                             f"r = {said(self.values_of('r'))}, "
                             f"{of} = {said(self.values_of(of))}{told}") from None

    def control(self):
        """The sampled stages."""
        self.count()
        for s in SAMPLED:
            gives, passes = STAGES[s].gives, STAGES[s].passes
            if s == "sensor":
                if self.stages[s]:
                    self.stage(s, gives)
                    self.miss("e_m", gives)
                continue
            passes = {"e": "e_m"}.get(passes, passes) if self.stages["sensor"] else passes
            names = {"u": self.command}
            self.stage(s, names.get(gives, gives), names.get(passes, passes))
        if self.lag:
            self.ring(write=True)

    def ring(self, write):
        """Lines that put the control into its ring, or take u out of it."""
        names = [local("c", q) for q in leaves(self.shapes["c"])]
        size = -(-self.lag//self.m) + 1
        if write:
            self.late = self.ringed(str(size*len(names)), 0.0)
        else:
            self.shapes["u"] = self.shapes["c"]
        at = f"count%{size}*{len(names)}" if write else f"(k - {self.lag})//m%{size}*{len(names)}"
        for i, q in enumerate(names):
            where = f"R[{self.late} + {at} + {i}]"
            self.write(f"{where} = {q}" if write else f"u{q[1:]} = {where}")

    def ringed(self, size, start):
        """Add a ring to R; return the variable that says where it begins."""
        source = first(self.rings)
        exec(source, self.values)
        self.trial.append(source)
        self.rings.append((size, start))
        self.values["R"] += [start]*eval(size, self.values)
        return source.partition(" ")[0]

    def act(self):
        """The control that is due now."""
        self.ring(write=False)

    def advance(self, nodes):
        """One Runge-Kutta step of the plant; u is held, a perturbation without memory is not."""
        entries = leaves(self.shapes["x"])
        for j, (c, _) in enumerate(nodes):
            alias = {}
            if j:
                alias = {"t": "t_node", "x": "h"}
                self.write(f"t_node = t + {c!r}*dt")
                for q in entries:
                    x, h = local("x", q), local("h", q)
                    self.write(f"{h} = {x} + {c!r}*dt*rate_{j - 1}{q}")
                if "perturbation" not in self.held_world:
                    self.stage("perturbation", "d", alias=alias)
            self.write(f"rate_{j} = {self.call('plant', alias)}")
        for q in entries:
            terms = [f"{w!r}*rate_{j}{q}" if w != 1.0 else f"rate_{j}{q}"
                     for j, (_, w) in enumerate(nodes) if w]
            rate = f"({' + '.join(terms)})" if len(terms) > 1 else terms[0]
            x = local("x", q)
            self.write(f"{x} = {x} + dt*{rate}")

    def advance_exactly(self):
        """One exact step of a linear plant: x + F dx/dt, F the integral of exp(A s) over the step.

        A perturbation without memory that moves is taken at the middle of the step.
        """
        n = range(len(self.x))

        def moved(name, matrix, j):
            made = [[f"{matrix}_{i}_{k}" for k in n] for i in n]
            self.exact += [q for row in made for q in row]
            self.values.update(dict.fromkeys(self.exact, 0.0))
            for i, row in zip(n, made, strict=True):
                terms = " + ".join(f"{q}*rate_{j}[{k}]" for k, q in enumerate(row))
                self.write(f"{name}_{i} = x_{i} + ({terms})")

        self.write(f"rate_0 = {self.call('plant', {})}")
        blocks = parts(self.stages["perturbation"])
        moves = "perturbation" not in self.held_world and any(b.signals for b in blocks)
        if moves:
            self.write("t_node = t + 0.5*dt")
            moved("h", "half", 0)
            self.stage("perturbation", "d", alias={"t": "t_node", "x": "h"})
            self.write(f"rate_1 = {self.call('plant', {})}")
        moved("x", "whole", int(moves))

    # ---- lines -----------------------------------------------------------------------------
    def written(self, write, *args):
        """The lines that a method writes."""
        self.lines = []
        write(*args)
        return self.lines

    def write(self, source, where="", given=()):
        """Append a line and try it; an error names the block, its line and its arguments.

        `given` has (name, name of the signal, text) of each argument.
        """
        try:
            exec(source, self.values)
        except Exception as why:
            values = {n: eval(q, self.values) for n, s, q in given if s in self.shapes}
            names = {n: n if s == n else f"{n} = {self.shown.get(s, s)}" for n, s, _ in given}
            told = ", ".join(f"{names[n]} = {said(v)} ({kind(v)})" for n, v in values.items())
            told = f" It was given {told}" if told else ""
            raise BlockError(f"{where} fails at t = 0{place(why)}: {type(why).__name__}: {why}."
                             + told + way_out(why, values)) from why
        self.lines.append(source)
        self.trial.append(source)

    def values_of(self, name):
        """Value of a signal in the trial."""
        return eval(self.text(name), self.values)

    def text(self, name, channel=None, alias=None):
        """Text of a signal, or of one channel of it."""
        s = self.shapes[name] if channel is None else self.shapes[name][channel]
        path = "" if channel is None else f"[{channel}]"
        return text(s, (local(alias or name, path + q) for q in leaves(s)))

    def assign(self, name, source):
        """Set the leaves of a signal from the text of an expression."""
        self.write(f"out = {source}")
        self.shapes[name] = shape(tuples(self.values["out"]))
        for q in leaves(self.shapes[name]):
            self.write(f"{local(name, q)} = float(out{q})")

    def stage(self, stage, gives, passes="", alias=None):
        """One stage: `gives` = block(...); without a block the signal `passes`, or zero."""
        if self.stages[stage]:
            self.assign(gives, self.call(stage, alias or {}))
        elif gives != passes:
            self.assign(gives, self.passed(passes, gives) if passes else "0.0")

    def passed(self, passes, gives):
        """The text of a signal that passes a stage; as sigma, a channel of one number is one."""
        channels = self.shapes[passes] or ()
        if gives != "sigma" or (None,) not in channels:
            return self.text(passes)
        return "(" + "".join(f"{self.text(passes, i)}{'[0]'*(v == (None,))}, "
                             for i, v in enumerate(channels)) + ")"

    # ---- blocks ----------------------------------------------------------------------------
    def call(self, stage, alias):
        """Call the blocks of a stage; return the text of its output."""
        self.numbers = {"part": 0, "p": 0, "z": 0}
        return self.called(stage, self.stages[stage], stage, None, alias)

    def called(self, stage, b, path, channel, alias):
        """Call a block, or channels of blocks; return the text of the output."""
        if not isinstance(b, Channels):
            return self.block(stage, b, path, channel, alias)
        if isinstance(b, Chain):
            return self.chained(stage, b, path, alias)
        channel = [None if stage == "probe" else i for i in range(len(b.parts))]
        results = [self.called(stage, part, f"{path}__{name}", i, alias)
                   for i, (name, part) in zip(channel, b.parts.items(), strict=True)]
        return "(" + "".join(f"{q}, " for q in results) + ")"

    def chained(self, stage, b, path, alias):
        """Call blocks in series; return the text of the output of the last one."""
        passes = STAGES[stage].passes.removesuffix("_hat")
        if not passes or stage == "law":
            raise BlockError(f"{stage} cannot be a chain; " + (
                "a block that follows the law belongs in allocation or actuator" if passes
                else "write one block that calls the others"))
        *first, (end, last) = b.parts.items()
        for name, part in first:
            between = f"{stage}_{self.numbers['part']}"
            self.assign(between, self.block(stage, part, f"{path}__{name}", None, alias))
            self.between[passes], self.shown[between] = between, f"{path}__{name}"
        result = self.block(stage, last, f"{path}__{end}", None, alias)
        self.between.clear()
        return result

    def seen(self, stage: str, signal: str) -> str:
        """The name under which a stage finds a signal: the control sees the sensor's output."""
        if signal in self.between:
            return self.between[signal]
        if stage in SAMPLED and self.stages["sensor"] and stage != "sensor":
            signal = {"y": "y_m", "e": "e_m"}.get(signal, signal)
        if signal in ("e", "e_m") and self.stages["differentiator"] and stage in ESTIMATED:
            return "e_hat"
        return self.command if signal == "u" and stage == "actuator" else signal

    def block(self, stage, b, path, channel, alias):
        """Call one block; return the text of its output."""
        where, numbers = f"{stage} '{b.name}'", self.numbers
        mark = f"_{numbers['part']}"*hasattr(self.stages[stage], "parts")
        name = f"f_{stage}{mark}"  # not the block's: loops that differ in names share a program
        states = self.memory(stage, b, where)
        asked = [self.seen(stage, n) for n in b.signals]
        memory = "".join(f"{nested(q, s)}, " for q, s, _ in states)
        own = {"z": f"({memory})", "tau": "tau",
               "t": alias.get("t", "t"), "k": "count", "salt": str(salt(path))}
        try:
            args = [own.get(n) or self.text(n, channel if n != "x" else None, alias.get(n))
                    for n in asked]
        except (TypeError, IndexError):
            told = (f"{n} = {said(self.values_of(n))}" for n in asked if n in self.shapes)
            raise BlockError(f"{where}: a signal it asks for has no channel {channel}: "
                             + ", ".join(told)) from None
        given = [*zip(b.signals, asked, args, strict=True)]
        args += [nested(f"p_{stage}_{numbers['p'] + j}", shape(b.values[n]))
                 for j, n in enumerate(b.params)]
        if name not in self.places and (source := draws(b.f)):
            raise BlockError(f"{where} draws random numbers with {source}, so its runs differ; "
                             "draw them once (noise = "
                             "np.random.default_rng(1).standard_normal(1000)) and read noise[...] "
                             "in the block")
        self.places[name], self.values[name] = (stage, numbers["part"]), b.f
        result = f"out_{stage}{mark}"
        for q, _, at in states:
            if at:
                self.write(f"{q} = {at}")
        self.write(f"{result} = {name}({', '.join(args)})", where, given)
        shapes = {n: None if n in b.buffers else shape(b.values[n]) for n in b.states}
        check(where, self.values[result], shapes, stage)
        self.trial.append(f"check({stage!r}, {result}, {shapes!r}, {stage!r})")
        for j, (z, s, at) in enumerate(states):
            for q in leaves(s):
                self.write(f"{at or local(z, q)} = float({result}[1][{j}]{q})")
        numbers["part"], numbers["p"] = numbers["part"] + 1, numbers["p"] + len(b.params)
        numbers["z"] += len(b.states)
        return f"{result}[0]" if states else result

    def memory(self, stage, b, where):
        """Variable, shape and, of a buffer, place in R of a block's states.

        It may ask only for what its stage offers.
        """
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
        if b.buffers and not memory:
            raise BlockError(f"{where}: the state {listed(b.buffers)} is a Buffer, and a plant "
                             "integrates its states; remember samples in a stage that has memory")
        made = []
        for j, n in enumerate(b.states if memory else ()):
            z, at = f"z_{stage}_{self.numbers['z'] + j}", ""
            if n in b.buffers:
                at = f"R[{self.ringed(f'n_{z}', b.buffers[n])} + count%n_{z}]"
            made.append((z, shape(b.values[n]), at))
        return made


def written(loop: Any, method: str, tau: float, m: int, lag: int = 0) -> Program:
    """Write the program of a loop.

    Parameters
    ----------
    loop : ClosedLoop
    method : str
        Integration method, one of `program.methods`.
    tau : float
        Sampling step [s].
    m : int
        Integration steps in a sampling step.
    lag : int
        Integration steps until a control acts.

    Raises
    ------
    BlockError
        A block does not fit its stage or fails at t = 0.
    """
    w = _Writer(loop, method, tau, m, lag)
    names = {s: [local(s, q) for q in leaves(w.shapes[s])] for s in w.shapes}
    law = loop.stages["law"] is not None
    recorded = [s for s in SIGNALS[1:] if s in w.shapes]
    meters = [(meter, q) for meter in METERS for s in meter.of if s != "v" or law for q in names[s]]
    held = [q for s in SAMPLED if STAGES[s].gives in w.shapes for q in names[STAGES[s].gives]]
    held += [q for s in w.held_world for q in names[STAGES[s].gives]]
    held += [q for s in ("e_m",) if s in names for q in names[s]]
    watched = names["sigma"] + names["u"]
    state = dict.fromkeys([*w.x, *w.z, *held], 0.0)
    state |= {f"{meter.name}_{q}": meter.start for meter, q in meters}
    columns = ["t", *(q for s in recorded for q in names[s]), *w.x, *w.z,
               *(f"{b}_{q}" for q in watched for b in ("low", "high")),
               *(f"integral_{q}" for q in names["v"] if law), *names.get("probe", [])]
    bounds = limits("y", w.shapes["y"], loop.metadata("y"))
    bounds += [q for i, meta in enumerate(loop.stages["plant"].states.values())
               for path in leaves(w.shapes["x"][i])
               for q in limits(local(f"x_{i}", path), None, meta)]
    seen = [*(names["e_hat"] if loop.stages["differentiator"] else []), *names.get("y_m", [])]
    # a NaN in these ends the run unrecorded
    driven = dict.fromkeys([*seen, *names["sigma"], *names["v"], *names[w.command], *w.z])
    every = [*w.x, *names["e"], *names["d"]]
    params = loop.parameters()
    return Program(
        segments={n: tuple(map(line, q)) for n, q in w.segments.items()},
        places=w.places, params={q: name for q, (name, _, _) in params.items()},
        kinds={q: kind for q, (_, _, kind) in params.items()},
        x=w.x, z=w.z, held=tuple(dict.fromkeys(held)), shapes=w.shapes,
        heads={s: tuple(q.path for q in leaves_of(loop, w.shapes, s) if not q.derivative)
               for s in ("e", "sigma", "u")},
        meters=tuple(meters), state=state, columns=tuple(columns),
        inside=" and ".join([f"{' + '.join(f'abs({q})' for q in every)} <= {LIMIT!r}", *bounds]),
        driven=f"{' + '.join(f'abs({q})' for q in driven)} <= {LIMIT!r}",
        rings=tuple(w.rings), lag=lag, trial=tuple(w.trial), exact=tuple(w.exact))
