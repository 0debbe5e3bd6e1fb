"""Quasi-continuous higher-order sliding mode control: discontinuous only at sigma = ... = 0."""

import math
from dataclasses import replace

from ..core import Block
from ..core.family import family
from ..core.param import chosen
from ..core.signal import sign
from ..sources import DING_2016, KODE, LEVANT_2005
from .homogeneous import CARD, law, order, power, ratio

__all__ = ["quasi_continuous"]


def rational_2(s0, s1):
    """([s1]^2 + s0)/(|s1|^2 + |s0|)."""
    b = s1*abs(s1)
    return ratio(b + s0, abs(b) + abs(s0))


def rational_3(s0, s1, s2):
    """([s2]^3 + [s1]^(3/2) + s0)/(|s2|^3 + |s1|^(3/2) + |s0|)."""
    b, c = s1*math.sqrt(abs(s1)), s2*s2*s2
    return ratio(c + b + s0, abs(c) + abs(b) + abs(s0))


def rational_4(s0, s1, s2, s3):
    """([s3]^4 + 2 [s2]^2 + 2 [s1]^(4/3) + s0)/(...)."""
    b, c, d = 2.0*power(s1, 4/3), 2.0*s2*abs(s2), s3*s3*s3*abs(s3)
    return ratio(d + c + b + s0, abs(d) + abs(c) + abs(b) + abs(s0))


def rational_5(s0, s1, s2, s3, s4):
    """([s4]^5 + 6 [s3]^(5/2) + 5 [s2]^(5/3) + 3 [s1]^(5/4) + s0)/(...)."""
    b, c = 3.0*s1*math.sqrt(math.sqrt(abs(s1))), 5.0*power(s2, 5/3)
    d, e = 6.0*s3*abs(s3)*math.sqrt(abs(s3)), s4*s4*s4*s4*s4
    return ratio(e + d + c + b + s0, abs(e) + abs(d) + abs(c) + abs(b) + abs(s0))


def levant_2(s0, s1):
    """Psi_1 with N_0 = |s0|: (s1 + a sign(s0))/(|s1| + a), a = |s0|^(1/2)."""
    return stage(s1, math.sqrt(abs(s0)), sign(s0))


def levant_3(s0, s1, s2):
    """Psi_2."""
    a = abs(s0)**(2/3)
    b = 2.0*math.sqrt(abs(s1) + a)
    return stage(s2, b, stage(s1, a, sign(s0)))


def levant_4(s0, s1, s2, s3):
    """Psi_3."""
    a = 0.5*abs(s0)**(3/4)
    b = (abs(s1) + a)**(2/3)
    c = 3.0*math.sqrt(abs(s2) + b)
    return stage(s3, c, stage(s2, b, stage(s1, a, sign(s0))))


def levant_5(s0, s1, s2, s3, s4):
    """Psi_4."""
    a = 0.35*abs(s0)**(4/5)
    b = 0.8*(abs(s1) + a)**(3/4)
    c = 1.8*(abs(s2) + b)**(2/3)
    d = 5.0*math.sqrt(abs(s3) + c)
    return stage(s4, d, stage(s3, c, stage(s2, b, stage(s1, a, sign(s0)))))


def stage(s, a, psi):
    """Psi_i = (s_i + a_i Psi_(i-1))/(|s_i| + a_i)."""
    return ratio(s + a*psi, abs(s) + a)


#: {family: {r: (Psi, default alpha, equation)}}
FAMILIES = {
    "rational": {
        1: (sign, 1.5, r"\Psi = \mathrm{sign}(s_0)"),
        2: (rational_2, 3.0, r"\Psi = \frac{\lfloor s_1\rceil^2 + s_0}{|s_1|^2 + |s_0|}"),
        3: (rational_3, 8.0, r"\Psi = \frac{\lfloor s_2\rceil^3 + \lfloor s_1\rceil^{3/2} + s_0}"
            r"{|s_2|^3 + |s_1|^{3/2} + |s_0|}"),
        4: (rational_4, 14.0, r"\Psi = \frac{\lfloor s_3\rceil^4 + 2\lfloor s_2\rceil^2 "
            r"+ 2\lfloor s_1\rceil^{4/3} + s_0}{|s_3|^4 + 2|s_2|^2 + 2|s_1|^{4/3} + |s_0|}"),
        5: (rational_5, 30.0, r"\Psi = \frac{\lfloor s_4\rceil^5 + 6\lfloor s_3\rceil^{5/2} "
            r"+ 5\lfloor s_2\rceil^{5/3} + 3\lfloor s_1\rceil^{5/4} + s_0}"
            r"{|s_4|^5 + 6|s_3|^{5/2} + 5|s_2|^{5/3} + 3|s_1|^{5/4} + |s_0|}"),
    },
    "levant2005": {
        1: (sign, 1.5, r"\Psi = \mathrm{sign}(s_0)"),
        2: (levant_2, 3.0, r"\Psi = \frac{s_1 + |s_0|^{1/2}\mathrm{sign}(s_0)}"
            r"{|s_1| + |s_0|^{1/2}}"),
        3: (levant_3, 14.0, "b = (1, 2)"),
        4: (levant_4, 20.0, r"b = (\tfrac12, 1, 3)"),
        5: (levant_5, 50.0, "b = (0.35, 0.8, 1.8, 5)"),
    },
}
RECURSION = (r"\Psi_0 = \mathrm{sign}(s_0),\quad N_0 = |s_0|,\quad "
             r"a_i = b_i N_{i-1}^{(r-i)/(r-i+1)},\quad "
             r"N_i = |s_i| + a_i,\quad \Psi_i = \frac{s_i + a_i\Psi_{i-1}}{N_i},\quad "
             r"\Psi = \Psi_{r-1},\quad ")


QUASI_CONTINUOUS = replace(CARD, source=(KODE, LEVANT_2005, DING_2016))


@family(card=QUASI_CONTINUOUS)
def quasi_continuous(r: int, family: str = "rational") -> Block:
    r"""Quasi-continuous higher-order sliding mode control: continuous except where sigma slides.

    .. math:: v = \alpha L\,\Psi_r(\sigma/L, \dot\sigma/L, ..., \sigma^{(r-1)}/L), \qquad
        |\Psi_r| \le 1

    Parameters
    ----------
    r : int
        Relative degree, 1 to 5; 1 is the relay.
    family : str
        ``"rational"``, one fraction, the paper's form; or ``"levant2005"``, the recursive form,
        which needs larger gains from r = 3 on.

    Returns
    -------
    Block
        A law of the tuple (sigma, sigma', ..., sigma^(r-1)), or of the number sigma where r = 1,
        with parameters `alpha`, `L`, `lam`.

    Raises
    ------
    ParameterError
        An order or a family that does not exist.

    Notes
    -----
    v is continuous except at :math:`\sigma = \dot\sigma = ... = 0`, where it is set to 0:
    it chatters once sigma = 0 is reached, not on the way there, as a nested law does. Sampled every
    tau, :math:`|\sigma^{(i)}| \sim \tau^{r-i}`.

    :math:`\Psi_r` is v with alpha = L = lam = 1. The default gains alpha settle the chain of r
    integrators from any direction, against sine, constant and sign-feedback perturbations up to the
    bound L.

    Erratum: (27) prints 6 as the coefficient of the first derivative; it is 3. With alpha = 20,
    which settles all of 40 trials within 40 s with 3, most fail to with 6, and some still oscillate
    after 600 s.

    References
    ----------
    Paper eq (27). A. Levant, IEEE Trans. Automatic Control 50 (2005) 1812. S. Ding, A. Levant and
    S. Li, Automatica 67 (2016) 22.

    Examples
    --------
    >>> quasi_continuous(2)((0.3, -0.2), alpha=1.0)
    0.7647058823529412
    """
    chosen("quasi_continuous", "family", family, FAMILIES)
    r = order("quasi_continuous", r, 1, 5)
    psi, alpha, equation = FAMILIES[family][r]
    rational = family == "rational"
    notes = ("Continuous except at sigma = sigma' = ... = 0. Sampled every tau, sigma^(i) is of\n"
             "    the order tau^(r-i). The default alpha settled in every trial. Output feedback\n"
             "    needs a differentiator of order r - 1.")
    if r == 5 and rational:
        notes += "\n\n    Erratum: (27) prints the coefficient 6 for the first derivative; it is 3."
    source = ("S. Ding, A. Levant and S. Li, Automatica 67 (2016) 22." if rational
              else "A. Levant, IEEE Trans. Automatic Control 50 (2005) 1812.")
    return law(f"quasi_continuous_{r}" if rational else f"levant2005_{r}", r, psi, alpha,
               QUASI_CONTINUOUS, title="Quasi-continuous sliding mode control",
               equation=equation if rational or r < 3 else RECURSION + equation, notes=notes,
               references=f"Paper eq (27). {source}")
