"""Checks of the arguments that the functions of `ui` take."""

import inspect
from collections.abc import Iterable, Mapping
from typing import Any

from ..core import Block, Channels, ClosedLoop, Param, ParameterError
from ..core.param import refused, said, texted, unknown

__all__ = ["Loop", "Loops", "names", "offered", "seconds", "states"]

Loop = Block | Channels | ClosedLoop
Loops = Loop | Mapping[str, Loop]
WORDS = {Block: "a block", Channels: "channels", ClosedLoop: "a closed loop"}


def _kind(name, value):
    """What a value is, and the way out if it only has to be called."""
    if not (inspect.isroutine(value) or inspect.isclass(value)):
        return f"{said({name: value} if name else value)} is not allowed"
    try:
        asked = [n for n, a in inspect.signature(value).parameters.items()
                 if a.default is a.empty and a.kind not in (a.VAR_POSITIONAL, a.VAR_KEYWORD)]
    except (TypeError, ValueError):
        asked = []
    given, f = f"{said(name)}: " if name else "", value.__name__
    return (f"{given}{f} is a {'class' if inspect.isclass(value) else 'function'}: "
            f"call it, {f}({', '.join(asked)}), or make a block of it with @block")


def offered(owner: str, given: Any, *kinds: type) -> dict[str, Any]:
    """Return {name: loop} of one loop, or of several given by name; `kinds` are those allowed."""
    loops = dict(given) if isinstance(given, Mapping) else {"": given}
    *some, last = (WORDS[k] for k in kinds)
    wanted = f"{', '.join(some)} or {last}" if some else last
    if not loops:
        raise ParameterError(f"{owner}: {{}} is not allowed; name at least one: {{'name': loop}}")
    for name, loop in loops.items():
        if not isinstance(name, str):
            raise refused(owner, "name", name, "text: {'name': loop}")
        if not isinstance(loop, kinds):
            raise ParameterError(f"{owner}: {_kind(name, loop)}; "
                                 f"it must be {wanted}, or several by name: {{'name': loop}}")
    return loops


def names(owner: str, what: str, given: Any) -> tuple[str, ...] | None:
    """Return the names as a tuple, or None if none are given."""
    if given is None:
        return None
    if isinstance(given, str) or not isinstance(given, Iterable):
        way = f": ({said(given)},)" if isinstance(given, str) else ""
        raise refused(owner, what, given, f"a sequence of names{way}")
    return tuple(texted(owner, f"{what}[{i}]", n) for i, n in enumerate(given))


def states(owner: str, given: Any, loops: Iterable[Any]) -> tuple[str, ...]:
    """Return the names of states, all of which the plants of the loops must have."""
    asked = names(owner, "states", given) or ()
    for plant in (q.stages["plant"] for q in loops if isinstance(q, ClosedLoop)):
        for n in asked:
            if n not in plant.states:
                raise unknown(f"{owner}: the plant {plant.name}", n, plant.states)
    return asked


def seconds(owner: str, **times: Any) -> dict[str, Any]:
    """Return the times as numbers or None; whether a run may have them, `simulate` says."""
    return {n: v if v is None else Param(unit="s").check(owner, n, v) for n, v in times.items()}
