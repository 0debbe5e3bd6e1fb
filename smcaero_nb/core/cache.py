"""Fingerprints of the content of functions, compiled functions, and a disk cache for them."""

import contextlib
import dis
import enum
import functools
import hashlib
import os
import pathlib
import pickle
import secrets
import stat
import sys
import tempfile
import time
import types
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import platformdirs

__all__ = ["OPTIONS", "cache_folder", "compiled", "draws", "fingerprint", "kept", "remembered"]

#: What is compiled beside a loop's own text and blocks, and how.
_ENGINE = hashlib.sha256(b"".join(pathlib.Path(__file__).with_name(f"{name}.py").read_bytes()
                                  for name in ("build", "cache", "signal", "vec"))).hexdigest()
_LIBRARIES = {"math", "builtins", "numpy", "scipy", "numba"}
_FORMAT = 2  # of the files on disk; part of the folder's name, so that older files are never loaded
_FILES = 500  # compiled loops kept on disk; the oldest go first
_STALE = 3600.0  # s after which an unfinished file must be from a process that has ended
_FUNCTIONS = 500  # compiled functions kept in memory
_PROCESS = secrets.token_hex(8)  # marks objects that only their identity tells apart
_PLAIN = (int, float, complex, str, bytes, type(None), type(...), range, slice, enum.Enum,
          np.generic, np.dtype)
#: Options of numba for a loop, and for a function that only loops call.
OPTIONS: dict[str, Any] = dict(nogil=True, error_model="numpy", no_cfunc_wrapper=True)
_INNER: dict[str, Any] = OPTIONS | dict(no_cpython_wrapper=True)
_compiled: dict = {}
_said: set[str] = set()


def _codes(c: types.CodeType) -> list[types.CodeType]:
    """A code object and those nested in it."""
    return [c] + [d for k in c.co_consts if isinstance(k, types.CodeType) for d in _codes(k)]


@functools.lru_cache(maxsize=2000)
def _written(code: types.CodeType) -> tuple[tuple[str, ...], str]:
    """Names that a code object reads, in order, and the hash of its content; neither changes."""
    say = [(c.co_argcount, c.co_code.hex(), c.co_names, c.co_varnames, c.co_freevars,
            [k for k in c.co_consts if not isinstance(k, types.CodeType)]) for c in _codes(code)]
    names = tuple(dict.fromkeys(n for c in _codes(code) for n in c.co_names))
    return names, hashlib.sha256(repr(say).encode()).hexdigest()


@functools.lru_cache(maxsize=2000)
def _attributes(code: types.CodeType) -> tuple[str, ...]:
    """Attributes that a code object reads, such as random in np.random."""
    return tuple({i.argval: None for c in _codes(code) for i in dis.get_instructions(c)
                  if i.opname in ("LOAD_ATTR", "LOAD_METHOD")})


def _used(f: types.FunctionType) -> dict[str, Any]:
    """The globals that a function reads."""
    return {n: f.__globals__[n] for n in _written(f.__code__)[0] if n in f.__globals__}


def _name(v: Any) -> str:
    """Module and name of a function, module or class."""
    name = getattr(v, "__qualname__", getattr(v, "__name__", ""))
    return f"{getattr(v, '__module__', '')}.{name}"


def _is_library(v: Any) -> bool:
    """Whether numba compiles `v` without help."""
    if hasattr(v, "of_signals"):
        return True
    return hasattr(v, "__name__") and _name(v).lstrip(".").split(".")[0] in _LIBRARIES


def _is_block(v: Any) -> bool:
    return hasattr(v, "f") and hasattr(v, "values")


def _content(v: Any, seen: dict, names: tuple[str, ...] = (), defaults: bool = True) -> str:
    """Text that changes whenever the compiled meaning of `v` may change."""
    v = getattr(v, "py_func", v)  # a numba function
    name = _name(v)
    if _is_library(v):
        return name  # covered by _ENGINE, or by the numba version
    if isinstance(v, types.FunctionType):
        if id(v) in seen:
            return f"seen {seen[id(v)]}"
        seen[id(v)] = len(seen)
        names, say = _written(v.__code__)
        given = (v.__defaults__, tuple((v.__kwdefaults__ or {}).items())) if defaults else None
        say = say, _content(given, seen, names)
        cells = [_content(c.cell_contents, seen, names) for c in v.__closure__ or ()]
        return repr((say, cells, [(n, _content(g, seen, names)) for n, g in _used(v).items()]))
    if isinstance(v, (types.ModuleType, type)):  # cfg.K: every attribute that may be read
        if (id(v), key := tuple(sorted(names))) in seen:
            return f"seen {v.__name__}"
        seen[id(v), key] = len(seen)
        read = [(n, _content(getattr(v, n), seen, names)) for n in key if hasattr(v, n)]
        return repr((v.__name__, read))
    if _is_block(v):  # used as a helper: its values are constants
        return repr((v.values, _content(v.f, seen, (), False)))
    if isinstance(v, np.ndarray):
        return repr((type(v), v.dtype, v.shape, hashlib.sha256(v.tobytes()).hexdigest()))
    if isinstance(v, (tuple, list)):
        return repr((type(v), getattr(v, "_fields", None), [_content(k, seen, names) for k in v]))
    if type(v) is int:
        return hex(v)  # Python refuses to write thousands of decimal digits
    return repr(v) if isinstance(v, _PLAIN) else f"{name} {_PROCESS} {id(v)}"


def fingerprint(f: Callable) -> str:
    """Return a hash of the content of `f` and of all that it calls and reads.

    The defaults of `f` itself are run-time parameters and are left out; those of its helpers are
    constants.
    """
    return hashlib.sha256(_content(f, {}, defaults=False).encode()).hexdigest()


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
        inner = [*(c.cell_contents for c in v.__closure__ or ()), *_used(v).values(),
                 *(v.__defaults__ or ())]
    elif module and _is_library(v):
        inner = [v.random] if "random" in names and hasattr(v, "random") else []
    elif isinstance(v, (types.ModuleType, type)):
        inner = [getattr(v, n) for n in names if hasattr(v, n)]
    elif isinstance(v, (tuple, list)):
        inner = v
    elif hasattr(v, "__wrapped__"):  # made by numba: a cfunc, a ufunc
        inner = [v.__wrapped__]
    return next((found for k in inner if (found := draws(k, names, seen))), None)


def compiled(f: types.FunctionType, defaults: tuple | None = None) -> Any:
    """Return the numba version of a plain function and of the helpers and blocks it calls."""
    from numba import njit

    defaults = defaults or f.__defaults__
    key = fingerprint(f), _content(defaults, {})
    if key not in _compiled:
        shadows = {}

        def inner(v):
            if _is_block(v):
                return compiled(v.f, v.p)
            v = getattr(v, "py_func", v)  # anew: the helpers of a numba function may have changed
            if _is_library(v):
                return v
            if isinstance(v, types.ModuleType):  # helpers.f: a copy of the module, f compiled
                if id(v) not in shadows:
                    shadows[id(v)] = copy = types.ModuleType(v.__name__)
                    vars(copy).update({n: inner(getattr(v, n)) for n in reads if hasattr(v, n)})
                return shadows[id(v)]
            if isinstance(v, tuple):
                made = map(inner, v)
                return type(v)(*made) if hasattr(v, "_fields") else tuple(made)
            if isinstance(v, np.ndarray) and not isinstance(v, np.ma.MaskedArray):
                return np.array(v, order="C")  # numba does not copy all arrays; this one may change
            return compiled(v) if isinstance(v, types.FunctionType) else v

        reads = {n for c in _codes(f.__code__) for n in c.co_names}
        names: dict[str, Any] = {"__name__": __name__}
        cells = tuple(types.CellType() for _ in f.__closure__ or ())
        own: Any = defaults and inner(defaults)
        g = types.FunctionType(f.__code__, names, f.__name__, own, cells or None)
        _compiled[key] = njit(**_INNER)(g)
        try:  # only now: a helper may call itself
            names.update({n: inner(v) for n, v in _used(f).items()})
            for new, old in zip(cells, f.__closure__ or (), strict=True):
                new.cell_contents = inner(old.cell_contents)
        except BaseException:
            del _compiled[key]
            raise
    return remembered(_compiled, key, _FUNCTIONS)


def remembered(store: dict, key: Any, most: int) -> Any:
    """Return an entry of a dictionary that keeps at most `most` entries, those used last."""
    store[key] = value = store.pop(key)
    while len(store) > most:
        del store[next(iter(store))]
    return value


def cache_folder() -> pathlib.Path:
    """Return the folder of compiled loops: the user's own, readable by nobody else.

    It lies in the user's cache directory, or in the directory that ``SMCAERO_CACHE_DIR`` names,
    which itself is not changed. Compiled code is executed: a folder that is a link, or that
    somebody else owns or may write to, is refused with `PermissionError`. `OSError` means that the
    folder cannot be made.
    """
    try:
        own = os.environ.get("SMCAERO_CACHE_DIR")
        parent = pathlib.Path(own or platformdirs.user_cache_path("smcaero_nb", False))
    except RuntimeError as why:  # no home directory
        raise FileNotFoundError(str(why)) from why
    if not own and not parent.is_absolute():
        raise FileNotFoundError("no home directory was found; set SMCAERO_CACHE_DIR to a folder")
    folder = parent/f"loops-{_FORMAT}"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if hasattr(os, "getuid"):
        s = folder.lstat()
        if not stat.S_ISDIR(s.st_mode) or s.st_uid != os.getuid() or s.st_mode & 0o022:
            raise PermissionError(
                f"{folder} is a link, belongs to another user, or others may write to it")
        if s.st_mode & 0o077:
            folder.chmod(0o700)
    return folder


def _sealed(name: str, data: bytes) -> bytes:
    """`data` behind a checksum of it and its file name, which reveals damage and mistaken files."""
    return hashlib.sha256(name.encode() + data).digest() + data


def _opened(path: str, flags: int) -> int:
    """Open a file, but do not follow a link, nor wait for a pipe."""
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))


def _unsealed(path: pathlib.Path) -> bytes:
    """Undo `_sealed`, for a file that nobody else can have written."""
    with open(path, "rb", opener=_opened) as f:
        s = os.fstat(f.fileno())
        foreign = hasattr(os, "getuid") and (s.st_uid != os.getuid() or s.st_mode & 0o022)
        if foreign or not stat.S_ISREG(s.st_mode):
            raise PermissionError(f"{path.name} belongs to another user, or others may write to it")
        whole = f.read()
    data = whole[hashlib.sha256().digest_size:]
    if whole != _sealed(path.name, data):
        raise ValueError(f"{path.name} is damaged")
    return data


def _swept(folder: pathlib.Path) -> None:
    """Remove the oldest loops beyond the number kept, and unfinished files of ended processes."""
    def age(path):
        return path.stat().st_mtime

    with contextlib.suppress(OSError):  # another process sweeps too
        left = [q for q in folder.glob("*.part") if age(q) < time.time() - _STALE]
        for q in [*left, *sorted(folder.glob("*.loop"), key=age)[:-_FILES]]:
            q.unlink()


def _once(message: str) -> None:
    """Warn, once a session for each message."""
    if message not in _said:
        _said.add(message)
        warnings.warn(message, RuntimeWarning, stacklevel=4)


class _Disk:
    """The part of numba's cache protocol that a dispatcher uses; a file per key and signature."""

    def __init__(self, key: str):
        self.key = key

    def path(self, sig: Any, codegen: Any) -> pathlib.Path:
        import numba

        say = repr((_ENGINE, self.key, str(sig), codegen.magic_tuple(), numba.__version__,
                    np.__version__, sys.implementation.cache_tag))
        return cache_folder() / (hashlib.sha256(say.encode()).hexdigest() + ".loop")

    def load_overload(self, sig: Any, target: Any) -> Any:
        from numba.core.compiler import CompileResult

        try:
            target.refresh()
            data = _unsealed(self.path(sig, target.codegen()))
            return CompileResult._rebuild(target, *pickle.loads(data))
        except FileNotFoundError:
            return None
        except Exception as why:  # a damaged file, or numba has changed: compile
            _once(f"smcaero_nb: compiled code not read from disk ({type(why).__name__}: {why}); "
                  "compiling again")
            return None

    def save_overload(self, sig: Any, result: Any) -> None:
        from numba.core.serialize import dumps

        # the file would hold addresses of this process
        if result.lifted or result.library.has_dynamic_globals:
            _once("smcaero_nb: a block refers to an array above 1 MB, or to code outside Python; "
                  "loops with it are compiled anew in every process")
            return
        try:
            path = self.path(sig, result.codegen)
            handle, name = tempfile.mkstemp(dir=path.parent, suffix=".part")
            try:
                with os.fdopen(handle, "wb") as f:
                    f.write(_sealed(path.name, dumps(result._reduce())))
                os.replace(name, path)  # whole or not at all, whoever else writes it now
            except BaseException:
                os.unlink(name)
                raise
            _swept(path.parent)
        except Exception as why:
            _once(f"smcaero_nb: compiled code not kept on disk ({type(why).__name__}: {why}); "
                  "it will be compiled anew next time")


def kept(dispatcher: Any, key: str) -> Any:
    """Return a numba function, made to keep its compiled code on disk under `key`.

    Where numba's internals have changed, it is not kept.
    """
    try:
        from numba.core.compiler import CompileResult
        from numba.core.serialize import dumps

        result = all(hasattr(CompileResult, n) for n in ("_reduce", "_rebuild"))
        known = dumps and hasattr(dispatcher, "_cache") and result
    except ImportError:
        known = False
    if not known:
        _once("smcaero_nb: this version of numba keeps compiled code in another way; "
              "it is compiled anew in every process")
        return dispatcher
    try:
        cache_folder()
        dispatcher._cache = _Disk(key)
    except OSError as why:
        _once(f"smcaero_nb: no folder for compiled code ({why}); "
              "it is compiled anew in every process")
    return dispatcher
