"""What a function says (not who it is): fingerprints, compiled functions, and a disk cache keyed on them."""

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

import numpy as np
import platformdirs

__all__ = ["cache_folder", "compiled", "draws", "fingerprint", "kept", "remembered"]

#: What is compiled beside a loop's own text and blocks, and how.
_ENGINE = hashlib.sha256(b"".join(pathlib.Path(__file__).with_name(f"{name}.py").read_bytes()
                                  for name in ("build", "cache", "signal", "vec"))).hexdigest()
_LIBRARIES = {"math", "builtins", "numpy", "scipy", "numba"}
_FORMAT = 2  # of the files on disk, and part of their folder's name: what an older version wrote is never loaded
_FILES = 500  # compiled loops kept on disk; the oldest go first
_STALE = 3600.0  # s after which a file that is still being written was left by a process that ended
_FUNCTIONS = 500  # compiled functions kept in memory
_PROCESS = secrets.token_hex(8)  # what has an identity, but no text, is the same in this process only
_PLAIN = (int, float, complex, str, bytes, type(None), type(...), range, slice, enum.Enum, np.generic, np.dtype)
_compiled = {}
_said = set()


def _codes(c):
    """A code object and those nested in it."""
    return [c] + [d for k in c.co_consts if isinstance(k, types.CodeType) for d in _codes(k)]


@functools.lru_cache(maxsize=2000)
def _written(code):
    """Names that a code object reads, in order, and the hash of what it says: neither ever changes."""
    say = [(c.co_argcount, c.co_code.hex(), c.co_names, c.co_varnames, c.co_freevars,
            [k for k in c.co_consts if not isinstance(k, types.CodeType)]) for c in _codes(code)]
    return tuple(dict.fromkeys(n for c in _codes(code) for n in c.co_names)), hashlib.sha256(repr(say).encode()).hexdigest()


@functools.lru_cache(maxsize=2000)
def _attributes(code):
    """Names that a code object reads in others, as random in np.random."""
    return tuple({i.argval: None for c in _codes(code) for i in dis.get_instructions(c)
                  if i.opname in ("LOAD_ATTR", "LOAD_METHOD")})


def _used(f):
    """The globals that a function reads."""
    return {n: f.__globals__[n] for n in _written(f.__code__)[0] if n in f.__globals__}


def _name(v):
    """Module and name of a function, module or class."""
    return f"{getattr(v, '__module__', '')}.{getattr(v, '__qualname__', getattr(v, '__name__', ''))}"


def _is_library(v):
    """Whether numba compiles `v` as it stands."""
    return hasattr(v, "of_signals") or hasattr(v, "__name__") and _name(v).lstrip(".").split(".")[0] in _LIBRARIES


def _content(v, seen, names=(), defaults=True):
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
        return repr((v.__name__, [(n, _content(getattr(v, n), seen, names)) for n in key if hasattr(v, n)]))
    if hasattr(v, "f") and hasattr(v, "values"):  # a block used as a helper: its values are constants
        return repr((v.values, _content(v.f, seen, (), False)))
    if isinstance(v, np.ndarray):
        return repr((type(v), v.dtype, v.shape, hashlib.sha256(v.tobytes()).hexdigest()))
    if isinstance(v, (tuple, list)):
        return repr((type(v), getattr(v, "_fields", None), [_content(k, seen, names) for k in v]))
    if type(v) is int:
        return hex(v)  # Python refuses to write thousands of decimal digits
    return repr(v) if isinstance(v, _PLAIN) else f"{name} {_PROCESS} {id(v)}"


def fingerprint(f):
    """Hash of what `f` and all that it calls and reads say.

    The defaults of `f` itself are run-time parameters and left out; those of its helpers are
    constants.
    """
    return hashlib.sha256(_content(f, {}, defaults=False).encode()).hexdigest()


def draws(v, names=(), seen=None):
    """Return the name of a source of random numbers that a function or what it calls uses, or None."""
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
    elif hasattr(v, "__wrapped__"):  # what numba made of a function: a cfunc, a ufunc
        inner = [v.__wrapped__]
    return next((found for k in inner if (found := draws(k, names, seen))), None)


def compiled(f, defaults=None):
    """The numba version of a plain function; the plain helpers and blocks that it calls are compiled with it."""
    from numba import njit

    defaults = defaults or f.__defaults__
    key = fingerprint(f), _content(defaults, {})
    if key not in _compiled:
        shadows = {}

        def inner(v):
            if hasattr(v, "f") and hasattr(v, "values"):
                return compiled(v.f, v.p)
            v = getattr(v, "py_func", v)  # a numba function: what it calls and reads may have changed since it was compiled
            if _is_library(v):
                return v
            if isinstance(v, types.ModuleType):  # helpers.f: the module again, with what may be read compiled
                if id(v) not in shadows:
                    shadows[id(v)] = types.ModuleType(v.__name__)
                    vars(shadows[id(v)]).update({n: inner(getattr(v, n)) for n in reads if hasattr(v, n)})
                return shadows[id(v)]
            if isinstance(v, tuple):
                made = map(inner, v)
                return type(v)(*made) if hasattr(v, "_fields") else tuple(made)
            if isinstance(v, np.ndarray) and not isinstance(v, np.ma.MaskedArray):
                return np.array(v, order="C")  # what numba does not copy into its code may change
            return compiled(v) if isinstance(v, types.FunctionType) else v

        reads = {n for c in _codes(f.__code__) for n in c.co_names}
        names = {"__name__": __name__}
        cells = tuple(types.CellType() for _ in f.__closure__ or ())
        g = types.FunctionType(f.__code__, names, f.__name__, defaults and inner(defaults), cells or None)
        _compiled[key] = njit(nogil=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)(g)
        try:
            names.update({n: inner(v) for n, v in _used(f).items()})  # only now: a helper may call itself
            for new, old in zip(cells, f.__closure__ or (), strict=True):
                new.cell_contents = inner(old.cell_contents)
        except BaseException:
            del _compiled[key]
            raise
    return remembered(_compiled, key, _FUNCTIONS)


def remembered(store, key, most):
    """Return an entry of a dictionary that keeps the `most` entries used last."""
    store[key] = value = store.pop(key)
    while len(store) > most:
        del store[next(iter(store))]
    return value


def cache_folder():
    """Return the folder of compiled loops: the user's own, readable by nobody else.

    It lies in the user's cache directory, or in the directory that ``SMCAERO_CACHE_DIR`` names,
    which itself stays as it is. Compiled code is code: a folder that is a link, or that somebody
    else owns or may write to, is refused with `PermissionError`; `OSError` says that there is no
    place for one.
    """
    try:
        own = os.environ.get("SMCAERO_CACHE_DIR")
        parent = pathlib.Path(own or platformdirs.user_cache_path("smcaero_nb", False))
    except RuntimeError as why:  # no home directory
        raise FileNotFoundError(str(why)) from why
    if not own and not parent.is_absolute():
        raise FileNotFoundError("there is no home directory; SMCAERO_CACHE_DIR names another place")
    folder = parent/f"loops-{_FORMAT}"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if hasattr(os, "getuid"):
        s = folder.lstat()
        if not stat.S_ISDIR(s.st_mode) or s.st_uid != os.getuid() or s.st_mode & 0o022:
            raise PermissionError(f"{folder} is a link, belongs to another user, or others may write to it")
        if s.st_mode & 0o077:
            folder.chmod(0o700)
    return folder


def _sealed(name, data):
    """`data` behind a checksum of it and of the name of its file: damage, and another loop's file, are told."""
    return hashlib.sha256(name.encode() + data).digest() + data


def _opened(path, flags):
    """Open a file that is not a link, and do not wait for what is not a file."""
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))


def _unsealed(path):
    """Return what `_sealed` was given, from a file that nobody else can have written."""
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


def _swept(folder):
    """Remove the oldest loops above the number kept, and what processes that ended left half written."""
    def age(path):
        return path.stat().st_mtime

    with contextlib.suppress(OSError):  # another process sweeps, too
        left = [q for q in folder.glob("*.part") if age(q) < time.time() - _STALE]
        for q in [*left, *sorted(folder.glob("*.loop"), key=age)[:-_FILES]]:
            q.unlink()


def _once(message):
    """Warn, but say each thing once a session."""
    if message not in _said:
        _said.add(message)
        warnings.warn(message, RuntimeWarning, stacklevel=4)


class _Disk:
    """The part of numba's cache protocol that a dispatcher uses, with one file for each content and signature."""

    def __init__(self, key):
        self.key = key

    def path(self, sig, codegen):
        import numba

        say = repr((_ENGINE, self.key, str(sig), codegen.magic_tuple(), numba.__version__, np.__version__,
                    sys.implementation.cache_tag))
        return cache_folder() / (hashlib.sha256(say.encode()).hexdigest() + ".loop")

    def load_overload(self, sig, target):
        from numba.core.compiler import CompileResult

        try:
            target.refresh()
            data = _unsealed(self.path(sig, target.codegen()))
            return CompileResult._rebuild(target, *pickle.loads(data))
        except FileNotFoundError:
            return None
        except Exception as why:  # a damaged file, or numba has changed: compile
            _once(f"smcaero_nb: compiled code not read from disk ({type(why).__name__}: {why}); compiling again")

    def save_overload(self, sig, result):
        from numba.core.serialize import dumps

        if result.lifted or result.library.has_dynamic_globals:  # it would hold addresses of this process
            _once("smcaero_nb: a block refers to an array above 1 MB, or to code outside Python; loops with it are "
                  "compiled anew in every process")
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
            _once(f"smcaero_nb: compiled code not kept on disk ({type(why).__name__}: {why}); it will be compiled anew next time")


def kept(dispatcher, key):
    """Let a numba function keep its compiled code on disk under `key`; where numba's internals have changed, do without."""
    try:
        from numba.core.compiler import CompileResult
        from numba.core.serialize import dumps

        known = dumps and hasattr(dispatcher, "_cache") and all(hasattr(CompileResult, n) for n in ("_reduce", "_rebuild"))
    except ImportError:
        known = False
    if not known:
        _once("smcaero_nb: this version of numba keeps compiled code in another way; it is compiled anew in every process")
        return dispatcher
    try:
        cache_folder()
        dispatcher._cache = _Disk(key)
    except OSError as why:
        _once(f"smcaero_nb: no folder for compiled code ({why}); it is compiled anew in every process")
    return dispatcher
