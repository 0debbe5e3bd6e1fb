"""Records: text files of numbers, with columns by name, and the one check of a user's samples."""

import csv
import math
import os
import pathlib
import re
from functools import cached_property
from typing import Any, NoReturn

import numpy as np

from .core.param import ParameterError, listed, real, refused, said

__all__ = ["EVEN", "Table", "check_samples", "columns", "longest_step", "numbers", "record"]

DELIMITERS = {",": "comma", ";": "semicolon", "\t": "tab", None: "blank"}
LONGEST = 131_072  # characters of a field in quotes
NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)(e[+-]?\d+)?", re.I)  # with one mark at most
GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}[.,]\d{3}")  # its mark may separate thousands or decimals
#: {mark: numbers whose thousands it separates, with the other one before the decimals}
THOUSANDS = {".": re.compile(r"[+-]?\d{1,3}(\.\d{3})+(,\d*)?"),
             ",": re.compile(r"[+-]?\d{1,3}(,\d{3})+(\.\d*)?")}
SECONDS = {"": 1.0, "s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6,
           "μs": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}


def _decoded(data):
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return data.decode("utf-16")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")  # the five bytes that it does not know


class Table:
    """Lines of numbers under a line of names.

    Commas, semicolons, tabs or blanks stand between the numbers; lines that begin with ``#`` or
    ``%`` are skipped, and a unit follows the name in brackets: ``time [ms]``, ``theta (rad)``. With
    semicolons, tabs or blanks a comma in a number is its decimal point. Where a number has both
    marks, as 1.234,5 or 1,234.5, the first separates thousands in the whole file. Where some
    numbers have commas and others points, one such as 1.234 may mean either and is refused. What is
    neither UTF-8 nor UTF-16 with its mark is read as Windows-1252.

    Parameters
    ----------
    owner : str
        The function that reads, for messages.
    source : str, path or open file
        A file, of text or bytes; an open one is named by its attribute `name`.

    Attributes
    ----------
    file, name : str
        Name of the file, with and without its ending.
    names, units : list of str
        Of the columns.

    Raises
    ------
    ParameterError
        If the file cannot be read, has no names, or has one column only.
    """

    def __init__(self, owner: str, source: Any):
        read = getattr(source, "read", None)
        name = getattr(source, "name", None) if read else source
        if not read and not isinstance(source, (str, os.PathLike)):
            raise refused(owner, "path", source, "a path or an open file")
        # the name of a temporary file is a number
        path = pathlib.Path(name if isinstance(name, (str, os.PathLike)) else "file")
        self.owner, self.file, self.name, self._serves = owner, path.name, path.stem, {}
        try:
            text = read() if read else path.read_bytes()
            text = _decoded(text) if isinstance(text, bytes) else text
        except (OSError, ValueError) as why:  # ValueError: a path with a NUL, a closed file
            self.refuse(f"cannot be read: {getattr(why, 'strerror', None) or why}")
        lines = [(i, q) for i, q in enumerate(text.splitlines(), 1)
                 if q.strip() and q.strip()[0] not in "#%" and not q.lower().startswith("sep=")]
        if len(lines) < 2:
            self.refuse("a line of names and lines of numbers are needed")
        (self.top, head), *rows = lines
        self.sep = next((s for s in sorted(";\t,", key=head.count, reverse=True) if s in head),
                        None)
        self.lines, self._rows = zip(*rows, strict=True)
        if self.sep is None:  # a unit belongs to the name before it
            head = re.sub(r"\s*([\[(][^\])]*)", lambda q: "".join(q[1].split()), head)
        columns = [q.groups("") for f in self._split(head)
                   if (q := re.match(r"([^\[(]*)(?:[\[(]([^\])]*))?", f))]  # it always matches
        self.names, self.units = [n.strip() for n, _ in columns], [u.strip() for _, u in columns]
        if any(math.isfinite(self._number(n)) for n in self.names):
            self.refuse("the first line must hold the names of the columns, not numbers "
                        f"({listed(self.names[:4])})", self.top)
        if len(self.names) < 2:
            self.refuse(f"only one column ('{self.names[0]}') was found; time and output are "
                        "needed", self.top)

    @cached_property
    def rows(self):
        """Fields of each line."""
        return [self._split(q) for q in self._rows]

    def refuse(self, said: str, line: int = 0) -> NoReturn:
        """Raise `ParameterError`, naming the file and the line."""
        at = listed([self.file]) + f", line {line}"*(line > 0)
        raise ParameterError(f"{self.owner}: {at}: {said}") from None

    def _split(self, line):
        if self.sep is None:
            return line.split()
        quoted = '"' in line and len(line) < LONGEST  # a field is no longer than its line
        return [f.strip() for f in (next(csv.reader([line], delimiter=self.sep)) if quoted
                                    else line.split(self.sep))]

    def _number(self, field):
        try:
            return math.nan if "_" in field else float(field if self.sep == ","
                                                       else field.replace(",", "."))
        except ValueError:
            return math.nan

    @cached_property
    def marks(self):
        """{mark: its first line} of separators of thousands, and of the marks in numbers with one.

        Empty where every number of the file has the same mark.
        """
        thousands, single = {}, {}
        if self.sep == "," or not all(any(m in q for q in self._rows) for m in ",."):
            return thousands, single
        for line, fields in zip(self.lines, self.rows, strict=True):
            for f in fields:
                for mark, pattern in THOUSANDS.items():
                    if mark in f and NUMBER.fullmatch(f):
                        single.setdefault(mark, line)
                    elif "," in f and "." in f and pattern.fullmatch(f):
                        thousands.setdefault(mark, line)
        return thousands, single if thousands or len(single) > 1 else {}

    def _unclear(self, field):
        """The line that makes the mark of a number ambiguous, or 0."""
        thousands, single = self.marks
        mark = next((m for m in ",." if m in field), None)
        if not mark or not NUMBER.fullmatch(field):
            return 0
        if thousands:
            known = mark not in thousands or THOUSANDS[mark].fullmatch(field)
            return 0 if known and len(thousands) == 1 else next(iter(thousands.values()))
        return single["," if mark == "." else "."] if single and GROUPED.fullmatch(field) else 0

    def _plain(self, field):
        """A number without its separators of thousands."""
        for mark in self.marks[0]:
            if THOUSANDS[mark].fullmatch(field):
                return field.replace(mark, "")
        return field

    def column(self, what, name):
        """Return the numbers of a column, and its unit.

        Raises
        ------
        ParameterError
            If it does not exist or is used for something else, or a field is not a finite number
            (named by line and column).
        """
        if not isinstance(name, str) or name not in self.names:
            self.refuse(f"{what} = {said(name)} does not exist; the columns are "
                        f"{listed(self.names)}", self.top)
        if self.names.count(name) > 1:
            self.refuse(f"{what} = {said(name)} names {self.names.count(name)} columns; give each "
                        "its own name", self.top)
        if (other := self._serves.setdefault(name, what)) != what:
            self.refuse(f"{what} = {said(name)} is already used as {other}; each needs its own "
                        "column", self.top)
        j = self.names.index(name)
        values, mixed = np.empty(len(self.rows)), any(self.marks)
        for k, (line, fields) in enumerate(zip(self.lines, self.rows, strict=True)):
            if len(fields) != len(self.names):
                self.refuse(f"{len(fields)} columns, but {len(self.names)} names; the "
                            f"delimiter is {DELIMITERS[self.sep]}", line)
            if mixed and (other := self._unclear(fields[j])):
                self.refuse(f"column {j + 1} ('{name}'): {said(fields[j])} may mean thousands or "
                            "decimals, because the numbers of the file have commas and points "
                            f"(line {other}); write all of them with one decimal mark and without "
                            "separators of thousands", line)
            values[k] = self._number(self._plain(fields[j]) if mixed else fields[j])
            if not math.isfinite(values[k]):
                self.refuse(f"column {j + 1} ('{name}'): {said(fields[j])} is not a finite number",
                            line)
        return values, self.units[j]

    def chosen(self, *names: str | None) -> list[str]:
        """Return the names given; in place of None, the name of the column at that position."""
        return [n if given is None else given for n, given in zip(self.names, names, strict=False)]

    def times(self, name: str) -> np.ndarray:
        """Return the column of time [s], which increases."""
        t, unit = self.column("t", name)
        if len(wrong := np.flatnonzero(np.diff(t) <= 0.0)):
            k, j = wrong[0] + 1, self.names.index(name)
            self.refuse(f"column {j + 1} ('{name}'): {self.rows[k][j]} after "
                        f"{self.rows[k - 1][j]}; times must increase",
                        self.lines[k])
        if unit.lower() not in SECONDS:
            self.refuse(f"the unit of time [{unit}] is not known; it must be one of "
                        f"{', '.join(filter(None, SECONDS))}", self.top)
        return t*SECONDS[unit.lower()]

    def about(self, **chosen):
        """Describe what was found, and which column serves for what."""
        said = ", ".join(f"{what} = '{n}' "
                         f"[{self.units[self.names.index(n)] or ('s' if what == 't' else '?')}]"
                         for what, n in chosen.items() if n)
        return (f"{self.file}: {len(self.rows)} rows, {len(self.names)} columns, delimiter "
                f"{DELIMITERS[self.sep]}; {said}")


# ---- samples -------------------------------------------------------------------------------------
EXACT = 2.0**53  # float64 holds every whole number up to this
MASKED = "is masked in part; remove the masked values and their times, or fill them"
GAP = 10.0  # a step longer than this times what nine of ten steps do not exceed is a gap
EVEN = 0.01  # of the mean step: steps that differ by less count as equal
#: {kind of a dtype: what it holds, and the way out}
REFUSED = {
    "M": "dates; give seconds from some instant: (t - t[0])/np.timedelta64(1, 's')",
    "m": "durations; give seconds: t/np.timedelta64(1, 's')",
    "c": "complex numbers; give their real parts or their sizes",
    "b": "switches (True, False); give numbers: np.asarray(..., float)",
    "U": "text; turn it into numbers first: np.asarray(..., float)",
    "S": "text; turn it into numbers first: np.asarray(..., float)",
    "V": "fields; choose one of them by its name",
}


def numbers(owner: str, name: str, values: Any) -> np.ndarray:
    """Return real numbers of any shape as an array of float, new or the same.

    Raises
    ------
    ParameterError
        What float64 cannot hold as it is meant: masked values, complex numbers, dates, durations,
        text, switches, units, whole numbers above 2**53 that would be rounded, other objects, rows
        of different lengths.
    """
    def refuse(what: str) -> NoReturn:
        raise ParameterError(f"{owner}: {name} {what}") from None

    parts = {type(v): v for v in values} if isinstance(values, (list, tuple)) else {}
    if np.ma.is_masked(values) or any(issubclass(q, np.ma.MaskedArray) for q in parts):
        refuse(MASKED)
    plain = parts and not any(issubclass(q, np.ndarray) for q in parts)
    try:
        a = np.asanyarray(values, object if plain else None)  # or True beside numbers would be 1
    except Exception as why:  # what another library's array raises
        refuse(f"must be real numbers, in one row or in rows of the same length: {said(str(why))}")
    if np.ma.is_masked(a):  # what another library makes of its variable
        refuse(MASKED)
    a = np.asarray(a)
    if a.dtype.kind in REFUSED:
        refuse(f"holds {REFUSED[a.dtype.kind]}")
    if hasattr(values, "unit") or hasattr(values, "units"):
        refuse("carries a unit; give its numbers, times in seconds")
    if a.dtype == object:
        items = {type(v): v for v in a.ravel().tolist()}
        if wrong := [v for v in items.values() if not real(v)]:
            kind = np.asarray(wrong[0]).dtype.kind if np.isscalar(wrong[0]) else ""
            refuse(f"holds {REFUSED[kind]}" if kind in REFUSED else
                   f"must be real numbers, in an array or a list; it holds {said(wrong[0])}")
    try:
        with np.errstate(over="ignore"):
            made = np.ascontiguousarray(a, dtype=float).reshape(a.shape)
    except OverflowError:
        refuse("holds a number beyond 1e308")
    if a.dtype.kind in "iuO" and len(big := np.flatnonzero(np.abs(made) >= EXACT)):
        exact = a.ravel()[big].astype(object)
        if len(lost := np.flatnonzero(exact != made.ravel()[big])):
            refuse(f"holds {said(exact[lost[0]])}, which float64 would round; subtract the first "
                   "value, or give floats")
    return made


def columns(owner: str, t: Any, y: Any, name: str = "y") -> tuple[np.ndarray, np.ndarray]:
    """Return times and samples as arrays of float, of the same length; else `ParameterError`."""
    t, y = numbers(owner, "t", t), numbers(owner, name, y)
    if t.ndim != 1 or t.shape != y.shape or len(t) < 2:
        raise ParameterError(f"{owner}: t and {name} must be two sequences of the same length, 2 "
                             f"or more; they have the shapes {t.shape} and {y.shape}")
    return t, y


def check_samples(owner: str, t: np.ndarray, y: np.ndarray, name: str = "y") -> None:
    """Raise `ParameterError` unless samples are finite and times increase within float64."""
    for n, q in (("t", t), (name, y)):
        if len(bad := np.flatnonzero(~np.isfinite(q))):
            at = f" at t = {t[bad[0]]:g} s" if q is y else ""
            raise ParameterError(f"{owner}: {n}[{bad[0]}] = {q[bad[0]]}{at} is not allowed, the "
                                 f"first of {len(bad)} samples that are not finite; remove them "
                                 "and their times")
    with np.errstate(over="ignore"):
        steps, span = np.diff(t), t[-1] - t[0]
    if len(bad := np.flatnonzero(steps <= 0.0)):
        k = bad[0] + 1
        raise ParameterError(f"{owner}: t[{k}] = {t[k]:.10g} s is not allowed after "
                             f"{t[k - 1]:.10g} s; times must increase")
    if span == np.inf:
        raise ParameterError(f"{owner}: t from {t[0]:g} to {t[-1]:g} s is not allowed; it must "
                             "span less than 1e308 s")


def record(owner: str, t: Any, y: Any, name: str = "y") -> tuple[np.ndarray, np.ndarray]:
    """Return times and samples as two new arrays of float, finite, the times increasing."""
    t, y = (q.copy() for q in columns(owner, t, y, name))
    check_samples(owner, t, y, name)
    return t, y


def longest_step(t: np.ndarray) -> float:
    """Return the longest step that is not yet a gap, found from about ten thousand of the steps."""
    stride = max(1, len(t)//10_000)
    with np.errstate(over="ignore"):
        return GAP*float(np.quantile(t[1::stride] - t[:-1:stride], 0.9, method="lower"))
