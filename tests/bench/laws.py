"""Benchmarks of the laws on their chains: some beside the same loop hand-written in C, all in ns a step.

``python tests/bench/laws.py [rounds]`` runs them alone.
"""

import ctypes
import math
import pathlib
import shutil
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np

import smcaero_nb as smc
from smcaero_nb import block

SOURCE = pathlib.Path(__file__).with_name("laws.c")
GOAL, LIMIT = 1.10, 1.25  # engine / C that does the same work
TOLERANCE = 1e-10  # largest difference between the two trajectories
DURATION, DT, ROWS = 30.0, 1e-5, 2000


@block(state=dict(sigma=1.0))
def motion(u, d):
    return (d - u,)


@block
def itself(x):
    return -x[0]


@block
def wave(t):
    return math.sin(t)


@block(state=dict(last=1.0))
def with_rate(e, z, tau):
    return (e, (e - z[0])/tau), (e,)


@block(state=dict(a=1.0, b=-0.5))
def pair(u, d):
    return d[0] - u[0], d[1] - u[1]


@block
def outputs(x):
    return (-x[0],), (-x[1],)


@block
def heads(e):
    return e[0][0], e[1][0]


@block
def waves(t):
    return math.sin(t), 0.5


ONE = dict(plant=motion, output=itself, perturbation=wave, duration=DURATION, dt=DT)
TWO = dict(plant=pair, output=outputs, surface=heads, perturbation=waves, duration=DURATION, dt=DT)

#: {name in laws.c: loop}. The C takes the law's parameters and initial states, then the plant's initial states.
IN_C = {law.name: smc.ClosedLoop(law=law, **ONE)
        for law in (smc.smc1.sign_smc, smc.smc2.super_twisting, smc.smc2.adaptive_super_twisting)}

#: {library and law: loop}: whatever `each_law` prints.
LOOPS = {f"smc1 {n}": smc.ClosedLoop(law=getattr(smc.smc1, n), **ONE)
         for n in ("sign_smc", "quasi_smc", "saturation_smc", "tanh_smc", "adaptive_smc", "adaptive_quasi_smc", "dual_layer_smc",
                   "dual_layer_quasi_smc")}
LOOPS |= {f"smc1 {n}, m = 2": smc.ClosedLoop(law=getattr(smc.smc1, n), **TWO)
          for n in ("unit_vector", "quasi_unit_vector", "adaptive_unit_vector", "adaptive_quasi_unit_vector")}
LOOPS["smc1 dual_layer_unit_vector, m = 2"] = smc.ClosedLoop(law=smc.smc1.dual_layer_unit_vector(2), **TWO)
LOOPS["smc1 unit_vector, decoupling, m = 2"] = smc.ClosedLoop(law=smc.smc1.unit_vector, **TWO,
                                                              allocation=smc.smc1.decoupling(((2.0, 1.0), (-1.0, 3.0))))
LOOPS |= {f"smc2 {n}": smc.ClosedLoop(law=getattr(smc.smc2, n), **ONE) for n in ("super_twisting", "adaptive_super_twisting")}
LOOPS |= {f"smc2 {n}": smc.ClosedLoop(law=getattr(smc.smc2, n), surface=with_rate, **ONE)
          for n in ("twisting", "adaptive_twisting")}


def nanoseconds(f, n):
    """Time that a call takes of the processor, divided by n; other processes do not count."""
    began = time.process_time()
    f()
    return (time.process_time() - began)/n*1e9


def library(folder):
    """The laws in C, compiled now."""
    path = pathlib.Path(folder)/"laws.so"
    flags = ["-O3", "-march=native", "-ffp-contract=off", "-shared", "-fPIC"]
    subprocess.run(["gcc", *flags, str(SOURCE), "-o", str(path), "-lm"], check=True)
    return ctypes.CDLL(str(path))


def in_c(c, name, loop, n):
    """A function that runs a loop in C and returns its rows and sums."""
    array, whole = ctypes.POINTER(ctypes.c_double), ctypes.c_long
    f = getattr(c, name)
    f.argtypes, f.restype = [array, ctypes.c_double, whole, whole, whole, array, array], whole
    law, plant = loop.stages["law"], loop.stages["plant"]
    P = np.array([*law.values.values(), *plant.z0])
    rec, acc = np.zeros((ROWS + 1, 14 + len(plant.z0) + len(law.z0))), np.zeros(8)

    def run():
        assert f(*(q.ctypes.data_as(array) if isinstance(q, np.ndarray) else q
                   for q in (P, DT, n, n//ROWS, n - round(0.2*n), rec, acc))) == n
        return rec, acc
    return run


def apart(run, rec, acc):
    """Largest difference between a run and the rows and sums of the C."""
    columns = [run.t, run.r, run.y, run.e, run.e_hat, run.sigma, run.v, run.u, run.d, *vars(run.x).values(),
               *vars(run.z.law).values(), run.low.sigma, run.high.sigma, run.low.u, run.high.u, run.integral_v]
    figures = [run.mean_e*run.steps, run.mean_u*run.steps, run.tail_e, run.tail_sigma, run.tail_u, run.variation_u,
               run.mean_v*(run.steps + 1)]
    return max(*(np.abs(a - b).max() for a, b in zip(columns, rec.T, strict=True)),
               *(abs(a/b - 1.0) for a, b in zip(figures, np.delete(acc, 6), strict=True)))


def beside_c(rounds):
    """Time of a step of some laws, engine and C, interleaved; True if the limits hold."""
    n, held = round(DURATION/DT), True
    print(f"Laws beside C that does the same work: {n:g} steps of {DT:g} s, medians of {rounds} rounds")
    if not shutil.which("gcc"):
        print("  no gcc here, so there is nothing to compare with: install a C compiler")
        return True
    with tempfile.TemporaryDirectory() as folder:
        c = library(folder)
        for name, loop in IN_C.items():
            hand = in_c(c, name, loop, n)
            difference = apart(smc.simulate(loop, record=ROWS), *hand())
            times = [(nanoseconds(lambda loop=loop: smc.simulate(loop, record=ROWS), n), nanoseconds(hand, n))
                     for _ in range(rounds)]
            mine, theirs = map(statistics.median, zip(*times, strict=True))
            fastest = [min(t) for t in zip(*times, strict=True)]
            print(f"  {name:<26}{mine:7.2f} ns/step, C {theirs:7.2f}, ratio {mine/theirs:.3f} (of the fastest "
                  f"{fastest[0]/fastest[1]:.3f}; goal {GOAL}, limit {LIMIT}); apart by {difference:.1e} (limit {TOLERANCE:g})")
            held = held and mine/theirs <= LIMIT and difference <= TOLERANCE
    return held


def each_law(rounds):
    """Print the time of a step of every law on its chain."""
    print(f"Laws on their chains, xi = sin t: medians of {rounds} rounds")
    for name, loop in LOOPS.items():
        smc.simulate(loop, 1e-3)
        n = round(DURATION/DT)
        times = [nanoseconds(lambda loop=loop: smc.simulate(loop, record=ROWS), n) for _ in range(rounds)]
        print(f"  {name:<38}{statistics.median(times):7.2f} ns/step")


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 9
    good = beside_c(count)
    each_law(max(3, count//3))
    sys.exit(not good)
