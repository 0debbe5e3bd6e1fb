"""Sliding variables: sigma = 0 is the wanted motion of the error.

For relative degree r, sigma = e^(r-1) + c_(r-2) e^(r-2) + ... + c_0 e + c_-1 int e, paper eq (9).
"""

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from .core import Block, Param, ParameterError, block
from .core.card import Surface
from .core.family import family, written
from .core.param import refused, relative_degree, said, several, switch
from .core.signal import first
from .sources import GRAHAM_1953, KODE, LEVANT_1993, LEVANT_2003

__all__ = ["coefficients", "differenced", "itae", "polynomial", "truncated"]

#: s^p + ... + 1, coefficients of descending powers after the first: minimal integral of time times
#: absolute error. classical: D. Graham and R. C. Lathrop, AIEE Trans. 72 (1953) 273; optimal: the
#: same criterion, recomputed.
TABLES = {"classical": {1: (1.0,), 2: (1.4, 1.0), 3: (1.75, 2.15, 1.0), 4: (2.1, 3.4, 2.7, 1.0),
                        5: (2.8, 5.0, 5.5, 3.4, 1.0), 6: (3.25, 6.6, 8.6, 7.45, 3.95, 1.0)},
          "optimal": {1: (1.0,), 2: (1.505, 1.0), 3: (1.782, 2.170, 1.0),
                      4: (1.951, 3.344, 2.647, 1.0), 5: (2.064, 4.494, 4.669, 3.255, 1.0)}, }
#: Settling time (2 %, unit step, zero initial derivatives) times frequency of these polynomials.
SETTLING = {
    "classical": {1: 3.915, 2: 5.980, 3: 7.545, 4: 4.515, 5: 6.685, 6: 7.815},
    "optimal": {1: 3.915, 2: 5.720, 3: 7.360, 4: 4.430, 5: 4.980},
}


SETTLED = Param("t_s", "s", low=1e-6, log=True, slider=(0.5, 50.0),
                help="settling time of the error while sigma = 0")
INTEGRAL = Param(r"\int e", "[e] s", help="integral to start with", slider=(-1.0, 1.0))
LAST = Param(r"\sigma_{-1}", "[sigma]", help="value one sample before the start",
             slider=(-1.0, 1.0))
KNOWN = Param("known", "1", low=0.0, high=1.0, help="1: the value before the start counts")


def _degree(r, integral):
    r = relative_degree("surface", r, 6)
    return r, r - 1 + switch("surface", "integral", integral)


def _chosen(degree, table, rule):
    """ITAE polynomial of a degree, without its leading 1, and settling time times frequency."""
    if not isinstance(table, str) or table not in TABLES or degree not in (0, *TABLES[table]):
        allowed = ", ".join(f"'{t}' up to {max(c)}" for t, c in TABLES.items())
        raise ParameterError(f"surface: table = {said(table)} has no polynomial of degree "
                             f"{degree}; there are {allowed}")
    if not isinstance(rule, str) or rule not in ("paper", "settling"):
        raise refused("surface", "rule", rule,
                      "'paper' (w = 10/t_s) or 'settling' (the measured 2 % settling)")
    return TABLES[table].get(degree,
                             ()), 10.0 if rule == "paper" else SETTLING[table].get(degree, 0.0)


def coefficients(r: int, settling_time: float, integral: bool = True, table: str = "classical",
                 rule: str = "paper") -> tuple[float, ...]:
    r"""Coefficients of a sliding variable from the wanted settling time.

    The polynomial of :math:`\sigma = 0` is the ITAE polynomial of degree r - 1 (r with the
    integral), its frequency :math:`\omega = 10/t_s` (``rule="paper"``) or that which settles to 2 %
    in t_s (``rule="settling"``).

    Parameters
    ----------
    r : int
        Relative degree, 1 to 6.
    settling_time : float
        t_s [s], 1e-6 or more.
    integral : bool
        With the integral term (integral sliding mode).
    table : str
        ``"classical"`` (Graham and Lathrop) or ``"optimal"`` (recomputed; up to degree 5).
    rule : str
        ``"paper"`` or ``"settling"``.

    Returns
    -------
    tuple of float
        :math:`(c_{r-2}, ..., c_0, c_{-1})`, the last only with the integral; [1/s], [1/s^2], ...

    Raises
    ------
    ParameterError
        A degree that the table lacks, or another value that is not allowed.

    Notes
    -----
    The paper's own designs (48), (49), (69) all follow w = 10/t_s. Erratum: eq (9) prints the
    coefficient of the integral as c_(-i,1); it is c_(i,-1).

    References
    ----------
    Paper eq (9). D. Graham and R. C. Lathrop, AIEE Trans. 72 (1953) 273.

    Examples
    --------
    >>> coefficients(2, 8.0)
    (1.75, 1.5625)
    """
    r, degree = _degree(r, integral)
    c, product = _chosen(degree, table, rule)
    w = product/SETTLED.check("surface", "settling_time", settling_time)
    return tuple(a*w**(k + 1) for k, a in enumerate(c))


def _written(name, doc, arguments, first_line, c, r, integral, derivative, check=None, **names):
    """Return the block sigma = sum of c_i e^(i); `c` are texts, ascending from the integral on."""
    def combined(shift):
        es = ["first(e)" if i == 0 else f"e[{i}]" for i in range(shift, r + shift)]
        terms = [f"{q}{e}" for q, e in zip(c[integral:], es, strict=True)][::-1]
        return " + ".join(terms + [c[0] + ("first(e)" if shift else "integral")]*integral)

    differs = isinstance(derivative, str) and derivative == "difference"
    if not (differs or isinstance(derivative, (bool, np.bool_))):
        raise refused("surface", "derivative", derivative, "False, True or 'difference'")
    states = ["integral"]*integral + ["last", "known"]*differs
    ahead = ["integral + tau*first(e)"]*integral + ["sigma", "1.0"]*differs
    rate = "(sigma - last)/tau if known else 0.0" if differs else combined(1) if derivative else ""
    lines = [first_line]*bool(first_line) + [f"{', '.join(states)}, = z"]*bool(states)
    given = (f"(sigma, {rate})" if rate else "sigma") + f", ({', '.join(ahead)},)"*bool(states)
    lines += [f"sigma = {combined(0)}", f"return {given}"]
    signals = "e, z, tau" if states else "e"
    names.update(first=first, __name__=__name__)
    f = written(name, ", ".join([signals, *arguments]), "\n".join(lines), names, doc)
    sigma = Param(r"\sigma")
    known = dict(integral=(0.0, INTEGRAL), last=(0.0, LAST), known=(0.0, KNOWN))
    return block(f, state={n: known[n] for n in states}, check=check,
                 output=(sigma, Param(r"\dot\sigma")) if derivative else sigma)


def _equation(c, r, integral):
    """The sliding variable in LaTeX, from the texts of its coefficients, descending."""
    def e(i):
        return r"\int e\,dt" if i < 0 else ("e", r"\dot e",
                                            r"\ddot e")[i] if i < 3 else f"e^{{({i})}}"
    return " + ".join([e(r - 1)] + [f"{q}\\,{e(r - 2 - i)}" for i, q in enumerate(c)])


@family(card=Surface(source=(KODE, GRAHAM_1953)))
def itae(r: int, settling_time: float = 8.0, integral: bool = True, table: str = "classical",
         rule: str = "paper", derivative: bool | str = False) -> Block:
    r"""Sliding variable from relative degree and settling time, `settling_time` its parameter.

    .. math:: \sigma = e^{(r-1)} + c_{r-2} e^{(r-2)} + ... + c_0 e + c_{-1} \int e\,dt

    Parameters
    ----------
    r, settling_time, integral, table, rule
        As in `coefficients`.
    derivative : bool or str
        True gives (sigma, sigma'), as twisting needs; the error must then come with r derivatives
        instead of r - 1. ``"difference"`` takes sigma' from the sample before, (sigma -
        sigma_before)/tau, and needs no more of the error: it lags by half a sample, and noise in
        sigma comes out of it 1/tau times as large.

    Returns
    -------
    Block
        A surface for `ClosedLoop`, with parameter `settling_time` [s].

    Raises
    ------
    ParameterError
        A degree that the table lacks, or another value that is not allowed.

    References
    ----------
    Paper eq (9). D. Graham and R. C. Lathrop, AIEE Trans. 72 (1953) 273.
    """
    r, degree = _degree(r, integral)
    settling_time = SETTLED.check("surface", "settling_time", settling_time)
    c, product = _chosen(degree, table, rule)
    said = [(f"{a:g}" if a != 1.0 else "") + r"\omega" + (f"^{k + 1}" if k else "") for k,
            a in enumerate(c)]
    omega = f", \\qquad \\omega = {product:g}/t_s" if degree else ""
    doc = (f"ITAE sliding variable, relative degree {r}.\n\n.. math:: \\sigma = "
           f"{_equation(said, r, integral)}{omega}\n\nThe error settles as the ITAE polynomial of "
           f"the {table} table does, in about `settling_time`.\n\nPaper eq (9); Graham and Lathrop "
           "1953.")
    meta = Annotated[float, SETTLED]
    texts = [f"{a!r}" + "*w"*(k + 1) + "*" for k, a in enumerate(c)][::-1] + [""]
    arguments = [f"settling_time: meta = {settling_time!r}"] if degree else []
    frequency = f"w = {product!r}/settling_time" if degree else ""
    return _written("itae", doc, arguments, frequency, texts, r, integral, derivative, meta=meta)


@family(card=Surface(source=(KODE,)))
def polynomial(c: Sequence[float], integral: bool = True, derivative: bool | str = False
               ) -> Block:
    r"""Sliding variable with given coefficients: a block with these as parameters.

    .. math:: \sigma = e^{(r-1)} + c_{r-2} e^{(r-2)} + ... + c_0 e + c_{-1} \int e\,dt

    Parameters
    ----------
    c : sequence of float
        :math:`(c_{r-2}, ..., c_0, c_{-1})`, the last only with the integral.
    integral : bool
        Whether the last coefficient belongs to the integral.
    derivative : bool or str
        Give (sigma, sigma'), as in `itae`.

    Returns
    -------
    Block
        A surface for `ClosedLoop`, with parameters `c_1`, `c_0`, ..., `c_int`.

    Raises
    ------
    ParameterError
        The polynomial is not Hurwitz: on sigma = 0 the error would not go to zero. The block's
        ``with_`` raises it too.

    References
    ----------
    Paper eq (9).
    """
    integral = switch("surface", "integral", integral)
    c = [Param().check("surface", f"c[{i}]", v) for i, v in enumerate(several("surface", "c", c))]
    r, _ = _degree(len(c) + 1 - integral, integral)
    names = [f"c_{i}" for i in range(r - 2, -1, -1)] + ["c_int"]*integral
    symbols = [f"c_{{{i}}}" for i in range(r - 2, -1 - integral, -1)]
    metas = {f"A{i}": Annotated[float,
                                Param(q, f"1/s^{i + 1}" if i else "1/s",
                                      slider=(0.0, max(10.0, 4*v)),
                                      help="coefficient of the sliding variable")] for i,
             (q, v) in enumerate(zip(symbols, c, strict=True))}
    arguments = [f"{n}: A{i} = {v!r}" for i, (n, v) in enumerate(zip(names, c, strict=True))]
    doc = (f"Sliding variable, relative degree {r}.\n\n.. math:: \\sigma = "
           f"{_equation(symbols, r, integral)}\n\n"
           "While sigma = 0 the error follows this polynomial.\n\nPaper eq (9).")

    def hurwitz(values):
        c = tuple(values[n] for n in names)
        roots = np.roots([1.0, *c])
        if any(q.real >= -1e-9*abs(q) for q in roots):
            return (f"c = {c} is not allowed; the polynomial with 1 before them must be Hurwitz, "
                    f"but it has the roots {', '.join(f'{q:.3g}' for q in roots)}")

    return _written("polynomial", doc, arguments, "", [f"{n}*" for n in names][::-1] + [""], r,
                    integral, derivative, hurwitz, **metas)


@family(card=Surface(source=(LEVANT_1993,)))
def differenced(r: int) -> Block:
    r"""The error, its derivatives, and one more from the sample before, for degree r + 1.

    .. math:: (\sigma, \dot\sigma, ..., \sigma^{(r)}), \qquad
        \sigma^{(r)}_k = (\sigma^{(r-1)}_k - \sigma^{(r-1)}_{k-1})/\tau

    Parameters
    ----------
    r : int
        How many the error comes with: the error itself and r - 1 derivatives, 1 to 5.

    Returns
    -------
    Block
        A surface for `ClosedLoop`, which gives r + 1 values.

    Raises
    ------
    ParameterError
        A number that is not allowed.

    Notes
    -----
    With ``hosmc.integrated`` as allocation it raises the relative degree by one. The difference
    lags by half a sample, and noise comes out of it 1/tau times as large; where there is noise, a
    differentiator does better.

    References
    ----------
    A. Levant, Int. J. Control 58 (1993) 1247: the twisting algorithm with the sign of a difference.
    """
    r = relative_degree("differenced", r, 5)
    parts = ["e"] if r == 1 else [f"e{i}" for i in range(r)]
    rate = f"({parts[-1]} - last)/tau if known else 0.0"
    body = [f"{', '.join(parts)} = e", "last, known = z",
            f"return ({', '.join(parts)}, {rate}), ({parts[-1]}, 1.0)"]
    f = written("differenced", "e, z, tau", "\n".join(body), {"__name__": __name__},
                differenced.__doc__)
    return block(f, state=dict(last=(0.0, LAST), known=(0.0, KNOWN)))


@family(card=Surface(source=(KODE, LEVANT_2003)))
def truncated(r: int) -> Block:
    r"""The error with as many derivatives as a law is for, of a differentiator that gives more.

    .. math:: (\sigma, \dot\sigma, ..., \sigma^{(r-1)}) = (e, \dot e, ..., e^{(r-1)})

    Parameters
    ----------
    r : int
        Relative degree of the law, 1 to 6.

    Returns
    -------
    Block
        A surface for `ClosedLoop`, which gives r values; a number where r = 1.

    Raises
    ------
    ParameterError
        A number that is not allowed.

    Notes
    -----
    The highest derivative that a differentiator gives is the one that chatters; of an order higher
    than r - 1 it gives the law smooth ones. For laws of the whole tuple (`smc.hosmc`); `itae` and
    `polynomial` take what they need by themselves.

    References
    ----------
    Paper eqs (26), (41). A. Levant, Int. J. Control 76 (2003) 924.

    Examples
    --------
    >>> truncated(2)((0.1, 0.2, 0.3))
    (0.1, 0.2)
    """
    r = relative_degree("truncated", r, 6)
    parts = ", ".join(f"e[{i}]" for i in range(r)) if r > 1 else "first(e)"
    names = {"first": first, "__name__": __name__}
    return block(written("truncated", "e", f"return {parts}", names, truncated.__doc__))
