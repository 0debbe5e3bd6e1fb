"""What the benchmarks share: C compiled and called, its run beside the kit's, both timed in turn,
and the verdict.

Times are of the processor, not of the clock: other processes on the machine count less. Only what
runs in new processes (first calls, in bench.py) goes by the clock.
"""

import atexit
import ctypes
import functools
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time

import numpy as np

import smcaero_nb as smc

GCC = shutil.which("gcc")
FOLDER = tempfile.TemporaryDirectory(prefix="smcaero_nb-bench-")
atexit.register(FOLDER.cleanup)
TYPES = {"a": np.ctypeslib.ndpointer(float, flags="C"), "n": ctypes.c_long, "x": ctypes.c_double,
         "p": ctypes.POINTER(ctypes.c_long)}
ROWS = 2000  # recorded, of a run


def rounds_asked(default):
    """The number of rounds: what the command line says, or the default."""
    return int(sys.argv[1]) if len(sys.argv) > 1 else default


def no_gcc():
    """Whether there is no C compiler, and says it."""
    if not GCC:
        print("  no gcc here, so there is nothing to compare with: install a C compiler")
    return not GCC


@functools.cache
def library(source, *flags):
    """A C file of this folder, compiled now, once in a process."""
    path = pathlib.Path(FOLDER.name)/f"{source}{''.join(flags)}.so"
    subprocess.run([GCC, "-O3", "-march=native", "-ffp-contract=off", "-shared", "-fPIC", *flags,
                    str(pathlib.Path(__file__).with_name(f"{source}.c")), "-o", str(path), "-lm"],
                   check=True)
    return ctypes.CDLL(str(path))


def in_c(source, types, *flags, name="run"):
    """A function of a C file that returns a whole number; `types` has a letter of TYPES for each
    argument."""
    f = library(source, *flags)[name]
    f.argtypes, f.restype = [TYPES[c] for c in types], ctypes.c_long
    return f


def seconds(f):
    """Time of the processor that a call takes."""
    began = time.process_time()
    f()
    return time.process_time() - began


def nanoseconds(rounds, n, *jobs):
    """Time of each of n steps of some jobs, interleaved: a row for each round."""
    return np.array([[seconds(job)/n*1e9 for job in jobs] for _ in range(rounds)])


def compare(name, rounds, n, kit, c, *bare, apart, goal=1.10, limit=1.25, tolerance=1e-10,
            step="step"):
    """Print the times of kit and C, their ratio and their largest differences; True if the limits
    hold.

    `c` does the same work as `kit`; `bare` may be one more function in C, that does less. Goal and
    limit are of the ratio of the medians, tolerance is of each number in `apart`.
    """
    times = nanoseconds(rounds, n, kit, c, *bare)
    (a, b, *less), fastest = np.median(times, axis=0), times.min(axis=0)
    print(f"  {name:<26}{a:7.2f} ns/{step}, C {b:7.2f}, ratio {a/b:.3f} (of the fastest "
          f"{fastest[0]/fastest[1]:.3f}; "
          f"goal {goal}, limit {limit}); apart by {', sums by '.join(f'{q:.1e}' for q in apart)} "
          f"(limit {tolerance:g})"
          + "".join(f"; bare C {q:.2f}, ratio {a/q:.3f}" for q in less))
    return bool(a/b <= limit and all(q <= tolerance for q in apart))


def leaves(s):
    """The numbers or arrays of a signal, or of the states of a run, as a list."""
    inside = s if isinstance(s, tuple) else vars(s).values() if hasattr(s, "__dict__") else None
    return [s] if inside is None else [q for v in inside for q in leaves(v)]


def columns(run):
    """The records of a run, in the order of a row of the C."""
    extremes = zip(leaves((run.low.sigma, run.low.u)), leaves((run.high.sigma, run.high.u)),
                   strict=True)
    return leaves((run.t, run.r, run.y, run.e, run.e_hat, run.sigma, run.v, run.u, run.d, run.x,
                   run.z, *extremes,
                   run.integral_v))


def figures(run):
    """The sums and maxima of a run, in the order of the C that `compare_loop` calls, less the turns
    of u."""
    return [q*w for s, w in ((run.mean_e, run.steps), (run.mean_u, run.steps),
                             (run.tail_peaks.e, 1), (run.tail_peaks.sigma, 1),
                             (run.tail_peaks.u, 1), (run.variation_u, 1),
                             (run.mean_v, run.steps + 1)) for q in leaves(s)]


def apart(run, rec, figures, sums):
    """Largest difference between the records of a run and the rows of the C, and, relative, between
    figures and sums."""
    return (np.max([np.abs(a - b).max() for a, b in zip(columns(run), rec.T, strict=True)]),
            np.max([abs(a/b - 1.0) for a, b in zip(figures, sums, strict=True)]))


def compare_loop(name, rounds, loop, source, parameters, *whole, function="run", bare=False):
    """`compare` a loop with function(parameters, dt, n, *whole, every, tail, rec, sums) in C; bare:
    also with -DBARE."""
    def kit():
        return smc.simulate(loop, record=ROWS)

    def c(*flags):
        return functools.partial(in_c(source, f"axn{'n'*len(whole)}nnaa", *flags, name=function),
                                 np.array(parameters, float),
                                 loop.dt, n, *whole, n//ROWS, n - round(0.2*n))

    run = kit()
    n = run.steps
    rec, sums = np.zeros((ROWS + 1, len(columns(run)))), np.zeros(len(figures(run)) + 1)
    same = functools.partial(c(), rec, sums)
    assert same() == n
    less = [functools.partial(c("-DBARE"), rec.copy(), sums.copy())] if bare else []
    return compare(name, rounds, n, kit, same, *less,
                   apart=apart(run, rec, figures(run), np.delete(sums, -2)))
