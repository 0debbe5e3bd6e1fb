"""Texts as HTML: symbols, units, docstrings, messages.

Every text from outside enters HTML through `plain`; where MathJax reads it, by `_unmathed` first.
"""

import html
import inspect
import itertools
import math
import re
from collections.abc import Iterable
from typing import Any

from ..core import BlockError, Param, ParameterError, Run
from ..core.signal import flat

__all__ = ["UNKNOWN", "alternative", "doc_html", "doubts_text", "label", "measure", "plain",
           "result_html", "said_html", "shown", "symbol", "unit_html", "unmarked", "why_diverged",
           "why_not"]

LETTERS = dict(zip(
    "alpha beta gamma delta epsilon varepsilon zeta eta theta vartheta iota kappa lambda mu nu xi "
    "omicron pi rho sigma tau upsilon phi varphi chi psi omega Gamma Delta Theta Lambda Xi Pi "
    "Sigma Upsilon Phi Psi Omega int infty partial nabla ell cdot".split(),
    "αβγδεεζηθθικλμνξοπρστυφφχψωΓΔΘΛΞΠΣΥΦΨΩ∫∞∂∇ℓ·", strict=True))
SIGNS = {rf"\{n}": c for n, c in LETTERS.items()} | {rf"\{c}": "\u2009" for c in ",;:! "}
SIGNS |= {r"\_": "_", r"\%": "%", r"\#": "#", r"\&": "&amp;"}
ACCENTS = {r"\dot": "\u0307", r"\ddot": "\u0308", r"\bar": "\u0304", r"\hat": "\u0302",
           r"\tilde": "\u0303"}
FONTS = (r"\mathrm", r"\mathbf")
TAGS = {"_": "sub", "^": "sup"}
TOKEN = re.compile(r"(\\text\{[A-Za-z\d .,-]*\})|(\\[A-Za-z]+)\s*|(\\.|'+|.)", re.S)
GLYPH = re.compile(r"[^\W_]|[ ()\[\]|+\-=/.,:;!?*@]")
WORD = re.compile("[A-Za-z]{2}[A-Za-z_ ]*")
LONGEST = 99  # characters of a symbol; what is longer is prose
FEW = 3  # lines of a message that are shown at once
UNKNOWN = "\u2013"
POWER = r"\^(-?\d+(?:/\d+)?|n)"
UNIT = re.compile(rf"(?!.*{POWER}\^)(?:[^\W_]|[ /*().,+\-\[\]·°]|{POWER})*+")  # what MathJax takes
DEGREES = {"rad": "deg", "rad/s": "deg/s", "rad/s^2": "deg/s^2"}
MATHS = re.compile(r"^\.\. math::(.*(?:\n(?:[ \t]+\S.*|[ \t]*(?=\n)))*)|:math:`([^`]*)`", re.M)
# an error to MathJax, or something that reaches beyond its equation
NO_EQUATION = re.compile(
    r"[$#%]|\\(?:href|style|class|cssId|data|unicode|require|def|let|(?:re)?newcommand)\b")


def plain(text: str) -> str:
    """Return a text for HTML between tags and for plotly, without tags, equations, placeholders."""
    return html.escape(text, quote=False).replace("$", "&#36;").replace("%{", "&#37;{")


def unmarked(said: str) -> str:
    """Return the text that HTML shows."""
    return html.unescape(re.sub("<.*?>", "", said))


def _unmathed(text):
    """A text in which MathJax finds no equation."""
    return re.sub(r"[\\$]", r"\\\g<0>", text)


def symbol(latex: str) -> str:
    """Return a LaTeX symbol as text with <sub> and <sup>, for axes, where there is no MathJax.

    Anything but LaTeX of letters, accents, roman type and indices is shown as it stands.
    """
    return _read(latex) or plain(latex)


def _read(latex):
    """HTML of a symbol in LaTeX that MathJax takes as well; empty for words and all else."""
    tokens = ["".join(q) for q in reversed(TOKEN.findall(latex))]
    if len(latex) > LONGEST or WORD.fullmatch(latex):
        return ""
    try:
        said = _row(tokens)
    except (IndexError, KeyError):  # it ends too soon, or is other LaTeX
        return ""
    return "" if tokens else said.strip()


def _row(tokens):
    """HTML up to the next closing brace or the end; the last of `tokens` comes first."""
    said, marked = "", set()  # which indices the last letter has: LaTeX allows one of each
    while tokens and tokens[-1] != "}":
        token = tokens.pop()
        mark = "^" if token[0] == "'" else token
        if mark in marked:
            raise KeyError(token)
        if mark in TAGS:
            marked.add(mark)
            part = token if token != mark else f"<{TAGS[mark]}>{_argument(tokens)}</{TAGS[mark]}>"
        else:
            part = _atom(token, tokens)
            marked = marked if part.isspace() else set()
        said += part
    return said


def _atom(token, tokens):
    """A letter, a group, or either with an accent or in another font."""
    if token == "{":
        tokens.append(token)
    elif token not in ACCENTS and token not in FONTS:
        return _glyph(token)
    said = _argument(tokens)
    if token in ACCENTS:
        if not said[0].isalpha():
            raise KeyError(token)
        said = said[0] + ACCENTS[token] + said[1:]
    return said


def _argument(tokens):
    """A letter, or a group in braces."""
    token = tokens.pop()
    while token.isspace():
        token = tokens.pop()
    if token != "{":
        if (said := _glyph(token)).isspace():
            raise KeyError(token)
        return said
    said = _row(tokens)
    tokens.pop()  # the brace that closes
    return said


def _glyph(token):
    """The characters that a token stands for."""
    if token.startswith(r"\text{"):
        return token[6:-1]
    return token if GLYPH.fullmatch(token) else SIGNS[token]


def _bracketed(unit):
    said = re.sub(r"\[(\w+)\]", lambda m: f"[{(LETTERS | {'lam': 'λ'}).get(m[1], m[1])}]", unit)
    return said if "[" in said else f"[{said}]"


def _raised(unit):
    """A unit with its powers as HTML; anything else as it stands."""
    if not UNIT.fullmatch(unit):
        return plain(unit)
    return re.sub(POWER, lambda m: f"<sup>{m[1]}</sup>".replace("-", "\u2212"), unit)


def unit_html(unit: str) -> str:
    """Return a unit in brackets, with a space before it; nothing if there is none."""
    return "" if unit == "1" else " " + _raised(_bracketed(unit))


def label(name: str, meta: Param) -> str:
    """Return the label of a control: symbol and unit, as LaTeX if MathJax takes it, else text."""
    said, unit = meta.symbol or name, _bracketed(meta.unit)
    said = f"${said}$" if _read(said) else _unmathed(said)
    if meta.unit == "1":
        return said
    if not UNIT.fullmatch(unit):
        return f"{said} {_unmathed(unit)}"
    unit = re.sub(POWER, r"^{\1}", unit).replace(" ", r"\,")
    return rf"{said} $\mathrm{{{unit}}}$"


def shown(meta: Param) -> tuple[float, str]:
    """Return factor and unit in which a quantity is shown: degrees for radians."""
    return (180/math.pi, DEGREES[meta.unit]) if meta.unit in DEGREES else (1.0, meta.unit)


def measure(values: Any, factor: float, unit: str) -> str:
    """Return a figure of merit with its unit, or one for each channel."""
    values = values if isinstance(values, tuple) else (values,)
    if not all(map(math.isfinite, values)):
        return UNKNOWN
    values = [v*factor for v in values]
    said = ", ".join(f"{v:.0f}" if 1e3 <= abs(v) < 1e5 else f"{v:.3g}" for v in values)
    return said if unit == "1" else f"{said} {_raised(unit)}"


def alternative(places: Any, runs: Any) -> str:
    """Return what a figure of runs shows, in words, for those who do not see it."""
    shown_here = {}
    for (row, _), curves in places.items():
        names = [unmarked(c.label + c.unit) for *_, c in curves if not c.reference and not c.filled]
        shown_here.setdefault(unmarked(curves[0][2].abscissa), {}).update(
            dict.fromkeys(names or [row]))
    over = "; ".join(f"{', '.join(names)} over {x}" for x, names in shown_here.items())
    return f"Curves of {over}" + f", for {', '.join(runs)}"*(len(runs) > 1) + "."


def said_html(text: str, refused: bool) -> str:
    """Return a message, as a refusal or as a remark; of many lines, the last ones fold away."""
    few, more = (lines := [plain(q) for q in text.split("\n")])[:FEW], lines[FEW:]
    said = "<br>".join(few)
    if more:
        said += f"<details><summary>and {len(more)} more</summary>{'<br>'.join(more)}</details>"
    return said and f'<span class="smcaero-{"bad" if refused else "good"}">{said}</span>'


def doubts_text(doubts: Iterable[str]) -> str:
    """Return what speaks against a run, a line each."""
    lines = [f"{q}." for q in doubts]
    return "In doubt: " + "\n".join(lines) if lines else ""


def why_not(error: BaseException) -> str:
    """Return the text of an exception: the kit's errors verbatim, others as "Type: message"."""
    own = isinstance(error, (ParameterError, BlockError))
    return str(error) if own else f"{type(error).__name__}: {error}"


def result_html(result: Any) -> str:
    """Return the text of a result as HTML; a picture has none."""
    mute = type(result).__str__ is object.__str__ or hasattr(result, "to_plotly_json")
    said = "" if mute else str(result)
    said = re.sub(r"\b([a-z])_(\d+)", r"\1<sub>\2</sub>", plain(said))
    few = {"0": "", "1": "'", "2": "''"}
    said = re.sub(r"\^\((\d+)\)", lambda m: few.get(m[1], f"<sup>({m[1]})</sup>"), said)
    return f'<div class="smcaero-result">{said}</div>' if said else ""


def doc_html(doc: str | None) -> str:
    """Return a numpydoc docstring as HTML, with LaTeX for MathJax.

    The arguments, which the mask itself shows, are left out.
    """
    doc = inspect.cleandoc(doc or "No description.")
    intro, *sections = re.split(r"\n([A-Z][\w ]+)\n-{3,}\n", doc)
    said = _prose(intro)
    for title, body in zip(sections[::2], sections[1::2], strict=True):
        if title == "Examples":
            said += f"<b>{title}</b><pre>{plain(body)}</pre>"
        elif title not in ("Parameters", "Returns", "Raises", "Attributes", "Yields", "See Also"):
            said += f"<b>{title}</b>{_prose(body)}"
    return said


def _prose(text):
    """Paragraphs, equations, mathematics and code of reStructuredText; a dollar is a dollar."""
    parts = MATHS.split(text)
    said = _worded(parts[0])
    for display, inline, words in zip(parts[1::3], parts[2::3], parts[3::3], strict=True):
        tex = _equation(inline or display or "", inline is None)
        said += (f"\n\n{tex}\n\n" if inline is None else tex) + _worded(words)
    return "".join(f"<p>{p}</p>" for p in re.split(r"\n\s*\n", said.strip()))


def _equation(tex, display):
    """Mathematics for MathJax, or as code if MathJax cannot take it."""
    tex = re.sub(r"\n\s*\n", "\n", tex).strip()
    bare = re.sub(r"\\[^A-Za-z]", "", tex)  # without braces and marks that are only shown
    depths = list(itertools.accumulate((q == "{") - (q == "}") for q in bare)) or [0]
    torn = min(depths) < 0 or depths[-1] or bare.endswith("\\")
    if torn or NO_EQUATION.search(bare) or "&" in bare and not (display or r"\begin" in bare):
        return f"<code>{plain(tex)}</code>"
    said = html.escape(tex, quote=False)
    return rf"$$\begin{{aligned}}{said}\end{{aligned}}$$" if display else f"${said}$"*(said != "")


def _worded(text):
    """Words, code and bold type."""
    parts = re.split(r"``?([^`]+)``?", text)
    parts[::2] = [plain(_unmathed(p.replace(r"\|", "|"))) for p in parts[::2]]
    parts[::2] = [re.sub(r"\*\*([^*]+)\*\*", r"<b>\1</b>", p) for p in parts[::2]]
    parts[1::2] = [f"<code>{plain(p)}</code>" for p in parts[1::2]]
    return "".join(parts)


def why_diverged(run: Run) -> str:
    """Say when a run diverged and what left its limit, judged by the last row recorded."""
    loop = run.loop
    if not len(run.t):
        return "diverged at 0 s: the start is beyond the limits of the plant"
    about = flat(loop.metadata("y") or ())
    signals = [("y", v, m) for v, m in zip(flat(run.y), about, strict=False) if m]
    signals += [(n, v, m) for n, m in loop.stages["plant"].states.items()
                for v in flat(getattr(run.x, n))]
    used = {}
    for name, values, meta in signals:
        bound = meta.high if values[-1] > 0 else -meta.low
        if 0 < bound < math.inf:
            name, (factor, unit) = unmarked(symbol(meta.symbol or name)), shown(meta)
            limit = f"{bound*factor:.3g}" + f" {unit}"*(unit != "1")
            used[abs(values[-1])/bound] = f"{name} left its limit of {limit}"
    said = used[max(used)] if used and max(used) > 0.1 else "a state is no longer finite"
    return f"diverged at {run.diverged_at:.4g} s: {said}"
