"""Sizes that keep the library readable: no function over 50 lines of code, no module over 350."""

import ast
import io
import tokenize
from pathlib import Path

import pytest

import smcaero_nb as smc

HOME = Path(smc.__file__).parent
FUNCTION, MODULE = 50, 350
FILES = {path.relative_to(HOME).as_posix(): path for path in sorted(HOME.rglob("*.py"))}
for name in "ui/mask.py", "ui/curves.py":  # to be rewritten as one form
    del FILES[name]
LAYOUT = {tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.COMMENT,
          tokenize.ENDMARKER}


def code_lines(text):
    """Numbers of the lines that hold code: not those of comments, docstrings and blanks."""
    lines = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in LAYOUT:
            lines |= {*range(token.start[0], token.end[0] + 1)}
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(getattr(node.value, "value", None), str):
            lines -= {*range(node.lineno, node.end_lineno + 1)}
    return lines


def functions(text):
    """(name, number of lines of code) of every function and method."""
    lines = code_lines(text)
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            yield node.name, len(lines & {*range(node.lineno, node.end_lineno + 1)})


def test_comments_docstrings_and_blanks_are_not_counted():
    text = '"""Module."""\n\n# why\ndef f(a,\n      b):\n    """Docstring\n    of two lines."""\n' \
           "    # a comment\n    return [a,\n\n            '''b\n\n            c''']\n"
    assert code_lines(text) == {4, 5, 9, 11, 12, 13} and [*functions(text)] == [("f", 6)]


@pytest.mark.parametrize("name", FILES)
def test_no_function_is_too_long(name):
    text = FILES[name].read_text(encoding="utf-8")
    assert {f: n for f, n in functions(text) if n > FUNCTION} == {}


@pytest.mark.parametrize("name", FILES)
def test_no_module_is_too_long(name):
    assert len(code_lines(FILES[name].read_text(encoding="utf-8"))) <= MODULE
