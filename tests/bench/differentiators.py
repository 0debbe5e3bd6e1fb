"""Benchmark of `differentiate`: 1e6 samples of order 5 beside the same update hand-written in C.

``python tests/bench/differentiators.py [rounds]`` runs it alone; ``bench.py`` may call `speed`.
"""

import ctypes
import pathlib
import shutil
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np

from smcaero_nb.differentiators import differentiate

SOURCE = pathlib.Path(__file__).with_name("differentiators.c")
GOAL, LIMIT = 1.10, 1.25  # differentiate / C that does the same work
TOLERANCE = 1e-9  # largest difference between the two, of the largest estimate
N, L = 1_000_000, 2.0


def nanoseconds(f):
    """Time that a call takes of the processor, for each sample; other processes do not count."""
    began = time.process_time()
    f()
    return (time.process_time() - began)/N*1e9


def in_c(folder):
    """The update in C, compiled now, as a function of the record that returns the estimates."""
    library = pathlib.Path(folder)/"differentiators.so"
    subprocess.run(["gcc", "-O3", "-march=native", "-ffp-contract=off", "-shared", "-fPIC", str(SOURCE), "-o", str(library),
                    "-lm"], check=True)
    array = np.ctypeslib.ndpointer(float, flags="C")
    c = ctypes.CDLL(str(library)).levant_5
    c.argtypes, c.restype = [array, array, array, ctypes.c_long, ctypes.c_double, ctypes.c_double], ctypes.c_long

    def run(t, f):
        out = np.empty((6, N))
        assert c(t, f, out, N, L, 10.0*(t[1] - t[0])) == N
        return out
    return run


def speed(rounds):
    """Time of a sample, kit and C, interleaved, uniform record and uneven one; True if the limits hold."""
    print(f"Differentiator of order 5, levant, {N:g} samples: medians of {rounds} rounds")
    if not shutil.which("gcc"):
        print("  no gcc here, so there is nothing to compare with: install a C compiler")
        return True
    held, rng = True, np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as folder:
        c = in_c(folder)
        for name, spread in (("uniform", 0.0), ("uneven", 0.5)):
            t = np.cumsum(1e-3*(1.0 + spread*rng.uniform(-1.0, 1.0, N)))
            f = np.sin(t) + np.cos(0.5*t) + 1e-3*rng.uniform(-1.0, 1.0, N)
            mine, hand = differentiate(t, f, L, 5), c(t, f)
            apart = np.max(np.abs(mine - hand).max(axis=1)/np.abs(hand).max(axis=1))
            times = [(nanoseconds(lambda t=t, f=f: differentiate(t, f, L, 5)), nanoseconds(lambda t=t, f=f: c(t, f)))
                     for _ in range(rounds)]
            a, b = map(statistics.median, zip(*times, strict=True))
            print(f"  {name:<8}{a:7.2f} ns/sample, C {b:7.2f}, ratio {a/b:.3f} (goal {GOAL}, limit {LIMIT}); apart by "
                  f"{apart:.1e} (limit {TOLERANCE:g})")
            held = held and a/b <= LIMIT and apart <= TOLERANCE
    return held


if __name__ == "__main__":
    sys.exit(not speed(int(sys.argv[1]) if len(sys.argv) > 1 else 9))
