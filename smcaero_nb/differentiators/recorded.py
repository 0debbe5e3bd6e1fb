"""Derivatives of recorded data: the blocks of `differentiator`, run over a record in one compiled pass."""

import math
import warnings

import numpy as np

from ..core import ParameterError
from ..core.cache import compiled, fingerprint, kept
from ..core.signal import text
from .sampled import differentiator

__all__ = ["differentiate"]

GAP = 10.0  # median steps; a longer step is a gap
EVEN = 0.01  # median steps; implicit takes steps that differ by less as equal
TEXT = '''
def run(t, f, out, L, median):
    z = {start}
    gaps, h = 0, t[1] - t[0]
    for k in range(len(t)):
        before = h
        if k + 1 < len(t):
            h = t[k + 1] - t[k]
        if not (0.0 < h < inf and abs(f[k]) < inf{even}):
            return k, gaps
        if before > {gap}*median:
            z = {start}
            gaps += 1
        {out}, z = step(f[k], z, {tau}, L)
    return len(t), gaps
'''
_made = {}


def _pass(method, blk, n_d):
    """The pass for a block, from memory, from disk, or compiled now."""
    from numba import config, float64, njit

    key = f"differentiate {fingerprint(blk.f)}", config.DISABLE_JIT
    if key not in _made:
        late = method == "implicit"
        names = dict(step=blk.f if config.DISABLE_JIT else compiled(blk.f), inf=math.inf, __name__=__name__)
        exec(TEXT.format(gap=GAP, start=repr(blk.z0), tau="median" if late else "h",
                         even=f" and (abs(h - median) <= {EVEN}*median or h > {GAP}*median)" if late else "",
                         out=text((None,)*(n_d + 1) if n_d else None, (f"out[{i}, k]" for i in range(n_d + 1)))), names)
        f = names["run"]
        if not config.DISABLE_JIT:
            f = kept(njit(nogil=True, error_model="numpy", no_cfunc_wrapper=True)(f), key[0])
            f.compile((float64[::1], float64[::1], float64[:, ::1], float64, float64))
        _made[key] = f
    return _made[key]


def _record(t, f):
    """The record as two arrays of float."""
    try:
        t, f = (np.ascontiguousarray(q, dtype=float) for q in (t, f))
    except (TypeError, ValueError) as why:
        raise ParameterError(f"differentiate: t and f must be arrays of real numbers: {why}") from None
    if t.ndim != 1 or t.shape != f.shape or len(t) < 2:
        raise ParameterError(f"differentiate: t and f must be two sequences of the same length, 2 or more; "
                             f"they have the shapes {t.shape} and {f.shape}")
    return t, f


def differentiate(t, f, L, n_d, n_f=0, method="levant"):
    r"""Derivatives of recorded data, in one pass.

    Parameters
    ----------
    t, f : array_like, shape (N,)
        Times [s], increasing, with even or uneven steps (`implicit`: even ones), and samples [f].
    L : float
        Bound of :math:`|f^{(n_d+1)}|` [f]/s^(n_d + 1).
    n_d, n_f, method
        As in `differentiator`.

    Returns
    -------
    ndarray, shape (n_d + 1, N)
        Column k estimates f, f', ..., f^(n_d) at t_k: `implicit` from the samples up to k, the others from those before k.

    Raises
    ------
    ParameterError
        Shapes that do not fit, times that do not increase, samples that are no numbers, uneven steps with `implicit`, an
        order, a method or a bound that is not allowed.

    Warns
    -----
    UserWarning
        The record has gaps, steps of more than ten times the median: they are named, and after each the estimates start
        anew from the next sample and zeros. And as `differentiator`.

    Notes
    -----
    These are the blocks of `differentiator`, run over the arrays; see there for the equation, the accuracy and its limits.
    The first estimates are f(0), 0, ..., 0 and have to settle. Taylor's terms take each step as long as it is. `implicit`
    takes steps that differ from the median by less than a hundredth as even.

    References
    ----------
    Paper eqs (41)-(43).

    Examples
    --------
    >>> t = np.arange(5001)*1e-3
    >>> differentiate(t, np.sin(t), 1.0, 1)[:, -1].round(3)  # sin 5 = -0.959, cos 5 = 0.284
    array([-0.959,  0.283])
    """
    t, f = _record(t, f)
    blk = differentiator(n_d, n_f, method)
    stride = max(1, len(t)//10_000)
    median = float(np.median(t[1::stride] - t[:-1:stride]))
    out = np.empty((n_d + 1, len(t)))
    L = blk.with_(L=L).values["L"]
    k, gaps = _pass(method, blk, n_d)(t, f, out, L, median)
    if k < len(t):
        raise _fault(t, f, k)
    if gaps:
        _warn_of(t, median)
    return out


def _fault(t, f, k):
    """The error for the sample at which the pass ended."""
    if not np.isfinite(f[k]):
        return ParameterError(f"differentiate: f[{k}] = {f[k]}, one of {np.count_nonzero(~np.isfinite(f))} samples that are no "
                              "finite numbers; drop them and their times")
    if not 0.0 < t[k + 1] - t[k] < np.inf:
        return ParameterError(f"differentiate: t must increase from sample to sample, but t[{k}] = {t[k]:g} s and "
                              f"t[{k + 1}] = {t[k + 1]:g} s")
    return ParameterError(f"differentiate: method = 'implicit' needs a uniform record, but the step after t[{k}] = {t[k]:g} s is "
                          f"{t[k + 1] - t[k]:g} s; method = 'levant' takes any steps")


def _warn_of(t, median):
    """Name the gaps of a record."""
    steps = np.diff(t)
    at = np.flatnonzero(steps > GAP*median)
    said = ", ".join(f"{steps[i]:g} s from t = {t[i]:g} s" for i in at[:3]) + (", ..." if len(at) > 3 else "")
    warnings.warn(f"differentiate: {len(at)} gap{'s'*(len(at) > 1)} of more than {GAP:g} steps of {median:g} s in the record: "
                  f"{said}; after a gap the estimates start anew", UserWarning, stacklevel=3)
