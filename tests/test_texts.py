"""Texts of a user's blocks are shown as typed wherever they stand, and run nowhere."""

import dataclasses
import functools
import html
import math
import random
import re
import types
from html.parser import HTMLParser
from typing import Annotated

import plotly.graph_objects as go
import pytest

import smcaero_nb as smc
from smcaero_nb import ClosedLoop, Param, block
from smcaero_nb.core.param import said as shortened
from smcaero_nb.ui import live, mask, plot, upload
from smcaero_nb.ui.curves import comparison_html, metrics_html, verdict_html
from smcaero_nb.ui.text import (
    doc_html,
    label,
    measure,
    result_html,
    said_html,
    symbol,
    unit_html,
    why_diverged,
)

PIECES = ("<script>globalThis.hacked=1</script>", '<img src=x onerror="globalThis.hacked=2">',
          "N<m>", "</div>", "<b>b</b>", "<a href='javascript:1'>a</a>", "<!--", "<![CDATA[", "<?x",
          "<extra>", "&amp;", "&lt;b&gt;", "&", "#", "%", "%{y}", "%{x:.2f}", "$x$", "$$", "$",
          r"\(x\)", r"\[x\]", r"\begin{x}", r"\dot{}", r"\frac{a}", r"\\", "\\", "{", "}", "_",
          "^^", "^2", "~", '"', "'", "-", "–", "ü", " ", "a")
LATEX = (*PIECES, r"\dot", r"\bar ", r"\alpha", r"\mathrm", r"\text{a}", r"\,", r"\_", "_a", "{b}",
         "1", "x")


def texts(seed, pieces, many, start=""):
    """Random texts, without blanks at their ends, which HTML may drop."""
    rng = random.Random(seed)
    return [start + "".join(rng.choices(pieces, k=rng.randint(1, 5))).strip() for _ in range(many)]


# none is LaTeX of a symbol, or a unit
HOSTILE = [*(f"<{q}".strip() for q in PIECES), *texts(0, PIECES, 300, "<")]


class Reader(HTMLParser):
    """Text and tags of HTML."""

    def __init__(self, said):
        super().__init__()
        self.text, self.tags = "", set()
        self.feed(said)
        self.close()

    def handle_data(self, data):
        self.text += data

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        assert all(n == "class" and v.startswith("smcaero-") or (tag, n) == ("th", "scope")
                   for n, v in attrs)

    def handle_comment(self, data):
        raise AssertionError(f"a comment: {data}")

    handle_decl = handle_pi = unknown_decl = handle_comment


def read(said, *tags):
    """The text of HTML that has no other tags."""
    there = Reader(said)
    assert there.tags <= set(tags), said
    return there.text


def drawn(said):
    """The text that plotly draws: it has other entities, equations, and places for numbers."""
    bare = re.sub("</?su[bp]>", "", said)
    assert not re.search(r"[<>$]|%{", bare)
    assert set(re.findall(r"&#?\w*;?", bare)) <= {"&amp;", "&lt;", "&gt;", "&#36;", "&#37;"}
    return html.unescape(bare)


def typeset(said):
    """What MathJax leaves as text of a text without equations: it takes escapes out."""
    parts = re.findall(r"\\[\\$]|.", said, re.S)
    assert not {"$", "\\"} & set(parts), said
    return "".join(q[-1] for q in parts)


def in_brackets(unit):
    """A unit as it is written: of a signal's unit the brackets are there."""
    return unit if "[" in unit else f"[{unit}]"


def hostile(text, limit=math.inf):
    """A loop all of whose texts are `text`."""
    about = Param(text, text, help=text)

    limited = Param("", text, low=-limit, high=limit, help=text)

    @block(state={text: (0.4, limited), "v": (1.0, about)})
    def plant(x, u, d):
        return x[1], u + d

    @block(output=(about, Param(text, f"{text}/s")))
    def output(x):
        return x[0], x[1]

    @block(output=about)
    def surface(e, c: Annotated[float, about] = 1.0):
        return e[1] + c*e[0]

    @block(output=about)
    def law(sigma, rho: Annotated[float, about] = 2.0):
        return rho*((sigma > 0.0) - (sigma < 0.0))

    for b in (plant, output, surface, law):
        b.name, b.__doc__ = text, text
    return ClosedLoop(plant=plant, output=output, surface=surface, law=law, name=text,
                      duration=1.0, dt=0.01, verdict=lambda run: text)


@functools.cache
def compiled(limit):
    return smc.simulate(hostile("x", limit))


def simulated(text, limit=math.inf):
    """A run of `hostile`, which is compiled but once."""
    run = compiled(limit)
    states = types.SimpleNamespace(**{text: run.x.x, "v": run.x.v})
    return dataclasses.replace(run, loop=hostile(text, limit), x=states)


def test_what_is_no_latex_of_a_symbol_is_shown_as_typed():
    for text in HOSTILE:
        assert read(symbol(text)) == drawn(symbol(text)) == text
        assert typeset(label("k", Param(text))) == typeset(label(text, Param())) == text


def test_no_symbol_raises_or_has_other_tags_than_indices():
    for text in texts(1, LATEX, 3000):
        read(symbol(text), "sub", "sup")
        drawn(symbol(text))


@pytest.mark.parametrize("bad", [
    r"\dot{}", r"\dot", r"\dot{+}", r"\dot\bar x", r"\frac{a}", r"\Alpha", r"\lam", r"\text{a_b}",
    "x_", "x^", "x_^2", r"x_\dot y", r"x_\,", "x_a_b", "x^a^b", "x^2'", "x'^2", "^^", "{x", "x}",
    "{}", "}{", "%", "#", "&", "$", "~", "\\", "a\\", "x"*200, "{"*2000, "{"*2000 + "x" + "}"*2000],
    ids=lambda q: q[:20])
def test_broken_latex_is_text_to_mathjax_too(bad):
    assert symbol(bad) == html.escape(bad, quote=False).replace("$", "&#36;")
    assert typeset(label("k", Param(bad))) == bad


@pytest.mark.parametrize("latex, said", [
    (r"\bar{v_{eq}}(0)", "v\u0304<sub>eq</sub>(0)"), ("k^*", "k<sup>*</sup>"), ("x''", "x''"),
    (r"\dot{\sigma}_1^{2}", "σ\u0307<sub>1</sub><sup>2</sup>"), (r"\mathrm{s\_x}", "s_x"),
    (r"\theta_{\text{ref}}", "θ<sub>ref</sub>"), (r"{x_1}_2", "x<sub>1</sub><sub>2</sub>"),
    (r"50\,\%", "50\u2009%"), (r"\Delta u", "Δu"), ("x_{a_b}", "x<sub>a<sub>b</sub></sub>")])
def test_latex_of_a_symbol_is_read(latex, said):
    assert symbol(latex) == said and label("k", Param(latex)) == f"${latex}$"


def test_a_word_stays_a_word_on_axes_too():
    assert symbol("speed_limit") == label("speed_limit", Param()) == "speed_limit"


def test_units_are_shown_as_typed():
    for text in HOSTILE:
        bracketed = in_brackets(text)
        assert read(unit_html(text)) == drawn(unit_html(text)) == f" {bracketed}"
        assert read(measure(1.5, 2.0, text)) == f"3 {text}"
        assert typeset(label("gain", Param(unit=text))) == f"gain {bracketed}"


@pytest.mark.parametrize("unit", ["%", "#", "&", "~", "$", "_", "m_1", "a^2^3", "m^23^2", "N<m>",
                                  "{", "\\", r"\dot{}", "^11a"*40 + "<"])
def test_units_that_are_no_latex_are_text_to_mathjax(unit):
    assert typeset(label("gain", Param(unit=unit))) == f"gain [{unit}]"
    assert read(unit_html(unit)) == f" [{unit}]"


def test_a_hyphen_is_a_minus_only_in_a_power():
    assert unit_html("N-m^-2") == " [N-m<sup>\u22122</sup>]"
    assert label("gain", Param(unit="N-m^-2")) == r"gain $\mathrm{[N-m^{-2}]}$"


def test_a_unit_with_a_dash_keeps_its_figure():
    run = simulated("kg – m")
    assert "max |u|" in metrics_html(run) and "kg – m" in metrics_html(run)


def test_messages_results_and_docstrings_are_shown_as_typed():
    class Result:
        def __str__(self):
            return text

    for text in HOSTILE:
        assert read(said_html(text, True), "span") == read(said_html(text, False), "span") == text
        assert read(result_html(Result()), "div") == text
        assert typeset(read(doc_html(text), "p")) == text
        example = doc_html(f"A law.\n\nExamples\n--------\n{text}")
        assert read(example, "p", "b", "pre") == f"A law.Examples{text}"
    text = f"^({'9'*5000})"
    assert "9"*5000 in result_html(Result())


@pytest.mark.parametrize("tex", [
    r"\href{javascript:alert(1)}{x}", r"\style{color:red}{x}", r"\def\x{y}", r"\class{a}{b}", "{x",
    "x}", "a & b", "100%", "#1", "\\", "a $b$"])
def test_equations_that_mathjax_cannot_take_are_code(tex):
    said = doc_html(f":math:`{tex}`")
    assert read(said, "p", "code") == tex and "<code>" in said


def test_a_dollar_in_a_docstring_is_a_dollar():
    said = doc_html(r"It costs $5, or $6: :math:`x < \{y`, `$z$`.")
    assert said == r"<p>It costs \&#36;5, or \&#36;6: $x &lt; \{y$, <code>&#36;z&#36;</code>.</p>"


def test_figures_and_tables_of_a_run_show_texts_as_typed():
    for text in HOSTILE:
        run = simulated(text)
        assert read(verdict_html(run), "div", "span") == text
        assert f" {text}" in read(metrics_html(run), "div", "span", "b", "sub", "sup")
        table = read(comparison_html({text: run}), *"table thead tbody tr th td div span".split())
        assert table.count(text) == 5  # name, two units, variation of u, verdict


@pytest.mark.parametrize("several", [False, True])
def test_pictures_show_texts_as_typed(several):
    for text in HOSTILE[:100]:
        run, bracketed = simulated(text), in_brackets(text)
        figure = plot({text: run, "b": run} if several else run, states=(text,))
        layout = figure.to_plotly_json()["layout"]
        axes = [axis for n, axis in layout.items() if re.match("[xy]axis", n)]
        assert f"{text} {bracketed}" in [drawn(axis["title"]["text"]) for axis in axes]
        names = {drawn(t.name) for t in figure.data} - {"reference", "ξ"}
        assert names == ({text, "b"} if several else {text})
        for t in figure.data:
            parts = re.fullmatch(r"(.*) %{y:\.4g}(.*)<extra>(.*)</extra>", t.hovertemplate)
            symbol, unit, name = parts.groups()
            assert drawn(name) in (text, "b") if several else name == ""
            assert drawn(symbol) == ("ξ" if t.meta == "xi" else text)
            assert drawn(unit) in (f" {bracketed}", f" {text}/s", f" [{text}/s]")
    assert layout["hoverlabel"]["namelength"] == -1  # else what is cut may be half of an entity


def test_a_mask_shows_texts_as_typed():
    for text in HOSTILE[:100]:
        m, bracketed = mask({text: hostile(text), "b": smc.lv.loop("pd")}), in_brackets(text)
        for name, shown in (("law__rho", text), (f"plant__{text}", text.rpartition("__")[2])):
            widget = m.widgets[name]
            said = typeset(widget.description).removesuffix(" (plant)")  # a state of the law, too
            assert said == f"{shown} {bracketed}" and widget.tooltip == text
        assert m.choice.options == (text, "b")
        folds = [f.opener.description for f in m._body.children]
        assert f"law: {text.replace('_', ' ')}" in folds
        fold = m._body.children[folds.index(f"law: {text.replace('_', ' ')}")]
        fold.helper.value = True
        assert typeset(read(fold.doc.value, "p")) == text
        assert not any(" " in q for row in m._rows.values() for q in row.box._dom_classes)
        assert m.page.told.names["law__rho"] == (f"law rho {text}", False)
        m.entries["law__rho"].value = text
        told = read(m._status.value, "span")
        assert told.startswith(f"{text}: rho = {shortened(text)} is not allowed")
        assert told.endswith(f", in {text}. It stays at 2.")


def test_why_a_run_diverged_is_said_with_texts_as_typed():
    for text in HOSTILE[:100]:
        run = simulated(text, 0.5)
        assert f": {text} left its limit of 0.5 {text}" in why_diverged(run)


def test_a_live_plot_says_errors_and_results_as_typed():
    @block
    def own(k: float = 0.0):
        if k:
            raise ValueError(text)
        return go.Figure()

    for text in HOSTILE[:20]:
        own.name = text
        p = live({text: own})
        p.set(k=1.0)
        assert read(p.mask._status.value, "span").startswith(f"ValueError: {text}; ")


def test_files_and_columns_are_named_as_typed():
    p = live(smc.differentiators.trial())
    p.wait()
    own = upload(p, smc.differentiators.read_csv, smc.differentiators.trial)
    for text in HOSTILE[:20]:
        name, column = f"{text}.csv".replace("/", "."), re.sub(r'[,;"\s[(]', ".", text)
        rows = "".join(f"{0.01*i:.2f},{i*i}\n" for i in range(50))
        own.take(name, f"t,{column}\n{rows}".encode())
        assert own.status.startswith(f"{name}: 50 rows") and column in own.status
        assert read(own._message.value, "span") == own.status
        assert p.mask.choice.value == name and own.entries["f"].value == column
        p.wait()
        assert p._download.saved.file == f"{name.removesuffix('.csv')}, estimates.csv"
