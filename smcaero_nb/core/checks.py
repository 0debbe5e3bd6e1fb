"""Checks of what a block returns, and its errors in words."""

import linecache
import math
import re
import types
from typing import Any

import numpy as np

from .block import BlockError
from .param import listed, number, real, said
from .signal import flat, shape, size, tuples

__all__ = ["check", "kind", "place", "way_out"]


def check(where: str, got: Any, states: dict[str, Any], stage: str) -> None:
    """Raise `BlockError` unless a block returned what its stage needs.

    `states` has the shape of each state; arrays are taken as tuples.
    """
    wanted, must = tuple(states.values()), ""
    if type(got) is float and (stage != "plant" and not states):
        return
    got = tuples(got)
    if stage != "plant" and states:
        if isinstance(got, tuple) and len(got) == 2 and shape(got[1]) == wanted:
            got = got[0]
        else:
            must = f"(output, next z), next z a tuple of {_named(states)}"
    if stage == "plant" and shape(got) != wanted:
        must = f"dx/dt as a tuple of {_named(states)}"
    elif stage == "stop" and isinstance(got, tuple):
        must = "a float, what is left until the run ends"
    elif not must and (isinstance(got, tuple) and not got or not all(map(_float, flat(got)))):
        must = "a float or a tuple of floats"
    if must:
        way = any(isinstance(q, list) for q in flat(got))*"; write (a, b) in place of [a, b]"
        raise BlockError(f"{where} must return {must}; it returned {said(got)}{way}")


def _named(states: dict[str, Any]) -> str:
    """Number, names and sizes of states, in words."""
    names = (n if s is None else f"{n}: {size(s)}" for n, s in states.items())
    return f"{len(states)} ({listed(names)})"


def _float(value: Any) -> bool:
    """Return whether numba and float64, too, take a value as a number."""
    if type(value) is float:
        return True
    fits = not isinstance(value, int) or math.isfinite(number(value))
    return isinstance(value, (float, int, np.number)) and real(value) and fits


def kind(value: Any) -> str:
    """Describe the shape of a signal in words."""
    if not isinstance(value, tuple):
        return "a number"
    if any(isinstance(v, tuple) for v in value):
        return f"{len(value)} channels: {', '.join(map(kind, value))}"
    return f"a tuple of {len(value)}"


def way_out(why: Exception, given: dict[str, Any]) -> str:
    """Return advice on an error that comes from the shape of a signal, or an empty text."""
    words, tuples = str(why), [n for n, v in given.items() if isinstance(v, tuple)]
    numbers = [n for n in given if n not in tuples]
    if re.search("subscript|iterable", words) and numbers:
        return (f". A number has no components: write {' or '.join(_blamed(why, numbers))}, "
                "without an index, or let a stage before this one (output, surface) give several")
    if re.search("unpack|out of range", words) and tuples:
        return "".join(f". {n} has {_counted(n, len(given[n]))}" for n in _blamed(why, tuples))
    if re.search("tuple|sequence", words) and tuples:
        n = _blamed(why, tuples, whole=True)[0]
        return (f". {n}[0] is the first component of {n}; a stage before this one (output, "
                "surface) may combine them into one number")
    return ""


def _counted(name: str, n: int) -> str:
    """The components of a tuple, in words."""
    return f"{n} components, {name}[0] to {name}[{n - 1}]" if n > 1 else f"1 component, {name}[0]"


def _blamed(why: BaseException, names: list[str], whole: bool = False) -> list[str]:
    """Those of the names that the failing expression reads, or else its line; else all of them.

    With `whole` those that it reads without an index come first.
    """
    patterns = [r"\b{}\b(?!\s*\[)"]*whole + [r"\b{}\b"]
    for at in reversed(_frames(why)[1:]):  # without that of the engine
        for source in _sources(at):
            for pattern in patterns:
                if found := [n for n in names if re.search(pattern.format(n), source)]:
                    return found
    return names


def _frames(why: BaseException) -> list[types.TracebackType]:
    """The frames that an exception went through, the innermost last."""
    frames, at = [], why.__traceback__
    while at:
        frames.append(at)
        at = at.tb_next
    return frames


def _sources(at: types.TracebackType) -> tuple[str, str]:
    """The expression that a frame evaluates, empty if it has several lines, and its line."""
    code = at.tb_frame.f_code
    source = linecache.getline(code.co_filename, at.tb_lineno)
    first, last, start, end = [*code.co_positions()][at.tb_lasti//2]
    expression = source.encode()[start:end].decode(errors="replace") if first == last else ""
    return expression, source


def place(why: BaseException) -> str:
    """Return the line of the block that raised an exception, in words."""
    frames = _frames(why)
    source = _sources(frames[-1])[1].strip() if frames else ""
    return f", line {frames[-1].tb_lineno} ({source})" if source else ""
