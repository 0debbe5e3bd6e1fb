"""The stages of a closed loop: a table of what each may ask for and what it gives."""

import zlib
from typing import NamedTuple

__all__ = ["SAMPLED", "STAGES", "Stage", "salt", "table"]


class Stage(NamedTuple):
    """A place in the loop for a block.

    Attributes
    ----------
    asks : tuple of str
        Signals that a block there may ask for.
    gives : str
        The signal that it gives.
    passes : str
        The signal that replaces it where there is no block; empty: zero, or nothing.
    when : str
        ``"dt"``: at every integration step; ``"tau"``: at every sample, and held in between;
        ``"row"``: at recorded rows.
    memory : bool
        Whether a block there may have states. It then asks for `z` and `tau`, and is evaluated at
        every sample.
    role : str
        ``"design"``: chosen by the designer; ``"world"``: given.
    """

    asks: tuple[str, ...]
    gives: str
    passes: str
    when: str
    memory: bool
    role: str


def _stage(asks: str, gives: str, passes: str, when: str, role: str, memory: bool = True) -> Stage:
    return Stage(tuple(asks.split()), gives, passes, when, memory, role)


STAGES = {
    "reference": _stage("t", "r", "", "dt", "world"),
    "output": _stage("t x u d", "y", "x", "dt", "world", memory=False),
    "sensor": _stage("t y", "y_m", "y", "tau", "design"),
    "differentiator": _stage("t r y e u", "e_hat", "e", "tau", "design"),
    "surface": _stage("t r y e u", "sigma", "e_hat", "tau", "design"),
    "law": _stage("t r y e sigma u", "v", "sigma", "tau", "design"),
    "allocation": _stage("t r y e sigma v u", "u", "v", "tau", "design"),
    "actuator": _stage("t y u", "u", "u", "tau", "design"),
    "perturbation": _stage("t x", "d", "", "dt", "world"),
    "plant": _stage("t x u d", "dx/dt", "", "dt", "world"),
    "stop": _stage("t x", "left", "", "dt", "world", memory=False),
    "probe": _stage("t x u d r y e", "probe", "", "row", "world", memory=False),
}
#: The stages of the control, in the order in which they act at a sample.
SAMPLED = tuple(name for name, s in STAGES.items() if s.when == "tau")
#: Offered to a block with memory besides the signals of its stage.
OWN = ("z", "tau", "k", "salt")
#: Recorded signals.
SIGNALS = ("t", "r", "y", "y_m", "e", "e_hat", "sigma", "v", "u", "d")


def salt(path: str) -> int:
    """Return an integer that is unique to the path of a block, such as ``sensor__noise``."""
    return zlib.crc32(path.encode())


def table() -> str:
    """Return the stages as a table in Markdown: which may ask for what."""
    when = {"dt": "every `dt`", "tau": "every `tau`", "row": "recorded rows"}
    lines = [f"| stage | may ask for | and for {', '.join(f'`{q}`' for q in OWN)} | gives | "
             "evaluated |", "|---|---|---|---|---|"]
    for name, s in STAGES.items():
        asks = ", ".join(f"`{q}`" for q in s.asks)
        remembers = s.memory and s.when == "dt" and name != "plant"
        own = "yes" if s.when == "tau" else "with memory" if remembers else "no"
        held = ", with memory every `tau`"*remembers
        lines.append(f"| {name} | {asks} | {own} | `{s.gives}` | {when[s.when]}{held} |")
    return "\n".join(lines)
