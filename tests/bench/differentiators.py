"""Benchmark of `differentiate`: 1e6 samples of order 5 beside the same update hand-written in C.

``python tests/bench/differentiators.py [rounds]`` runs it alone; ``bench.py`` may call `speed`.
"""

import sys

import beside
import numpy as np

from smcaero_nb.differentiators import differentiate

N, L = 1_000_000, 2.0


def in_c(t, f):
    """The estimates of a record, in C."""
    out = np.empty((6, N))
    assert beside.in_c("differentiators", "aaanxx", name="levant_5")(t, f, out, N, L,
                                                                     10.0*(t[1] - t[0])) == N
    return out


def speed(rounds):
    """Time of a sample, kit and C, interleaved, uniform record and uneven one; True if the limits
    hold."""
    print(f"Differentiator of order 5, levant, {N:g} samples: medians of {rounds} rounds")
    if beside.no_gcc():
        return True
    held, rng = True, np.random.default_rng(0)
    for name, spread in (("uniform", 0.0), ("uneven", 0.5)):
        t = np.cumsum(1e-3*(1.0 + spread*rng.uniform(-1.0, 1.0, N)))
        f = np.sin(t) + np.cos(0.5*t) + 1e-3*rng.uniform(-1.0, 1.0, N)
        kit, c = (lambda t=t, f=f: differentiate(t, f, L, 5)), (lambda t=t, f=f: in_c(t, f))
        hand = c()
        # of the largest estimate
        apart = np.max(np.abs(kit() - hand).max(axis=1)/np.abs(hand).max(axis=1))
        held &= beside.compare(name, rounds, N, kit, c, apart=[apart], tolerance=1e-9,
                               step="sample")
    return held


if __name__ == "__main__":
    sys.exit(not speed(beside.rounds_asked(9)))
