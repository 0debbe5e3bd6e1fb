"""Sliding variables: sigma = 0 is the motion that is wanted of the error.

For relative degree r, sigma = e^(r-1) + c_(r-2) e^(r-2) + ... + c_0 e + c_-1 int e, paper eq (9).
"""

from collections.abc import Sequence
from inspect import cleandoc
from typing import Annotated

import numpy as np

from .core import Block, Param, ParameterError, block
from .core.block import Buffer, wanted
from .core.card import Surface
from .core.family import family, written
from .core.param import refused, relative_degree, said, several, switch
from .core.signal import first
from .core.stages import OWN, STAGES
from .sources import GRAHAM_1953, KODE, LEVANT_1993, LEVANT_2003, UTKIN_1996

__all__ = ["coefficients", "differenced", "integral_sliding", "itae", "polynomial", "truncated"]

#: s^p + ... + 1, coefficients of descending powers after the first: minimal integral of time times
#: absolute error. classical: D. Graham and R. C. Lathrop, AIEE Trans. 72 (1953) 273; optimal: the
#: same criterion, recomputed.
TABLES = {"classical": {1: (1.0,), 2: (1.4, 1.0), 3: (1.75, 2.15, 1.0), 4: (2.1, 3.4, 2.7, 1.0),
                        5: (2.8, 5.0, 5.5, 3.4, 1.0), 6: (3.25, 6.6, 8.6, 7.45, 3.95, 1.0)},
          "optimal": {1: (1.0,), 2: (1.505, 1.0), 3: (1.782, 2.170, 1.0),
                      4: (1.951, 3.344, 2.647, 1.0), 5: (2.064, 4.494, 4.669, 3.255, 1.0)}, }
#: Time in which e settles to 2 % on sigma = 0, times frequency, by table, integral and degree: from
#: e = 1, its derivatives and its integral 0, but the one derivative that sigma = 0 determines; for
#: r = 1 with the integral, the decay of e that is left.
SETTLING = {
    "classical": {False: {1: 3.915, 2: 5.980, 3: 7.545, 4: 4.515, 5: 6.685},
                  True: {1: 3.915, 2: 4.882, 3: 7.009, 4: 9.148, 5: 11.841, 6: 13.193}},
    "optimal": {False: {1: 3.915, 2: 5.720, 3: 7.360, 4: 4.430, 5: 4.980},
                True: {1: 3.915, 2: 4.970, 3: 7.011, 4: 10.880, 5: 12.897}},
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


def _chosen(degree, integral, table, rule):
    """ITAE polynomial of a degree, without its leading 1, and settling time times frequency."""
    if not isinstance(table, str) or table not in TABLES or degree not in (0, *TABLES[table]):
        allowed = ", ".join(f"'{t}' up to {max(c)}" for t, c in TABLES.items())
        raise ParameterError(f"surface: table = {said(table)} has no polynomial of degree "
                             f"{degree}; there are {allowed}")
    if not isinstance(rule, str) or rule not in ("paper", "settling"):
        raise refused("surface", "rule", rule,
                      "'paper' (w = 10/t_s) or 'settling' (the measured 2 % settling)")
    settling = SETTLING[table][bool(integral)].get(degree, 0.0)
    return TABLES[table].get(degree, ()), 10.0 if rule == "paper" else settling


def coefficients(r: int, settling_time: float, integral: bool = True, table: str = "classical",
                 rule: str = "paper") -> tuple[float, ...]:
    r"""Coefficients of a sliding variable from the wanted settling time.

    The polynomial of :math:`\sigma = 0` is the ITAE polynomial of degree r - 1 (r with the
    integral), its frequency :math:`\omega = 10/t_s` (``rule="paper"``) or that with which e settles
    to 2 % in t_s (``rule="settling"``).

    Parameters
    ----------
    r : int
        Relative degree, 1 to 6.
    settling_time : float
        t_s [s], 1e-6 or more.
    integral : bool
        With the integral of the error, so that an error which does not vanish drives sigma away
        from 0. This is not integral sliding mode: that is `integral_sliding`.
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
    The paper's own designs (48), (49), (69) all follow w = 10/t_s, with which e settles earlier or
    later than t_s; `itae` says by how much. Erratum: eq (9) prints the coefficient of the integral
    as c_(-i,1); it is c_(i,-1).

    References
    ----------
    Paper eq (9). D. Graham and R. C. Lathrop, AIEE Trans. 72 (1953) 273.

    Examples
    --------
    >>> coefficients(2, 8.0)
    (1.75, 1.5625)
    """
    r, degree = _degree(r, integral)
    c, product = _chosen(degree, integral, table, rule)
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
        instead of r - 1. ``"difference"`` takes sigma' from the previous sample, (sigma -
        sigma_before)/tau, and needs no further derivative: it lags by half a sample, and amplifies
        noise in sigma 1/tau times.

    Returns
    -------
    Block
        A surface for `ClosedLoop`, with parameter `settling_time` [s].

    Raises
    ------
    ParameterError
        A degree that the table lacks, or another value that is not allowed.

    Notes
    -----
    Once sigma = 0 is reached, soon after the start, e settles to 2 % of e(0), its other derivatives
    being 0, in t_s with ``rule="settling"``. With ``rule="paper"`` and the classical table it
    settles in
    0.39, 0.60, 0.75, 0.45, 0.67 times t_s for r = 2, ..., 6 without the integral, and in
    0.49, 0.70, 0.91, 1.18, 1.32 times t_s with it.

    With the integral e must overshoot, for on sigma = 0 its integral returns to 0, where it began:
    by 21, 46, 62, 75, 98 % of e(0) for r = 2, ..., 6; without it, by 0, 5, 2, 2, 2 %. Begin on
    sigma = 0 to avoid this, at rest with the state `integral` = -c_0 e(0)/c_(-1) (r = 2 and more),
    or leave the integral out.

    References
    ----------
    Paper eq (9). D. Graham and R. C. Lathrop, AIEE Trans. 72 (1953) 273.
    """
    r, degree = _degree(r, integral)
    settling_time = SETTLED.check("surface", "settling_time", settling_time)
    c, product = _chosen(degree, integral, table, rule)
    said = [(f"{a:g}" if a != 1.0 else "") + r"\omega" + (f"^{k + 1}" if k else "") for k,
            a in enumerate(c)]
    omega = f", \\qquad \\omega = {product:g}/t_s" if degree else ""
    doc = (f"ITAE sliding variable, relative degree {r}.\n\n.. math:: \\sigma = "
           f"{_equation(said, r, integral)}{omega}\n\n")
    if r > 1:
        share = SETTLING[table][bool(integral)][degree]/product
        doc += (f"On sigma = 0 the error settles to 2 % in {share:.2g} `settling_time` ({table} "
                "table)" + ", and overshoots, because its integral returns to 0"*integral + ".\n\n")
    doc += "Paper eq (9); Graham and Lathrop 1953. See `itae`."
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


OFFSET = Param(r"\zeta", "[v] s", slider=(-10.0, 10.0),
               help="integral of the nominal law, less the highest derivative at the start")
AROUND = r"""Integral sliding mode around {name}, relative degree {r}.

.. math:: \sigma = e^{{({last})}} - e^{{({last})}}(0) + \int_0^t v_0\,dt

On sigma = 0, from the first sample on, the error moves as under the nominal law v_0 alone. The law
has to supply v_0 too: a relay needs \|xi + v_0\| < rho. V. I. Utkin and J. Shi, 1996; see
`integral_sliding`. The nominal law v_0 is:

"""
STARTED = Param("started", "1", low=0.0, high=1.0,
                help="0: begins on sigma = 0; 1: begins with the offset that is given")


@family(card=Surface(source=(UTKIN_1996,)))
def integral_sliding(r: int, nominal: Block) -> Block:
    r"""Integral sliding mode around a nominal law: sigma is 0 from the start.

    .. math::

        \sigma = e^{(r-1)} - e^{(r-1)}(0) + \int_0^t v_0\,dt, \qquad
        \dot\sigma = (\xi + v_0) - v

    Parameters
    ----------
    r : int
        Relative degree: of the error, the derivatives up to r - 1 are used, 1 to 6.
    nominal : Block
        Law :math:`v_0` of one input that gives the motion wanted, :math:`e^{(r)} = -v_0`:
        `pid.pd`, a law of `hosmc`, your own. Its `sigma` is (e, ..., e^(r-1)); a number for r = 1.

    Returns
    -------
    Block
        A surface for `ClosedLoop`, with the parameters and states of the nominal law, and with the
        states `offset` and `started`.

    Raises
    ------
    ParameterError
        A relative degree that is not allowed, or that the nominal law is not for; a nominal law
        that asks for what a surface does not see, or has a name that the surface needs.
    BlockError
        A nominal law that is not a block.

    Notes
    -----
    While sigma = 0 the error moves as under :math:`v_0` without a perturbation, from the first
    sample on: there is no reaching, and what is matched is rejected in full, as long as the law
    can keep sigma at 0. To this end it supplies :math:`v_0` too: a relay needs
    :math:`\rho > |\xi + v_0|`, and `Run.xi` and `Run.doubts` speak of this sum. :math:`v_0` is that
    of Utkin and Shi's u = u_0 + u_1; here the law's v contains it, and no stage adds it.

    With `started` = 1 it begins with `offset` as given, and then reaches sigma = 0 as any surface.
    The integral term of `itae` is something else: it removes an error that remains.

    References
    ----------
    V. I. Utkin and J. Shi, 35th IEEE Conf. Decision and Control (1996) 4591.

    Examples
    --------
    >>> surface = integral_sliding(2, smc.pid.pd)
    >>> surface((0.5, -0.2), surface.z0, 0.01)
    (0.0, (0.203, 1.0))
    """
    r = relative_degree("integral_sliding", r, 6)
    nominal = wanted("integral_sliding: nominal", nominal)
    if nominal.r not in (None, r):
        raise ParameterError(f"integral_sliding: r = {r} is not allowed; {nominal.name} is for "
                             f"relative degree {nominal.r}")
    seen = (*STAGES["surface"].asks, "sigma", *OWN)
    if unseen := [n for n in nominal.signals if n not in seen]:
        raise ParameterError(f"integral_sliding: nominal = {nominal.name} asks for {unseen[0]}, "
                             f"which a surface does not see; allowed are {', '.join(seen)}")
    if taken := {"first", "nominal", "offset", "s", "started", "v_0"} & {*nominal.settable}:
        raise ParameterError(f"integral_sliding: nominal = {nominal.name} has a '{min(taken)}', "
                             "which is a name of the surface's own; give it another")
    states = list(nominal.states)
    sigma = "first(e)" if r == 1 else f"({', '.join(f'e[{i}]' for i in range(r))})"
    given = dict(sigma=sigma, z=f"({', '.join(states)},)")
    asked = [given[n] if n in given else n for n in nominal.signals]
    call = f"nominal({', '.join([*asked, *nominal.params])})"
    s = "first(e)" if r == 1 else f"e[{r - 1}]"
    body = [f"{', '.join([*states, 'offset', 'started'])} = z", f"s = {s}",
            "offset = offset if started else -s",
            f"v_0, ({', '.join(states)},) = {call}" if states else f"v_0 = {call}",
            f"return s + offset, ({', '.join([*states, 'offset + tau*v_0', '1.0'])})"]
    names = dict(nominal=nominal.f, first=first, __name__=__name__)
    names |= {f"A_{n}": Annotated[nominal.kinds[n], m] for n, m in nominal.params.items()}
    signals = dict.fromkeys(("e", *(n for n in nominal.signals if n != "sigma"), "z", "tau"))
    arguments = [*signals, *(f"{n}: A_{n} = {nominal.values[n]!r}" for n in nominal.params)]
    doc = AROUND.format(r=r, last=r - 1, name=nominal.name) + cleandoc(nominal.__doc__ or "")
    f = written("integral_sliding", ", ".join(arguments), "\n".join(body), names, doc)
    kept = {n: Buffer(nominal.values[n], nominal.buffers[n]) if n in nominal.buffers
            else (nominal.values[n], m) for n, m in nominal.states.items()}
    own = dict(offset=(0.0, OFFSET), started=(0.0, STARTED))

    def together(values):
        return nominal.check and nominal.check({n: values[n] for n in nominal.settable})

    return block(f, state=kept | own, output=Param(r"\sigma"), check=together)


@family(card=Surface(source=(LEVANT_1993,)))
def differenced(r: int) -> Block:
    r"""The error, its derivatives, and one more by difference from the previous sample.

    .. math:: (\sigma, \dot\sigma, ..., \sigma^{(r)}), \qquad
        \sigma^{(r)}_k = (\sigma^{(r-1)}_k - \sigma^{(r-1)}_{k-1})/\tau

    Parameters
    ----------
    r : int
        Length of the error, which comes with r - 1 derivatives, 1 to 5.

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
    For laws of relative degree r + 1: with ``hosmc.integrated`` as allocation it raises the
    relative degree by one. The difference lags by half a sample and amplifies noise 1/tau times;
    where there is noise, a differentiator does better.

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
    r"""The error with as many derivatives as the law needs, from a differentiator that gives more.

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
    The highest derivative of a differentiator chatters; one of an order higher than r - 1 gives the
    law smooth derivatives. For laws that take the whole tuple (`smc.hosmc`); `itae` and
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
