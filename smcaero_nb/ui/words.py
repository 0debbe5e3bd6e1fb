"""What a person reads: symbols, units, docstrings, messages, as HTML."""

import html
import inspect
import math
import re
import unicodedata

from ..core import BlockError, ParameterError
from ..core.signal import flat

__all__ = ["UNKNOWN", "doc_html", "label", "measure", "result_html", "said_html", "shown", "symbol", "unit_html", "why_diverged",
           "why_not"]

SPELT = {"varepsilon": "EPSILON", "varphi": "PHI", "vartheta": "THETA", "lambda": "LAMDA", "lam": "LAMDA"}
OTHER = {"int": "∫", "infty": "∞", "partial": "∂", "nabla": "∇", "ell": "ℓ", "cdot": "·"}
ACCENTS = {"dot": "\u0307", "ddot": "\u0308", "bar": "\u0304", "hat": "\u0302", "tilde": "\u0303"}
UNKNOWN = "\u2013"
POWER = r"\^(-?\d+(?:/\d+)?)"
DEGREES = {"rad": "deg", "rad/s": "deg/s", "rad/s^2": "deg/s^2"}


def _letter(name):
    """The character that a LaTeX name stands for, or the name itself."""
    case = "CAPITAL" if name[0].isupper() else "SMALL"
    try:
        return OTHER.get(name) or unicodedata.lookup(f"GREEK {case} LETTER {SPELT.get(name, name.upper())}")
    except KeyError:
        return name


def symbol(latex):
    """A LaTeX symbol as text with <sub> and <sup>, for axes, where no MathJax is at hand."""
    s = re.sub(r"\\(dot|ddot|bar|hat|tilde)\s*(?:{(.*?)}|(\\[A-Za-z]+|\w))", lambda m: (m[2] or m[3]) + ACCENTS[m[1]], latex)
    s = re.sub(r"\\(?:mathrm|text|mathbf)\b", "", s)
    s = re.sub(r"\\([A-Za-z]+)\s*", lambda m: _letter(m[1]), s)
    s = re.sub(r"\\[,;! ]", "\u2009", s)
    for mark, tag in (("_", "sub"), ("^", "sup")):
        s = re.sub(rf"\{mark}(?:{{(.*?)}}|(.))", lambda m, tag=tag: f"<{tag}>{m[1] or m[2]}</{tag}>", s)
    return s.replace("{", "").replace("}", "")


def _bracketed(unit):
    said = re.sub(r"\[(\w+)\]", lambda m: f"[{_letter(m[1])}]", unit)
    return said if "[" in said else f"[{said}]"


def unit_html(unit):
    """A unit in brackets, with a space before it; nothing if there is none."""
    return "" if unit == "1" else " " + re.sub(POWER, r"<sup>\1</sup>", _bracketed(unit)).replace("-", "\u2212")


def label(name, meta):
    """Label of a control, for MathJax: symbol (a word stays a word) and unit."""
    said = meta.symbol or name
    said = said if re.fullmatch("[A-Za-z]{2}[A-Za-z_ ]*", said) else f"${said}$"
    unit = re.sub(POWER, r"^{\1}", _bracketed(meta.unit)).replace(" ", r"\,")
    return said if meta.unit == "1" else rf"{said} $\mathrm{{{unit}}}$"


def shown(meta):
    """(factor, unit) in which a person reads a quantity: degrees for radians."""
    return (180/math.pi, DEGREES[meta.unit]) if meta.unit in DEGREES else (1.0, meta.unit)


def measure(values, factor, unit):
    """A figure of merit, or one a channel, with its unit."""
    values = values if isinstance(values, tuple) else (values,)
    if not all(map(math.isfinite, values)):
        return UNKNOWN
    said = ", ".join(f"{v*factor:.0f}" if 1e3 <= abs(v*factor) < 1e5 else f"{v*factor:.3g}" for v in values)
    return said if unit == "1" else said + " " + re.sub(POWER, r"<sup>\1</sup>", unit)


def said_html(text, refused):
    """A message, as a refusal or as a remark."""
    return text and f'<span class="smcaero-{"bad" if refused else "good"}">{html.escape(text, quote=False)}</span>'


def why_not(error):
    """What an exception says to a person: the kit's own words, or another's with its kind."""
    return str(error) if isinstance(error, (ParameterError, BlockError)) else f"{type(error).__name__}: {error}"


def result_html(result):
    """What a result says of itself, as HTML; a picture says nothing."""
    said = "" if type(result).__str__ is object.__str__ or hasattr(result, "to_plotly_json") else str(result)
    said = re.sub(r"\b([a-z])_(\d+)", r"\1<sub>\2</sub>", html.escape(said, quote=False))
    said = re.sub(r"\^\((\d+)\)", lambda m: f"<sup>({m[1]})</sup>" if int(m[1]) > 2 else "'"*int(m[1]), said)
    return f'<div class="smcaero-result">{said}</div>' if said else ""


def doc_html(doc):
    """A numpydoc docstring as HTML, with LaTeX for MathJax; what the mask shows itself, the arguments, is left out."""
    intro, *sections = re.split(r"\n([A-Z][\w ]+)\n-{3,}\n", inspect.cleandoc(doc or "No description."))
    said = _prose(intro)
    for title, body in zip(sections[::2], sections[1::2], strict=True):
        if title == "Examples":
            said += f"<b>{title}</b><pre>{html.escape(body)}</pre>"
        elif title not in ("Parameters", "Returns", "Raises", "Attributes", "Yields", "See Also"):
            said += f"<b>{title}</b>{_prose(body)}"
    return said


def _prose(text):
    """Paragraphs, equations, inline mathematics and code of reStructuredText."""
    def equation(m):
        tex = re.sub(r"\n\s*\n", "\n", m[1]).strip()
        return f"\n\n$$\\begin{{aligned}}{tex}\\end{{aligned}}$$\n\n"

    text = html.escape(text, quote=False)
    text = re.sub(r"^\.\. math::(.*(?:\n(?:[ \t]+\S.*|[ \t]*(?=\n)))*)", equation, text, flags=re.M)
    text = re.sub(r":math:`([^`]*)`", r"$\1$", text)
    parts = re.split(r"(\$\$.*?\$\$|\$.*?\$)", text, flags=re.S)
    parts[::2] = [re.sub(r"``?([^`]+)``?", r"<code>\1</code>", re.sub(r"\*\*([^*]+)\*\*", r"<b>\1</b>", p)).replace(
        r"\|", "|") for p in parts[::2]]
    return "".join(f"<p>{p}</p>" for p in re.split(r"\n\s*\n", "".join(parts).strip()))


def why_diverged(run):
    """When a run diverged and what left its limit, in words; the last row recorded tells which it was."""
    loop = run.loop
    if not len(run.t):
        return "diverged at 0 s: the start is beyond the limits of the plant"
    signals = [("y", v, m) for v, m in zip(flat(run.y), flat(loop.metadata("y") or ()), strict=False) if m]
    signals += [(n, getattr(run.x, n), m) for n, m in loop.stages["plant"].states.items()]
    used = {}
    for name, values, meta in signals:
        bound = meta.high if values[-1] > 0 else -meta.low
        if 0 < bound < math.inf:
            name, (factor, unit) = re.sub("<.*?>", "", symbol(meta.symbol or name)), shown(meta)
            used[abs(values[-1])/bound] = f"{name} left its limit of {bound*factor:.3g} {unit}".removesuffix(" 1")
    said = used[max(used)] if used and max(used) > 0.1 else "a state is no longer finite"
    return f"diverged at {run.diverged_at:.4g} s: {said}"
