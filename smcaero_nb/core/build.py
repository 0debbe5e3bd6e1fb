"""From a loop to a function that runs it: written, compiled, kept in memory and on disk."""

import hashlib
import linecache
import re
import threading
import types
from collections.abc import Callable
from typing import Any

from .block import BlockError
from .cache import OPTIONS, compiled, kept
from .content import remembered
from .program import Program
from .signal import shape
from .writer import asking, inputs, written

__all__ = ["built"]

LOOPS = 64  # kept in memory; the others are read from disk again
_made: dict = {}
_lock = threading.RLock()  # masks simulate in threads


def built(loop: Any, method: str, tau: float, m: int, lag: int,
          jit: bool) -> tuple[Callable, Program]:
    """Return the function that runs a loop of these blocks, and its program.

    The function comes from memory, from disk, or is made now.

    Raises
    ------
    BlockError
        A block that does not fit its stage, fails at t = 0 or cannot be compiled.
    """
    with _lock:
        key = _key(loop, method, m, lag)
        if not jit:  # these very functions, in which a debugger can stop
            return _plain(written(loop, method, tau, m, lag), loop)
        if key in _made and not _made[key][1].stands(loop, tau, m):
            written(loop, method, tau, m, lag)  # raises the error of a new loop
        if key not in _made:
            _made[key] = _compiled(written(loop, method, tau, m, lag), loop, tau, m, key)
        return remembered(_made, key, LOOPS)


def _key(loop: Any, method: str, m: int, lag: int) -> str:
    """All that the text of a loop depends on."""
    shapes = shape(inputs(loop.stages["plant"])[0]) if asking(loop.stages) or lag else ()
    late = (lag, -(-lag//m)) if lag else ()
    return repr((method, shapes, late, [(s, b and b.content()) for s, b in loop.stages.items()]))


def _defined(program: Program, functions: dict[str, Any]) -> types.FunctionType:
    """Define the function of a program, with its text for debuggers."""
    source = program.source
    # numba asks for __name__ when it loads from disk
    names: dict[str, Any] = {**functions, "__name__": __name__}
    file = f"<loop {hashlib.sha256(source.encode()).hexdigest()[:8]}>"
    linecache.cache[file] = len(source), None, source.splitlines(True), file
    exec(compile(source, file, "exec"), names)
    return names["run"]


def _plain(program: Program, loop: Any) -> tuple[Callable, Program]:
    return _defined(program, program.functions(loop)), program


def _compiled(program: Program, loop: Any, tau: float, m: int,
              key: str) -> tuple[Callable, Program]:
    from numba import float64, int64, njit
    from numba.core.errors import NumbaError, UnsupportedBytecodeError

    plain = _defined(program, {n: compiled(f) for n, f in program.functions(loop).items()})
    f = kept(njit(**OPTIONS)(plain), key + program.source)
    try:
        f.compile((*[float64[::1]]*3, float64[:, ::1], float64, float64, *[int64]*8))
    except (NumbaError, UnsupportedBytecodeError) as why:
        raise _uncompilable(program, loop, program.tried(loop, tau, m), why) from why
    return f, program


def _uncompilable(program: Program, loop: Any, values: dict, why: Exception) -> BlockError:
    """The error that names the block, and the line in it, that numba cannot compile."""
    blocks = program.blocks(loop)
    for source in program.source.split("\n"):
        for name, b in blocks.items():
            if f" = {name}(" not in source:
                continue
            args = eval(f"({source.split(f' = {name}(')[1][:-1]},)", values)
            if reason := _refusal(b.f, args):
                where = f"{program.places[name][0]} '{b.name}'"
                return BlockError(f"{where} cannot be compiled{_place(reason)}: {_first(reason)}. "
                                  "A block may use floats, tuples, math and plain functions, and "
                                  "has the numbers of a dict or an object as parameters (k=2.0); "
                                  "simulate(..., jit=False) runs it as plain Python")
    return BlockError(f"the loop cannot be compiled: {_first(why)}")


def _refusal(f: types.FunctionType, args: tuple) -> Exception | None:
    """The error with which numba refuses to compile one block, or None."""
    from numba import njit, typeof
    from numba.core.errors import NumbaError, UnsupportedBytecodeError

    try:
        alone = compiled(f).py_func
        njit(nogil=True, error_model="numpy")(alone).compile(tuple(map(typeof, args)))
    except (NumbaError, UnsupportedBytecodeError) as reason:
        return reason
    return None


def _place(reason: Exception) -> str:
    """The line of a block that numba's error is about."""
    found = re.findall(r'(?:File "|Raised from )(.*?)(?:", line | \()(\d+)', str(reason))
    if not found:
        return ""
    file, number = found[-1]
    return f", line {number} ({linecache.getline(file, int(number)).strip()})"


def _first(reason: Exception) -> str:
    """The first line of a numba error that says something."""
    lines = [q.strip() for q in re.sub(r"\x1b\[\d*m", "", str(reason)).split("\n")]
    telling = (q for q in lines if q and not q.startswith(("Failed in", "-", "File")))
    return next(telling, "numba gives no reason")
