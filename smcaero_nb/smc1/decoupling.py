"""Decoupling of several inputs: from the law's v to the inputs u."""

import inspect
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from ..core import Block, Param, block
from ..core.card import Allocation
from ..core.family import family, written
from ..core.param import refused
from ..core.signal import solved
from ..records import numbers
from ..sources import ISIDORI_1995, KODE

__all__ = ["decoupling"]

NEAR, SINGULAR = 1e4, 1e15  # condition numbers: warn, refuse
CARD = Allocation(source=(KODE, ISIDORI_1995))


def condition(G):
    """Condition number of a matrix with its rows and columns scaled, so that units do not count."""
    for axis in (1, 0, 1):
        size = np.abs(G).max(axis=axis, keepdims=True)
        if not size.all():
            return np.inf
        G = G/size
    return np.linalg.cond(G)


def invertible(values):
    """Say why these values, row by row, are not a matrix to invert; warn if it is near to that."""
    G = np.array(list(values.values())).reshape(round(len(values)**0.5), -1)
    size = condition(G)
    if size > SINGULAR:
        return (f"G0 = {G.tolist()} is not allowed; it is singular (condition number {size:.1e}), "
                "so G0^-1 v does not exist")
    if size > NEAR:
        warnings.warn(f"decoupling: G0 = {G.tolist()} is nearly singular (condition number "
                      f"{size:.1e}): u will be large, and an error of G0 that is small compared "
                      "with its entries undoes the decoupling", stacklevel=4)


@family(card=CARD)
def decoupling(G0: ArrayLike | Callable) -> Block:
    r"""Decoupling as the allocation stage: the inputs of which the law's v is made.

    .. math:: u = G_0^{-1} v

    Parameters
    ----------
    G0 : float, m x m matrix, or function
        The known input matrix of :math:`\dot\sigma = \bar\xi - G_0 u`, m = 1 to 4: numbers, or a
        plain function of the output y that returns its rows as a tuple of tuples.

    Returns
    -------
    Block
        An allocation for `ClosedLoop`. The entries of a matrix of numbers are its parameters G0_11,
        G0_12, ...

    Raises
    ------
    ParameterError
        Not a square matrix of at most 4 x 4 finite numbers, or a singular one.

    Notes
    -----
    The equations are solved at every sample by elimination with row exchanges. A matrix of numbers
    warns (`UserWarning`) where it is nearly singular: condition number above 1e4 with its rows and
    columns scaled to 1. A function is called at every sample: where it is nearly singular, by the
    same measure, `Run.doubts` and the mask say so; where it is exactly singular u is not a number,
    and the run ends there with `Run.diverged_at`.

    With another input matrix G in the plant, (I - G G0^-1) v is added to xi. Unit vector control
    holds it if ``(G - G0) G0^-1`` is less than gamma < 1 in norm and rho > L/(1 - gamma); laws
    channel by channel, of equal gains, if each of its rows sums to less than gamma in absolute
    value. Erratum: (A1) puts the bound on ``G0^-1 (G - G0)``, which does not suffice: with G0 =
    ((1, 4), (0, 1)) and G = G0 + ((2, 0), (0.5, 0)) that matrix has the row sums 0 and 0.5, and yet
    sign control channel by channel drives sigma away, whatever its gain. Erratum of (11): the term
    e^(r) on its right is not there, for it is what xi - G0 u replaces.

    References
    ----------
    Paper eqs (10)-(13) and (A1). A. Isidori, Nonlinear Control Systems, Springer, 1995, section
    5.3.

    Examples
    --------
    >>> decoupling(((2.0, 1.0), (0.0, 4.0)))((4.0, 8.0))
    (1.0, 2.0)
    """
    if inspect.isfunction(G0):
        def law(v, y):
            return solved(G0(y), v)

        def near(values, ys):
            size = max(condition(np.array(G0(y), float)) for y in ys)
            if size > NEAR:
                return f"G0(y) comes near to singular (condition number {size:.1e})"

        law.__name__, law.__doc__ = "decoupling", decoupling.__doc__
        return block(law, card=replace(CARD, assumes=near))
    G = np.atleast_2d(numbers("decoupling", "G0", G0))
    if G.shape not in ((1, 1), (2, 2), (3, 3), (4, 4)) or not np.isfinite(G).all():
        raise refused("decoupling", "G0", G0, "a square matrix of finite numbers, 1 x 1 to 4 x 4, "
                      "or a plain function of y that returns its rows")
    m, size = len(G), float(np.abs(G).max())
    names = [[f"G0_{i + 1}{j + 1}" for j in range(m)] for i in range(m)]
    flat = {q: float(G[i, j]) for i, row in enumerate(names) for j, q in enumerate(row)}
    meta = {f"A_{q}": Annotated[float,
                                Param(f"G_{{0,{q[3:]}}}", "[v]/[u]",
                                      help="entry of the known input matrix",
                                      slider=(v - 2*size, v + 2*size))] for q, v in flat.items()}
    rows = "".join(f"({', '.join(row)},), " for row in names)
    arguments = ", ".join(f"{q}: A_{q} = {v!r}" for q, v in flat.items())
    f = written("decoupling", f"v, {arguments}", f"return solved(({rows}), v)",
                {"solved": solved, "__name__": __name__, **meta}, decoupling.__doc__)
    return block(f, check=invertible)
