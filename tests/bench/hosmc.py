"""Benchmark of the higher-order laws: ns a step of each on its chain, and the compiled loop beside the same loop in C.

``python tests/bench/hosmc.py [rounds]`` runs it alone.
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

import smcaero_nb as smc
from smcaero_nb import hosmc

SOURCE = pathlib.Path(__file__).with_name("hosmc.c")
GOAL, LIMIT = 1.10, 1.25  # engine / C that does the same work
TOLERANCE = 1e-10  # largest difference between the two trajectories
DT, STEPS, ROWS = 1e-3, 3_000_000, 2000


def in_c(folder, name, *flags):
    """The loop in C, compiled now, as a function of arrays."""
    library = pathlib.Path(folder)/f"{name}.so"
    subprocess.run(["gcc", "-O3", "-march=native", "-ffp-contract=off", "-shared", "-fPIC", *flags, str(SOURCE),
                    "-o", str(library), "-lm"], check=True)
    array, whole = ctypes.POINTER(ctypes.c_double), ctypes.c_long
    f = ctypes.CDLL(str(library)).run
    f.argtypes, f.restype = [array, ctypes.c_double, *[whole]*4, array, array], whole

    def run(parameters, rec, sums):
        return f(parameters.ctypes.data_as(array), DT, STEPS, 1, STEPS//ROWS, int(0.8*STEPS), rec.ctypes.data_as(array),
                 sums.ctypes.data_as(array))
    return run


def seconds(f):
    """Time of the processor that a call takes: other work on the machine counts less."""
    began = time.process_time()
    f()
    return time.process_time() - began


def beside_c(rounds):
    """Time of a step of the quasi-continuous law of order 3, engine and C, interleaved; True if the limit holds."""
    print("Speed: quasi-continuous law on the chain of 3, 3e6 steps of 1e-3 s")
    if not shutil.which("gcc"):
        print("  no gcc here, so there is nothing to compare with: install a C compiler")
        return True
    loop = smc.applications.perturbed_chain(hosmc.quasi_continuous(3), 3)
    parameters = np.array([v for s in ("law", "perturbation", "plant") for v in loop.stages[s].values.values()])
    rec, sums = np.zeros((ROWS + 1, 29)), np.zeros(14)
    with tempfile.TemporaryDirectory() as folder:
        same, bare = in_c(folder, "same"), in_c(folder, "bare", "-DBARE")
        jobs = {"C, bare loop": lambda: bare(parameters, np.zeros_like(rec), sums.copy()),
                "C, same work": lambda: same(parameters, rec, sums),
                "smcaero_nb": lambda: smc.simulate(loop, STEPS*DT, DT, DT, record=ROWS)}
        jobs["C, same work"]()
        run = smc.simulate(loop, STEPS*DT, DT, DT, record=ROWS)
        times = {name: [] for name in jobs}
        for _ in range(rounds):
            for name, job in jobs.items():
                times[name].append(seconds(job)/STEPS*1e9)
    columns = [run.t, run.r, *run.y, *run.e, *run.e_hat, *run.sigma, run.v, run.u, run.d, *vars(run.x).values()]
    columns += [q for pair in zip(run.low.sigma, run.high.sigma, strict=True) for q in pair]
    columns += [run.low.u, run.high.u, run.integral_v]
    apart = max(np.abs(a - c).max() for a, c in zip(columns, rec.T, strict=True))
    figures = [*(q*STEPS for q in run.mean_e), run.mean_u*STEPS, *run.tail_e, run.tail_sigma[0], run.tail_u, run.variation_u,
               *run.tail_sigma[1:], run.mean_v*(STEPS + 1)]
    apart_sums = max(abs(a/c - 1.0) for a, c in zip(figures, np.delete(sums, 10), strict=True))
    median = {name: statistics.median(t) for name, t in times.items()}
    for name, t in times.items():
        print(f"  {name:<14}{median[name]:7.2f} ns/step (fastest {min(t):.2f})")
    ratio = median["smcaero_nb"]/median["C, same work"]
    print(f"  ratio to C that does the same work {ratio:.3f} (goal {GOAL}, limit {LIMIT}); to the bare C loop "
          f"{median['smcaero_nb']/median['C, bare loop']:.3f}; medians of {rounds} rounds")
    print(f"  largest difference between the trajectories {apart:.1e} (limit {TOLERANCE:g}), between the sums {apart_sums:.1e}")
    return ratio <= LIMIT and apart <= TOLERANCE and apart_sums <= TOLERANCE


def of_each(rounds):
    """Time of a step of each law on its chain."""
    print("Each higher-order law on its chain, ns/step")
    families = {"quasi-continuous, rational": hosmc.quasi_continuous,
                "quasi-continuous, Levant 2005": lambda r: hosmc.quasi_continuous(r, "levant2005"),
                "nested": hosmc.nested, "adaptive continuous": hosmc.adaptive_continuous}
    for name, family in families.items():
        said = []
        for r in range(2, 6):
            loop = smc.applications.perturbed_chain(family(r), r)
            smc.simulate(loop, DT, DT, DT)
            t = [seconds(lambda loop=loop: smc.simulate(loop, 2e5*DT, DT, DT)) for _ in range(rounds)]
            said.append(f"r = {r} {statistics.median(t)/2e5*1e9:.0f}")
        print(f"  {name:<32}{', '.join(said)}")


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 15
    held = beside_c(count)
    of_each(max(count//3, 1))
    sys.exit(not held)
