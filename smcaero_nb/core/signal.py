"""Signals: a signal is a float, or a tuple of signals (channels outside, derivatives inside).

Code for a shape is written out leaf by leaf, once, as text: for the loop (`engine`) and for the helpers below, which
blocks may use on signals of any shape, compiled or not.
"""

try:
    from numba import types
    from numba.extending import overload

    TUPLES = (tuple, types.BaseTuple)
except ImportError:  # simulate(..., jit=False) needs no numba
    TUPLES, overload = (tuple,), None

__all__ = ["first", "flat", "leaves", "shape", "text"]


def shape(s):
    """Nested tuple that tells the shape of a signal (or of its numba type): None for a float."""
    return tuple(map(shape, s)) if isinstance(s, TUPLES) else None


def leaves(s, path=""):
    """Index expressions of the leaves of shape `s`: '[0]', '[1][0]', ..."""
    return [path] if s is None else [q for i, v in enumerate(s) for q in leaves(v, f"{path}[{i}]")]


def text(s, names):
    """Source text of a signal of shape `s` whose leaves are the next of the iterator `names`."""
    return next(names) if s is None else "(" + "".join(text(v, names) + ", " for v in s) + ")"


def flat(s):
    """The leaves of a signal, as a list."""
    return [q for v in s for q in flat(v)] if isinstance(s, tuple) else [s]


def generated(args, body):
    """A function of signals, for Python and numba alike; ``body(*shapes)`` is its source text for these shapes."""
    made = {}

    def code(*a):
        key = tuple(map(shape, a))
        if key not in made:
            exec(f"def f({args}): {body(*key)}", ns := {"__name__": __name__})
            made[key] = ns["f"]
        return made[key]

    def f(*a):
        return code(*a)(*a)

    f.of_signals = True  # the engine leaves it alone: its text is part of the engine
    if overload:
        overload(f, strict=False)(code)
    return f


#: First leaf of a signal: the output itself, without its derivatives.
first = generated("s", lambda s: "return s" + leaves(s)[0])
