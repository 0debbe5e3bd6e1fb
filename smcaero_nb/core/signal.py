"""Signals: a signal is a float, or a tuple of signals (channels outside, derivatives inside).

Code for a shape is written out leaf by leaf, once, as text: for the loop (`writer`) and for the
helpers below, which blocks may use on signals of any shape, compiled or not.
"""

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from .family import written

try:
    from numba import types
    from numba.extending import overload

    TUPLES: Any = (tuple, types.BaseTuple)
except ImportError:  # simulate(..., jit=False) needs no numba
    TUPLES, overload = (tuple,), None

__all__ = ["filled", "filtered", "first", "flat", "leaves", "norm", "scaled", "shape", "sign",
           "size", "solution", "solved", "text", "tuples"]


def sign(s: float) -> float:
    """Return the sign of a number; 0 at 0."""
    return (s > 0.0)*1.0 - (s < 0.0)*1.0


def shape(s: Any) -> Any:
    """Return the shape of a signal, or of its numba type: None for a float, tuples nested alike."""
    return tuple(map(shape, s)) if isinstance(s, TUPLES) else None


def leaves(s: Any, path: str = "") -> list[str]:
    """Return the index expressions of the leaves of shape `s`: '[0]', '[1][0]', ..."""
    return [path] if s is None else [q for i, v in enumerate(s) for q in leaves(v, f"{path}[{i}]")]


def text(s: Any, names: Iterator[str]) -> str:
    """Return the source of a signal of shape `s` whose leaves `names` yields."""
    return next(names) if s is None else "(" + "".join(text(v, names) + ", " for v in s) + ")"


def filled(s: Any, values: Iterator) -> Any:
    """Return a signal of shape `s` whose leaves `values` yields."""
    return next(values) if s is None else tuple([filled(v, values) for v in s])


def flat(s: Any) -> list:
    """Return the leaves of a signal."""
    return [q for v in s for q in flat(v)] if isinstance(s, tuple) else [s]


def tuples(s: Any) -> Any:
    """Return a signal with a tuple in place of each array that a block returned."""
    if isinstance(s, np.ndarray) and s.ndim or isinstance(s, tuple):
        return tuple(map(tuples, s))
    return s


def size(s: Any) -> str:
    """Return a shape in words: a vector or a matrix."""
    if s is None:
        return "a number"
    nested = next((v for v in s if v is not None), None)
    return f"{len(s)} numbers" if nested is None else f"{len(s)} rows of {len(nested)}"


def generated(args: str, body: Callable[..., str]) -> Callable:
    """Return a function of signals, for Python and numba alike.

    Its source for signals of given shapes is ``body(*shapes)``.
    """
    made = {}

    def code(*a):
        key = tuple(map(shape, a))
        if key not in made:
            names: dict[str, Any] = {"__name__": __name__, "sqrt": math.sqrt, "nan": math.nan}
            made[key] = written(body.__name__.strip("_"), args, body(*key), names)
        return made[key]

    def f(*a):
        return code(*a)(*a)

    vars(f)["of_signals"] = True  # the engine leaves it alone: its text is part of the engine
    f.__name__ = f.__qualname__ = body.__name__
    if overload:
        overload(f, strict=False)(code)
    return f


def _first(s):
    return "return s" + leaves(s)[0]


def _norm(s: Any) -> str:
    q = leaves(s)
    if len(q) == 1:
        return f"return abs(s{q[0]})"
    return f"return sqrt({' + '.join(f's{i}*s{i}' for i in q)})"


def _scaled(s: Any, k: Any, size: Any) -> str:
    return "return " + text(s, (f"(k*(s{q}/size) if size > 0.0 else 0.0)" for q in leaves(s)))


def _filtered(z: Any, s: Any, share: Any) -> str:
    if z != s:
        raise ValueError(f"the signal has {len(leaves(s))} components, "
                         f"but the block is made for {len(leaves(z))}")
    return "return " + text(s, (f"z{q} + share*(s{q} - z{q})" for q in leaves(s)))


def solution(G: Any, s: Any) -> str:
    """Return the body of a function for G^-1 s, by elimination with row exchanges."""
    m = len(s) if s else 1
    if s not in (None, (None,)*m) or not (G == ((None,)*m,)*m or m == 1 and G is None):
        raise ValueError(f"G0 must be {m} rows of {m} numbers each, one row per component of v")
    lines = [f"a{i}{j} = float(G{f'[{i}][{j}]' if G else ''})" for i in range(m) for j in range(m)]
    lines += [f"b{i} = s{f'[{i}]' if s else ''}" for i in range(m)]
    for k in range(m):
        for i in range(k + 1, m):
            upper, lower = ([f"a{q}{j}" for j in range(k, m)] + [f"b{q}"] for q in (k, i))
            lines += [f"if abs(a{i}{k}) > abs(a{k}{k}):",
                      f"    {', '.join(upper + lower)} = {', '.join(lower + upper)}"]
        for i in range(k + 1, m):
            lines += [f"q = a{i}{k}/a{k}{k} if a{k}{k} != 0.0 else nan"]
            lines += [f"a{i}{j} -= q*a{k}{j}" for j in range(k + 1, m)] + [f"b{i} -= q*b{k}"]
    for i in reversed(range(m)):
        rest = "".join(f" - a{i}{j}*b{j}" for j in range(i + 1, m))
        lines += [f"b{i} = (b{i}{rest})/a{i}{i} if a{i}{i} != 0.0 else nan"]
    return "\n".join([*lines, "return " + text(s, (f"b{i}" for i in range(m)))])


#: First leaf of a signal: the output itself, without its derivatives.
first = generated("s", _first)
#: Euclidean norm over all leaves.
norm = generated("s", _norm)
#: k s/size, leaf by leaf; 0 where size is 0. It divides first: tiny signals do not overflow.
scaled = generated("s, k, size", _scaled)
#: One step of a low-pass filter: z + share (s - z), leaf by leaf.
filtered = generated("z, s, share", _filtered)
#: G^-1 s by elimination with row exchanges; NaN where G, a tuple of rows, is singular.
solved = generated("G, s", solution)
