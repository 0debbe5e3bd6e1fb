"""Derivatives of a record: the blocks of `differentiator`, run over it in one compiled pass."""

import math
import warnings
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from ..core import ParameterError
from ..core.cache import OPTIONS, compiled, kept
from ..core.content import fingerprint
from ..core.family import written
from ..core.signal import text
from ..records import EVEN, check_samples, columns, longest_step
from .differentiator import differentiator, orders
from .lipschitz import scale

__all__ = ["differentiate"]

ARGUMENTS = "t, f, out, first, L, gap, even"
TEXT = '''
gaps, h = -1, inf  # the record starts as if after a gap
for k in range(len(t)):
    before = h
    if k + 1 < len(t):
        h = t[k + 1] - t[k]
    if not (0.0 < h < inf and abs(f[k]) < inf{uneven}):
        return k, gaps
    if before > gap:
        gaps += 1
        piece = min(gaps, len(first) - 1)
        z = {first}
    {out}, z = step(f[k], z, {tau}, L)
return len(t), gaps
'''
_made = {}


def _pass(method, blk, n_d):
    """The pass for a block, from memory, from disk, or compiled now."""
    from numba import config, float64, njit

    plain = config.DISABLE_JIT  # pyright: ignore[reportAttributeAccessIssue]
    key = f"{__name__} {fingerprint(blk.f)}", plain
    if key not in _made:
        late = method == "implicit"
        names = dict(step=blk.f if plain else compiled(blk.f), inf=math.inf,
                     __name__=__name__)
        first = "".join(f"first[piece, {i}], " for i in range(len(blk.z0)))
        source = TEXT.format(first=f"({first})", tau="even" if late else "h",
                             uneven=f" and (abs(h - even) <= {EVEN}*even or h > gap)" if late
                             else "",
                             out=text((None,)*(n_d + 1) if n_d else None,
                                      (f"out[{i}, k]" for i in range(n_d + 1))))
        f = written("run", ARGUMENTS, source.strip(), names)
        if not plain:
            f = kept(njit(**OPTIONS)(f), key[0] + source)
            f.compile((float64[::1], float64[::1], float64[:, ::1], float64[:, ::1], float64,
                       float64, float64))
        _made[key] = f
    return _made[key]


def _start(t, f, n_d, span):
    """f, f', ..., f^(n_d) at the start of a piece, of the polynomial that fits best.

    It has two samples per coefficient.
    """
    n = min(max(int(np.searchsorted(t, t[0] + span)), 2*(n_d + 1)), len(t))
    fitted = np.polynomial.Polynomial.fit(t[:n], f[:n], min(n_d, max(n//2 - 1, 0)))
    return [float(fitted.deriv(i)(t[0])) for i in range(n_d + 1)]


def differentiate(t: ArrayLike, f: ArrayLike, L: float | str, n_d: int, n_f: int = 0,
                  method: str = "levant") -> np.ndarray:
    r"""Estimate the derivatives of a record in one pass.

    Parameters
    ----------
    t, f : array_like, shape (N,)
        Times [s], increasing, with even or uneven steps (`implicit`: even ones), and samples [f].
    L : float or "auto"
        Bound of :math:`|f^{(n_d+1)}|` [f]/s^(n_d + 1); ``"auto"`` takes what `lipschitz` finds in
        the record.
    n_d, n_f, method
        As in `differentiator`.

    Returns
    -------
    ndarray, shape (n_d + 1, N)
        Column k estimates f, f', ..., f^(n_d) at t_k: `implicit` from the samples up to k, the
        others from those before k.

    Raises
    ------
    ParameterError
        If the shapes do not fit, times do not increase, samples are not real finite numbers (but
        masked, complex, dates, text, switches), steps are uneven with `implicit`, or an order, a
        method or a bound is not allowed.

    Warns
    -----
    UserWarning
        If the record has gaps, steps of more than ten times what nine of ten do not exceed: they
        are named, and after each the estimates start anew. If estimates are beyond float64. And as
        `differentiator`.

    Notes
    -----
    These are the blocks of `differentiator`, run over the arrays; see there for the equation, the
    accuracy and its limits. The first estimates, and those after a gap, are f, 0, ..., 0 and have
    to settle; with ``L="auto"`` they are those of the polynomial of degree n_d that fits the next
    samples best, because the L of a steady motion is too small to get there. Taylor's terms take
    each step as long as it is. `implicit` takes steps that differ from their mean by less than a
    hundredth as even; if they really differ, that costs it its order: prefer `levant` unless the
    times are only rounded.

    References
    ----------
    Paper eqs (41)-(43).

    Examples
    --------
    >>> t = np.arange(5001)*1e-3
    >>> differentiate(t, np.sin(t), 1.0, 1)[:, -1].round(3)  # sin 5 = -0.959, cos 5 = 0.284
    array([-0.959,  0.283])
    """
    t, f = columns("differentiate", t, f, "f")
    n_d, n_f = orders("differentiate", n_d, n_f)
    blk = differentiator(n_d, n_f, method)
    first = np.array([blk.z0])
    if isinstance(L, str) and L == "auto":
        L, span, edges = scale(t, f, n_d)
        first = np.array([(*blk.z0[:n_f], *_start(t[a:b], f[a:b], n_d, span), 1.0)
                          for a, b in pairwise(edges)])
    blk = blk.with_(L=L)
    longest, even = longest_step(t), 0.0
    if method == "implicit" or not longest < math.inf:  # or the pass would not even start
        check_samples("differentiate", t, f, "f")
    if method == "implicit":
        even = np.diff(t)
        even = float(even[even <= longest].mean())
    out = np.empty((n_d + 1, len(t)))
    k, gaps = _pass(method, blk, n_d)(t, f, out, first, blk.values["L"], longest, even)
    if k < len(t):
        check_samples("differentiate", t, f, "f")
        raise ParameterError("differentiate: method = 'implicit' needs even steps, but that from "
                             f"t[{k}] = {t[k]:g} s is {t[k + 1] - t[k]:g} s, their mean {even:g} "
                             "s; method = 'levant' takes any")
    if not np.isfinite(out).all():
        warnings.warn("differentiate: estimates are beyond float64; count time or f in other units",
                      UserWarning, stacklevel=2)
    if gaps:
        at = np.flatnonzero(np.diff(t) > longest)
        said = ", ".join(f"{t[i + 1] - t[i]:g} s from t = {t[i]:g} s"
                         for i in at[:3]) + (", ..." if gaps > 3 else "")
        warnings.warn(f"differentiate: {gaps} gap{'s'*(gaps > 1)} in the record, {said}; after a "
                      "gap the estimates start anew",
                      UserWarning, stacklevel=2)
    return out
