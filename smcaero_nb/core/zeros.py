"""Zero dynamics: what a plant does while its sliding variable is held at zero."""

import functools
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from .card import Law
from .chain import Chain
from .leaves import at as leaf
from .linear import called, given, jacobian, motion, vector
from .program import parts
from .rows import row
from .signal import filled, flat, shape

if TYPE_CHECKING:
    from .run import Run

__all__ = ["named", "of_run", "pushed", "slid", "unstable", "zero_doubts", "zeros"]

HIT = 1e-6  # of the sum of the paths: an input acts on a derivative
SINGULAR = 1e9  # condition of the gains above which the inputs do not act one by one
AXIS = 1e-6  # of a zero: a real part that counts as positive
GROWN = 2.0  # factor in a run, from which a growing zero dynamics is a doubt


def zeros(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray) -> np.ndarray:
    r"""Return the zeros of x' = A x + B u, y = C x + D u: the modes left while y = 0.

    Differentiate each output until an input acts on it, :math:`y_i^{(r_i)} = F_i x + E_i u`. Then
    y = 0 takes :math:`u = -E^{-1} F x`, and the zeros are the eigenvalues of
    :math:`A - B E^{-1} F` on the states in which y and its derivatives below r vanish.

    Parameters
    ----------
    A, B, C, D : ndarray

    Returns
    -------
    ndarray of complex
        Empty also where there are not as many outputs as inputs, or E is singular: such a plant has
        no vector relative degree, and nothing is said of its zeros.

    References
    ----------
    A. Isidori, Nonlinear Control Systems (1995), sections 4.3 and 5.1.
    """
    n, rows, gains, rates = len(A), [], [], []
    if B.shape[1] != len(C):
        return np.empty(0, complex)
    for c, d in zip(C, D, strict=True):
        hit, size = d, np.abs(c)
        for _ in range(n + 1):
            if (np.abs(hit) > 0.0).any():
                break
            rows.append(c/(np.abs(c).max() or 1.0))
            hit, bound = c @ B, size @ np.abs(B)
            hit = np.where(np.abs(hit) > HIT*bound, hit, 0.0)
            c, size = c @ A, size @ np.abs(A)
        gains.append(hit)
        rates.append(c)
    E = np.array(gains)
    scale = np.abs(E).max(axis=1, keepdims=True)
    if not (scale > 0.0).all() or np.linalg.cond(E/scale) > SINGULAR or len(rows) >= n:
        return np.empty(0, complex)
    inner = A - B @ np.linalg.solve(E, np.array(rates))
    free = np.linalg.qr(np.array(rows).reshape(-1, n).T, mode="complete")[0][:, len(rows):]
    return np.linalg.eigvals(free.T @ inner @ free).astype(complex)


def unstable(found: np.ndarray) -> tuple[complex, ...]:
    """Return the zeros in the right half plane, one of each pair, the fastest first [1/s]."""
    right = [complex(q) for q in found if q.real > AXIS*abs(q) and q.imag >= 0.0]
    return tuple(sorted(right, key=lambda q: -q.real))


def named(found: tuple[complex, ...]) -> str:
    """Return zeros in words: "zeros at 0.25 +- 1.98j 1/s"."""
    pairs = [q.imag > 1e-9*abs(q) for q in found]
    said = [f"{q.real:.3g}" + f" +- {q.imag:.3g}j"*pair
            for q, pair in zip(found, pairs, strict=True)]
    several = len(found) > 1 or any(pairs)
    return f"{'zeros' if several else 'a zero'} at {', '.join(said)} 1/s"


# ---- of a loop -----------------------------------------------------------------------------------
def of_run(run: "Run") -> np.ndarray:
    """Return the zeros of a run's plant from v to sigma, linearised at the start of the run.

    Where the surface or a differentiator has memory, from v to the outputs: what they add does not
    grow. Empty where the plant is not smooth there, and where `zeros` says nothing.
    """
    at = given(run, 0) | {n: row(getattr(run, n), 0) for n in ("r", "y", "e", "v")}
    rate = motion(run)
    found, push = slid(run, at), pushed(run, at)
    if found is None or push is None:
        return np.empty(0, complex)
    x, v, floor = vector(at["x"]), vector(push[0]), 1e-3/(run.steps*run.dt or 1.0)
    with np.errstate(all="ignore"):
        A = jacobian(functools.partial(rate, at), x, floor)
        B = jacobian(lambda q: rate({**at, "u": push[1](q)}, x), v, floor)
        C = jacobian(lambda q: found(q, at["u"]), x, floor)
        D = jacobian(lambda q: found(x, push[1](q)), v, floor)
    if any(q is None or not np.isfinite(q).all() for q in (A, B, C, D)):
        return np.empty(0, complex)
    return zeros(A, B, C, D)  # pyright: ignore[reportArgumentType]


def _plain(b: Any) -> bool:
    """Whether blocks have no memory, and are not in series."""
    return not isinstance(b, Chain) and not any(q.states for q in parts(b))


def pushed(run: "Run", at: dict) -> tuple[Any, Callable] | None:
    """Return the law's v at a row and u as a function of it; where none allocates, u itself."""
    allocation = run.loop.stages["allocation"]
    if allocation is None:
        return at["u"], lambda q: filled(shape(at["u"]), iter(q.tolist()))
    if not _plain(allocation) or any(n in ("sigma", "u") for n in allocation.signals):
        return None
    form = shape(at["v"])
    return at["v"], lambda q: called(allocation, {**at, "v": filled(form, iter(q.tolist()))})


def slid(run: "Run", at: dict) -> Callable | None:
    """Return the sliding variables, one of each channel, as a function of x and u."""
    loop, form, y0 = run.loop, shape(at["x"]), vector(at["y"])
    output, surface = loop.stages["output"], loop.stages["surface"]
    through = surface and not loop.stages["differentiator"] and _plain(surface)
    if not (output is None or _plain(output)) or through and "u" in surface.signals:
        return None
    own = output and output.with_(**{n: v for n, v in loop.stages["plant"].values.items()
                                     if n in output.params})
    paths = [q.path for q in run.leaves("sigma" if through else "e") if not q.derivative]
    if not (output or through):  # the states are no outputs: the first is taken for one
        paths = paths[:1]

    def variables(x: np.ndarray, u: Any) -> np.ndarray:
        values = {**at, "x": filled(form, iter(x.tolist())), "u": u}
        y = called(own, values) if own else values["x"]
        e = vector(at["e"]) - (vector(y) - y0)
        s = filled(shape(at["e"]), iter(e.tolist()))
        if through:
            s = called(surface, {**values, "y": y, "e": s})
        return np.array([leaf(s, path) for path in paths], float)

    return variables


def zero_doubts(run: "Run") -> list[str]:
    """Return what unstable zero dynamics do to a loop under sliding mode control, in words.

    Returns
    -------
    list of str
        Empty where the loop does not slide, or where what grows does not double within the run. A
        law of your own without a card slides if sigma crosses zero in the second half of the run.
    """
    laws = [b for b in parts(run.loop.stages["law"]) if "sigma" in b.signals]
    slides = any(isinstance(b.card, Law) for b in laws)
    if not slides and any(b.card is None for b in laws):
        low, high = (np.array(flat(q.sigma))[:, len(run.t)//2:] for q in (run.low, run.high))
        slides = bool((low*high < 0.0).any())
    if not slides or not len(run.t):
        return []
    span = run.steps*run.dt
    found = tuple(q for q in unstable(of_run(run)) if q.real*span > math.log(GROWN))
    if not found:
        return []
    return [f"the plant has {named(found)} in the right half plane, from u to sigma: while sigma "
            f"is held at zero, its other states grow as exp({found[0].real:.3g} t), in this run by "
            f"{math.exp(min(found[0].real*span, 700.0)):.2g}; slide on another output"]
