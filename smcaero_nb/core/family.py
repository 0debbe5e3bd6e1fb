"""Functions made from text, and factories whose blocks remember how they were made."""

import copy
import functools
import hashlib
import importlib
import inspect
import linecache
import numbers
import sys
import textwrap
from collections.abc import Callable
from types import FunctionType
from typing import Any

import numpy as np

from .content import is_block

__all__ = ["family", "found", "home", "plain", "public", "rebuilt", "spelt", "written"]

KIT = __name__.partition(".")[0]


def written(name: str, args: str, body: str, names: dict, doc: str | None = None) -> FunctionType:
    """Return the function ``def name(args): body``.

    Its text is kept where debuggers, tracebacks and `inspect.getsource` look for it.

    Parameters
    ----------
    name, args, body : str
        The text of the function; lines of the body are not indented.
    names : dict
        What it reads, annotations included; ``__name__`` is the module that writes it.
    doc : str, optional
        Its docstring.
    """
    text = f"def {name}({args}):\n{textwrap.indent(body, '    ')}\n"
    file = f"<{name} {hashlib.sha256(text.encode()).hexdigest()[:12]}>"
    linecache.cache[file] = len(text), None, text.splitlines(True), file  # without a time: it stays
    made: dict[str, Any] = {}  # not among the names: its own may be one that it reads
    exec(compile(text, file, "exec"), dict(names), made)
    made[name].__doc__ = doc
    return made[name]


def family(*, card: Any = None) -> Callable[[Callable], Callable]:
    """Decorate a function that returns a block, so that the block remembers how it was made.

    Parameters
    ----------
    card : Card, optional
        What the blocks of the family have in common; a block that has no card of its own takes it.
    """
    def decorated(factory):
        signature = inspect.signature(factory)

        @functools.wraps(factory)
        def made(*args, **given):
            b = copy.copy(factory(*args, **given))  # a factory may keep its blocks
            asked = signature.bind(*args, **given)
            asked.apply_defaults()
            b.factory = made, {n: plain(v) for n, v in asked.arguments.items()}
            b.card = b.card or card
            return b

        made.__dict__["card"] = card
        return made

    return decorated


def plain(value: Any) -> Any:
    """Return an argument as numbers, texts and tuples of them; anything else as it is."""
    value = value.item() if getattr(value, "ndim", 1) == 0 else value  # a number of numpy
    if isinstance(value, (bool, str)):
        return value
    if isinstance(value, numbers.Real):
        return int(value) if isinstance(value, numbers.Integral) else float(value)
    return tuple(map(plain, value)) if np.iterable(value) else value


# ---- where blocks come from ----------------------------------------------------------------------
def found(module: str, name: str) -> Any:
    """Return what an importable module has under a name, or None."""
    return getattr(sys.modules.get(module), name, None)


def home(maker: Callable) -> tuple[str, str] | None:
    """Return module and name to import a factory, or a function's block, from, or None."""
    module, name = maker.__module__, maker.__qualname__
    thing = None if module == "__main__" else found(module, name)
    return (module, name) if thing is maker or getattr(thing, "f", None) is maker else None


def public(module: str, name: str) -> str:
    """Return the name by which a person reaches it; within the kit, without that of the kit."""
    if module.partition(".")[0] != KIT:
        return f"{module}.{name}"
    library = ".".join(module.split(".")[:2])
    module = library if found(library, name) is found(module, name) else module
    return f"{module}.{name}".removeprefix(f"{KIT}.")


def spelt(maker: Callable, arguments: dict | None = None) -> str:
    """Return the code that makes a factory's block, or a function's, with arguments as needed."""
    at = home(maker)
    text = "smc."*(at[0].partition(".")[0] == KIT) + public(*at) if at else maker.__name__
    if arguments is None:
        return text
    given = []
    for n, a in inspect.signature(maker).parameters.items():
        v = arguments[n]
        if a.default is a.empty or v != a.default:
            value = spelt(v) if inspect.isfunction(v) else v.code() if is_block(v) else repr(v)
            given.append(value if a.default is a.empty else f"{n}={value}")
    return f"{text}({', '.join(given)})"


def rebuilt(at: tuple[str, str], arguments: dict | None, values: dict) -> Any:
    """Return the block that `Block.__reduce__` describes."""
    maker = getattr(importlib.import_module(at[0]), at[1])
    return (maker if arguments is None else maker(**arguments)).with_(**values)
