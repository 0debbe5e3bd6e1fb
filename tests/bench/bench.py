"""Benchmarks: the compiled loop beside the same loop hand-written in C, and what a first call
costs.

``python tests/bench/bench.py [rounds]`` prints ratios taken in one run, because machines are noisy,
and exits with an error where a limit does not hold.
"""

import dataclasses
import os
import subprocess
import sys
import tempfile

import beside
import differentiators
import hosmc
import lander
import laws
import numpy as np

import smcaero_nb as smc
from smcaero_nb.core.assumptions import _assumed, _limited, _moving

# first call of a new combination, and in a new process, / import of numba with a trivial function
FIRST, WARM = 8.0, 3.0
IMPORT = 1.4  # of the kit, / that of numba
CALL = 0.2  # ms
# of the run, and ms, whichever is more, for what is said of sliding
SHARE, LEAST = 0.05, 1.0


def speed(rounds):
    """Time of a step, engine and C, interleaved; True if the limits hold."""
    print(f"Speed: launch vehicle, 3e6 steps of 1e-5 s, medians of {rounds} rounds")
    if beside.no_gcc():
        return True
    loop = smc.lv.loop("quasi_smc", "eq69").with_(duration=30.0, dt=1e-5)
    b = {s: v.values for s, v in loop.stages.items() if v}
    parameters = [*list(b["plant"].values())[:17], b["surface"]["c_0"], b["surface"]["c_int"],
                  b["law"]["rho"], b["law"]["eps"],
                  b["allocation"]["G0"], b["reference"]["unit"], *b["perturbation"].values()]
    return beside.compare_loop("quasi-SMC on (69)", rounds, loop, "launch_vehicle", parameters,
                               bare=True)


TRIVIAL = "import numba; numba.njit(lambda x: x + 1.0)(1.0)"
WHOLE = "import smcaero_nb as smc; smc.simulate(smc.lv.loop('quasi_smc'), 1e-2, 1e-3)"
ANOTHER = "smc.simulate(smc.lv.loop('adaptive_super_twisting', 'r3'), 1e-2, 1e-3)"


def in_new_process(code, then, folder):
    """Time of `code` and of `then` after it in a new Python process whose compiled loops are kept
    in `folder`."""
    text = (f"import time; a = time.perf_counter(); {code}; b = time.perf_counter(); {then}; "
            "print(b - a, time.perf_counter() - b)")
    out = subprocess.run([sys.executable, "-c", text],
                         env={**os.environ, "SMCAERO_CACHE_DIR": folder}, check=True,
                         capture_output=True, text=True).stdout
    return map(float, out.split())


def start(rounds):
    """First calls, cold and from disk, against the import of numba with a trivial function; True if
    the limits hold."""
    print("First call: beside `import numba` and a trivial compiled function, in new processes")
    base, first, other, warm = [], [], [], []
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as folder:
            base.append(next(in_new_process(TRIVIAL, "pass", folder)))
            cold = list(in_new_process(WHOLE, ANOTHER, folder))
            first.append(cold[0])
            other.append(cold[1])
            warm.append(next(in_new_process(WHOLE, "pass", folder)))
    one, held = np.median(base), True
    for name, t, limit in (("whole process, nothing compiled yet", first, FIRST),
                           ("a further combination", other, FIRST),
                           ("whole process, compiled before", warm, WARM)):
        median = np.median(t)
        print(f"  {name:<38}{median:5.2f} s = {median/one:.2f} times {one:.2f} s (limit {limit:g})")
        held = held and median/one <= limit
    return held


def imports(rounds):
    """Import of the kit against that of numba, in new processes; True if the limit holds."""
    with tempfile.TemporaryDirectory() as folder:
        times = np.array([[next(in_new_process(f"import {name}", "pass", folder))
                           for name in ("smcaero_nb", "numba")] for _ in range(rounds)])
    kit, numba = np.median(times, axis=0)
    print(f"Import: smcaero_nb {kit:.2f} s = {kit/numba:.2f} times numba, {numba:.2f} s "
          f"(limit {IMPORT:g})")
    return kit/numba <= IMPORT


def fixed(rounds):
    """Fixed cost of one call, for short runs; True if the limit holds."""
    loop = smc.lv.loop("quasi_smc")
    smc.simulate(loop, 1e-3, 1e-4)
    t = np.median(beside.nanoseconds(10*rounds, 1e6, lambda: smc.simulate(loop, 1e-3, 1e-4)))
    print(f"One call of simulate, without its steps: {t:.2f} ms (limit {CALL:g})")
    return t <= CALL


def sliding(rounds):
    """What judging whether a run slides costs beside it; True if the limits hold."""
    print("Whether a run slides, beside the run, least of the rounds:")
    angle = smc.differentiators.differentiator(1).with_(L=6.0)
    loops = {"launch vehicle, output feedback": smc.lv.loop("hosm", "output_feedback"),
             "lander": smc.rpl.loop("adaptive_smc"),
             "motor": smc.applications.dc_motor("quasi_continuous").with_(differentiator=angle),
             "chain": smc.applications.perturbed_chain(smc.hosmc.nested(3), 3)}
    held = True
    for name, loop in loops.items():
        run = smc.simulate(loop)
        whole = beside.nanoseconds(rounds, 1e6, lambda loop=loop: smc.simulate(loop)).min()
        parts = []
        for judge in (_assumed, _moving, _limited):
            def judged(run=run, judge=judge):  # the last one has what the one before it found
                judge(run if judge is _limited else dataclasses.replace(run))

            parts += [np.min(beside.nanoseconds(rounds, 1e6, judged))]
        limit = max(SHARE*whole, LEAST)
        said = ", ".join(f"{q:.2f}" for q in parts)
        print(f"  {name:<34}{whole:6.2f} ms; theorem, sigma and gain, actuator {said} ms each "
              f"(limit {limit:.2f})")
        held = held and max(parts) <= limit
    return held


if __name__ == "__main__":
    count = beside.rounds_asked(15)
    held = [speed(count), laws.beside_c(count), hosmc.beside_c(count), differentiators.speed(count),
            lander.beside_c(count),
            start(3), imports(7), fixed(count), sliding(count)]
    laws.each_law(max(3, count//3))
    hosmc.of_each(max(3, count//3))
    held.append(lander.descents())
    good = ("All limits hold." if beside.GCC
            else "What needs no C compiler holds; nothing was compared with C.")
    print(good if all(held) else "A limit does not hold.")
    sys.exit(not all(held))
