"""Benchmarks of the laws on their chains: some beside the same loop hand-written in C, all in ns a
step.

``python tests/bench/laws.py [rounds]`` runs them alone.
"""

import math
import sys

import beside
import numpy as np

import smcaero_nb as smc
from smcaero_nb import block

DURATION, DT = 30.0, 1e-5


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

#: {name in laws.c: loop}. The C takes the law's parameters and initial states, then the plant's
#: initial states.
IN_C = {law.name: smc.ClosedLoop(law=law, **ONE)
        for law in (smc.smc1.sign_smc, smc.smc2.super_twisting, smc.smc2.adaptive_super_twisting)}

#: {library and law: loop}: whatever `each_law` prints.
LOOPS = {f"smc1 {n}": smc.ClosedLoop(law=getattr(smc.smc1, n), **ONE)
         for n in ("sign_smc", "quasi_smc", "saturation_smc", "tanh_smc", "adaptive_smc",
                   "adaptive_quasi_smc", "dual_layer_smc",
                   "dual_layer_quasi_smc")}
LOOPS |= {f"smc1 {n}, m = 2": smc.ClosedLoop(law=getattr(smc.smc1, n), **TWO)
          for n in ("unit_vector", "quasi_unit_vector", "adaptive_unit_vector",
                    "adaptive_quasi_unit_vector")}
LOOPS["smc1 dual_layer_unit_vector, m = 2"] = smc.ClosedLoop(law=smc.smc1.dual_layer_unit_vector(2),
                                                             **TWO)
LOOPS["smc1 unit_vector, decoupling, m = 2"] = smc.ClosedLoop(
    law=smc.smc1.unit_vector, **TWO, allocation=smc.smc1.decoupling(((2.0, 1.0), (-1.0, 3.0))))
LOOPS |= {f"smc2 {n}": smc.ClosedLoop(law=getattr(smc.smc2, n), **ONE)
          for n in ("super_twisting", "adaptive_super_twisting")}
LOOPS |= {f"smc2 {n}": smc.ClosedLoop(law=getattr(smc.smc2, n), surface=with_rate, **ONE)
          for n in ("twisting", "adaptive_twisting")}


def beside_c(rounds):
    """Time of a step of some laws, engine and C, interleaved; True if the limits hold."""
    print(f"Laws beside C that does the same work: {DURATION/DT:g} steps of {DT:g} s, medians of "
          f"{rounds} rounds")
    if beside.no_gcc():
        return True
    held = True
    for name, loop in IN_C.items():
        parameters = [*loop.stages["law"].values.values(), *loop.stages["plant"].z0]
        held &= beside.compare_loop(name, rounds, loop, "laws", parameters, function=name)
    return held


def each_law(rounds):
    """Print the time of a step of every law on its chain."""
    print(f"Laws on their chains, xi = sin t: medians of {rounds} rounds")
    for name, loop in LOOPS.items():
        smc.simulate(loop, 1e-3)
        times = beside.nanoseconds(rounds, DURATION/DT,
                                   lambda loop=loop: smc.simulate(loop, record=beside.ROWS))
        print(f"  {name:<38}{np.median(times):7.2f} ns/step")


if __name__ == "__main__":
    count = beside.rounds_asked(9)
    good = beside_c(count)
    each_law(max(3, count//3))
    sys.exit(not good)
