"""What there is: blocks by name, with their cards, and the literature they come from."""

import inspect
import sys
from types import ModuleType

from .core import Block, Channels, ClosedLoop
from .core.card import Source
from .core.family import KIT
from .core.param import given

__all__ = ["catalogue", "cite"]


def catalogue(*modules: ModuleType) -> dict:
    """List the blocks, and the functions that make blocks, of the kit and of your own modules.

    Parameters
    ----------
    *modules : module
        Your own modules. Of each, the names in its ``__all__`` count, or those without a leading
        underscore; what it imports from elsewhere does not.

    Returns
    -------
    dict
        Blocks and functions by name, such as ``"smc1.sign_smc"`` and ``"hosmc.nested"``. Each has
        its `card`, of which the type says for which stage it is: ``smc.card.Law``, ...

    Raises
    ------
    ParameterError
        Something that is not a module.

    Examples
    --------
    >>> [n for n, b in catalogue().items() if isinstance(b.card, smc.card.Law) and b.card.channels]
    ['smc1.adaptive_quasi_unit_vector', 'smc1.adaptive_unit_vector', ..., 'smc1.unit_vector']
    """
    for i, m in enumerate(modules):
        given("catalogue", f"modules[{i}]", m, ModuleType, "a module")
    kit = sys.modules[KIT]
    libraries = [m for n in kit.__all__ if isinstance(m := getattr(kit, n), ModuleType)]
    return {f"{m.__name__.removeprefix(f'{KIT}.')}.{n}": thing
            for m in [*libraries, *modules] for n, thing in _blocks(m)}


def _blocks(module):
    """(name, block or family) of what is public in a module and its own."""
    public = getattr(module, "__all__", [n for n in vars(module) if not n.startswith("_")])
    for n in sorted(public):
        thing = getattr(module, n)
        made = isinstance(thing, Block) or inspect.isfunction(thing) and hasattr(thing, "card")
        where = getattr(thing, "f", thing).__module__ if made else ""
        if f"{where}.".startswith(f"{module.__name__}."):
            yield n, thing


def cite(source: Block | Channels | ClosedLoop) -> str:
    """Return the references of a block, or of all blocks of a loop, one a line.

    Parameters
    ----------
    source : Block, Channels or ClosedLoop
        Its cards name the references.

    Returns
    -------
    str
        In alphabetical order; empty where there are none.

    Raises
    ------
    ParameterError
        `source` is something else.

    Examples
    --------
    >>> print(cite(smc.hosmc.integrated))
    A. Levant (1993). Sliding order and sliding accuracy in sliding mode control. ...
    """
    given("cite", "source", source, (Block, Channels, ClosedLoop), "a block or a closed loop")
    return "\n".join(sorted(map(str, _sources(source))))


def _sources(source) -> set[Source]:
    """Sources of a block, of blocks side by side, or of the stages of a loop."""
    if isinstance(source, Block):
        return set(source.card.source) if source.card else set()
    parts = source.parts if isinstance(source, Channels) else source.stages
    return set().union(*(_sources(b) for b in parts.values() if b))
