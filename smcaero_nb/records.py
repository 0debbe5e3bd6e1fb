"""Records: text files of numbers, columns by name, and the one check of samples that a user gives."""

import csv
import math
import os
import pathlib
import re
from functools import cached_property

import numpy as np

from .core.param import ParameterError, listed, real, refused, said

__all__ = ["Table", "finite", "numbers", "record"]

DELIMITERS = {",": "comma", ";": "semicolon", "\t": "tab", None: "blank"}
LONGEST = 131_072  # characters of a field in quotes
NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)(e[+-]?\d+)?", re.I)  # with one mark at most
GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}[.,]\d{3}")  # its mark may separate thousands or decimals
#: {mark: numbers whose thousands it separates, with the other one before the decimals}
THOUSANDS = {".": re.compile(r"[+-]?\d{1,3}(\.\d{3})+(,\d*)?"),
             ",": re.compile(r"[+-]?\d{1,3}(,\d{3})+(\.\d*)?")}
SECONDS = {"": 1.0, "s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9, "min": 60.0,
           "h": 3600.0}


def _decoded(data):
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return data.decode("utf-16")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")  # the five bytes that it does not know


class Table:
    """Lines of numbers under a line of names.

    Commas, semicolons, tabs or blanks stand between the numbers; lines that begin with ``#`` or ``%`` are passed over, and a
    unit stands in brackets behind the name: ``time [ms]``, ``theta (rad)``. With semicolons, tabs or blanks a comma in a number
    is its decimal point. Where a number has both marks, as 1.234,5 or 1,234.5, the first separates
    thousands in the whole file. Where some numbers have commas and others points, one such as 1.234
    may mean either and is refused. What is neither UTF-8 nor UTF-16 with its mark is read as
    Windows-1252.

    Parameters
    ----------
    owner : str
        Who reads, for messages.
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
        A file that cannot be read, without names, or with one column only.
    """

    def __init__(self, owner, source):
        stream = hasattr(source, "read")
        name = getattr(source, "name", None) if stream else source
        if not stream and not isinstance(source, (str, os.PathLike)):
            raise refused(owner, "path", source, "a path or an open file")
        path = pathlib.Path(name if isinstance(name, (str, os.PathLike)) else "file")  # that of a temporary file is a number
        self.owner, self.file, self.name, self._serves = owner, path.name, path.stem, {}
        try:
            text = source.read() if stream else path.read_bytes()
            text = _decoded(text) if isinstance(text, bytes) else text
        except (OSError, ValueError) as why:  # ValueError: what is no text, a path with a NUL, a file that is closed
            self.refuse(f"cannot be read: {getattr(why, 'strerror', None) or why}")
        lines = [(i, q) for i, q in enumerate(text.splitlines(), 1)
                 if q.strip() and q.strip()[0] not in "#%" and not q.lower().startswith("sep=")]
        if len(lines) < 2:
            self.refuse("a line of names and lines of numbers are needed")
        (self.top, head), *rows = lines
        self.sep = next((s for s in sorted(";\t,", key=head.count, reverse=True) if s in head), None)
        self.lines, self._rows = zip(*rows, strict=True)
        if self.sep is None:  # a unit belongs to the name before it
            head = re.sub(r"\s*([\[(][^\])]*)", lambda q: "".join(q[1].split()), head)
        columns = [re.match(r"([^\[(]*)(?:[\[(]([^\])]*))?", q).groups("") for q in self._split(head)]
        self.names, self.units = [n.strip() for n, _ in columns], [u.strip() for _, u in columns]
        if any(math.isfinite(self._number(n)) for n in self.names):
            self.refuse("the first line must hold the names of the columns, not numbers "
                        f"({listed(self.names[:4])})", self.top)
        if len(self.names) < 2:
            self.refuse(f"only one column ('{self.names[0]}') was found; time and output are needed", self.top)

    @cached_property
    def rows(self):
        """The fields of each line."""
        return [self._split(q) for q in self._rows]

    def refuse(self, said, line=0):
        """Raise `ParameterError`, naming the file and the line."""
        at = listed([self.file]) + f", line {line}"*(line > 0)
        raise ParameterError(f"{self.owner}: {at}: {said}") from None

    def _split(self, line):
        if self.sep is None:
            return line.split()
        quoted = '"' in line and len(line) < LONGEST  # a field is no longer than its line
        return [f.strip() for f in (next(csv.reader([line], delimiter=self.sep)) if quoted else line.split(self.sep))]

    def _number(self, field):
        try:
            return math.nan if "_" in field else float(field if self.sep == "," else field.replace(",", "."))
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
        """The numbers of a column, and its unit.

        Raises
        ------
        ParameterError
            It is not there, or serves as something else, or a field is not a finite number, by line and column.
        """
        if not isinstance(name, str) or name not in self.names:
            self.refuse(f"{what} = {said(name)} is not there; the columns are {listed(self.names)}",
                        self.top)
        if self.names.count(name) > 1:
            self.refuse(f"{what} = {said(name)} stands over {self.names.count(name)} columns; give "
                        "each a name of its own", self.top)
        if (other := self._serves.setdefault(name, what)) != what:
            self.refuse(f"{what} = {said(name)} serves as {other} already; each needs a column of "
                        "its own", self.top)
        j = self.names.index(name)
        values, mixed = np.empty(len(self.rows)), any(self.marks)
        for k, (line, fields) in enumerate(zip(self.lines, self.rows, strict=True)):
            if len(fields) != len(self.names):
                self.refuse(f"{len(fields)} columns, but the names are {len(self.names)}; the delimiter is "
                            f"{DELIMITERS[self.sep]}", line)
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

    def times(self, name):
        """The column of time [s], which increases."""
        t, unit = self.column("t", name)
        if len(wrong := np.flatnonzero(np.diff(t) <= 0.0)):
            k, j = wrong[0] + 1, self.names.index(name)
            self.refuse(f"column {j + 1} ('{name}'): {self.rows[k][j]} after {self.rows[k - 1][j]}; times must increase",
                        self.lines[k])
        if unit.lower() not in SECONDS:
            self.refuse(f"the unit of time [{unit}] is not known; it must be one of {', '.join(filter(None, SECONDS))}", self.top)
        return t*SECONDS[unit.lower()]

    def about(self, **chosen):
        """What was found, in words, and which column serves for what."""
        said = ", ".join(f"{what} = '{n}' [{self.units[self.names.index(n)] or ('s' if what == 't' else '?')}]"
                         for what, n in chosen.items() if n)
        return f"{self.file}: {len(self.rows)} rows, {len(self.names)} columns, delimiter {DELIMITERS[self.sep]}; {said}"


# ---- samples --------------------------------------------------------------------------------------
EXACT = 2.0**53  # up to which float64 knows every whole number
MASKED = "is masked in part; remove the masked values and their times, or fill them"
#: {kind of a dtype: what it holds, and the way out}
REFUSED = {
    "M": "dates; give seconds from some time on: (t - t[0])/np.timedelta64(1, 's')",
    "m": "durations; give seconds: t/np.timedelta64(1, 's')",
    "c": "complex numbers; give their real parts or their sizes",
    "b": "switches (True, False); give numbers: np.asarray(..., float)",
    "U": "text; turn it into numbers first: np.asarray(..., float)",
    "S": "text; turn it into numbers first: np.asarray(..., float)",
    "V": "fields; choose one of them by its name",
}


def numbers(owner, name, values):
    """Real numbers of any shape, as a new or the same array of float.

    Raises
    ------
    ParameterError
        What float64 cannot hold as it is meant: masked values, complex numbers, dates, durations,
        text, switches, units, whole numbers above 2**53 that would be rounded, other objects, rows
        of different lengths.
    """
    def refuse(what):
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


def record(owner, t, y, name="y"):
    """Times and samples as two arrays of float, of the same length; else `ParameterError`."""
    t, y = numbers(owner, "t", t), numbers(owner, name, y)
    if t.ndim != 1 or t.shape != y.shape or len(t) < 2:
        raise ParameterError(f"{owner}: t and {name} must be two sequences of the same length, 2 "
                             f"or more; they have the shapes {t.shape} and {y.shape}")
    return t, y


def finite(owner, t, y, name="y"):
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
