"""Derivatives of recorded data: the blocks of `differentiator`, run over a record in one compiled pass."""

import math
import warnings

import numpy as np

from ..core import Param, ParameterError
from ..core.cache import compiled, fingerprint, kept
from ..core.signal import text
from .sampled import differentiator

__all__ = ["differentiate", "lipschitz"]

GAP = 10.0  # times the step that nine of ten do not exceed; a longer one is a gap
EVEN = 0.01  # of the mean step; steps that differ by less are taken as equal
TEXT = '''
def run(t, f, out, L, gap, even):
    z = {start}
    gaps, h = 0, t[1] - t[0]
    for k in range(len(t)):
        before = h
        if k + 1 < len(t):
            h = t[k + 1] - t[k]
        if not (0.0 < h < inf and abs(f[k]) < inf{uneven}):
            return k, gaps
        if before > gap:
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
        exec(TEXT.format(start=repr(blk.z0), tau="even" if late else "h",
                         uneven=f" and (abs(h - even) <= {EVEN}*even or h > gap)" if late else "",
                         out=text((None,)*(n_d + 1) if n_d else None, (f"out[{i}, k]" for i in range(n_d + 1)))), names)
        f = names["run"]
        if not config.DISABLE_JIT:
            f = kept(njit(nogil=True, error_model="numpy", no_cfunc_wrapper=True)(f), key[0])
            f.compile((float64[::1], float64[::1], float64[:, ::1], float64, float64, float64))
        _made[key] = f
    return _made[key]


def _record(owner, t, f):
    """The record as two arrays of float."""
    try:
        t, f = (np.ascontiguousarray(q, dtype=float) for q in (t, f))
    except (TypeError, ValueError) as why:
        raise ParameterError(f"{owner}: t and f must be arrays of real numbers: {why}") from None
    if t.ndim != 1 or t.shape != f.shape or len(t) < 2:
        raise ParameterError(f"{owner}: t and f must be two sequences of the same length, 2 or more; "
                             f"they have the shapes {t.shape} and {f.shape}")
    return t, f


def _refuse(owner, t, f):
    """Raise `ParameterError` if times do not increase or samples are no numbers."""
    if len(bad := np.flatnonzero(~np.isfinite(f))):
        raise ParameterError(f"{owner}: f[{bad[0]}] = {f[bad[0]]} at t = {t[bad[0]]:g} s, the first of {len(bad)} samples "
                             "that are no finite numbers; drop them and their times")
    steps = np.diff(t)
    if len(bad := np.flatnonzero(~((steps > 0.0) & (steps < np.inf)))):
        raise ParameterError(f"{owner}: t must increase from sample to sample, but t[{bad[0]}] = {t[bad[0]]:g} s and "
                             f"t[{bad[0] + 1}] = {t[bad[0] + 1]:g} s")


def _gap(t):
    """Length from which a step is a gap, from about ten thousand of the steps."""
    stride = max(1, len(t)//10_000)
    return GAP*float(np.quantile(t[1::stride] - t[:-1:stride], 0.9, method="lower"))


def lipschitz(t, f, n_d):
    r"""Bound L of the derivative n_d + 1 of a noisy record, estimated: what ``L="auto"`` means in `differentiate`.

    .. math:: L = 2\max_k\frac{|\Delta_{2m}^{n_d+1} f_k|}{(2mh)^{n_d+1}}, \qquad m = 1, 2, 4, ... \text{ the first with }
        \frac{S_m}{S_{2m}} < 2^{(n_d+1)/2}

    Parameters
    ----------
    t, f : array_like, shape (N,)
        Times [s] and samples [f], as in `differentiate`; of a record with gaps, the longest piece serves.
    n_d : int
        Order of the differentiator.

    Returns
    -------
    float
        L [f]/s^(n_d + 1).

    Raises
    ------
    ParameterError
        A record that `differentiate` would refuse, or of fewer than 4 (n_d + 1) samples.

    Notes
    -----
    :math:`S_m` is the largest difference of order n_d + 1 over m samples each, divided by its step. Noise makes it fall by
    :math:`2^{n_d+1}` when m doubles; the derivative of f leaves it as it is. Where the fall is less than half of that, on the
    logarithmic scale, the derivative stands out, and twice its size is the bound. It finds white noise of unknown size and
    rounding, with n_d up to 3 or so; a part of f that is smaller than the noise is lost, and a tone is no noise.

    References
    ----------
    Not in the paper.

    Examples
    --------
    >>> t = np.arange(5001)*1e-3
    >>> lipschitz(t, np.sin(t), 1)  # |sin''| <= 1
    1.99...
    """
    t, f = _record("lipschitz", t, f)
    n_d = Param(low=0, high=12).check("lipschitz", "n_d", n_d, int)
    _refuse("lipschitz", t, f)
    steps = np.diff(t)
    edges = np.array([0, *(np.flatnonzero(steps > _gap(t)) + 1), len(t)])
    i = np.argmax(np.diff(edges))
    t, f = t[edges[i]:edges[i + 1]], f[edges[i]:edges[i + 1]]
    steps, n = steps[edges[i]:edges[i + 1] - 1], n_d + 1
    h = steps.mean() if len(steps) else np.inf
    m, S = math.ceil(steps.max(initial=0.0)/h - EVEN), []  # within a step, interpolation would pass for smoothness
    if len(t) < 4*n*m or len(t) < 4:
        raise ParameterError(f"lipschitz: {len(t)} samples without a gap are too few; n_d = {n_d} needs {4*n*max(m, 1)} or more")
    if np.ptp(steps) > EVEN*h:
        f = np.interp(t[0] + h*np.arange(len(t)), t, f)
    while 2*n*m <= len(f) and (len(S) < 2 or S[-2] >= 2.0**(n/2)*S[-1]):
        stride = max(1, m//8)
        g = f[::stride]
        for _ in range(n):
            g = g[m//stride:] - g[:-(m//stride)]
        S.append(np.abs(g).max()/(m//stride*stride*h)**n)
        m *= 2
    return max(2.0*float(S[-1]), 1e-9)


def differentiate(t, f, L, n_d, n_f=0, method="levant"):
    r"""Derivatives of recorded data, in one pass.

    Parameters
    ----------
    t, f : array_like, shape (N,)
        Times [s], increasing, with even or uneven steps (`implicit`: even ones), and samples [f].
    L : float or "auto"
        Bound of :math:`|f^{(n_d+1)}|` [f]/s^(n_d + 1); ``"auto"`` takes what `lipschitz` finds in the record.
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
        The record has gaps, steps of more than ten times what nine of ten do not exceed: they are named, and after each the
        estimates start anew, from the next sample and zeros. And as `differentiator`.

    Notes
    -----
    These are the blocks of `differentiator`, run over the arrays; see there for the equation, the accuracy and its limits.
    The first estimates are f(0), 0, ..., 0 and have to settle. Taylor's terms take each step as long as it is. `implicit`
    takes steps that differ from their mean by less than a hundredth as even.

    References
    ----------
    Paper eqs (41)-(43).

    Examples
    --------
    >>> t = np.arange(5001)*1e-3
    >>> differentiate(t, np.sin(t), 1.0, 1)[:, -1].round(3)  # sin 5 = -0.959, cos 5 = 0.284
    array([-0.959,  0.283])
    """
    t, f = _record("differentiate", t, f)
    blk = differentiator(n_d, n_f, method)
    blk = blk.with_(L=lipschitz(t, f, n_d) if isinstance(L, str) and L == "auto" else L)
    gap, even = _gap(t), 0.0
    if method == "implicit":
        _refuse("differentiate", t, f)
        even = np.diff(t)
        even = float(even[even <= gap].mean())
    out = np.empty((n_d + 1, len(t)))
    k, gaps = _pass(method, blk, n_d)(t, f, out, blk.values["L"], gap, even)
    if k < len(t):
        _refuse("differentiate", t, f)
        raise ParameterError(f"differentiate: method = 'implicit' needs even steps, but that from t[{k}] = {t[k]:g} s is "
                             f"{t[k + 1] - t[k]:g} s, their mean {even:g} s; method = 'levant' takes any")
    if gaps:
        at = np.flatnonzero(np.diff(t) > gap)
        said = ", ".join(f"{t[i + 1] - t[i]:g} s from t = {t[i]:g} s" for i in at[:3]) + (", ..." if gaps > 3 else "")
        warnings.warn(f"differentiate: {gaps} gap{'s'*(gaps > 1)} in the record, {said}; after a gap the estimates start anew",
                      UserWarning, stacklevel=2)
    return out
