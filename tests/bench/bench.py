"""Benchmarks: the compiled loop beside the same loop hand-written in C, and what a first call costs.

``python tests/bench/bench.py [rounds]`` prints ratios taken in one run, because machines are noisy, and exits with an
error where a limit does not hold.
"""

import ctypes
import os
import pathlib
import shutil
import statistics
import subprocess
import sys
import tempfile
import time

import differentiators
import hosmc
import lander
import laws
import numpy as np

import smcaero_nb as smc

SOURCE = pathlib.Path(__file__).with_name("launch_vehicle.c")
GOAL, LIMIT = 1.10, 1.25  # engine / C that does the same work
FIRST, WARM = 8.0, 3.0  # first call of a new combination, and in a new process, / import of numba with a trivial function
TOLERANCE = 1e-10  # largest difference between the two trajectories
DURATION, DT, ROWS = 30.0, 1e-5, 2000


def seconds(f):
    """Time that a call takes."""
    began = time.perf_counter()
    f()
    return time.perf_counter() - began


def in_c(folder, name, *flags):
    """The loop in C, compiled now, as a function of arrays."""
    library = pathlib.Path(folder)/f"{name}.so"
    subprocess.run(["gcc", "-O3", "-march=native", "-ffp-contract=off", "-shared", "-fPIC", *flags, str(SOURCE),
                    "-o", str(library), "-lm"], check=True)
    array, whole = ctypes.POINTER(ctypes.c_double), ctypes.c_long
    f = ctypes.CDLL(str(library)).run
    f.argtypes, f.restype = [array, ctypes.c_double, whole, whole, whole, array, array], whole

    def run(parameters, n, rec, sums):
        return f(parameters.ctypes.data_as(array), DT, n, n//ROWS, int(0.8*n), rec.ctypes.data_as(array),
                 sums.ctypes.data_as(array))
    return run


def speed(rounds):
    """Time of a step, engine and C, interleaved; True if the limit holds."""
    print("Speed: launch vehicle, quasi-SMC on (69), 3e6 steps of 1e-5 s")
    if not shutil.which("gcc"):
        print("  no gcc here, so there is nothing to compare with: install a C compiler")
        return True
    loop = smc.lv.loop("quasi_smc", "eq69")
    b = {s: v.values for s, v in loop.stages.items() if v}
    parameters = np.array([*list(b["plant"].values())[:17], b["surface"]["c_0"], b["surface"]["c_int"], b["law"]["rho"],
                           b["law"]["eps"], b["allocation"]["G0"], b["reference"]["unit"], *b["perturbation"].values()])
    n = round(DURATION/DT)
    rec, sums = np.zeros((ROWS + 1, 25)), np.zeros(10)
    with tempfile.TemporaryDirectory() as folder:
        same, bare = in_c(folder, "same"), in_c(folder, "bare", "-DBARE")
        jobs = {"C, bare loop": lambda: bare(parameters, n, np.zeros_like(rec), sums.copy()),
                "C, same work": lambda: same(parameters, n, rec, sums),
                "smcaero_nb": lambda: smc.simulate(loop, DURATION, DT, record=ROWS)}
        jobs["C, same work"]()
        run = smc.simulate(loop, DURATION, DT, record=ROWS)
        times = {name: [] for name in jobs}
        for _ in range(rounds):
            for name, job in jobs.items():
                times[name].append(seconds(job)/n*1e9)
    columns = [run.t, run.r, *run.y, *run.e, *run.e_hat, run.sigma, run.v, run.u, run.d, *vars(run.x).values(),
               run.z.surface.integral, run.low.sigma, run.high.sigma, run.low.u, run.high.u, run.integral_v]
    apart = max(np.abs(a - c).max() for a, c in zip(columns, rec.T, strict=True))
    figures = [run.mean_e[0]*n, run.mean_e[1]*n, run.mean_u*n, *run.tail_e, run.tail_sigma, run.tail_u, run.variation_u,
               run.mean_v*(n + 1)]
    apart_sums = max(abs(a/c - 1.0) for a, c in zip(figures, np.delete(sums, 8), strict=True))
    median = {name: statistics.median(t) for name, t in times.items()}
    for name, t in times.items():
        print(f"  {name:<14}{median[name]:7.2f} ns/step (fastest {min(t):.2f})")
    ratio = median["smcaero_nb"]/median["C, same work"]
    print(f"  ratio to C that does the same work {ratio:.3f} (goal {GOAL}, limit {LIMIT}); to the bare C loop "
          f"{median['smcaero_nb']/median['C, bare loop']:.3f}; medians of {rounds} rounds")
    print(f"  largest difference between the trajectories {apart:.1e} (limit {TOLERANCE:g}), between the sums {apart_sums:.1e}")
    return ratio <= LIMIT and apart <= TOLERANCE and apart_sums <= TOLERANCE


TRIVIAL = "import numba; numba.njit(lambda x: x + 1.0)(1.0)"
WHOLE = "import smcaero_nb as smc; smc.simulate(smc.lv.loop('quasi_smc'), 1e-2, 1e-3)"
ANOTHER = "smc.simulate(smc.lv.loop('adaptive_super_twisting', 'r3'), 1e-2, 1e-3)"


def in_new_process(code, then, folder):
    """Time of `code` and of `then` after it in a new Python process whose compiled loops are kept in `folder`."""
    text = f"import time; a = time.perf_counter(); {code}; b = time.perf_counter(); {then}; print(b - a, time.perf_counter() - b)"
    out = subprocess.run([sys.executable, "-c", text], env={**os.environ, "SMCAERO_CACHE_DIR": folder}, check=True,
                         capture_output=True, text=True).stdout
    return map(float, out.split())


def start(rounds):
    """First calls, cold and from disk, against the import of numba with a trivial function; True if the limits hold."""
    print("First call: beside `import numba` and a trivial compiled function, in new processes")
    base, first, other, warm = [], [], [], []
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as folder:
            base.append(next(in_new_process(TRIVIAL, "pass", folder)))
            cold = list(in_new_process(WHOLE, ANOTHER, folder))
            first.append(cold[0])
            other.append(cold[1])
            warm.append(next(in_new_process(WHOLE, "pass", folder)))
    one = statistics.median(base)
    ratios = {}
    for name, t, limit in (("whole process, nothing compiled yet", first, FIRST), ("a further combination", other, FIRST),
                           ("whole process, compiled before", warm, WARM)):
        ratios[name] = statistics.median(t)/one, limit
        print(f"  {name:<38}{statistics.median(t):5.2f} s = {ratios[name][0]:.2f} times {one:.2f} s (limit {limit:g})")
    return all(r <= limit for r, limit in ratios.values())


def fixed(rounds):
    """Fixed cost of one call, for short runs."""
    loop = smc.lv.loop("quasi_smc")
    smc.simulate(loop, 1e-3, 1e-4)
    t = [seconds(lambda: smc.simulate(loop, 1e-3, 1e-4)) for _ in range(10*rounds)]
    print(f"One call of simulate, without its steps: {statistics.median(t)*1e3:.2f} ms")


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 15
    held = [speed(count), laws.beside_c(count), hosmc.beside_c(count), differentiators.speed(count), lander.beside_c(count),
            start(3)]
    fixed(count)
    laws.each_law(max(3, count//3))
    hosmc.of_each(max(3, count//3))
    lander.descents()
    good = "All limits hold." if shutil.which("gcc") else "What needs no C compiler holds; nothing was compared with C."
    print(good if all(held) else "A limit does not hold.")
    sys.exit(not all(held))
