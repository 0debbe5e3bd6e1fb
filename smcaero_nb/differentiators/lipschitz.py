"""Bound of the highest derivative, estimated from a record."""

import math

import numpy as np
from numpy.typing import ArrayLike

from ..core import Param, ParameterError
from ..records import EVEN, longest_step, record

__all__ = ["lipschitz", "scale"]


def lipschitz(t: ArrayLike, f: ArrayLike, n_d: int) -> float:
    r"""Estimate the bound L of the derivative n_d + 1 of a noisy record.

    This is what ``L="auto"`` means in `differentiate`.

    .. math:: L = 2\max_k\frac{|\Delta_{2m}^{n_d+1} f_k|}{(2mh)^{n_d+1}},
        \qquad m = 1, 2, 4, ... \text{ the first with }
        \frac{S_m}{S_{2m}} < 2^{(n_d+1)/2}

    Parameters
    ----------
    t, f : array_like, shape (N,)
        Times [s] and samples [f], as in `differentiate`; of a record with gaps, the longest piece
        serves.
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
    :math:`S_m` is the largest difference of order n_d + 1 over m samples each, divided by its step.
    Noise makes it fall by :math:`2^{n_d+1}` when m doubles; the derivative of f leaves it as it is.
    Where the fall is less than half of that, on the logarithmic scale, the derivative stands out,
    and twice its size is the bound. It copes with white noise of unknown size and with rounding;
    with n_d above 3 it may be too small by a factor of 3 or so in noise. A part of f that is
    smaller than the noise is lost, and a tone does not count as noise. L is at least what rounding
    may hide: the machine epsilon times the maximum :math:`|f|` (of f = 0: times 1), over the length
    of the record to the power n_d + 1.

    References
    ----------
    Not in the paper.

    Examples
    --------
    >>> t = np.arange(5001)*1e-3
    >>> lipschitz(t, np.sin(t), 1)  # |sin''| <= 1
    1.99...
    """
    return scale(t, f, n_d)[0]


def scale(t: ArrayLike, f: ArrayLike, n_d: int) -> tuple[float, float, np.ndarray]:
    """The bound, and what else `differentiate` needs to start.

    That is the time over which the derivative n_d + 1 stands out of the noise, and where the pieces
    between gaps begin.
    """
    t, f = record("lipschitz", t, f, "f")
    n_d = Param(low=0, high=12).check("lipschitz", "n_d", n_d, int)
    with np.errstate(all="ignore"):
        found = _scale(t, f, n_d)
    if not 0.0 < found[0] < np.inf:
        raise ParameterError(f"lipschitz: the bound of derivative {n_d + 1} is beyond float64, "
                             f"with t from {t[0]:g} to {t[-1]:g} s and f up to "
                             f"{np.abs(f).max():g}; count time or f in other units")
    return found


def _scale(t, f, n_d):
    steps = np.diff(t)
    edges = np.array([0, *(np.flatnonzero(steps > longest_step(t)) + 1), len(t)])
    i = np.argmax(np.diff(edges))
    t, f = t[edges[i]:edges[i + 1]], f[edges[i]:edges[i + 1]]
    steps, n = steps[edges[i]:edges[i + 1] - 1], n_d + 1
    h = steps.mean() if len(steps) else np.inf
    # within a step, interpolation would pass for smoothness
    m, S = math.ceil(steps.max(initial=0.0)/h - EVEN), []
    if len(t) < 4*n*m or len(t) < 4:
        raise ParameterError(f"lipschitz: {len(t)} samples without a gap are too few; n_d = {n_d} "
                             f"needs {4*n*max(m, 1)} or more")
    if np.ptp(steps) > EVEN*h:
        f = np.interp(t[0] + h*np.arange(len(t)), t, f)
    while 2*n*m <= len(f) and (len(S) < 2 or S[-2] >= 2.0**(n/2)*S[-1]):
        stride = max(1, m//8)
        g = f[::stride]
        for _ in range(n):
            g = g[m//stride:] - g[:-(m//stride)]
        S.append(np.abs(g).max()/(m//stride*stride*h)**n)
        m *= 2
    least = np.finfo(float).eps*(np.abs(f).max() or 1.0)/(t[-1] - t[0])**n
    return max(2.0*float(S[-1]), float(least)), n*m//2*h, edges
