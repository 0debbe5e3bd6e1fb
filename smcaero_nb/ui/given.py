"""What the functions of `ui` are given, refused in words where it is something else."""

import inspect

from ..core import Block, Channels, ClosedLoop, Param, ParameterError
from ..core.param import said

__all__ = ["called", "names", "offered", "seconds"]

WORDS = {Block: "a block", Channels: "channels", ClosedLoop: "a closed loop"}


def _kind(name, value):
    """What a value is, and the way out if it has only to be called."""
    if not (inspect.isroutine(value) or inspect.isclass(value)):
        return f"{said({name: value} if name else value)} is not allowed"
    try:
        asked = [n for n, a in inspect.signature(value).parameters.items()
                 if a.default is a.empty and a.kind not in (a.VAR_POSITIONAL, a.VAR_KEYWORD)]
    except (TypeError, ValueError):
        asked = []
    given, f = f"{name!r}: " if name else "", value.__name__
    return (f"{given}{f} is a {'class' if inspect.isclass(value) else 'function'}: "
            f"call it, {f}({', '.join(asked)}), or make a block of it with @block")


def offered(owner, given, *kinds):
    """{name: loop} of a loop, or of several by name; `kinds` are those allowed."""
    loops = dict(given) if isinstance(given, dict) else {"": given}
    *some, last = (WORDS[k] for k in kinds)
    wanted = f"{', '.join(some)} or {last}" if some else last
    if not loops:
        raise ParameterError(f"{owner}: {{}} is not allowed; name at least one: {{'name': loop}}")
    for name, loop in loops.items():
        if not isinstance(name, str):
            raise ParameterError(
                f"{owner}: the name {said(name)} is not allowed; "
                "it must be a text: {'name': loop}")
        if not isinstance(loop, kinds):
            raise ParameterError(f"{owner}: {_kind(name, loop)}; "
                                 f"it must be {wanted}, or several by name: {{'name': loop}}")
    return loops


def names(owner, what, given):
    """The names, as a tuple, or None."""
    if given is None:
        return None
    if isinstance(given, str):
        raise ParameterError(
            f"{owner}: {what} = {said(given)} is not allowed; "
            f"it must be a sequence of names: ({said(given)},)")
    try:
        given = tuple(given)
    except TypeError:
        raise ParameterError(f"{owner}: {what} = {said(given)} is not allowed; "
                             "it must be a sequence of names") from None
    for name in given:
        if not isinstance(name, str):
            raise ParameterError(f"{owner}: {what} has {said(name)}, which is not allowed; "
                                 "a name must be a text")
    return given


def seconds(owner, **times):
    """The times that are given; whether a run may have them, `simulate` says."""
    return {n: v if v is None else Param(unit="s").check(owner, n, v) for n, v in times.items()}


def called(owner, **functions):
    """Refuse what is no function."""
    for name, f in functions.items():
        try:
            inspect.signature(f)
        except (TypeError, ValueError):  # no function, or one of C that does not tell its arguments
            raise ParameterError(
                f"{owner}: {name} = {said(f)} is not allowed; "
                "it must be a function, not called") from None
