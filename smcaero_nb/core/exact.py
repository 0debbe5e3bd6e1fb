"""The matrices that advance a linear plant exactly from step to step."""

import functools
from typing import Any

import numpy as np

from .program import Program

__all__ = ["constants", "integral"]


def constants(program: Program, loop: Any, dt: float) -> list[float]:
    r"""Return the entries of the matrices that a program with exact steps reads.

    They are those of :math:`\int_0^h e^{A s}\,ds`, row by row: for the middle of the step,
    h = dt/2, if its perturbation is taken there, then for h = dt. Without exact steps: none.
    """
    if not program.exact:
        return []
    A = loop.stages["plant"].A
    spans = (0.5*dt, dt)[-(len(program.exact)//len(A)**2):]
    return [q for h in spans for q in integral(A, h).ravel().tolist()]


def integral(A: np.ndarray, h: float) -> np.ndarray:
    """Return the integral of exp(A s) over s from 0 to h."""
    return _integral(tuple(map(tuple, A.tolist())), h)


@functools.lru_cache(maxsize=200)
def _integral(A: tuple[tuple[float, ...], ...], h: float) -> np.ndarray:
    from scipy.linalg import expm  # slow to import, so only here

    n = len(A)
    both = np.block([[np.array(A), np.eye(n)], [np.zeros((n, 2*n))]])
    with np.errstate(all="ignore"):  # what grows beyond all numbers ends the run as diverged
        return expm(both*h)[:n, n:]
