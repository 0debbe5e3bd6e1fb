"""Benchmark of the higher-order laws: ns a step of each on its chain, and the compiled loop beside
the same loop in C.

``python tests/bench/hosmc.py [rounds]`` runs it alone.
"""

import sys

import beside
import numpy as np

import smcaero_nb as smc
from smcaero_nb import hosmc

DT, STEPS = 1e-3, 3_000_000


def beside_c(rounds):
    """Time of a step of the quasi-continuous law of order 3, engine and C, interleaved; True if the
    limits hold."""
    print(f"Speed: higher-order law on the chain of 3, {STEPS:g} steps of {DT:g} s, medians of "
          f"{rounds} rounds")
    if beside.no_gcc():
        return True
    loop = smc.applications.perturbed_chain(hosmc.quasi_continuous(3), 3).with_(duration=STEPS*DT,
                                                                                dt=DT, tau=DT)
    parameters = [v for s in ("law", "perturbation", "plant")
                  for v in loop.stages[s].values.values()]
    return beside.compare_loop("quasi-continuous", rounds, loop, "hosmc", parameters, 1, bare=True)


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
            t = beside.nanoseconds(rounds, 2e5,
                                   lambda loop=loop: smc.simulate(loop, 2e5*DT, DT, DT))
            said.append(f"r = {r} {np.median(t):.0f}")
        print(f"  {name:<32}{', '.join(said)}")


if __name__ == "__main__":
    count = beside.rounds_asked(15)
    held = beside_c(count)
    of_each(max(count//3, 1))
    sys.exit(not held)
