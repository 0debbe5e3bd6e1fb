"""Masks: the form of a block or closed loop, made from the metadata of its parameters."""

import functools
import math
import pathlib
import re
import threading
import warnings
from typing import NamedTuple, get_args

import anywidget
import ipywidgets as W
import traitlets

from ..core import Block, ClosedLoop, ParameterError
from ..core.block import Channels
from ..core.param import texted, unknown
from .given import names, offered
from .job import RAISED
from .text import doc_html, label, said_html, why_not

__all__ = ["Mask", "mask"]

HERE = pathlib.Path(__file__).parent
DESIGN = ("differentiator", "surface", "law", "allocation", "actuator")  # what a designer sets; the rest is folded away
WORLD = ("reference", "perturbation", "output", "plant")


class _Names(W.Widget):
    """Of each control: accessible name, and whether its slider is logarithmic."""

    names = traitlets.Dict().tag(sync=True)


class Page(anywidget.AnyWidget):
    """What ipywidgets leave out in the page: accessible names, live announcements, the fit of the plot."""

    _esm = HERE / "page.js"
    _css = HERE / "page.css"
    told = traitlets.Instance(W.Widget).tag(sync=True, **W.widget_serialization)

    def __init__(self, **names):
        super().__init__(told=_Names(names=names))

    def tell(self, names):
        """Name more controls."""
        self.told.names = self.told.names | names


def _blocks(prefix, b):
    """(prefix, block) of a stage, those of channels one by one."""
    if isinstance(b, Channels):
        for c, part in b.parts.items():
            yield from _blocks(f"{prefix}{c}__", part)
    elif b:
        yield prefix, b


def _settable(target):
    """{name: (Param, value, kind)} of a block or loop."""
    if isinstance(target, ClosedLoop):
        return target.settable()
    return {n: (m, target.values[n], target.kinds.get(n, float)) for n, m in target.settable.items()}


def _groups(target):
    """[(title, block, names, folded)] in the order in which one designs; initial states last."""
    stages = {"": target}
    if isinstance(target, ClosedLoop):
        stages = {f"{s}__": target.stages[s] for s in DESIGN + WORLD}
    blocks = [q for prefix, b in stages.items() for q in _blocks(prefix, b)]
    groups = [(": ".join(filter(None, (" ".join(p.split("__")[:-1]), b.name.replace("_", " ")))), b,
               [f"{p}{n}" for n in b.params], p.startswith(WORLD)) for p, b in blocks]
    starts = {}
    for p, b in reversed(blocks):
        starts.setdefault(": ".join(["initial state", *p.split("__")[1:-1]]), []).extend(f"{p}{n}" for n in b.states)
    return [*groups, *((title, None, names, True) for title, names in sorted(starts.items()))]


def _span(meta, value):
    """Range of the slider: the declared one, else the bounds, else about the value, and so where it is less than three steps."""
    low, high = meta.slider or (meta.low, meta.high)
    reach = 4*abs(value) or 1.0
    if not (meta.log or isinstance(value, int)) and math.isfinite(high - low) and 0.0 < abs(value) < 3*_step(high - low):
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


def _place(name):
    """Name of a control as a class of the page, which has no blanks."""
    return "-".join(name.split())


def _written(value):
    """A number as the entry shows it; of a list, the choice."""
    return value if isinstance(value, str) else re.sub(r"e([+-])0*", lambda m: "e" + m[1].strip("+"), f"{value:.6g}")


class _Row:
    """Slider and text entry of one number, the checkbox of a switch, or a list; `asked` is called with what a person asks for."""

    def __init__(self, name, meta, value, kind, asked, shared, grid):
        say = dict(description=label(name, meta), tooltip=meta.help)
        self.meta, self.kind, self.entry, self.told = meta, kind, None, []
        self.value, self.refused = value, False
        self._placed = self._written = None  # where a program has put slider and entry
        self._ask = functools.partial(asked, name)
        if kind is bool:
            self.widget = self.box = W.Checkbox(value, indent=False, layout=shared["layout"], **say)
        elif get_args(kind):
            self.widget = self.box = W.Dropdown(options=get_args(kind), value=value, layout=shared["layout"], **say)
        else:
            low, high = _span(meta, value)
            step = _step(high - low)
            if meta.samples and grid:  # a slider that stands where it may
                low, high, step = grid, grid*max(round(high/grid), 1), grid
            say |= dict(readout=False, layout=shared["layout"], style=shared["slider"])
            if kind is int:
                self.widget = W.IntSlider(value, math.floor(low), math.ceil(high), **say)
            elif meta.log:
                a, b = math.log10(low), math.log10(high)
                self.widget = W.FloatLogSlider(10.0**a, min=a, max=b, step=_step(b - a), **say)
            else:
                self.widget = W.FloatSlider(low, min=low, max=high, step=step, **say)
            self.entry = W.Text(continuous_update=False, tooltip=meta.help, layout=shared["layout"], style=shared["text"])
            self.entry.observe(self._entered, "value")
            self.box = W.HBox([self.widget, self.entry], layout=shared["layout"])
        self.widget.observe(self._slid, "value")
        for mark in ("row", f"set-{_place(name)}"):
            self.box.add_class(f"smcaero-{mark}")

    def _entered(self, change):
        if change.new != self._written:
            self._ask(self.typed(change.new))

    def _slid(self, change):
        if change.new != self._placed and self.moved(change.new):
            self._ask(self.slid(change.new))

    def place(self, v):
        """Where `v` is on the slider, in steps."""
        w = self.widget
        return (math.log10(max(v, 10.0**w.min)) if isinstance(w, W.FloatLogSlider) else v)/w.step

    def moved(self, v):
        """Whether somebody moved the slider: the page also answers what it is told, with the nearest step, perhaps too late."""
        if not (self.entry and self.from_page()):
            return True
        if abs(self.place(v) - self.place(self.value)) < 0.5:
            return False
        late = [q for q in self.told if abs(self.place(v) - q) < 0.5]
        self.told = [q for q in self.told if q not in late] if late else []
        if late:
            self.put(self.value)
        return not late

    def from_page(self):
        """Whether the page, not a program, sets the slider just now."""
        return "value" in self.widget._property_lock

    def slid(self, v):
        """The slider's value, without the digits that a step does not mean; its ends are the bounds, whatever they round to."""
        if self.entry and self.from_page():
            v = self.kind(f"{v:.3g}" if isinstance(self.widget, W.FloatLogSlider) else f"{v:.6g}")
        return min(max(v, self.meta.low), self.meta.high) if self.entry else v

    def typed(self, text):
        """The number that the text says, or the text, which validation then refuses in words."""
        try:
            return float(text)
        except ValueError:
            return text.strip()

    def show(self, value, pull=False):
        """Show a value in the entry, unless what was typed says the same, and by the slider's step.

        A handle that is being dragged stays where the hand is, unless it is to be pulled back.
        """
        self.mark(False)
        self.value = value
        if self.entry is None:
            self._placed = self.widget.value = value
            return
        same = self.typed(self.entry.value) == value
        self._written = self.entry.value if same else _written(value)
        self.entry.value = self._written
        if self.from_page() and not pull:
            self._placed = self.widget.value
            return  # an answer would pull it back
        if self.told[-1:] != [self.place(value)]:
            self.told = [*self.told[-30:], self.place(value)]
        self.put(value)

    def at(self, value):
        """The slider's value for `value`: the next of its steps."""
        w, place = self.widget, self.place(value)*self.widget.step
        if w.min < place < w.max:
            place = float(f"{w.min + w.step*round((place - w.min)/w.step):.12g}")
        place = min(max(place, w.min), w.max)
        return 10.0**place if isinstance(w, W.FloatLogSlider) else self.kind(place)

    def put(self, value):
        """Put the slider on the next of its steps, so that the page has little to answer."""
        self._placed = self.at(value)
        self.widget.value = self._placed

    def true(self):
        """Whether it shows its value, as far as steps go, or what was refused."""
        if self.refused or self.entry is None:
            return self.refused or self.widget.value == self.value
        near = abs(self.place(self.widget.value) - self.place(self.at(self.value))) < 0.75
        text = self.entry.value
        return near and (text == _written(self.value) or self.typed(text) == self.value)

    def mend(self, value, page):
        """Show `value` where Ctrl-C left something else; to the page too if it may not know."""
        if self.value != value or not self.true():
            self.show(value, pull=True)
        for w in filter(None, (self.widget, self.entry)) if page else ():
            w.send_state("value")

    def mark(self, refused):
        """Mark the entry as refused, or not; what is refused may be asked for again."""
        self.refused = refused
        if refused:
            self._placed = self._written = None
        (self.box.add_class if refused else self.box.remove_class)("smcaero-refused")


class _Fold(W.VBox):
    """A group that opens and closes; what is in it is sent to the page when it first opens."""

    def __init__(self, title, block, rows, folded, shared):
        self.rows, self.block = rows, block
        plain = dict(layout=shared["layout"])
        self.opener = W.ToggleButton(not folded, description=title, tooltip="Show or hide", **plain)
        self.helper = W.ToggleButton(description="?", tooltip=f"What {title} is: equation, conditions, sources", **plain)
        self.doc, self.body = W.HTMLMath(**plain), W.VBox(**plain)
        head = W.HBox([self.opener, self.helper] if block else [self.opener], **plain)
        for w, name in ((self.opener, "fold"), (self.helper, "help"), (self.doc, "doc"), (head, "head")):
            w.add_class(f"smcaero-{name}")
        super().__init__([head], **plain)
        self.opener.observe(self.arrange, "value")
        self.helper.observe(self.arrange, "value")
        self.arrange()

    def arrange(self, _=None):
        """Show what is open."""
        self.opener.icon = "caret-down" if self.opener.value else "caret-right"
        if self.opener.value and not self.body.children:
            self.body.children = self.rows
        if self.helper.value and not self.doc.value:
            self.doc.value = doc_html(self.block.__doc__)
        self.children = [self.children[0], *[self.doc]*self.helper.value, *[self.body]*self.opener.value]


class _State(NamedTuple):
    """Of a mask: the name of the chosen loop, the loops as set, and as they were given."""

    chosen: str
    offered: dict
    given: dict

    target = property(lambda self: self.offered[self.chosen])

    def put(self, target):
        """The state with another target in place of the chosen one."""
        return self._replace(offered=self.offered | {self.chosen: target})


class Mask(W.VBox):
    """The form of a block or closed loop; made by `mask`.

    Attributes
    ----------
    target : Block, Channels or ClosedLoop
        As set now; ``mask.observe(f, "target")`` calls `f` after every change.
    values : dict
        {name: value} of what the form shows.
    widgets, entries : dict
        {name: slider or checkbox} and {name: text entry}.
    choice : ipywidgets.Dropdown
        Which of several loops.
    page : Page
        What runs beside it in the page.
    """

    target = traitlets.Any()

    def __init__(self, target, include=None, tau=None):
        loops = offered("mask", target, Block, Channels, ClosedLoop)
        self._state, self._shown, self._told = _State(next(iter(loops)), loops, loops), None, None
        self._tau, self._include = tau, names("mask", "include", include)
        self._forms, self._rows, self._lock = {}, {}, threading.RLock()
        self.page, self._status, self._body = Page(), W.HTML(), W.VBox()
        self.choice = W.Dropdown(options=list(loops))
        self._reset = W.Button(description="Reset", icon="undo", tooltip="Back to the values at the start")
        self._head = head = W.HBox()
        super().__init__()
        for w, name in ((self, "mask"), (head, "top"), (self.choice, "choice"), (self._body, "body"), (self._status, "status")):
            w.add_class(f"smcaero-{name}")
        self.children = [head, self._body, self._status, self.page]
        self.choice.observe(self._picked, "value")
        self._reset.on_click(lambda _: self.reset())
        self._formed(self._state)
        self._change(lambda: self._state)

    @property
    def offered(self):
        """{name: loop} of all that may be chosen, as set now."""
        return self._state.offered

    @property
    def chosen(self):
        """The name of the chosen loop."""
        return self._state.chosen

    @property
    def values(self):
        """{name: value} of what the form shows."""
        now = _settable(self._state.target)
        return {n: now[n][1] for n in self.widgets}

    def set(self, **values):
        """Set several values at once, with one notification; with none if they are set already.

        Raises
        ------
        ParameterError
            An unknown name, or a value that its metadata does not allow; nothing has changed then.
        """
        def made():
            before = self._state.target
            target, now = before.with_(**values), _settable(before)
            same = values.keys() <= now.keys() and _settable(target) == now
            return self._state.put(before if same else target)

        self._change(made)

    def reset(self):
        """Go back to the values at the start."""
        # a copy: observers hear of it even if nothing differs
        self._change(lambda: self._state.put(self._state.given[self.chosen].with_()))

    def offer(self, name, target):
        """Offer another loop or block, or another under a name, and choose it.

        Raises
        ------
        ParameterError
            The name is not a text, or the target is something else.
        """
        name = texted("mask", "name", name)
        more = offered("mask", {name: target}, Block, Channels, ClosedLoop)

        def made():
            old, loops, given = self._state
            if [*loops] == [""]:  # one that needed no name
                old = loops[""].name or "given"
                loops, given, self._forms = ({old: q[""]} for q in (loops, given, self._forms))
            state = _State(old, loops | more, given | more)
            return self._formed(state if old == name else self._brought(state, name))

        self._change(made)

    def mend(self):
        """Show again, and tell, what an interrupt left half done."""
        self._change(lambda: self._mend(False) or self._state)

    def say(self, text="", refused=False):
        """Show a message under the form; screen readers announce it."""
        self._status.value = said_html(text, refused)

    def in_this_world(self):
        """{name: loop} of all that are offered, each with what was changed in the vehicle and world of the chosen one."""
        return {n: self._brought(self._state, n).target for n in self.offered}

    def _brought(self, state, new):
        """Another one is chosen, with what was changed in the vehicle and world of the one before.

        A block, with all that was, except where it is meant to differ. What is not allowed there stays behind.
        """
        three = state.given[state.chosen], state.target, state.offered[new]
        was, now, there = map(_settable, three)
        block = isinstance(state.target, Block)
        carried = {n: v for n, (_, v, _) in now.items() if n in there and v != was[n][1]
                   and (n.split("__")[0] in WORLD or block and there[n][1] == was[n][1])}
        made = state.offered[new]
        for some in (carried, *({n: v} for n, v in carried.items())):  # all at once, as they belong together, or what goes
            try:
                made = made.with_(**some)
            except RAISED:
                continue
            if some is carried:
                break
        return state._replace(chosen=new).put(made)

    def _formed(self, state):
        """The state, once there is a form for it: what cannot have one is not chosen."""
        given = state.given[state.chosen]
        if self._forms.get(state.chosen, (None,))[0] is not given:
            self._forms[state.chosen] = given, *self._form(state.target)
        return state

    def _change(self, make):
        """Take the state that `make` returns, show it and tell the observers, whole or not at all.

        The state is one attribute, assigned once; what is shown follows from it, and is shown again
        where Ctrl-C, which may come at any moment, left it half done: here, or at the next change.
        """
        with self._lock:
            try:
                self._settle()
                self._state = make()
                self._settle()
            except Exception:  # of `make`: nothing has changed; of an observer: it was told
                self._mend(False)
                self._shown = self._told = self._state
                raise
            except BaseException:
                self._settle()
                self._mend(True)
                raise

    def _settle(self):
        """Show the state and tell the observers, unless that was done."""
        while self._told is not self._state:
            state, again = self._state, self._shown is self._state
            self._show(state)
            self._shown = state
            if again and self.target is state.target:  # not all of them may have heard
                self._notify_trait("target", state.target, state.target)
            self.target = state.target
            if self._state is state:  # no observer has changed it
                self._told = state

    def _show(self, state):
        """Show a state; to do so twice does no harm."""
        _, self._rows, folds = self._forms[state.chosen]
        self.widgets = {n: row.widget for n, row in self._rows.items()}
        self.entries = {n: row.entry for n, row in self._rows.items() if row.entry}
        self._show_choice(state)
        now = _settable(state.target)
        for n, row in self._rows.items():
            row.show(now[n][1])
        self.say()
        self._body.children = folds

    def _show_choice(self, state):
        if self.choice.options != tuple(state.offered):
            self.choice.options = list(state.offered)
        self.choice.value = state.chosen
        self._head.children = [*[self.choice]*(len(state.offered) > 1), self._reset]

    def _mend(self, page):
        """Let the controls show the state where they do not."""
        self._show_choice(self._state)
        now = _settable(self._state.target)
        for n, row in self._rows.items():
            row.mend(now[n][1], page)
        if page:
            self.choice.send_state("index")

    def _asked(self, name, value):
        """A person moved a slider or typed: take the value, or say what is allowed."""
        remarks, row = [], self._rows[name]

        def made():
            try:
                with warnings.catch_warnings(record=True) as heard:
                    warnings.simplefilter("always")
                    target = self._state.target.with_(**{name: value})
            except ParameterError:
                row.mark(True)  # what was typed stays, to be corrected
                raise
            remarks.extend(heard)
            return self._state.put(target)

        with self._lock:
            before = self._state
            try:
                self._change(made)
            except RAISED as why:
                if self._state is not before:  # an observer's
                    raise
                self.say(f"{why_not(why)}. It stays at {_written(row.value)}.", refused=True)
            else:
                if remarks:
                    self.say(f"{remarks[-1].message}.")

    def _picked(self, change):
        """A person chose another loop; what was changed in vehicle and world comes along."""
        if change.new == self.chosen or self._shown is not self._state:  # it is being shown
            return
        try:
            self._change(lambda: self._formed(self._brought(self._state, change.new)))
        except ParameterError as why:
            self.say(f"{why}.", refused=True)

    def _form(self, target):
        """Rows {name: _Row} and groups of the form."""
        known, include = {n: q for n, q in _settable(target).items() if not q[0].hidden}, self._include
        for i in include or ():
            if not any(n == i or n.startswith(f"{i}__") for n in known):
                raise unknown("mask: include", i, known)
        chosen = [n for n in known if include is None
                  or any(n == i or n.startswith(f"{i}__") for i in include)]
        shared = dict(layout=W.Layout(), slider=W.FloatSlider.style.klass(), text=W.Text.style.klass())
        grid = (self._tau or target.tau or target.dt) if isinstance(target, ClosedLoop) else None
        rows = {n: _Row(n, *known[n], self._asked, shared, grid) for n in chosen}
        units = {n: f" {q[0].unit}"*(q[0].unit != "1") for n, q in known.items()}
        self.page.tell({_place(n): (n.replace("__", " ") + units[n], known[n][0].log)
                        for n in chosen})
        groups = [(title, b, [rows[n].box for n in group if n in rows], folded and include is None)
                  for title, b, group, folded in _groups(target)]
        return rows, [_Fold(*group, shared) for group in groups if group[2]]


def mask(target, include=None):
    """Make the form of a block or closed loop from the metadata of its parameters.

    Parameters
    ----------
    target : Block, Channels, ClosedLoop or dict
        ``{name: loop}`` offers a choice of loops.
    include : sequence of str, optional
        Names (``"law__rho"``) or stages (``"law"``) to show; default: all.

    Returns
    -------
    Mask
        A widget; its `target` is the block or loop as set.

    Raises
    ------
    ParameterError
        `target` is something else, such as a function that makes a loop but was not called, or
        offers nothing, or under a name that is not a text; `include` is not a sequence of names, or
        names something that does not exist.

    Examples
    --------
    >>> m = mask(smc.lv.loop("quasi_smc"))
    >>> m.set(law__rho=3.0)
    >>> m.target.stages["law"].values["rho"]
    3.0
    """
    return Mask(target, include)
