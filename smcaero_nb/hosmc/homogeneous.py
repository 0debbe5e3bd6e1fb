r"""Homogeneous laws: sigma^(r) = xi - v, \|xi\| <= L, v = alpha L Psi(sigma/L), \|Psi\| <= 1.

Fractional powers are written so that a compiled run and a plain one agree to the last bit:
``x*abs(x)`` and `math.sqrt` for the powers 2 and 1/2, which compilers turn into these, and `power`
for others, which are the C library's in both.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Annotated

from ..core import Block, Param, block
from ..core.assumptions import MARGIN
from ..core.card import Law
from ..core.family import written
from ..core.param import relative_degree

__all__ = ["law", "order", "power", "ratio"]

#: What the laws of all relative degrees have in common.
CARD = Law(sees="derivatives", needs="the bound of |xi|",
           guarantees="sigma and its derivatives are 0 after a finite time")
BOUND = Param("L", "[v]", low=1e-9, log=True, slider=(1e-2, 100.0),
              help="bound of the perturbation |xi|")
SPEED = Param(r"\lambda", "1", low=1e-3, log=True, slider=(0.1, 10.0),
              help="converges this many times as fast, for a control lambda^r times as large")


def power(x, a):
    r"""\|x\|^a sign(x), a > 0; not for the literals 2 and 1/2."""
    return math.copysign(abs(x)**a, x)


def ratio(n, d):
    """n/d, and 0 where d is."""
    return n/d if d > 0.0 else 0.0


def order(owner, r, low, high):
    """Return the relative degree `r` if it is from `low` to `high`, else raise `ParameterError`."""
    return relative_degree(owner, r, high, low)


def relayed(values, a, omega):
    """Describing function for relative degree 1, where all of these laws are the relay."""
    return 4.0*values["alpha"]*values["L"]*values["lam"]/(math.pi*a)


DOC = r"""{title}, relative degree {r}.

    .. math:: v = \alpha L \lambda^{r}\,\Psi(s_0, ...), \qquad
        s_i = \frac{{\sigma^{{(i)}}}}{{L\lambda^i}}

    .. math:: {equation}

    with :math:`\lfloor x\rceil^a = |x|^a\,\mathrm{{sign}}(x)`.

    Parameters
    ----------
    sigma : {signal}
        {meaning}.
    alpha : float
        Gain [1], in units of the bound.
    L : float
        Bound of the perturbation :math:`|\xi|` [v].
    lam : float
        Speed [1]: 2 converges twice as fast, for a control :math:`2^{r}` times as large.

    Returns
    -------
    float
        v, of :math:`\sigma^{{({r})}} = \xi - v`; :math:`|v| \le \alpha L\lambda^{r}`.

    Notes
    -----
    {notes}

    References
    ----------
    {references}
    """


def law(name: str, r: int, psi: Callable, alpha: float, card: Law, said: str = "", **doc: str
        ) -> Block:
    """Return the block v = alpha L lam^r Psi(sigma_i/(L lam^i)); `said` and `doc` are its help."""
    scales = ["L", *(f"scale_{i}" for i in range(1, r + 1))]
    parts = ["sigma"] if r == 1 else [f"s{i}" for i in range(r)]
    arguments = [f"{s}/{scale}" for s, scale in zip(parts, scales, strict=False)]
    body = [f"{', '.join(parts)} = sigma"]*(r > 1)
    body += [f"{scales[i]} = {scales[i - 1]}*lam" for i in range(1, r + 1)]
    body += [f"return alpha*{scales[r]}*psi({', '.join(arguments)})"]
    gain = Param(r"\alpha", "1", low=0.0,
                 help=f"{said}gain, in units of the bound L; {alpha:g} settled in every trial",
                 slider=(0.0, 4.0*alpha))
    names = dict(psi=psi, A=Annotated[float, gain], B=Annotated[float, BOUND],
                 S=Annotated[float, SPEED], __name__=__name__)
    derivatives = f" and its derivatives up to the order {r - 1}" if r > 1 else ""
    f = written(name, f"sigma, alpha: A = {alpha!r}, L: B = 1.0, lam: S = 1.0", "\n".join(body),
                names,
                DOC.format(r=r, signal="float" if r == 1 else f"tuple of {r} float", **doc,
                           meaning=f"Sliding variable{derivatives}"))

    def assumed(values, xi, dxi):
        """Say which assumption of the theorem fails, or that |v| cannot reach |xi|."""
        scale = values["lam"]**r
        bound, said = values["L"]*scale, "L" if scale == 1.0 else f"L lambda^{r}"
        for factor, what in ((1.0, said), (values["alpha"], f"the greatest |v|, alpha {said}")):
            if xi > MARGIN*factor*bound:
                return f"|xi| reaches {xi:.3g}, more than {what} = {factor*bound:.3g} [v]"

    sees = "derivatives" if r > 1 else "sigma"
    return block(f, output=Param("v"),
                 card=replace(card, order=r, r=r, sees=sees, assumes=assumed,
                              describing=relayed if r == 1 else card.describing))
