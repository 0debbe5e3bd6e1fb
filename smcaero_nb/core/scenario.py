"""Scenarios: a plant with its task, and the designs that are known for it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from .block import Block
from .loop import ClosedLoop
from .param import ParameterError, chosen, given, listed

__all__ = ["Scenario"]

Stages = Mapping[str, Any]


@dataclass(frozen=True)
class Scenario:
    """A plant with its task, and the designs that are known for it.

    Attributes
    ----------
    name : str
        The function that a user calls for it; messages begin with it.
    task : ClosedLoop
        The loop without a law: plant, output, command, perturbation, times. Its name, if it has
        one, replaces that of the preset in the titles of the loops.
    designs : dict
        ``{(law, preset): stages}``: what a design adds to the task, or replaces in it.
    around : dict
        ``{r: stages}``: what a law needs around it, by the relative degree that it is for; None is
        for laws of sigma alone. Where it is empty, designs are complete, and only they are known.
    sources : tuple of str
        Where plant, task and designs come from.
    """

    name: str
    task: ClosedLoop
    designs: Mapping[tuple[str, str], Stages]
    around: Mapping[int | None, Stages] = field(default_factory=dict)
    sources: tuple[str, ...] = ()

    @property
    def presets(self) -> dict[str, dict[str, Stages]]:
        """The designs by law: ``{law: {preset: stages}}``."""
        table: dict[str, dict[str, Stages]] = {}
        for (law, preset), stages in self.designs.items():
            table.setdefault(law, {})[preset] = stages
        return table

    def fit(self, law: Block) -> Stages:
        """Return the stages that a law needs around it; none where the designs are complete.

        Raises
        ------
        ParameterError
            A law for a relative degree that the scenario does not have.
        """
        if not self.around:
            return {}
        if law.r not in self.around:
            degrees = dict.fromkeys("1, on a sliding variable," if r in (None, 1) else str(r)
                                    for r in self.around)
            raise ParameterError(f"{self.name}: {law.name} is for relative degree {law.r or 1}; it "
                                 f"must be {' or '.join(degrees).rstrip(',')}")
        return self.around[law.r]

    def loop(self, law: str | Block, preset: str = "recommended") -> ClosedLoop:
        """Return the closed loop of a design, or of a law of your own with what it needs.

        Raises
        ------
        ParameterError
            An unknown law or preset, or a law for another relative degree.
        """
        presets = self.presets
        if self.around and not (isinstance(law, str) and law in presets):
            allowed = f"a law (a block), or one of {listed(presets)}"
            stages = dict(law=given(self.name, "law", law, Block, allowed))
        else:
            own = presets[chosen(self.name, "law", law, presets)]
            stages = own[chosen(f"{self.name} of {law}", "preset", preset, own)]
        stages = {**self.fit(stages["law"]), **stages}
        task = self.task.name
        title = law if isinstance(law, str) and not task else stages["law"].name
        return self.task.with_(name=f"{title}, {task or preset}", **stages)
