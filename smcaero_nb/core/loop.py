"""The closed loop: blocks in their stages."""

import itertools
from collections.abc import Callable, Iterator
from typing import Any

from .block import Block, BlockError, Channels, routed, wanted
from .expressions import spread
from .param import Param, ParameterError, function, positive, texted, unknown
from .program import parts, paths
from .signal import flat, leaves, shape
from .stages import SAMPLED, STAGES

__all__ = ["ClosedLoop"]

OWN = ("duration", "dt", "tau", "latency", "name", "verdict")


class ClosedLoop:
    """A plant under sampled control: what `simulate` runs.

    Parameters
    ----------
    plant : Block
        ``x' = plant(t, x, u, d)``, integrated with `dt`.
    reference, output, sensor, differentiator, surface : Block, Channels or None
    law, allocation, actuator, perturbation : Block, Channels or None
        The stages of the pipeline; a stage left out is the identity (reference and perturbation:
        zero) and costs nothing. Without `output`, y is the tuple of the plant's states, or, for a
        plant with one state, that number. A parameter that `output`, or a part of it, shares with
        the plant follows the plant. The output may ask for u and d as they act on the plant when y
        is measured: at a sample, u is still that of the previous sample (zero before the first), so
        that no loop is algebraic; in the stages of the control, too, u is what has acted since the
        previous sample. The control sees the output of `sensor` in place of y, and r minus it in
        place of e. A `reference` or `perturbation` with memory is evaluated at every sample and
        held in between.
    stop : Block or None
        Distance to the end of the run, which ends at the first step at which ``stop(t, x)`` is no
        longer positive.
    probe : Block, Channels or None
        Signals derived for the record only, by the name of the block, or of each part of
        `channels`, each of which sees all signals.
    duration, dt, tau : float, optional
        Defaults of `simulate` [s].
    latency : float, optional
        Time from a sample until its control acts, a multiple of dt; until the first one does, zero
        acts [s].
    name : str
        Shown in titles.
    verdict : callable, optional
        ``verdict(run)`` judges a run: it returns an object whose text is the verdict, true if all
        went well. Masks show it.

    Raises
    ------
    BlockError
        A stage is not a block, or the law is a block that is a surface or something else by its
        card.
    ParameterError
        An unknown stage, or a time, name or verdict that is not allowed.

    Notes
    -----
    The table of what a block may ask for in each stage is in `smcaero_nb.core.stages`, and in the
    README.
    """

    duration: float | None
    dt: float | None
    tau: float | None

    def __init__(self, plant: Block, *, duration: float | None = None, dt: float | None = None,
                 tau: float | None = None, latency: float | None = None, name: str = "",
                 verdict: Callable | None = None, **stages: "Block | Channels | None"):
        for n, v in dict(duration=duration, dt=dt, tau=tau).items():
            setattr(self, n, v if v is None else positive("ClosedLoop", n, v))
        late = 0.0 if latency is None else latency
        self.latency = Param(unit="s", low=0.0).check("ClosedLoop", "latency", late)
        self.name = texted("ClosedLoop", "name", name)
        self.verdict = function("ClosedLoop", "verdict", verdict)
        self.stages: dict[str, Any] = routed("ClosedLoop", dict.fromkeys(STAGES),
                                             {"plant": plant, **stages})
        for stage, b in self.stages.items():
            wanted(stage, b, *((Block,) if stage == "plant" else (Block, Channels, type(None))))
            _belongs(stage, b)
            kinds = b.kinds if b else {}
            if texts := [n for n, k in kinds.items() if k not in (float, int, bool)]:
                raise BlockError(f"{stage} '{b.name}': {texts[0]} is a choice of texts; "
                                 "a stage has numbers and switches only")

    def with_(self, **changes: Any) -> "ClosedLoop":
        """Return a copy with changes.

        ``law=other_block`` replaces a stage, ``law__lam=2.0`` sets a parameter in it,
        ``plant__theta=0.1`` an initial state, ``law__attitude__lam=2.0`` reaches into channels;
        `duration`, `dt`, `tau`, `latency`, `name`, `verdict` as in `ClosedLoop`.

        Raises
        ------
        ParameterError
            An unknown stage or name, or a value that its metadata does not allow.
        BlockError
            A stage is not a block.
        """
        own = {k: changes.pop(k, getattr(self, k)) for k in OWN}
        for name in changes:
            if (stage := name.partition("__")[0]) not in STAGES:
                raise unknown("ClosedLoop", stage, (*STAGES, *OWN), self.settable())
        new = ClosedLoop(**routed("ClosedLoop", self.stages, changes), **own)
        if tied := [q for n, q in new._tied.items() if n in changes]:
            raise ParameterError(f"ClosedLoop: {tied[0]} of the output follows the plant; "
                                 f"set plant__{tied[0]}")
        return new

    def settable(self) -> dict[str, tuple[Param, Any, Any]]:
        """Return {name: (Param, value, kind)} of all that `with_` sets in the stages."""
        tied, found = self._tied, {}
        for stage, b in self.stages.items():
            if b is None:
                continue
            values, kinds = b.values, b.kinds
            found |= {f"{stage}__{n}": (meta, values[n], kinds.get(n, float))
                      for n, meta in b.settable.items() if f"{stage}__{n}" not in tied}
        return found

    @property
    def _tied(self) -> dict[str, str]:
        """The parameters of the output that follow the plant: {name in the loop: the plant's}."""
        return {f"{path}__{n}": n for path, b in paths("output", self.stages["output"])
                for n in b.params if n in self.stages["plant"].params}

    @property
    def p(self) -> dict[str, tuple]:
        """The parameters, stage by stage; one that output and plant share has the plant's value."""
        plant, b = self.stages["plant"], dict(self.stages)
        if tied := {n.removeprefix("output__"): plant.values[q] for n, q in self._tied.items()}:
            b["output"] = b["output"].with_(**tied)
        return {s: v.p for s, v in b.items() if v}

    def numbers(self) -> list[float]:
        """Return the values of all parameters, entry by entry, and of the sizes of buffers."""
        blocks = (b for s, q in STAGES.items() if q.memory for b in parts(self.stages[s]))
        made = []
        for v in itertools.chain(*self.p.values()):
            made += flat(v) if isinstance(v, tuple) else (v,)
        return made + [b.values[n] for b in blocks for n in b.buffers]

    def parameters(self) -> dict[str, tuple[str, float, type]]:
        """Return {variable: (full name, value, kind)} of what `numbers` has the values of."""
        made = {}
        for s, values in self.p.items():
            own = [(f"{path}__{n}", b.kinds[n]) for path, b in paths(s, self.stages[s])
                   for n in b.params]
            for i, (v, (name, kind)) in enumerate(zip(values, own, strict=True)):
                entries = zip(spread(f"p_{s}_{i}", v).items(), leaves(shape(v)), strict=True)
                made |= {q: (name + at, number, kind) for (q, number), at in entries}
        for variable, name, b, n in self._states():
            if n in b.buffers:
                made[f"n_{variable}"] = name, b.values[n], int
        return made

    def _states(self) -> Iterator[tuple[str, str, Block, str]]:
        """(variable, full name, block, name) of each state of the blocks with memory."""
        for s, q in STAGES.items():
            if q.memory and s != "plant":
                own = ((path, b, n) for path, b in paths(s, self.stages[s]) for n in b.states)
                yield from ((f"z_{s}_{i}", f"{path}__{n}", b, n)
                            for i, (path, b, n) in enumerate(own))

    def start(self) -> tuple[dict[str, float], dict[str, float]]:
        """Return the initial {variable: value} of the plant and of the blocks with memory."""
        x, z = {}, {}
        for i, v in enumerate(self.stages["plant"].z0):
            x |= spread(f"x_{i}", v)
        for variable, _, b, n in self._states():
            z |= {} if n in b.buffers else spread(variable, b.values[n])
        return x, z

    def metadata(self, signal: str) -> Any:
        """Return the metadata of a signal: a `Param`, a nested tuple of them, or None."""
        control = "allocation" if self.stages["allocation"] else "law"
        by = dict(r=["output"], y=["output"], y_m=["sensor", "output"], e=["output"],
                  e_m=["output"], e_hat=["output"], sigma=["surface"], v=["law"],
                  u=["actuator", control], d=["perturbation"], probe=["probe"])[signal]
        blocks = (self.stages[s] for s in by)
        return next((b.output for b in blocks if b and b.output), None)

    def blocks(self) -> list[Block]:
        """Return all blocks, those of channels one by one."""
        return [q for b in self.stages.values() for q in parts(b)]

    def __eq__(self, other: object) -> bool:
        return vars(self) == vars(other) if isinstance(other, ClosedLoop) else NotImplemented

    def __hash__(self) -> int:
        return hash((self.name, *self.stages.values()))

    def __repr__(self) -> str:
        blocks = [f"  {s:<15}{b!r}" for s, b in self.stages.items() if b]
        late = f", latency {self.latency:g} s"*(self.latency > 0.0)
        return "\n".join([f"ClosedLoop {self.name}".rstrip() + late, *blocks])


def _belongs(stage: str, b: Any) -> None:
    """Raise `BlockError` for a law that by its card is another stage of the control."""
    for q in parts(b) if stage == "law" else ():
        at = q.card.stage if q.card else None
        if at in SAMPLED and at != stage:
            raise BlockError(f"law '{q.name}' is a block for the stage {at}, as its card says; "
                             f"give it as {at}={q.name}, and a law beside it")
