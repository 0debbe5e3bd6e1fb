"""Files and transfer functions of the user's own, offered in the mask of a live plot."""

import inspect
import io
import math
import pathlib
import re
from collections.abc import Callable
from typing import Any

import anywidget
import ipywidgets as W

from ..core import ParameterError
from ..core.param import given, refused, said
from ..records import Table
from .job import RAISED
from .live import Live
from .mask import Page
from .text import said_html, unmarked, why_not

__all__ = ["TransferFunction", "Upload", "transfer_function", "upload"]

NOTHING = "–"


class File(anywidget.AnyWidget):
    """A button to give a file of any size, unlike FileUpload; calls ``take(name, content)``."""

    _esm = pathlib.Path(__file__).parent / "upload.js"

    def __init__(self, take: Callable[[str, bytes], object]):
        self._take, self._content = take, b""
        super().__init__()
        self.on_msg(self._piece)

    def _piece(self, _, message, pieces):
        self._content = (b"" if message["first"] else self._content) + bytes(pieces[0])
        if message["last"]:
            self._take(message["name"], self._content)


class Own(W.VBox):
    """Entries that add something of the user's own to the mask of a live plot, and a message."""

    def __init__(self, live: Live, head: list[W.DOMWidget]):
        self.live, self._message, self._head = live, W.HTML(), W.HBox(head)
        super().__init__([self._head, self._message, Page()])
        for w, name in ((self, "study"), (self, "own"), (self._head, "choices"),
                        (self._message, "status")):
            w.add_class(f"smcaero-{name}")

    @property
    def status(self) -> str:
        """Text of the message."""
        return unmarked(self._message.value)

    def _offer(self, make):
        """Offer what `make` returns, (name, block, message), or say why not."""
        try:
            name, made, message = make()
            self._message.value = said_html(message, False)
            self.live.mask.offer(name, made)
        except RAISED as why:  # what a user brings may be anything: the page goes on
            self._message.value = said_html(why_not(why), True)


class Upload(Own):
    """A button that reads a file, and lists to say which column is what; made by `upload`."""

    def __init__(self, live: Live, read: Callable, make: Callable):
        self._read, self._make = read, make
        self._file, self._laid_out = ("", b""), None  # the file, and that of the entries
        self.button = File(self.take)
        self.entries = {}
        for n, a in list(inspect.signature(read).parameters.items())[1:]:
            kind = W.Dropdown if a.kind is a.POSITIONAL_OR_KEYWORD else W.Text
            self.entries[n] = kind(description=n.replace("_", " "), layout=W.Layout(width="180px"),
                                   style=dict(description_width="76px"))
            self.entries[n].continuous_update = False  # of a text
            self.entries[n].observe(self._entered, "value")
        super().__init__(live, [self.button])

    def _entered(self, _):
        if self._laid_out is self._file:
            self._taken()

    def take(self, name: str, content: bytes) -> None:
        """Take a file, as if it had been given by hand."""
        self._file, self._message.value = (name, content), said_html(f"Reading {name} ...", False)
        try:
            self._lay_out(Table("upload", self._stream()).names)
        except RAISED as why:
            self._message.value, self._head.children = said_html(why_not(why), True), [self.button]
            return
        except BaseException:
            message = f"Reading {name} was interrupted; give the file again."
            self._message.value = said_html(message, True)
            self._head.children = [self.button]
            raise
        self._taken()

    def _lay_out(self, names):
        """Let the entries offer the columns of the file; until all do, nothing is read from it."""
        columns = [n for n, w in self.entries.items() if isinstance(w, W.Dropdown)]
        alike = {n: q for n in columns if (q := _alike(n, names))}
        for i, n in enumerate(columns):
            likely = i < len(names) and (i < 2 or len(names) == len(columns))
            free = [q for q in names[i:] + names[:i] if q not in alike.values()]
            alike.setdefault(n, free[0] if likely and free else NOTHING)
            self.entries[n].options = [NOTHING, *dict.fromkeys(names)]
            self.entries[n].value = alike[n]
        for w in self.entries.values():
            if isinstance(w, W.Text):
                w.value = ""
        self._head.children = [self.button, *self.entries.values()]
        self._laid_out = self._file

    def _stream(self):
        stream = io.BytesIO(self._file[1])
        stream.name = self._file[0]
        return stream

    def _taken(self):
        self._offer(self._block)

    def _block(self):
        options = {}
        for n, w in self.entries.items():
            if isinstance(w, W.Dropdown):
                options[n] = "" if w.value == NOTHING else w.value
            elif text := w.value.strip():
                options[n] = _number(n, text)
        record = self._read(self._stream(), **options)
        return self._file[0], self._make(record), f"{record.about}."


class TransferFunction(Own):
    """Two entries, the coefficients of a transfer function; made by `transfer_function`."""

    def __init__(self, live: Live, make: Callable):
        self._make = make
        look = dict(layout=W.Layout(width="300px"), style=dict(description_width="90px"),
                    tooltip="Coefficients, highest power first, separated by blanks")
        self.entries = {n: W.Text(value, description=n, **look)
                        for n, value in (("numerator", "1"), ("denominator", "1 3 3 1"))}
        self.button = W.Button(description="Identify", icon="check",
                               tooltip="Offer this transfer function in the mask")
        self.button.on_click(lambda _: self._offer(self._block))
        super().__init__(live, [*self.entries.values(), self.button])

    def _block(self):
        import control  # it takes a second to import, so only here

        num, den = (_coefficients(n, w.value.strip()) for n, w in self.entries.items())
        for n, q in (("numerator", num), ("denominator", den)):
            if not any(q):
                raise ParameterError(f"{n}: {said(self.entries[n].value)} is not allowed; "
                                     "at least one coefficient must not be 0")
        name = f"({_polynomial(num)})/({_polynomial(den)})"
        made = self._make(control.tf(num, den, name="own"))
        made()  # an improper one is refused here
        return name, made, f"{name} is chosen in the mask."


def _alike(name, names):
    """The column whose name is that of a signal: a T beside a time is a temperature."""
    ways = (lambda q: q == name, lambda q: name == "t" and q.lower().startswith("time"),
            lambda q: q.lower() == name)
    return next((q for way in ways for q in names if way(q)), None)


def _number(name, text):
    """A finite number, or the error that names its entry."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ParameterError(f"{name.replace('_', ' ')}: {said(text)} is not a finite number")
    return value


def _coefficients(name, text):
    """The numbers of a text; a comma beside blanks or semicolons is a decimal point."""
    if re.fullmatch(r"[^,;\s]+,[^,;\s]+", text):
        raise ParameterError(f"{name}: {said(text)} may be one number or two; "
                             "put blanks between coefficients, a point in a number")
    parts = re.split(r"[;\s]+", text) if re.search(r"[;\s]", text) else text.split(",")
    return [_number(name, q.rstrip(",").replace(",", ".")) for q in parts]


def _polynomial(coefficients):
    """A polynomial in s, written out."""
    terms = []
    for i, c in zip(range(len(coefficients) - 1, -1, -1), coefficients, strict=True):
        power = "s" + f"^{i}"*(i > 1) if i else ""
        if c:
            factor = f"{c:g}"*(abs(c) != 1.0 or not i) + "-"*(c == -1.0 and i > 0)
            terms.append(factor + power)
    return " + ".join(terms).replace("+ -", "- ")


def _checked(owner, live, **functions):
    """Refuse what is not a live plot, or not a function."""
    given(owner, "live", live, Live, "a live plot, live(...)")
    for name, f in functions.items():
        try:
            inspect.signature(f)
        except (TypeError, ValueError):  # not a function, or one of C that hides its arguments
            raise refused(owner, name, f, "a function, not called") from None


def upload(live: Live, read: Callable[..., Any], make: Callable[..., Any]) -> Upload:
    """Show a button to add a file of numbers to what a live plot offers.

    Parameters
    ----------
    live : Live
    read : function
        Reads an open file, given the names of its columns: `prd.read_csv` or
        `differentiators.read_csv`. Lists ask for the columns, entries for whatever else it takes.
    make : function
        Makes a block of what was read: `prd.experiment` or `differentiators.trial`.

    Returns
    -------
    Upload
        A widget.

    Raises
    ------
    ParameterError
        `live` is not a live plot; `read` or `make` is not a function.

    Examples
    --------
    >>> plot = live(smc.prd.experiment(smc.lv.transfer_function()))
    >>> own = upload(plot, smc.prd.read_csv, smc.prd.experiment)
    """
    _checked("upload", live, read=read, make=make)
    return Upload(live, read, make)


def transfer_function(live: Live, make: Callable[..., Any]) -> TransferFunction:
    """Show entries to add your own transfer function, as coefficients, to what a live plot offers.

    Parameters
    ----------
    live : Live
    make : function
        Makes a block of a `control.TransferFunction`: `prd.experiment`.

    Returns
    -------
    TransferFunction
        A widget.

    Raises
    ------
    ParameterError
        `live` is not a live plot; `make` is not a function.

    Examples
    --------
    >>> plot = live(smc.prd.experiment(smc.lv.transfer_function()))
    >>> own = transfer_function(plot, smc.prd.experiment)
    """
    _checked("transfer_function", live, make=make)
    return TransferFunction(live, make)
