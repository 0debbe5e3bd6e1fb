"""The closed loop: blocks in their stages."""

from collections.abc import Callable
from typing import Any

from .block import Block, BlockError, Channels, routed, wanted
from .param import Param, ParameterError, function, positive, texted
from .program import parts
from .stages import STAGES

__all__ = ["ClosedLoop"]

OWN = ("duration", "dt", "tau", "latency", "name", "verdict")


class ClosedLoop:
    """A plant under sampled control: what `simulate` runs.

    Parameters
    ----------
    plant : Block
        ``x' = plant(t, x, u, d)``, integrated with `dt`.
    reference, output, sensor, differentiator, surface, law, allocation, actuator, perturbation : Block
        Or Channels, or None. The stages of the pipeline; one left out is the identity (reference and perturbation: zero),
        free of cost. Without `output`, y is the tuple of the plant's states, or, of a plant with
        one state, that number. A parameter of `output` that the plant has too follows the plant. It
        may ask for u and d as they act on the plant when y is measured: at a sample, u is still
        that of the sample before (zero before the first), so that no loop is algebraic; so it is
        for the stages of the control, to which u is what acted since the sample before. The control
        sees what `sensor` gives in place of y, and r less that in place of e. A `reference` or
        `perturbation` with memory is evaluated at every sample and held in between.
    stop : Block or None
        What is left until the run ends: it ends at the first step at which ``stop(t, x)`` is no
        longer positive.
    probe : Block, Channels or None
        Signals derived for the record only, by the name of the block, or of each part of
        `channels`, each of which sees all signals.
    duration, dt, tau : float, optional
        What `simulate` uses unless told otherwise [s].
    latency : float, optional
        Time from a sample until the control that it gives acts, a multiple of dt; zero acts until
        the first does [s].
    name : str
        For titles.
    verdict : callable, optional
        ``verdict(run)`` says what became of a run: an object with its words as text, true if all
        went well. Masks show it.

    Raises
    ------
    BlockError
        A stage is not a block.
    ParameterError
        An unknown stage, or a time, name or verdict that is not allowed.

    Notes
    -----
    `smcaero_nb.core.stages` has the table of what a block may ask for in each stage; so
    has the README.
    """

    def __init__(self, plant: Block, *, duration: float | None = None, dt: float | None = None, tau: float | None = None,
                 latency: float | None = None, name: str = "", verdict: Callable | None = None,
                 **stages: "Block | Channels | None"):
        for n, v in dict(duration=duration, dt=dt, tau=tau).items():
            setattr(self, n, v if v is None else positive("ClosedLoop", n, v))
        self.latency = Param(unit="s", low=0.0).check("ClosedLoop", "latency", 0.0 if latency is None else latency)
        self.name = texted("ClosedLoop", "name", name)
        self.verdict = function("ClosedLoop", "verdict", verdict)
        self.stages: dict[str, Any] = routed("ClosedLoop", dict.fromkeys(STAGES), {"plant": plant, **stages})
        for stage, b in self.stages.items():
            wanted(stage, b, *((Block,) if stage == "plant" else (Block, Channels, type(None))))
            if texts := [n for n, k in (b.kinds if b else {}).items() if k not in (float, int, bool)]:
                raise BlockError(f"{stage} '{b.name}': {texts[0]} is a choice of texts; a stage has numbers and switches only")

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
        for name in getattr(changes.get("plant", self.stages["plant"]), "params", ()):
            if f"output__{name}" in changes:
                raise ParameterError(f"ClosedLoop: {name} of the output follows the plant; set plant__{name}")
        return ClosedLoop(**routed("ClosedLoop", self.stages, changes), **own)

    def settable(self) -> dict[str, tuple[Param, Any, Any]]:
        """Return {name: (Param, value, kind)} of all that `with_` accepts in the stages: what a mask shows."""
        tied = self.stages["plant"].params
        return {f"{s}__{n}": (m, values[n], kinds.get(n, float)) for s, b in self.stages.items() if b
                for values, kinds in [(b.values, b.kinds)] for n, m in b.settable.items() if not (s == "output" and n in tied)}

    @property
    def p(self) -> dict[str, tuple]:
        """The parameters, stage by stage; the output takes the plant's value of any name they share."""
        plant, b = self.stages["plant"], dict(self.stages)
        if b["output"]:
            b["output"] = b["output"].with_(**{n: plant.values[n] for n in b["output"].params if n in plant.params})
        return {s: v.p for s, v in b.items() if v}

    def start(self) -> tuple[dict[str, float], dict[str, float]]:
        """Return the initial states {variable: value} of the plant and of the blocks with memory."""
        z = {f"z_{s}_{i}": v for s, q in STAGES.items() if q.memory and s != "plant" and self.stages[s]
             for i, v in enumerate(self.stages[s].z0)}
        return {f"x_{i}": v for i, v in enumerate(self.stages["plant"].z0)}, z

    def metadata(self, signal: str) -> Any:
        """Return the metadata of a signal: a `Param`, a (nested) tuple of them, or None where no block declares any."""
        by = dict(r=("output",), y=("output",), y_m=("sensor", "output"), e=("output",), e_m=("output",), e_hat=("output",),
                  sigma=("surface",), v=("law",), d=("perturbation",), probe=("probe",),
                  u=("actuator", "allocation") if self.stages["allocation"] else ("actuator", "law"))[signal]
        return next((self.stages[s].output for s in by if self.stages[s] and self.stages[s].output), None)

    def blocks(self) -> list[Block]:
        """Return all blocks, those of channels one by one."""
        return [q for b in self.stages.values() for q in parts(b)]

    def __eq__(self, other: object) -> bool:
        return vars(self) == vars(other) if isinstance(other, ClosedLoop) else NotImplemented

    def __hash__(self) -> int:
        return hash((self.name, *self.stages.values()))

    def __repr__(self) -> str:
        return "\n".join([f"ClosedLoop {self.name}".rstrip(), *(f"  {s:<15}{b!r}" for s, b in self.stages.items() if b)])
