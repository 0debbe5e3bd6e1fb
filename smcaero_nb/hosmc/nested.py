"""Nested higher-order sliding mode control: a relay that switches on another relay, and so on."""

import math
from dataclasses import replace

from ..core import Block
from ..core.family import family
from ..core.signal import sign
from ..sources import KODE, LEVANT_2003
from .homogeneous import CARD, law, order

__all__ = ["nested"]


def nested_2(s0, s1):
    """sign(s1 + N_1 sign(s0)), N_1 = |s0|^(1/2)."""
    return sign(s1 + math.sqrt(abs(s0))*sign(s0))


def nested_3(s0, s1, s2):
    """sign(s2 + 2 N_2 sign(s1 + N_1 sign(s0))), N_2 = (|s0|^2 + |s1|^3)^(1/6)."""
    n1 = abs(s0)**(2/3)
    n2 = (s0*s0 + abs(s1)**3.0)**(1/6)
    return sign(s2 + 2.0*n2*sign(s1 + n1*sign(s0)))


def nested_4(s0, s1, s2, s3):
    """sign(s3 + 3 N_3 sign(s2 + N_2 sign(s1 + 0.5 N_1 sign(s0)))), q = 12."""
    p0, p1, p2 = abs(s0)**3.0, abs(s1)**4.0, abs(s2)**6.0
    n1, n2, n3 = abs(s0)**(3/4), (p0 + p1)**(1/6), (p0 + p1 + p2)**(1/12)
    return sign(s3 + 3.0*n3*sign(s2 + n2*sign(s1 + 0.5*n1*sign(s0))))


def nested_5(s0, s1, s2, s3, s4):
    """sign(s4 + 8 N4 sign(s3 + 1.8 N3 sign(s2 + 0.8 N2 sign(s1 + 0.35 N1 sign(s0))))), q = 60."""
    p0, p1, p2, p3 = abs(s0)**12.0, abs(s1)**15.0, abs(s2)**20.0, abs(s3)**30.0
    n1, n2 = abs(s0)**(4/5), (p0 + p1)**(1/20)
    n3, n4 = (p0 + p1 + p2)**(1/30), (p0 + p1 + p2 + p3)**(1/60)
    return sign(s4 + 8.0*n4*sign(s3 + 1.8*n3*sign(s2 + 0.8*n2*sign(s1 + 0.35*n1*sign(s0)))))


def switched(values, a, omega):
    """Describing function for relative degree 2: a relay that switches before sigma is 0.

    It switches at sigma = a q, where (sigma')^2 = a^2 omega^2 (1 - q^2) = L lam^2 a q.
    """
    p = a*omega*omega/(values["L"]*values["lam"]**2)
    q = 2.0*p/(1.0 + math.sqrt(1.0 + 4.0*p*p))
    size = 4.0*values["alpha"]*values["L"]*values["lam"]**2/(math.pi*a)
    return size*complex(math.sqrt(1.0 - q*q), q)


#: {r: (Psi, default alpha, equation)}
LAWS = {
    1: (sign, 1.5, r"\Psi = \mathrm{sign}(s_0)"),
    2: (nested_2, 2.0, r"\Psi = \mathrm{sign}(s_1 + |s_0|^{1/2}\mathrm{sign}(s_0))"),
    3: (nested_3, 8.0, r"\Psi = \mathrm{sign}(s_2 + 2 (|s_1|^3 + |s_0|^2)^{1/6}"
        r"\,\mathrm{sign}(s_1 + |s_0|^{2/3}\mathrm{sign}(s_0)))"),
    4: (nested_4, 20.0, r"\Psi = \mathrm{sign}(s_3 + 3 (s_2^6 + s_1^4 + |s_0|^3)^{1/12}"
        r"\,\mathrm{sign}(s_2 + (s_1^4 + |s_0|^3)^{1/6}"
        r"\,\mathrm{sign}(s_1 + \tfrac12 |s_0|^{3/4}\mathrm{sign}(s_0))))"),
    5: (nested_5, 120.0, r"\Psi_0 = \mathrm{sign}(s_0),\quad "
        r"N_i = \Big(\sum_{j<i} |s_j|^{60/(5-j)}\Big)^{(5-i)/60},\quad "
        r"\Psi_i = \mathrm{sign}(s_i + b_i N_i \Psi_{i-1}),\quad "
        r"\Psi = \Psi_4,\quad b = (0.35, 0.8, 1.8, 8)"),
}


NESTED = replace(CARD, source=(KODE, LEVANT_2003))


@family(card=NESTED)
def nested(r: int) -> Block:
    r"""Nested higher-order sliding mode control: v is +alpha L or -alpha L.

    .. math:: v = \alpha L\,\Psi_r(\sigma/L, \dot\sigma/L, ..., \sigma^{(r-1)}/L), \qquad
        \Psi_r \in \{-1, 0, 1\}

    Parameters
    ----------
    r : int
        Relative degree, 1 to 5; 1 is the relay. 5 is experimental.

    Returns
    -------
    Block
        A law of the tuple (sigma, sigma', ..., sigma^(r-1)), or of the number sigma where r = 1,
        with parameters `alpha`, `L`, `lam`.

    Raises
    ------
    ParameterError
        An order that does not exist.

    Notes
    -----
    v chatters on the way to sigma = 0, too, while it slides along one inner surface after another;
    `quasi_continuous` does not. Sampled every tau, :math:`|\sigma^{(i)}| \sim \tau^{r-i}`; large
    gains need a small tau.

    Order 5 is experimental: no coefficients for it were found in print. With those here, sampled
    every 0.5 ms, the gains 60 and 100 to 160 settled in all of 80 trials, 70 to 90 in all but one
    to four of 40.

    Erratum: (28) prints alpha {...}; it is alpha sign{...}.

    References
    ----------
    Paper eq (28). A. Levant, Int. J. Control 76 (2003) 924.

    Examples
    --------
    >>> nested(2)((0.3, -0.2), alpha=1.0)
    1.0
    """
    r = order("nested", r, 1, 5)
    psi, alpha, equation = LAWS[r]
    notes = ("Discontinuous wherever Psi changes its sign. Sampled every tau, sigma^(i) is of the\n"
             "    order tau^(r-i). The default alpha settled in every trial.")
    if r == 4:
        notes += "\n\n    Erratum: (28) prints alpha {...}; it is alpha sign{...}."
    if r == 5:
        notes += ("\n\n    Experimental: these b were found by search, not in print; they want a\n"
                  "    tau of 5e-4 s or less. Sizes of s_3 above 1e10 overflow.")
    card = replace(NESTED, describing=switched) if r == 2 else NESTED
    return law(f"nested_{r}" + "_experimental"*(r == 5), r, psi, alpha, card,
               said="experimental; " if r == 5 else "",
               title="Nested sliding mode control" + (" (experimental)" if r == 5 else ""),
               equation=equation, notes=notes,
               references="Paper eq (28). A. Levant, Int. J. Control 76 (2003) 924.")
