"""What a person brings and takes away: files of numbers, transfer functions, results."""

import inspect
import io
import math
import pathlib
import re

import anywidget
import ipywidgets as W
import traitlets

from ..core import ParameterError
from ..core.param import said
from ..records import Table
from .given import called
from .job import RAISED
from .mask import Mask, Page
from .text import said_html, unmarked, why_not

__all__ = ["Download", "TransferFunction", "Upload", "transfer_function", "upload"]

NOTHING = "–"


class _Saved(W.Widget):
    """What a button saves: asked for it, the text comes as a message."""

    file = traitlets.Unicode().tag(sync=True)  # its name; empty: no button


class Download(anywidget.AnyWidget):
    """A button that saves what `make` returns, a text, as a file."""

    _esm = pathlib.Path(__file__).parent / "download.js"
    saved = traitlets.Instance(W.Widget).tag(sync=True, **W.widget_serialization)

    def __init__(self, make):
        super().__init__(saved=_Saved())
        self.saved.on_msg(lambda *_: self.saved.send({}, [make().encode()]))

    def show(self, file):
        """Offer the file under this name, or nothing."""
        self.saved.file = file or ""


class File(anywidget.AnyWidget):
    """A button with which a person gives a file: ``take(name, content)`` is called with it. Unlike FileUpload, of any size."""

    _esm = pathlib.Path(__file__).parent / "upload.js"

    def __init__(self, take):
        self._take, self._content = take, b""
        super().__init__()
        self.on_msg(self._piece)

    def _piece(self, _, message, pieces):
        self._content = (b"" if message["first"] else self._content) + bytes(pieces[0])
        if message["last"]:
            self._take(message["name"], self._content)


class Own(W.VBox):
    """Something of one's own for the mask of a live plot: entries, and a message."""

    def __init__(self, live, head):
        self.live, self._message, self._head = live, W.HTML(), W.HBox(head)
        super().__init__([self._head, self._message, Page()])
        for w, name in ((self, "study"), (self, "own"), (self._head, "choices"), (self._message, "status")):
            w.add_class(f"smcaero-{name}")

    @property
    def status(self):
        """What the message says."""
        return unmarked(self._message.value)

    def _offer(self, make):
        """Offer what `make` returns, (name, block, what to say), or say why not."""
        try:
            name, made, said = make()
            self._message.value = said_html(said, False)
            self.live.mask.offer(name, made)
        except RAISED as why:  # what a person brings may be anything: the page goes on
            self._message.value = said_html(why_not(why), True)


class Upload(Own):
    """A button that reads a file of one's own, and lists that say which column is what; made by `upload`."""

    def __init__(self, live, read, make):
        self._read, self._make = read, make
        self._file = self._laid_out = None  # the file, and the one that the entries are of
        self.button = File(self.take)
        self.entries = {}
        for n, a in list(inspect.signature(read).parameters.items())[1:]:
            kind = W.Dropdown if a.kind is a.POSITIONAL_OR_KEYWORD else W.Text
            self.entries[n] = kind(description=n.replace("_", " "), layout=W.Layout(width="180px"),
                                   style=dict(description_width="76px"))
            self.entries[n].continuous_update = False  # of an entry
            self.entries[n].observe(self._entered, "value")
        super().__init__(live, [self.button])

    def _entered(self, _):
        if self._laid_out is self._file:
            self._taken()

    def take(self, name, content):
        """Take a file, as if it had been given by hand."""
        self._file, self._message.value = (name, content), said_html(f"Reading {name} ...", False)
        try:
            self._lay_out(Table("upload", self._stream()).names)
        except RAISED as why:
            self._message.value, self._head.children = said_html(why_not(why), True), [self.button]
            return
        except BaseException:
            said = f"Reading {name} was interrupted; give the file again."
            self._message.value = said_html(said, True)
            self._head.children = [self.button]
            raise
        self._taken()

    def _lay_out(self, names):
        """Let the entries ask for the columns of the file; until all do, they ask for nothing."""
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
        given = {n: "" if w.value == NOTHING else w.value for n, w in self.entries.items() if isinstance(w, W.Dropdown)}
        given |= {n: _number(n, w.value.strip()) for n, w in self.entries.items() if isinstance(w, W.Text) and w.value.strip()}
        record = self._read(self._stream(), **given)
        return self._file[0], self._make(record), f"{record.about}."


class TransferFunction(Own):
    """Two entries, the coefficients of a transfer function; made by `transfer_function`."""

    def __init__(self, live, make):
        self._make = make
        self.entries = {n: W.Text(value, description=n, layout=W.Layout(width="300px"), style=dict(description_width="90px"),
                                  tooltip="Coefficients, highest power first, with blanks between them")
                        for n, value in (("numerator", "1"), ("denominator", "1 3 3 1"))}
        self.button = W.Button(description="Identify", icon="check", tooltip="Offer this transfer function in the mask")
        self.button.on_click(lambda _: self._offer(self._block))
        super().__init__(live, [*self.entries.values(), self.button])

    def _block(self):
        import control  # it takes a second to import, so only here

        num, den = (_coefficients(n, w.value.strip()) for n, w in self.entries.items())
        for n, q in (("numerator", num), ("denominator", den)):
            if not any(q):
                raise ParameterError(f"{n}: {self.entries[n].value!r} is not allowed; one of its coefficients must not be 0")
        name = f"({_polynomial(num)})/({_polynomial(den)})"
        made = self._make(control.tf(num, den, name="own"))
        made()  # an improper one is refused here
        return name, made, f"{name} is chosen in the mask."


def _alike(name, names):
    """The column that is called like a signal: a T beside a time is a temperature."""
    ways = (lambda q: q == name, lambda q: name == "t" and q.lower().startswith("time"), lambda q: q.lower() == name)
    return next((q for way in ways for q in names if way(q)), None)


def _number(name, text):
    """A finite number, or the error that names its entry."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ParameterError(f"{name.replace('_', ' ')}: {text!r} is not a finite number")
    return value


def _coefficients(name, text):
    """The numbers of a text; beside blanks or semicolons a comma is a decimal point."""
    if re.fullmatch(r"[^,;\s]+,[^,;\s]+", text):
        raise ParameterError(f"{name}: {text!r} may be one number or two; put blanks between coefficients, a point in a number")
    parts = re.split(r"[;\s]+", text) if re.search(r"[;\s]", text) else text.split(",")
    return [_number(name, q.rstrip(",").replace(",", ".")) for q in parts]


def _polynomial(coefficients):
    """A polynomial in s, written out."""
    terms = []
    for i, c in zip(range(len(coefficients) - 1, -1, -1), coefficients, strict=True):
        power = "s" + f"^{i}"*(i > 1) if i else ""
        if c:
            terms.append(f"{c:g}"*(abs(c) != 1.0 or not i) + "-"*(c == -1.0 and i > 0) + power)
    return " + ".join(terms).replace("+ -", "- ")


def _refuse(owner, live, **functions):
    """Refuse what is no live plot, or no function."""
    if not isinstance(getattr(live, "mask", None), Mask):
        raise ParameterError(
            f"{owner}: live = {said(live)} is not allowed; it must be a live plot, live(...)")
    called(owner, **functions)


def upload(live, read, make):
    """A button with which a person adds a file of numbers to what a live plot offers.

    Parameters
    ----------
    live : Live
    read : function
        Reads an open file, given the names of its columns: `prd.read_csv` or `differentiators.read_csv`. Lists ask for the
        columns, entries for what else it takes.
    make : function
        Makes a block of what was read: `prd.experiment` or `differentiators.trial`.

    Returns
    -------
    Upload
        A widget.

    Raises
    ------
    ParameterError
        `live` is no live plot; `read` or `make` is no function.

    Examples
    --------
    >>> own = upload(live(smc.prd.experiment(smc.lv.transfer_function())), smc.prd.read_csv, smc.prd.experiment)
    """
    _refuse("upload", live, read=read, make=make)
    return Upload(live, read, make)


def transfer_function(live, make):
    """Entries with which a person adds an own transfer function, typed as coefficients, to what a live plot offers.

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
        `live` is no live plot; `make` is no function.

    Examples
    --------
    >>> own = transfer_function(live(smc.prd.experiment(smc.lv.transfer_function())), smc.prd.experiment)
    """
    _refuse("transfer_function", live, make=make)
    return TransferFunction(live, make)
