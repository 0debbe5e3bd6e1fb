"""Differentiators as blocks: the stage between the error and the sliding variable."""

import functools
import math
import warnings
from typing import Annotated

from ..core import Block, Param, block
from ..core.card import Differentiator
from ..core.family import family, written
from ..core.param import chosen
from ..core.signal import first, generated, leaves, text
from ..sources import KOCH_2020, KODE, LEVANT_2003, LEVANT_2020, LIVNE_2014
from .coefficients import LAMBDA
from .methods import METHODS, newton

__all__ = ["differentiator"]

LIMIT = 7  # highest order that float64 can resolve
LOW = 1e-200  # of L in any unit; with less, its products with powers of tau would underflow


def _error(r, z):
    n = len(leaves(z))
    if r is not None and len(r) < n:
        raise ValueError(f"the reference gives {len(r) - 1} derivatives; it must give {n - 1}, or "
                         "be a number (steps)")
    at = ["r"] + [""]*(n - 1) if r is None else [f"r[{i}]" for i in range(n)]
    return "return " + text(z, (f"{at[i]} - z{q}" for i, q in enumerate(leaves(z))))


#: e = r - y and its derivatives, from those of y; a reference without derivatives is piecewise
#: constant.
error = generated("r, z", _error)

DOC = r"""Robust exact differentiator of {of}, {method}, n_d = {n_d}, n_f = {n_f}.

    .. math::

        {equation}

    with :math:`s = {s}`, :math:`\lfloor x\rceil^a = |x|^a\,\mathrm{{sign}}(x)` and
    :math:`\lambda = ({lam})`.

    Parameters
    ----------
    {signals}
    L : float
        Bound of the derivative of order {order} of {of} [{of}]/s^{order}.

    Returns
    -------
    {returns}

    Notes
    -----
    {notes}

    The state `started` is 0 at the start: z_0 is then set to the first sample. With 1 it starts
    where it is told to.

    Errata and limits: see `differentiator`.

    References
    ----------
    Paper eqs (41)-(43). A. Levant and M. Livne, European J. Control 55 (2020) 33.
    """


def equation(x, minus):
    """Differential equations of the states `x`, in LaTeX; minus = {row: what it subtracts}."""
    n, rows = len(x) - 1, []
    for i in range(n + 1):
        power = (rf"\lfloor s\rceil^{{{n - i}/{n + 1}}} + {x[i + 1]}" if i < n else
                 r"\,\mathrm{sign}(s)")
        speed = rf" L^{{{i + 1}/{n + 1}}} " if i < n else " L"
        rows.append(rf"\dot {x[i]} &= -\lambda_{{{n - i}}}{speed}{power}{minus.get(i, '')}")
    return " \\\\\n        ".join(rows)


def _explained(x, n_d, n_f, method, of):
    """Help of a block."""
    signals = (f"{of} : float or tuple of float\n"
               "        f, or a tuple that starts with it; the rest is not used.")
    if of == "y":
        signals += ("\n    r : float or tuple of float\n"
                    "        Reference; without derivatives it is piecewise constant.")
    many = f"tuple of {n_d + 1} float" if n_d else "float"
    returns = ("f" if of == "e" else "e = r - f") + (" and its derivatives" if n_d else "")
    return DOC.format(n_d=n_d, n_f=n_f, method=method, of=of, order=n_d + 1, signals=signals,
                      lam=", ".join(f"{v:g}" for v in LAMBDA[n_d + n_f]),
                      equation=equation(x, {n_f - 1: " - f"}),
                      s=x[0] + ("" if n_f else " - f"),
                      returns=f"{many}\n        Estimates of {returns}.",
                      notes=METHODS[method][1].format(order=n_d + 1, N=len(x), n=len(x) - 1))


def per(unit, i):
    """Unit of the i-th derivative; i < 0: of an integral."""
    return unit + (("/s" if i > 0 else " s") + f"^{abs(i)}"*(abs(i) > 1) if i else "")


def memory(n_d, unit):
    """The states z_0..z_nd and started."""
    z = {f"z_{i}": (0.0,
                    Param(f"z_{i}(0)", per(unit, i), help=f"derivative of order {i} to start with",
                          slider=(-10.0, 10.0))) for i in range(n_d + 1)}
    started = Param(low=0.0, high=1.0, slider=(0.0, 1.0),
                    help="0: z_0 is set to the first sample; 1: z_0 starts as given")
    return {**z, "started": (0.0, started)}


@family(card=Differentiator(source=(KODE, LEVANT_2003, LIVNE_2014, LEVANT_2020, KOCH_2020)))
def differentiator(n_d: int, n_f: int = 0, method: str = "levant", of: str = "e") -> Block:
    r"""Levant's robust exact differentiator of a sampled signal, with or without a filter.

    .. math::

        \dot x_i &= -\lambda_{n-i} L^{\frac{i+1}{n+1}} |s|^{\frac{n-i}{n+1}}\,\mathrm{sign}(s)
        + x_{i+1} - \delta_{i,n_f-1} f,
        \qquad i = 0..n, \qquad n = n_d + n_f \\
        x &= (w_1, ..., w_{n_f}, z_0, ..., z_{n_d}), \qquad x_{n+1} = 0,
        \qquad s = w_1 \ (n_f > 0) \ \text{ or } \ z_0 - f

    Parameters
    ----------
    n_d : int
        Order of the highest derivative estimated.
    n_f : int
        Order of the filter; n_d + n_f is 12 at most.
    method : str
        How a step is made: ``"levant"``, explicit with Taylor's terms; ``"implicit"``, which uses
        the sample at t and does not chatter; ``"matching"``, explicit with matched eigenvalues;
        ``"euler"``, for teaching.
    of : str
        ``"e"``: differentiates the error; ``"y"``: the output, and gives (r - z_0, r' - z_1, ...)
        as the error. A reference that moves in steps does not disturb it then.

    Returns
    -------
    Block
        A differentiator stage with the parameter `L` and the states w_1..w_nf, z_0..z_nd, started.
        What it gives, a tuple of n_d + 1 estimates (a number where n_d = 0), is e for surface, law
        and allocation.

    Raises
    ------
    ParameterError
        An order or a name that does not exist.

    Warns
    -----
    UserWarning
        n_d + n_f > 7: more than float64 can resolve.

    Notes
    -----
    L must bound :math:`|f^{(n_d+1)}|`. Then, after a finite time, the order of
    :math:`|z_i - f^{(i)}|` is
    :math:`\tau^{n_d+1-i}` without noise, and :math:`\varepsilon^{(n_d+1-i)/(n_d+1)}` with noise of
    size eps and small tau: no differentiator does better. An L larger than needed costs accuracy in
    noise, a smaller one loses f. A filter, n_f > 0, removes noise that may be large but is so fast
    that its iterated integral is small.

    In a loop L has to cover what the control does: with a law of relative degree n_d + 1, the bound
    of the perturbation plus that of v, also on the way to sigma = 0. The law then keeps its order
    of accuracy.

    From exact values `levant` follows a polynomial of degree n_d or less without an error, but any
    rounding, however small, starts a limit cycle of up to 4, 10, 70, 3400 times
    :math:`L\tau^{n_d+1-i}` for n_d = 2, 3, 4, 5; `implicit` and `matching` have none.

    Euler's steps lose the order: z_1, z_2, ... have errors of the order tau, such as tau z_2/2 in
    z_1.

    Float64 limits the accuracy: however small tau is, the error of z_i stays above
    :math:`10^{-16(n+1-i)/(n+1)}` times the signal. With order 5 that of the highest derivative
    stays near 1e-2, with order 12 it exceeds the signal at any tau.

    Errata: (41) prints 3 for lambda_2; the row of n = 2 ends with 2. As L bounds the derivative of
    order n_d + 1, what is Lipschitz is the n_d-th: the second in (41), not the third; the third in
    (43), not the fourth. The sliding mode that (42) and (43) speak of is of order n + 1, not of the
    second.

    `matching` sums differences from the identity, because powers of the eigenvalues cancel where
    tau is small, and makes Euler's steps in the rows of w, because exact ones would leave a bias of
    order tau in z_0.

    References
    ----------
    Paper eqs (41)-(43). A. Levant, Int. J. Control 76 (2003) 924. `levant`: M. Livne and A. Levant,
    Automatica 50 (2014) 2007. Filter: A. Levant and M. Livne, European J. Control 55 (2020) 33.
    `implicit`: after R. Seeber, arXiv 2404.02770. `matching`: S. Koch, M. Reichhartinger, M. Horn
    and L. Fridman, IEEE Trans. Automatic Control 65 (2020) 757.

    Examples
    --------
    >>> differentiator(2)(0.9, (1.0, 2.0, 3.0, 1.0), 0.01, L=2.0)[0]
    (1.0, 2.0, 3.0)
    """
    n_d, n_f = orders("differentiator", n_d, n_f)
    if n_d + n_f > LIMIT:
        warnings.warn(f"differentiator: n_d + n_f = {n_d + n_f} is more than float64 can resolve: "
                      f"above {LIMIT} rounding spoils the highest derivatives",
                      UserWarning, stacklevel=3)
    return _made(n_d, n_f, chosen("differentiator", "method", method, METHODS),
                 chosen("differentiator", "of", of, ("e", "y")))


def orders(owner: str, n_d: int, n_f: int) -> tuple[int, int]:
    """The two orders as whole numbers if they are allowed, else `ParameterError`."""
    n_d = Param(low=0, high=12).check(owner, "n_d", n_d, int)
    return n_d, Param(low=0, high=12 - n_d).check(owner, "n_f", n_f, int)


@functools.cache
def _made(n_d, n_f, method, of):
    """The block, written out for the orders."""
    order = n_d + 1
    x = [f"w_{i + 1}" for i in range(n_f)] + [f"z_{i}" for i in range(n_d + 1)]
    lines, y = METHODS[method][0](n_d, n_f, x)
    out = f"({', '.join(y)})"
    name = f"{method}_{n_d}" + f"_{n_f}"*(n_f > 0)
    bound = Param("L", per(f"[{of}]", order), low=LOW, log=True, slider=(1e-2, 1e4),
                  help=f"bound of the derivative of order {order} of {of}"
                  + "; more than float64 can resolve"*(n_d + n_f > LIMIT))
    names = dict(math=math, first=first, error=error, B=Annotated[float, bound], __name__=__name__)
    names["newton"] = written("newton", "c", newton(n_d + n_f), names)
    estimates = f"error(r, {out})" if of == "y" else out
    body = [f"{', '.join(x)}, started = z", f"f = first({of})", "if started == 0.0:", "    z_0 = f",
            *lines, f"return {estimates}, ({', '.join(f'n_{i}' for i in range(len(x)))}, 1.0)"]
    f = written(name, f"{of}, {'r, '*(of == 'y')}z, tau, L: B = 1.0", "\n".join(body), names,
                _explained(x, n_d, n_f, method, of))
    state = {f"w_{i + 1}": (0.0, Param(f"w_{i + 1}(0)", per(f"[{of}]", i - n_f),
                                       help="filter to start with", slider=(-1.0, 1.0)))
             for i in range(n_f)}
    return block(state=state | memory(n_d, f"[{of}]"))(f)
