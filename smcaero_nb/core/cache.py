"""Fingerprints of the content of functions, compiled functions, and a disk cache for them."""

import contextlib
import hashlib
import os
import pathlib
import pickle
import stat
import sys
import tempfile
import time
import types
import warnings
from typing import Any

import numpy as np
import platformdirs

from .content import codes, content, fingerprint, is_block, is_library, remembered, used

__all__ = ["OPTIONS", "cache_folder", "compiled", "kept"]

#: What is compiled beside a loop's own text and blocks, and how.
_ENGINE = hashlib.sha256(b"".join(pathlib.Path(__file__).with_name(f"{name}.py").read_bytes()
                                  for name in ("build", "cache", "signal", "vec"))).hexdigest()
_FORMAT = 2  # of the files on disk; part of the folder's name, so that older files are never loaded
_FILES = 500  # compiled loops kept on disk; the oldest go first
_STALE = 3600.0  # s after which an unfinished file must be from a process that has ended
_FUNCTIONS = 500  # compiled functions kept in memory
#: Options of numba for a loop, and for a function that only loops call.
OPTIONS: dict[str, Any] = dict(nogil=True, error_model="numpy", no_cfunc_wrapper=True)
_INNER: dict[str, Any] = OPTIONS | dict(no_cpython_wrapper=True)
_compiled: dict = {}
_said: set[str] = set()


def compiled(f: types.FunctionType, defaults: tuple | None = None) -> Any:
    """Return the numba version of a plain function and of the helpers and blocks it calls."""
    from numba import njit

    defaults = defaults or f.__defaults__
    key = fingerprint(f), content(defaults)
    if key not in _compiled:
        shadows = {}

        def inner(v):
            if is_block(v):
                return compiled(v.f, v.p)
            v = getattr(v, "py_func", v)  # anew: the helpers of a numba function may have changed
            if is_library(v):
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

        reads = {n for c in codes(f.__code__) for n in c.co_names}
        names: dict[str, Any] = {"__name__": __name__}
        cells = tuple(types.CellType() for _ in f.__closure__ or ())
        own: Any = defaults and inner(defaults)
        g = types.FunctionType(f.__code__, names, f.__name__, own, cells or None)
        _compiled[key] = njit(**_INNER)(g)
        try:  # only now: a helper may call itself
            names.update({n: inner(v) for n, v in used(f).items()})
            for new, old in zip(cells, f.__closure__ or (), strict=True):
                new.cell_contents = inner(old.cell_contents)
        except BaseException:
            del _compiled[key]
            raise
    return remembered(_compiled, key, _FUNCTIONS)


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
        _once("smcaero_nb: this version of numba keeps compiled code differently; "
              "it is compiled anew in every process")
        return dispatcher
    try:
        cache_folder()
        dispatcher._cache = _Disk(key)
    except OSError as why:
        _once(f"smcaero_nb: no folder for compiled code ({why}); "
              "it is compiled anew in every process")
    return dispatcher
