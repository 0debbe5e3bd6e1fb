"""Expressions of the program: text in terms of the leaves of signals."""

import math
from typing import Any

from .block import BlockError
from .param import Param
from .signal import flat, leaves, shape, text

__all__ = ["error", "limits", "local", "nested", "spread", "zero"]


def local(name: str, path: str = "") -> str:
    """Return the variable of a leaf: sigma, e_0, x_3."""
    return name + path.replace("][", "_").replace("[", "_").replace("]", "")


def spread(name: str, value: Any) -> dict[str, float]:
    """Return {variable: value} of a number, or of each entry of a nested tuple."""
    if not isinstance(value, tuple):
        return {name: value}
    return {local(name, q): v for q, v in zip(leaves(shape(value)), flat(value), strict=True)}


def nested(name: str, s: Any) -> str:
    """Return the text of a signal of shape `s` in terms of its variables."""
    return text(s, (local(name, q) for q in leaves(s)))


def error(r: Any, y: Any, p: str = "", q: str = "", name: str = "y") -> str:
    """Return the text of r - y.

    A reference without derivatives is piecewise constant, and its derivatives are zero.
    """
    if y is None:
        return f"{local('r', p)} - {local(name, q)}"
    if r is None:
        if any(v is not None for v in y):
            raise BlockError(f"the reference is one number, but y has {len(y)} channels; "
                             "give one for each")
        rest = "".join(f"-{local(name, f'{q}[{i}]')}, " for i in range(1, len(y)))
        return f"({local('r', p)} - {local(name, q + '[0]')}, {rest})"
    inner = (error(r[i], v, f"{p}[{i}]", f"{q}[{i}]", name) + ", " for i, v in enumerate(y))
    return "(" + "".join(inner) + ")"


def zero(y: Any) -> str:
    """Return the text of a zero reference: one zero for each channel of y."""
    return "0.0" if y is None or not any(y) else "(" + "".join(f"{zero(v)}, " for v in y) + ")"


def limits(name: str, s: Any, meta: Any) -> list[str]:
    """Return the text of the limits declared in the metadata of a signal."""
    if isinstance(meta, tuple) and s is not None:
        return [q for i, (v, m) in enumerate(zip(s, meta, strict=False))
                for q in limits(local(name, f"[{i}]"), v, m)]
    if not isinstance(meta, Param) or s is not None:
        return []
    low = [f"{name} >= {meta.low!r}"] if meta.low > -math.inf else []
    return low + ([f"{name} <= {meta.high!r}"] if meta.high < math.inf else [])
