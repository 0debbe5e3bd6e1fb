"""Seeded designs that meet what the laws' theorems ask for: no run of one may raise a doubt.

``python tests/designs.py [count]`` runs every law at three steps, all presets, and 200 designs, or
as many as are asked for.
"""

import math
import sys

import numpy as np

from smcaero_nb import block, differentiators, hosmc, simulate, smc1, smc2
from smcaero_nb.applications import double_integrator, perturbed_chain
from smcaero_nb.core import reaching_time
from smcaero_nb.hosmc.nested import LEAST as NESTED
from smcaero_nb.hosmc.quasi_continuous import LEAST


@block
def measured(x):
    """Without derivatives."""
    return -x[0]


@block
def place(x):
    """Position alone."""
    return x[0]


def relays(g, L, dL):
    """Gains of first-order laws, g times the bound."""
    return dict(rho=g*L)


def super_twisted(g, L, dL):
    return dict(beta=g*dL, lam=np.sqrt(g*(g + 1.0)*dL))


def twisted(g, L, dL):
    return dict(alpha_1=2*g*dL, alpha_2=g*dL, L=min(dL, 0.99*g*dL), v_M=1.2*g*L)


def as_it_is(g, L, dL):
    return {}


def homogeneous(least):
    return lambda g, L, dL: dict(alpha=g*least, L=L)


#: law, relative degree, gains
DESIGNS = [
    *((b, 1, relays) for b in (smc1.sign_smc, smc1.quasi_smc, smc1.saturation_smc, smc1.tanh_smc)),
    *((b, 1, as_it_is) for b in (
        smc1.adaptive_smc, smc1.adaptive_quasi_smc, smc1.dual_layer_smc, smc1.dual_layer_quasi_smc,
        smc2.adaptive_super_twisting, smc2.adaptive_twisting)),
    (smc2.super_twisting, 1, super_twisted), (smc2.twisting, 1, twisted),
    *((hosmc.quasi_continuous(r, f), r, homogeneous(LEAST[f][r])) for f in LEAST
      for r in (2, 3, 4)),
    *((hosmc.nested(r), r, homogeneous(NESTED[r] or 1.5)) for r in (2, 3, 4)),
    *((hosmc.adaptive_continuous(r), r, as_it_is) for r in (2, 3, 4)),
]
SURFACED = [q for q in DESIGNS if q[1] == 1 and q[0].r is None]  # on e' + 2.5 e

#: More than the error of the estimate, for adaptive laws behind a differentiator.
ACCEPTED = dict(adaptive_smc=dict(law__delta=0.3), adaptive_quasi_smc=dict(law__delta=0.3),
                adaptive_super_twisting=dict(law__mu=0.1))


def estimated(law, r):
    """A chain of which the first state alone is measured."""
    order = differentiators.differentiator(r - 1)
    return perturbed_chain(law, r).with_(output=measured, differentiator=order)


BASES = [*((b, r, gains, perturbed_chain(b, r)) for b, r, gains in DESIGNS),
         *((b, r, gains, estimated(b, r)) for b, r, gains in DESIGNS if r > 1),
         *((b, 2, gains, double_integrator(b).with_(
             output=place, differentiator=differentiators.differentiator(1), duration=20.0))
           for b, _, gains in SURFACED)]


def design(rng, law, r, gains, loop):
    """A loop with random gains, perturbation and start."""
    g, share = rng.uniform(1.05, 3.0), rng.uniform(0.2, 0.95)
    w, L, start = rng.uniform(0.5, 1.5), rng.uniform(0.5, 1.5), rng.uniform(0.3, 2.0)
    if r > 1 or gains is as_it_is:
        L = 1.0  # their gains are in units of the bound, or their own
    values = gains(g, L, w*L)
    changes = {f"law__{n}": float(v) for n, v in values.items()}
    if loop.stages["differentiator"]:
        if not law.card.adaptive:
            most = values.get("alpha", g)*L
        elif r > 2 or law.r == 2:
            most = 3.0*law.values["gamma_1"]
        else:
            most = 4.0
            changes |= ACCEPTED.get(law.name, {})
        changes["differentiator__L"] = float(L + most + (2.5*most if law.r is None else 0.0))
    if loop.stages["plant"].name == "mass":
        push = dict(plant__s=start, perturbation__d_0=0.0, perturbation__d_1=share*L)
        return loop.with_(**changes, **push, perturbation__omega=w)
    return loop.with_(**changes, plant__s0=start, perturbation__xi_1=share*L,
                      perturbation__omega=w)


def doubtful(count, seed=3, kinds=BASES, **how):
    """(loop, doubts) of the designs among `count` that raise one."""
    rng = np.random.default_rng(seed)
    runs = ((loop := design(rng, *kinds[i % len(kinds)]), simulate(loop, record=1000, **how))
            for i in range(count))
    return [(loop, said) for loop, run in runs if (said := run.doubts())]


def settled(law, r, tau, **how):
    """Runs of a law on its chain, with and without perturbation."""
    loop = perturbed_chain(law, r)
    return [simulate(loop.with_(perturbation__xi_1=xi), dt=tau, tau=tau, **how)
            for xi in (0.8, 0.0)]


def judged(law, run):
    """Assert that a run slides; adaptive laws that accept too little for their step do not."""
    time, = reaching_time(run)
    if law.name in ("adaptive_smc", "adaptive_super_twisting",
                    "adaptive_twisting") and run.tau == 1e-2:
        assert time == math.inf and "still grows" in run.doubts()[0], law
    else:
        assert 0.0 < time < 0.7*run.t[-1] and run.doubts() == [], (law, run.tau, time)


if __name__ == "__main__":
    from test_made import LOOPS
    from test_presets import DOUBTS

    asked = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    for b, degree, _ in DESIGNS:
        for step in (1e-2, 1e-3, 1e-4):
            for done in settled(b, degree, step):
                judged(b, done)
    print(f"{len(DESIGNS)} laws slide at every step")
    for name, loop in LOOPS.items():
        said = simulate(loop).doubts()
        assert bool(said) == (name in DOUBTS), (name, said)
    print(f"of {len(LOOPS)} presets {len(DOUBTS)} raise a doubt, as proved")
    wrong = doubtful(asked)
    for loop, said in wrong:
        print(loop, *said, "", sep="\n")
    print(f"{asked} designs, {len(wrong)} with a doubt")
    sys.exit(bool(wrong))
