r"""What the homogeneous laws share: sigma^(r) = xi - v, \|xi\| <= L, v = alpha L Psi(sigma/L), \|Psi\| <= 1.

Fractional powers are written so that a compiled run and a plain one agree to the last bit: ``x*abs(x)`` and `math.sqrt`
for the powers 2 and 1/2, which compilers turn into these, and `power` for others, which are the C library's in both.
"""

import math
from typing import Annotated

from ..core import Param, block
from ..core.assumptions import MARGIN

__all__ = ["law", "order", "power", "ratio"]

BOUND = Param("L", "[v]", low=1e-9, log=True, slider=(1e-2, 100.0), help="bound of the perturbation |xi|")
SPEED = Param(r"\lambda", "1", low=1e-3, log=True, slider=(0.1, 10.0),
              help="converges this many times as fast, for a control lambda^r times as large")


def power(x, a):
    r"""\|x\|^a sign(x), a > 0; not for the literals 2 and 1/2."""
    return math.copysign(abs(x)**a, x)


def ratio(n, d):
    """n/d, and 0 where d is."""
    return n/d if d > 0.0 else 0.0


def order(owner, r, low, high):
    """Return the relative degree `r` if it is a whole number from `low` to `high`, else raise `ParameterError`."""
    return Param(low=low, high=high).check(owner, "r", r, int)


DOC = r"""{title}, relative degree {r}.

    .. math:: v = \alpha L \lambda^{r}\,\Psi(s_0, ...), \qquad s_i = \frac{{\sigma^{{(i)}}}}{{L\lambda^i}}

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


def law(name, r, psi, alpha, said="", **doc):
    """The block v = alpha L lam^r Psi(sigma_i/(L lam^i)) of relative degree `r`; `said` and `doc` are for its help."""
    scales = ["L", *(f"scale_{i}" for i in range(1, r + 1))]
    parts = ["sigma"] if r == 1 else [f"s{i}" for i in range(r)]
    arguments = [f"{s}/{scale}" for s, scale in zip(parts, scales, strict=False)]
    body = [f"{', '.join(parts)} = sigma"]*(r > 1) + [f"{scales[i]} = {scales[i - 1]}*lam" for i in range(1, r + 1)]
    body += [f"return alpha*{scales[r]}*psi({', '.join(arguments)})"]
    gain = Param(r"\alpha", "1", low=0.0, help=f"{said}gain, in units of the bound L; {alpha:g} settled in every trial",
                 slider=(0.0, 4.0*alpha))
    names = dict(psi=psi, A=Annotated[float, gain], B=Annotated[float, BOUND], S=Annotated[float, SPEED], V=Param("v"),
                 __name__=__name__)
    exec(f"def {name}(sigma, alpha: A = {alpha!r}, L: B = 1.0, lam: S = 1.0) -> V:\n    " + "\n    ".join(body), names)
    f = names[name]
    f.__doc__ = DOC.format(r=r, signal="float" if r == 1 else f"tuple of {r} float", **doc,
                           meaning="Sliding variable" + (f" and its derivatives up to the order {r - 1}" if r > 1 else ""))

    def assumed(values, xi, dxi):
        """What the theorem assumes of the perturbation, and what alpha has to give at least."""
        scale = values["lam"]**r
        bound, said = values["L"]*scale, "L" if scale == 1.0 else f"L lambda^{r}"
        for factor, what in ((1.0, said), (values["alpha"], f"the greatest |v|, alpha {said}")):
            if xi > MARGIN*factor*bound:
                return f"|xi| reaches {xi:.3g}, more than {what} = {factor*bound:.3g} [v]"

    return block(f, theorem=assumed, r=r if r > 1 else None)
