"""Benchmark of the lander: 240 s under the 1-SMC Lander beside the same loop hand-written in C, and 500 descents.

``python tests/bench/lander.py [rounds]`` runs it alone.
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

SOURCE = pathlib.Path(__file__).with_name("lander.c")
GOAL, LIMIT = 1.15, 1.35  # engine / C that does the same work
TOLERANCE = 1e-9  # largest difference between the two; the loop is chaotic: they agree to the last bits or not at all
ROWS, COLUMNS = 2000, 49


def seconds(f):
    """Time of the processor that a call takes: other work on the machine counts less."""
    began = time.process_time()
    f()
    return time.process_time() - began


def in_c(folder):
    """The loop in C, compiled now, as a function of the loop and dt that returns steps, rows and sums."""
    library = pathlib.Path(folder)/"lander.so"
    subprocess.run(["gcc", "-O3", "-march=native", "-ffp-contract=off", "-shared", "-fPIC", str(SOURCE), "-o", str(library),
                    "-lm"], check=True)
    array, whole, real = np.ctypeslib.ndpointer(float, flags="C"), ctypes.c_long, ctypes.c_double
    c = ctypes.CDLL(str(library)).run
    c.argtypes, c.restype = [array, real, real, *[whole]*4, array, array, ctypes.POINTER(whole)], whole

    def run(loop, dt):
        p = {s: b.values for s, b in loop.stages.items() if b}
        n, m, rows = round(loop.duration/dt), round(loop.tau/dt), whole()
        P = [p["surface"][f"{c}__{k}"] for c in ("attitude", "descent") for k in ("c_0", "c_int", "a_b", "e_I", "w_max")]
        P += [p["law"][f"{c}__{k}"] for c in ("attitude", "descent")
              for k in ("gamma", "rho_max", "delta_1", "delta_2", "delta_3", "t_1", "t_2", "a", "omega")]
        P += [p["law"][f"{c}__rho"] for c in ("attitude", "descent")]
        P += [p["allocation"][k] for k in ("m", "J", "l_a", "feedforward", "s_min")]
        P += [p["actuator"][f"{c}__{k}"] for c in ("attitude", "descent") for k in ("low", "high")]
        P += [*p["perturbation"].values(), *p["plant"].values()]
        every = -(-n//ROWS)
        rec, sums = np.empty((-(-n//every) + 1, COLUMNS)), np.zeros(20)
        steps = c(np.array(P, float), dt, m*dt, m, n, every, n - round(0.2*n), rec, sums, ctypes.byref(rows))
        return steps, rec[:rows.value], sums
    return run


def apart(run, steps, rec, sums):
    """Largest difference between a run and the rows, and between it and the sums, of the C."""
    flat = smc.core.signal.flat
    columns = [run.t, *flat(run.r), *flat(run.y), *flat(run.e), *flat(run.e_hat), *run.sigma, *run.v, *run.u, *run.d,
               *vars(run.x).values()]
    columns += [q for stage in vars(run.z).values() for channel in vars(stage).values() for q in vars(channel).values()]
    columns += [getattr(b, s)[c] for s in ("sigma", "u") for c in (0, 1) for b in (run.low, run.high)]
    columns += run.integral_v
    samples = math.floor(steps*run.loop.dt/run.loop.tau + 1e-9) + 1
    figures = [*(q*steps for q in flat(run.mean_e)), *flat(run.tail_e), *(q*steps for q in run.mean_u), *run.variation_u,
               *(q*samples for q in run.mean_v), *run.max_sigma, *run.max_u]
    return (max(np.abs(a - b).max() for a, b in zip(columns, rec.T, strict=True)),
            max(abs(a/b - 1.0) for a, b in zip(figures, np.delete(sums, [12, 13]), strict=True)))


def beside_c(rounds):
    """Time of 240 s, engine and C, interleaved, at two steps; True if the limits hold."""
    print(f"Speed: lander, 240 s under the 1-SMC Lander, medians of {rounds} rounds")
    if not shutil.which("gcc"):
        print("  no gcc here, so there is nothing to compare with: install a C compiler")
        return True
    held = True
    with tempfile.TemporaryDirectory() as folder:
        c = in_c(folder)
        for dt in (1e-3, 1e-4):
            loop = smc.rpl.loop().with_(dt=dt)
            run, hand = smc.simulate(loop, record=ROWS), c(loop, dt)
            assert run.steps == hand[0]
            rows, sums = apart(run, *hand)
            times = [(seconds(lambda q=loop: smc.simulate(q, record=ROWS)), seconds(lambda q=loop, h=dt: c(q, h)))
                     for _ in range(rounds)]
            a, b = (statistics.median(t)/run.steps*1e9 for t in zip(*times, strict=True))
            print(f"  dt = {dt:g} s:{a:7.2f} ns/step, C {b:7.2f}, ratio {a/b:.3f} (goal {GOAL}, limit {LIMIT}); apart by "
                  f"{rows:.1e} (limit {TOLERANCE:g}), sums by {sums:.1e}")
            held = held and a/b <= LIMIT and rows <= TOLERANCE and sums <= TOLERANCE
    return held


def descents(n=500):
    """Time of n descents from random states, each to touchdown."""
    loop, rng = smc.rpl.loop(), np.random.default_rng(0)
    smc.simulate(loop, 0.05)

    def all_of_them():
        return sum(smc.rpl.landing(smc.simulate(loop.with_(
            plant__theta=math.pi/2 + rng.uniform(-0.087, 0.087), plant__dtheta=rng.uniform(-0.1, 0.1),
            plant__altitude=rng.uniform(5900.0, 6700.0), plant__velocity=rng.uniform(-15.0, -5.0)))).soft for _ in range(n))

    began = time.process_time()
    print(f"  {all_of_them()} of {n} descents from random states land softly, in {time.process_time() - began:.1f} s")


if __name__ == "__main__":
    held = beside_c(int(sys.argv[1]) if len(sys.argv) > 1 else 15)
    descents()
    sys.exit(not held)
