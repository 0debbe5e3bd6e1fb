"""Checks of what a block returns, and its errors in words."""

import linecache
import math
import re
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
    names = listed(n if s is None else f"{n}: {size(s)}" for n, s in states.items())
    got, wanted = tuples(got), tuple(states.values())
    if stage != "plant" and states:
        if not (isinstance(got, tuple) and len(got) == 2 and shape(got[1]) == wanted):
            raise BlockError(f"{where} must return (output, next z), next z a tuple of "
                             f"{len(states)} ({names}); it returned {said(got)}")
        got = got[0]
    if stage == "plant" and shape(got) != wanted:
        raise BlockError(f"{where} must return dx/dt as a tuple of {len(states)} ({names}); "
                         f"it returned {said(got)}")
    if stage == "stop" and isinstance(got, tuple):
        raise BlockError(f"{where} must return a float, what is left until the run ends; "
                         f"it returned {said(got)}")
    if (isinstance(got, tuple) and not got) or not all(map(_float, flat(got))):
        raise BlockError(f"{where} must return a float or a tuple of floats; "
                         f"it returned {said(got)}")


def _float(value: Any) -> bool:
    """Whether numba and float64, too, take a value as a number."""
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
        return (f". A number has no components: write {' or '.join(numbers)}, without an index, "
                "or let a stage before this one (output, surface) give several")
    if re.search("unpack|out of range", words) and tuples:
        return "".join(f". {n} has {len(given[n])} components, {n}[0] to {n}[{len(given[n]) - 1}]"
                       for n in tuples)
    if re.search("tuple|sequence", words) and tuples:
        n = tuples[0]
        return (f". {n}[0] is the first component of {n}; a stage before this one (output, "
                "surface) may combine them into one number")
    return ""


def place(why: BaseException) -> str:
    """Return the line of the block that raised an exception, in words."""
    at = why.__traceback__
    while at and at.tb_next:
        at = at.tb_next
    file, number = (at.tb_frame.f_code.co_filename, at.tb_lineno) if at else ("", 0)
    source = linecache.getline(file, number).strip()
    return f", line {number} ({source})" if source else ""
