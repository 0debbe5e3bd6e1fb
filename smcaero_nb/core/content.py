"""The content of a function: its code and all that it calls and reads, as text and as a hash."""

import dis
import enum
import functools
import hashlib
import secrets
import types
from typing import Any

import numpy as np

__all__ = ["codes", "content", "draws", "fingerprint", "is_block", "is_library",
           "remembered", "used"]

_LIBRARIES = {"math", "builtins", "numpy", "scipy", "numba"}
_PROCESS = secrets.token_hex(8)  # marks objects that only their identity tells apart
_PLAIN = (int, float, complex, str, bytes, type(None), type(...), range, slice, enum.Enum,
          np.generic, np.dtype)
_MISSING = object()
_FUNCTIONS = 1000  # whose fingerprints are kept in memory
_known: dict = {}


def codes(c: types.CodeType) -> list[types.CodeType]:
    """Return a code object and those nested in it."""
    return [c] + [d for k in c.co_consts if isinstance(k, types.CodeType) for d in codes(k)]


@functools.lru_cache(maxsize=2000)
def _written(code: types.CodeType) -> tuple[tuple[str, ...], str]:
    """Names that a code object reads, in order, and the hash of its content; neither changes."""
    say = [(c.co_argcount, c.co_code.hex(), c.co_names, c.co_varnames, c.co_freevars,
            [k for k in c.co_consts if not isinstance(k, types.CodeType)]) for c in codes(code)]
    names = tuple(dict.fromkeys(n for c in codes(code) for n in c.co_names))
    return names, hashlib.sha256(repr(say).encode()).hexdigest()


@functools.lru_cache(maxsize=2000)
def _attributes(code: types.CodeType) -> tuple[str, ...]:
    """Attributes that a code object reads, such as random in np.random."""
    return tuple({i.argval: None for c in codes(code) for i in dis.get_instructions(c)
                  if i.opname in ("LOAD_ATTR", "LOAD_METHOD")})


def used(f: types.FunctionType) -> dict[str, Any]:
    """Return the globals that a function reads."""
    return {n: f.__globals__[n] for n in _written(f.__code__)[0] if n in f.__globals__}


def _name(v: Any) -> str:
    """Module and name of a function, module or class."""
    name = getattr(v, "__qualname__", getattr(v, "__name__", ""))
    return f"{getattr(v, '__module__', '')}.{name}"


def is_library(v: Any) -> bool:
    """Return whether numba compiles `v` without help."""
    if hasattr(v, "of_signals"):
        return True
    return hasattr(v, "__name__") and _name(v).lstrip(".").split(".")[0] in _LIBRARIES


def is_block(v: Any) -> bool:
    """Return whether it is a block, which a function uses as a helper."""
    return hasattr(v, "f") and hasattr(v, "values")


def _content(v: Any, seen: dict, trace: list, names: tuple[str, ...] = (),
             defaults: bool = True) -> str:
    """Text that changes whenever the compiled meaning of `v` may change.

    `trace` collects what was read, as (reader, holder, name, value), and None for an object that
    may change in place.
    """
    v = getattr(v, "py_func", v)  # a numba function
    name = _name(v)
    if is_library(v):
        return name  # covered by the hash of the engine, or by the numba version
    if isinstance(v, types.FunctionType):
        if id(v) in seen:
            return f"seen {seen[id(v)]}"
        seen[id(v)] = len(seen)
        return _function(v, seen, trace, defaults)
    if isinstance(v, (types.ModuleType, type)):  # cfg.K: every attribute that may be read
        if (id(v), key := tuple(sorted(names))) in seen:
            return f"seen {v.__name__}"
        seen[id(v), key] = len(seen)
        trace.extend((getattr, v, n, getattr(v, n, _MISSING)) for n in key)
        read = [(n, _content(getattr(v, n), seen, trace, names)) for n in key if hasattr(v, n)]
        return repr((v.__name__, read))
    if is_block(v):  # used as a helper: its values are constants
        trace.extend((dict.get, v.values, n, q) for n, q in v.values.items())
        return repr((v.values, _content(v.f, seen, trace, (), False)))
    if isinstance(v, np.ndarray):
        trace.append(None)
        return repr((type(v), v.dtype, v.shape, hashlib.sha256(v.tobytes()).hexdigest()))
    if isinstance(v, (tuple, list)):
        if isinstance(v, list):
            trace.append(None)
        items = [_content(k, seen, trace, names) for k in v]
        return repr((type(v), getattr(v, "_fields", None), items))
    if type(v) is int:
        return hex(v)  # Python refuses to write thousands of decimal digits
    return repr(v) if isinstance(v, _PLAIN) else f"{name} {_PROCESS} {id(v)}"


def _function(f: types.FunctionType, seen: dict, trace: list, defaults: bool) -> str:
    """Text that changes with a function, its defaults and what it reads."""
    names, say = _written(f.__code__)
    for n in ("__code__", "__defaults__", "__kwdefaults__"):
        trace.append((getattr, f, n, getattr(f, n)))
    trace.extend((dict.get, f.__globals__, n, f.__globals__.get(n, _MISSING)) for n in names)
    cells = [c.cell_contents for c in f.__closure__ or ()]
    trace.extend((getattr, c, "cell_contents", c.cell_contents) for c in f.__closure__ or ())
    given = (f.__defaults__, tuple((f.__kwdefaults__ or {}).items())) if defaults else None
    says = say, _content(given, seen, trace, names)
    held = [_content(c, seen, trace, names) for c in cells]
    read = [(n, _content(g, seen, trace, names)) for n, g in used(f).items()]
    return repr((says, held, read))


def content(v: Any) -> str:
    """Return text that changes whenever the compiled meaning of `v` may change."""
    return _content(v, {}, [])


def fingerprint(f: Any) -> str:
    """Return a hash of the content of `f` and of all that it calls and reads.

    The defaults of `f` itself are run-time parameters and are left out; those of its helpers are
    constants. A hash found before is returned again while everything that was read for it is the
    same object, unless one of them may change in place.
    """
    known = _known.get(f)
    if known is None or any(get(holder, n, _MISSING) is not v for get, holder, n, v in known[1]):
        trace: list = []
        text = _content(f, {}, trace, defaults=False)
        known = hashlib.sha256(text.encode()).hexdigest(), trace
        _known[f] = known
        if None in trace:
            del _known[f]
        else:
            remembered(_known, f, _FUNCTIONS)
    return known[0]


def remembered(store: dict, key: Any, most: int) -> Any:
    """Return an entry of a dictionary that keeps at most `most` entries, those used last."""
    store[key] = value = store.pop(key)
    while len(store) > most:
        del store[next(iter(store))]
    return value


def draws(v: Any, names: tuple[str, ...] = (), seen: set | None = None) -> str | None:
    """Return the name of a random source that a function or one of its helpers uses, or None."""
    v = getattr(v, "f", v) if hasattr(v, "values") else getattr(v, "py_func", v)
    module = isinstance(v, types.ModuleType)
    where = v.__name__ if module else type(getattr(v, "__self__", v)).__module__
    if f"{where}.".startswith(("random.", "numpy.random.")):
        return ".".join(where.split(".")[:1 + where.startswith("numpy.")])
    seen = set() if seen is None else seen
    if (id(v), names) in seen:
        return None
    seen.add((id(v), names))
    inner = []
    if isinstance(v, types.FunctionType):
        names = _attributes(v.__code__)
        inner = [*(c.cell_contents for c in v.__closure__ or ()), *used(v).values(),
                 *(v.__defaults__ or ())]
    elif module and is_library(v):
        inner = [v.random] if "random" in names and hasattr(v, "random") else []
    elif isinstance(v, (types.ModuleType, type)):
        inner = [getattr(v, n) for n in names if hasattr(v, n)]
    elif isinstance(v, (tuple, list)):
        inner = v
    elif hasattr(v, "__wrapped__"):  # made by numba: a cfunc, a ufunc
        inner = [v.__wrapped__]
    return next((found for k in inner if (found := draws(k, names, seen))), None)
