"""A row of a mask: the controls of one parameter, and what the page says about its slider."""

import functools
import math
import re
from collections.abc import Callable
from typing import Any, get_args

import ipywidgets as W

from ..core import Param
from ..core.signal import flat

__all__ = ["Entries", "Row", "css_class", "written"]


def css_class(name: str) -> str:
    """Return the name of a control as a CSS class, which has no blanks."""
    return "-".join(name.split())


def written(value: Any) -> str:
    """Return a number as an entry shows it; of a list, the choice; of a tuple, all its entries."""
    if isinstance(value, str):
        return value
    if isinstance(value, tuple):
        return f"({', '.join(map(written, value))})"
    return re.sub(r"e([+-])0*", lambda m: "e" + m[1].strip("+"), f"{value:.6g}")


def typed(text: str) -> float | str:
    """Return the number that a text says, or the text, which validation then refuses."""
    try:
        return float(text)
    except ValueError:
        return text.strip()


def _span(meta, value):
    """Range of the slider: the declared one; otherwise the bounds; otherwise around the value.

    It is also around a value that is less than three steps from zero.
    """
    low, high = meta.slider or (meta.low, meta.high)
    reach = 4*abs(value) or 1.0
    if isinstance(value, int) and not meta.slider and high > 1000*reach:
        high = reach
    fine = meta.log or isinstance(value, int) or not math.isfinite(high - low)
    if not fine and 0.0 < abs(value) < 3*_step(high - low):
        low, high = max(low, -reach), min(high, reach)
    low = low if math.isfinite(low) else min(0.0 if value > 0 else -reach, high - reach)
    high = high if math.isfinite(high) else max(0.0 if value < 0 else reach, low + reach)
    if meta.log and low <= 0.0:
        low = 1e-4*high
    return min(low, value) if value > 0.0 or not meta.log else low, max(high, value)


def _step(span):
    """About a two-hundredth of the range: 1, 2 or 5 times a power of ten."""
    power = 10.0**math.floor(math.log10((span or 1.0)/200))
    return power*next(m for m in (1, 2, 5, 10) if m*power >= 0.999*span/200)


class Row:
    """The controls of one parameter: slider and text entry, checkbox, or list of choices.

    Parameters
    ----------
    name, title : str
        Of the parameter, and what the row is called.
    meta : Param
    value : float, int, bool or str
    kind : type
        float, int, bool or a Literal of texts.
    asked : callable
        ``asked(name, value)`` is called with what the user asks for.
    shared : dict
        Layout and styles that all rows share.
    grid : float or None
        Step of the slider of a time that is counted in samples, or in steps of the run [s].

    Attributes
    ----------
    box, widget, entry : ipywidgets.Widget
        The whole row, its slider, checkbox or list, and its entry, which only numbers have.
    value
        The value shown.
    log : bool
        Whether the slider is logarithmic.
    refused : bool
        Whether the row is marked as refused.
    told : list of float
        Positions of the slider that the page has been sent and may still answer.
    """

    widget: Any  # only a slider has limits and a step

    def __init__(self, name: str, title: str, meta: Param, value: Any, kind: Any,
                 asked: Callable[[str, Any], object], shared: dict[str, Any], grid: float | None):
        say = dict(description=title, tooltip=meta.help or name.replace("__", " "),
                   layout=shared["layout"])
        self.meta, self.kind, self.entry, self.told = meta, kind, None, []
        self.value, self.refused = value, False
        self._placed = self._written = None  # where a program has put slider and entry
        self._ask = functools.partial(asked, name)
        if kind is bool:
            self.widget = self.box = W.Checkbox(value, indent=False, **say)
        elif get_args(kind):
            self.widget = self.box = W.Dropdown(options=get_args(kind), value=value, **say)
        else:
            self.widget = self._slider(grid, dict(say, readout=False, style=shared["slider"]))
            self.entry = W.Text(continuous_update=False, tooltip=say["tooltip"],
                                layout=shared["layout"], style=shared["text"])
            self.entry.observe(self._entered, "value")
            self.box = W.HBox([self.widget, self.entry], layout=shared["layout"])
        self.log = isinstance(self.widget, W.FloatLogSlider)
        self.widget.observe(self._slid, "value")
        for mark in ("row", f"set-{css_class(name)}"):
            self.box.add_class(f"smcaero-{mark}")

    def _slider(self, grid, look):
        meta = self.meta
        low, high = _span(meta, self.value)
        step = _step(high - low)
        if grid:  # a slider that stops at multiples of it only
            low, high, step = grid*meta.samples, grid*max(round(high/grid), 1), grid
        if self.kind is int:
            return W.IntSlider(self.value, math.floor(low), math.ceil(high), **look)
        if meta.log:
            a, b = math.log10(low), math.log10(high)
            return W.FloatLogSlider(10.0**a, min=a, max=b, step=_step(b - a), **look)
        return W.FloatSlider(low, min=low, max=high, step=step, **look)

    def _entered(self, change):
        if change.new != self._written:
            self._ask(typed(change.new))

    def _slid(self, change):
        if change.new != self._placed and self.moved(change.new):
            self._ask(self.slid(change.new))

    def place(self, v: float) -> float:
        """Return the position of `v` on the slider, in steps."""
        if self.log:
            v = math.log10(max(v, 10.0**self.widget.min))
        return v/self.widget.step

    def moved(self, v: float) -> bool:
        """Return whether the user moved the slider.

        The page echoes what it is sent, rounded and sometimes late; an echo is not a move.
        """
        if not (self.entry and self.from_page()):
            return True
        if abs(self.place(v) - self.place(self.value)) < 0.5:
            return False
        late = [q for q in self.told if abs(self.place(v) - q) < 0.5]
        self.told = [q for q in self.told if q not in late] if late else []
        if late:
            self.put(self.value)
        return not late

    def from_page(self) -> bool:
        """Return whether the page, not a program, is setting the slider."""
        return "value" in self.widget._property_lock

    def slid(self, v: Any) -> Any:
        """Return the slider's value within the bounds, without digits that a step cannot mean."""
        if self.entry and self.from_page():
            v = self.kind(f"{v:.3g}" if self.log else f"{v:.6g}")
        return min(max(v, self.meta.low), self.meta.high) if self.entry else v

    def show(self, value: Any, pull: bool = False) -> None:
        """Show a value in the entry, unless what was typed says the same, and on the slider.

        A handle that is being dragged stays where it is, unless it is to be pulled back.
        """
        self.mark(False)
        self.value = value
        if self.entry is None:
            self._placed = self.widget.value = value
            return
        same = typed(self.entry.value) == value
        self._written = self.entry.value if same else written(value)
        self.entry.value = self._written
        if self.from_page() and not pull:
            self._placed = self.widget.value
            return  # an answer would pull the handle back
        if self.told[-1:] != [self.place(value)]:
            self.told = [*self.told[-30:], self.place(value)]
        self.put(value)

    def at(self, value: float) -> float:
        """Return the slider's value for `value`: the nearest of its steps."""
        w, place = self.widget, self.place(value)*self.widget.step
        if w.min < place < w.max:
            place = float(f"{w.min + w.step*round((place - w.min)/w.step):.12g}")
        place = min(max(place, w.min), w.max)
        return 10.0**place if self.log else self.kind(place)

    def put(self, value: float) -> None:
        """Put the slider on the nearest of its steps, so that the page has little to answer."""
        self._placed = self.at(value)
        self.widget.value = self._placed

    def true(self) -> bool:
        """Return whether the row shows its value, as far as steps allow, or what was refused."""
        if self.refused or self.entry is None:
            return self.refused or self.widget.value == self.value
        near = abs(self.place(self.widget.value) - self.place(self.at(self.value))) < 0.75
        text = self.entry.value
        return near and (text == written(self.value) or typed(text) == self.value)

    def mend(self, value: Any, page: bool) -> None:
        """Show `value` where Ctrl-C left something else; send it to the page too, if `page`."""
        if self.value != value or not self.true():
            self.show(value, pull=True)
        for w in filter(None, (self.widget, self.entry)) if page else ():
            w.send_state("value")

    def mark(self, refused: bool) -> None:
        """Mark the entry as refused, or not; what is refused may be asked for again."""
        self.refused = refused
        if refused:
            self._placed = self._written = None
        (self.box.add_class if refused else self.box.remove_class)("smcaero-refused")


class Entries:
    """The entries of a parameter that is a tuple, or a matrix; each sets it whole.

    Parameters
    ----------
    name, title : str
        Of the parameter, and what its row is called.
    meta : Param
    value : tuple of float, or of rows of them
    kind : type
    asked, shared
        As in `Row`.

    Attributes
    ----------
    box, widget : ipywidgets.HBox
        The whole row.
    texts : dict of tuple to ipywidgets.Text
        The entries by index.
    value : tuple
        The value shown.
    """

    entry, log = None, False

    def __init__(self, name: str, title: str, meta: Param, value: tuple, kind: Any,
                 asked: Callable[[str, Any], object], shared: dict[str, Any]):
        self.name, self.value, self.kind, self._written = name, value, kind, {}
        self._ask = functools.partial(asked, name)
        help = meta.help or name.replace("__", " ")
        self.texts = {at: W.Text(continuous_update=False, tooltip=help, layout=shared["layout"],
                                 style=shared["text"]) for at in _places(value)}
        for at, text in self.texts.items():
            text.add_class(f"smcaero-set-{self._marked(at)}")
            text.observe(functools.partial(self._entered, at), "value")
        lines: dict[tuple, list] = {}
        for at, text in self.texts.items():
            lines.setdefault(at[:-1], []).append(text)
        rows = W.VBox([W.HBox(q, layout=shared["layout"]) for q in lines.values()],
                      layout=shared["layout"])
        self.box = self.widget = W.HBox([W.Label(title, tooltip=help), rows],
                                        layout=shared["layout"])
        for mark in ("row", "entries", f"set-{css_class(name)}"):
            self.box.add_class(f"smcaero-{mark}")
        self.show(value)

    def _entered(self, at, change):
        if change.new != self._written.get(at):
            self._typed, entry = at, typed(change.new)
            switch = self.kind is bool and entry in (0.0, 1.0)
            self._ask(_put(self.value, at, bool(entry) if switch else entry))

    def names(self, name: str) -> dict[str, str]:
        """Return {CSS class: what the entry is} of each entry, after the name of the parameter."""
        return {self._marked(at): f"{name} {', '.join(str(i + 1) for i in at)}"
                for at in self.texts}

    def _marked(self, at):
        return "-".join([css_class(self.name), *map(str, at)])

    def show(self, value: tuple) -> None:
        """Show a value, and leave what was typed where it says the same."""
        self.mark(False)
        self.value = value
        for (at, text), v in zip(self.texts.items(), flat(value), strict=True):
            self._written[at] = text.value if typed(text.value) == v else written(v)
            text.value = self._written[at]

    def mend(self, value: tuple, page: bool) -> None:
        """Show `value` where Ctrl-C left something else; send it to the page too, if `page`."""
        if self.value != value or not self.true():
            self.show(value)
        for text in self.texts.values() if page else ():
            text.send_state("value")

    def true(self) -> bool:
        """Return whether the entries show the value, or one that was refused."""
        return all(text.value == self._written.get(at) for at, text in self.texts.items()
                   if "smcaero-refused" not in text._dom_classes)

    def mark(self, refused: bool) -> None:
        """Mark the entry that was typed last as refused, or none; it may be asked for again."""
        if refused:
            self._written.pop(self._typed, None)
            self.texts[self._typed].add_class("smcaero-refused")
        else:
            for text in self.texts.values():
                text.remove_class("smcaero-refused")


def _places(value):
    """The indices of the entries, (i,) or (i, j)."""
    for i, v in enumerate(value):
        yield from ((i, *q) for q in _places(v)) if isinstance(v, tuple) else [(i,)]


def _put(value, at, entry):
    """The value with another entry at an index."""
    i, *rest = at
    return (*value[:i], _put(value[i], rest, entry) if rest else entry, *value[i + 1:])
