"""Benchmark of the lander: 240 s under the 1-SMC Lander beside the same loop hand-written in C, and
500 descents.

``python tests/bench/lander.py [rounds]`` runs it alone.
"""

import ctypes
import math
import sys

import beside
import numpy as np

import smcaero_nb as smc

COLUMNS = 47


def in_c(loop):
    """The loop in C: its steps, rows and sums."""
    p = {s: b.values for s, b in loop.stages.items() if b}
    n, m, rows = round(loop.duration/loop.dt), round(loop.tau/loop.dt), ctypes.c_long()
    P = [p["surface"][f"{c}__{k}"] for c in ("attitude", "descent")
         for k in ("c_0", "c_int", "a_b", "e_I", "w_max")]
    P += [p["law"][f"{c}__{k}"] for c in ("attitude", "descent")
          for k in ("gamma", "rho_max", "delta_1", "delta_2", "delta_3", "t_1", "t_2", "a",
                    "omega")]
    P += [p["law"][f"{c}__rho"] for c in ("attitude", "descent")]
    P += [p["allocation"][k] for k in ("m", "J", "l_a", "feedforward", "s_min")]
    P += [p["actuator"][f"{c}__{k}"] for c in ("attitude", "descent") for k in ("low", "high")]
    P += [*p["perturbation"].values(), *p["plant"].values()]
    every = -(-n//beside.ROWS)
    rec, sums = np.empty((-(-n//every) + 1, COLUMNS)), np.zeros(20)
    steps = beside.in_c("lander", "axxnnnnaap")(np.array(P, float), loop.dt, m*loop.dt, m, n, every,
                                                n - round(0.2*n), rec, sums,
                                                ctypes.byref(rows))
    return steps, rec[:rows.value], sums


def figures(run):
    """The sums and maxima of a run, in the order of the C, less the turns of u."""
    samples = math.floor(run.steps*run.loop.dt/run.loop.tau + 1e-9) + 1
    return [q*w for s, w in ((run.mean_e, run.steps), (run.tail_peaks.e, 1),
                             (run.mean_u, run.steps), (run.variation_u, 1),
                             (run.mean_v, samples), (run.max_sigma, 1), (run.max_u, 1))
            for q in beside.leaves(s)]


def beside_c(rounds):
    """Time of 240 s, engine and C, interleaved, at two steps; True if the limits hold."""
    print(f"Speed: lander, 240 s under the 1-SMC Lander, medians of {rounds} rounds")
    if beside.no_gcc():
        return True
    held = True
    for dt in (1e-3, 1e-4):
        loop = smc.rpl.loop().with_(dt=dt)
        kit, c = (lambda q=loop: smc.simulate(q, record=beside.ROWS)), (lambda q=loop: in_c(q))
        run, (steps, rec, sums) = kit(), c()
        assert run.steps == steps
        apart = beside.apart(run, rec, figures(run), np.delete(sums, [12, 13]))
        held &= beside.compare(f"dt = {dt:g} s", rounds, steps, kit, c, apart=apart, goal=1.15,
                               limit=1.35,
                               # the loop is chaotic: the two agree to the last bits or not at all
                               tolerance=1e-9)
    return held


def descents(n=500):
    """Time of n descents from random states, each to touchdown; True if all land softly."""
    loop, rng = smc.rpl.loop(), np.random.default_rng(0)
    smc.simulate(loop, 0.05)
    soft = []

    def descend():
        soft.append(smc.rpl.landing(smc.simulate(loop.with_(
            plant__theta=math.pi/2 + rng.uniform(-0.087, 0.087),
            plant__dtheta=rng.uniform(-0.1, 0.1),
            plant__altitude=rng.uniform(5900.0, 6700.0),
            plant__velocity=rng.uniform(-15.0, -5.0)))).soft)

    time = sum(beside.seconds(descend) for _ in range(n))
    print(f"  {sum(soft)} of {n} descents from random states land softly, in {time:.1f} s")
    return all(soft)


if __name__ == "__main__":
    held = beside_c(beside.rounds_asked(15))
    sys.exit(not (descents() and held))
