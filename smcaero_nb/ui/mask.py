"""Masks: the form of a block or closed loop, made from the metadata of its parameters."""

import pathlib
import threading
import warnings
from collections.abc import Iterable
from typing import Any, Literal, NamedTuple

import anywidget
import ipywidgets as W
import traitlets
from ipywidgets.widgets.widget_string import TextStyle

from ..core import Block, ClosedLoop, Param, ParameterError
from ..core.block import Channels
from ..core.param import chosen, texted, unknown
from ..core.program import methods
from ..core.stages import STAGES
from .given import Loop, Loops, names, offered
from .job import RAISED
from .row import Entries, Row, css_class, written
from .text import doc_html, label, said_html, why_not

__all__ = ["Mask", "mask"]

HERE = pathlib.Path(__file__).parent
# what a designer sets; the rest is folded away
DESIGN = tuple(name for name, stage in STAGES.items() if stage.role == "design")
WORLD = tuple(name for name, stage in STAGES.items() if stage.role == "world")
# of a loop as a whole and of its runs; they come along with the world
SIMULATION = "method", "latency"
METHOD = Param(help="how the plant is integrated from step to step")


class _Names(W.Widget):
    """The accessible name of each control, and whether its slider is logarithmic."""

    names = traitlets.Dict().tag(sync=True)


class Page(anywidget.AnyWidget):
    """What ipywidgets leave out in the page: accessible names and live announcements."""

    _esm = HERE / "page.js"
    _css = HERE / "page.css"
    told = traitlets.Instance(_Names).tag(sync=True, **W.widget_serialization)

    def __init__(self, **names: tuple[str, bool]):
        super().__init__(told=_Names(names=names))

    def tell(self, names: dict[str, tuple[str, bool]]) -> None:
        """Name more controls."""
        self.told.names = self.told.names | names


def _blocks(prefix, b):
    """(prefix, block) of a stage, those of channels one by one."""
    if isinstance(b, Channels):
        for c, part in b.parts.items():
            yield from _blocks(f"{prefix}{c}__", part)
    elif b:
        yield prefix, b


def _groups(target):
    """[(title, block, names, folded)] in the order in which one designs; initial states last."""
    stages = {"": target}
    if isinstance(target, ClosedLoop):
        stages = {f"{s}__": target.stages[s] for s in DESIGN + WORLD}
    blocks = [q for prefix, b in stages.items() for q in _blocks(prefix, b)]
    groups = [(": ".join(filter(None, (" ".join(p.split("__")[:-1]), b.name.replace("_", " ")))), b,
               [f"{p}{n}" for n in (*b.params, *b.buffers)], p.startswith(WORLD)) for p, b in blocks]
    starts = {}
    for p, b in reversed(blocks):
        title = ": ".join(["initial state", *p.split("__")[1:-1]])
        starts.setdefault(title, []).extend(f"{p}{n}" for n in b.states if n not in b.buffers)
    if isinstance(target, ClosedLoop):
        groups.append(("simulation", None, [*SIMULATION], True))
    return [*groups, *((title, None, names, True) for title, names in sorted(starts.items()))]


def _told(name, meta, row):
    """(CSS class, (accessible name, whether its slider is logarithmic)) of controls of a row."""
    said, unit = name.replace("__", " "), f" {meta.unit}"*(meta.unit != "1")
    if isinstance(row, Entries):
        return [(q, (called + unit, False)) for q, called in row.names(said).items()]
    return [(css_class(name), (said + unit, meta.log))]


def _titles(names, known):
    """{name: what its row is called in its group}: with the stage, where two are alike."""
    short = {n: n.rpartition("__")[::2] for n in names}
    called = [known[n][0].symbol or short[n][1] for n in names]
    return {n: label(short[n][1], known[n][0])
            + f" ({label(short[n][0].replace('__', ' '), Param())})"*(called.count(q) > 1)
            for n, q in zip(names, called, strict=True)}


class _Fold(W.VBox):
    """A group that opens and closes; what is in it is sent to the page when it first opens."""

    def __init__(self, title, block, rows, folded, shared):
        self.rows, self.block = rows, block
        plain = dict(layout=shared["layout"])
        self.opener = W.ToggleButton(not folded, description=title, tooltip="Show or hide", **plain)
        self.helper = W.ToggleButton(
            description="?", tooltip=f"About {title}: equation, conditions, sources", **plain)
        self.doc, self.body = W.HTMLMath(**plain), W.VBox(**plain)
        self.head = W.HBox([self.opener, self.helper] if block else [self.opener], **plain)
        for w, name in ((self.opener, "fold"), (self.helper, "help"), (self.doc, "doc"),
                        (self.head, "head")):
            w.add_class(f"smcaero-{name}")
        super().__init__([self.head], **plain)
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
        self.children = [self.head, *[self.doc]*self.helper.value, *[self.body]*self.opener.value]


class _State(NamedTuple):
    """State of a mask: the name of the chosen loop, the loops as set, and as they were given.

    `methods` are the integration methods by name, where they are not the default.
    """

    chosen: str
    offered: dict
    given: dict
    methods: dict

    target = property(lambda self: self.offered[self.chosen])

    @property
    def allowed(self):
        """The integration methods that the target may have, its default first."""
        return methods(self.target) if isinstance(self.target, ClosedLoop) else ()

    @property
    def method(self):
        """The integration method of the target; None of a block."""
        set_here = self.methods.get(self.chosen)
        return set_here if set_here in self.allowed else next(iter(self.allowed), None)

    def settable(self):
        """{name: (Param, value, kind)} of all that can be set in the target."""
        target = self.target
        if isinstance(target, ClosedLoop):
            few = 10*(target.tau or target.dt or 0.1)  # s: ten samples
            late = Param(unit="s", low=0.0, slider=(0.0, few),
                         help="time from a sample until its control acts")
            return target.settable() | {"method": (METHOD, self.method, Literal[self.allowed]),
                                        "latency": (late, target.latency, float)}
        return {n: (m, target.values[n], target.kinds.get(n, float))
                for n, m in target.settable.items()}

    def put(self, target):
        """The state with another target in place of the chosen one."""
        return self._replace(offered=self.offered | {self.chosen: target})

    def with_(self, **values):
        """The state with values set in the target."""
        methods = self.methods
        if "method" in values and self.allowed:
            method = chosen("mask", "method", values.pop("method"), self.allowed)
            methods = methods | {self.chosen: method}
        return self._replace(methods=methods).put(self.target.with_(**values))


class Mask(W.VBox):
    """The form of a block or closed loop; made by `mask`.

    Attributes
    ----------
    target : Block, Channels or ClosedLoop
        As set now; ``mask.observe(f, "target")`` calls `f` after every change.
    values : dict
        {name: value} of what the form shows.
    widgets, entries : dict
        {name: slider or checkbox}, or all entries of a tuple, and {name: text entry}.
    choice : ipywidgets.Dropdown
        Which of several loops.
    page : Page
        What runs beside it in the page.
    """

    target: Any = traitlets.Any()
    widgets: Any  # not those of ipywidgets, whose attribute of this name is deprecated
    entries: dict[str, W.Text]

    def __init__(self, target: Loops, include: Iterable[str] | None = None,
                 tau: float | None = None, dt: float | None = None):
        loops = offered("mask", target, Block, Channels, ClosedLoop)
        self._state, self._shown = _State(next(iter(loops)), loops, loops, {}), None
        self._told = None
        self._tau, self._dt, self._include = tau, dt, names("mask", "include", include)
        self._forms, self._rows, self._lock = {}, {}, threading.RLock()
        self.page, self._status, self._body = Page(), W.HTML(), W.VBox()
        self.choice = W.Dropdown(options=list(loops))
        self._reset = W.Button(description="Reset", icon="undo",
                               tooltip="Back to the initial values")
        self._head = head = W.HBox()
        super().__init__()
        for w, name in ((self, "mask"), (head, "top"), (self.choice, "choice"),
                        (self._body, "body"), (self._status, "status")):
            w.add_class(f"smcaero-{name}")
        self.children = [head, self._body, self._status, self.page]
        self.choice.observe(self._picked, "value")
        self._reset.on_click(lambda _: self.reset())
        self._formed(self._state)
        self._change(lambda: self._state)

    @property
    def offered(self) -> dict[str, Loop]:
        """{name: loop} of all that may be chosen, as set now."""
        return self._state.offered

    @property
    def chosen(self) -> str:
        """The name of the chosen loop."""
        return self._state.chosen

    @property
    def method(self) -> str | None:
        """The integration method of the chosen loop; None of a block."""
        return self._state.method

    @property
    def values(self) -> dict[str, Any]:
        """{name: value} of what the form shows."""
        now = self._state.settable()
        return {n: now[n][1] for n in self.widgets}

    def set(self, **values: Any) -> None:
        """Set several values at once, with one notification; with none if they are set already.

        Raises
        ------
        ParameterError
            An unknown name, or a value that its metadata does not allow; nothing has changed then.
        """
        def made():
            state, now = self._state.with_(**values), self._state.settable()
            same = values.keys() <= now.keys() and state.settable() == now
            return self._state.put(self._state.target) if same else state

        self._change(made)

    def reset(self) -> None:
        """Go back to the initial values."""
        def made():
            given, methods = self._state.given[self.chosen], dict(self._state.methods)
            methods.pop(self.chosen, None)
            # a copy: observers hear of it even if nothing differs
            return self._state._replace(methods=methods).put(given.with_())

        self._change(made)

    def offer(self, name: str, target: Loop) -> None:
        """Offer another loop or block, or another under a name, and choose it.

        Raises
        ------
        ParameterError
            The name is not text, or the target is something else.
        """
        name = texted("mask", "name", name)
        more = offered("mask", {name: target}, Block, Channels, ClosedLoop)

        def made():
            old, loops, given, kept = self._state
            if [*loops] == [""]:  # one that needed no name
                old = loops[""].name or "given"
                loops, given, self._forms, kept = (
                    {n or old: v for n, v in q.items()}
                    for q in (loops, given, self._forms, kept))
            state = _State(old, loops | more, given | more, kept)
            return self._formed(state if old == name else self._brought(state, name))

        self._change(made)

    def mend(self) -> None:
        """Show again, and tell the observers, what an interrupt left half done."""
        self._change(lambda: self._mend(False) or self._state)

    def say(self, text: str = "", refused: bool = False) -> None:
        """Show a message under the form; screen readers announce it."""
        self._status.value = said_html(text, refused)

    def in_this_world(self) -> dict[str, Loop]:
        """Return {name: loop} of all, each in the vehicle and world of the chosen one, as set."""
        return {n: loop for n, (loop, _) in self.settings().items()}

    def settings(self) -> dict[str, tuple[Loop, str | None]]:
        """Return {name: (loop, integration method)} of all in the world of the chosen one."""
        made = {n: self._brought(self._state, n) for n in self.offered}
        return {n: (state.target, state.method) for n, state in made.items()}

    def _brought(self, state, new):
        """The state with another choice, which takes the changes of vehicle and world along.

        A block takes all changes along, except of values in which the two are meant to differ. What
        is not allowed there stays behind.
        """
        made = state._replace(chosen=new)
        was = state._replace(methods={}).put(state.given[state.chosen]).settable()
        now, there = state.settable(), made.settable()
        block = isinstance(state.target, Block)
        carried = {n: v for n, (_, v, _) in now.items() if n in there and v != was[n][1]
                   and (n.split("__")[0] in (*WORLD, *SIMULATION)
                        or block and there[n][1] == was[n][1])}
        # all at once, as they belong together, or one by one
        for some in (carried, *({n: v} for n, v in carried.items())):
            try:
                made = made.with_(**some)
            except RAISED:
                continue
            if some is carried:
                break
        return made

    def _formed(self, state):
        """The state, once there is a form for it; without a form, nothing is chosen."""
        given = state.given[state.chosen]
        if self._forms.get(state.chosen, (None,))[0] is not given:
            self._forms[state.chosen] = given, *self._form(state)
        return state

    def _change(self, make):
        """Take the state that `make` returns, show it and tell the observers, whole or not at all.

        The state is one attribute, assigned once; the controls follow it. Where Ctrl-C, which may
        come at any moment, left them half done, they are mended here or at the next change.
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
            before = self.target
            self.target = state.target  # this tells the observers, unless the two are equal
            if before == state.target and (again or before is not state.target):
                self._notify_trait("target", before, state.target)
            if self._state is state:  # no observer has changed it
                self._told = state

    def _show(self, state):
        """Show a state; doing so twice is harmless."""
        _, self._rows, folds = self._forms[state.chosen]
        self.widgets = {n: row.widget for n, row in self._rows.items()}
        self.entries = {n: row.entry for n, row in self._rows.items() if row.entry}
        self._show_choice(state)
        now = state.settable()
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
        now = self._state.settable()
        for n, row in self._rows.items():
            row.mend(now[n][1], page)
        if page:
            self.choice.send_state("index")

    def _asked(self, name, value):
        """Take the value that the user slid to or typed, or say what is allowed."""
        remarks, row = [], self._rows[name]

        def made():
            try:
                with warnings.catch_warnings(record=True) as heard:
                    warnings.simplefilter("always")
                    state = self._state.with_(**{name: value})
            except ParameterError:
                row.mark(True)  # what was typed stays, to be corrected
                raise
            remarks.extend(heard)
            return state

        with self._lock:
            before = self._state
            try:
                self._change(made)
            except RAISED as why:
                if self._state is not before:  # an observer's
                    raise
                self.say(f"{why_not(why)}. It stays at {written(row.value)}.", refused=True)
            else:
                if remarks:
                    self.say(f"{remarks[-1].message}.")

    def _picked(self, change):
        """Take another loop that the user chose; changes of vehicle and world come along."""
        if change.new == self.chosen or self._shown is not self._state:  # it is being shown
            return
        try:
            self._change(lambda: self._formed(self._brought(self._state, change.new)))
        except ParameterError as why:
            self.say(f"{why}.", refused=True)

    def _form(self, state):
        """Rows {name: Row} and groups of the form."""
        target = state.target
        known = {n: q for n, q in state.settable().items() if not q[0].hidden}
        include = self._include
        for i in include or ():
            if not any(n == i or n.startswith(f"{i}__") for n in known):
                raise unknown("mask: include", i, known)
        chosen = [n for n in known if include is None
                  or any(n == i or n.startswith(f"{i}__") for i in include)]
        groups = [(title, b, [n for n in group if n in chosen], folded and include is None)
                  for title, b, group, folded in _groups(target)]
        titles = {n: q for _, _, group, _ in groups for n, q in _titles(group, known).items()}
        shared = dict(layout=W.Layout(), slider=W.SliderStyle(), text=TextStyle())
        rows: dict[str, Row | Entries] = {}
        for n in chosen:
            meta, value, kind = known[n]
            if isinstance(value, tuple):
                rows[n] = Entries(n, titles[n], meta, value, kind, self._asked, shared)
            else:
                rows[n] = Row(n, titles[n], meta, value, kind, self._asked, shared,
                              self._grid(target, n, meta))
        self.page.tell(dict(q for n, row in rows.items() for q in _told(n, known[n][0], row)))
        return rows, [_Fold(title, b, [rows[n].box for n in group], folded, shared)
                      for title, b, group, folded in groups if group]

    def _grid(self, target, name, meta):
        """The step of a time that is counted in samples, or in steps of the run [s], or None."""
        if not isinstance(target, ClosedLoop):
            return None
        dt = self._dt or target.dt
        tau = (self._tau or target.tau or dt) if meta.samples else None
        grid = dt if name == "latency" else tau
        return grid if grid and grid > 0.0 else None


def mask(target: Loops, include: Iterable[str] | None = None) -> Mask:
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
        `target` is something else, such as a function that makes a loop but was not called, or an
        empty dict, or has a name that is not text; `include` is not a sequence of names, or names
        something that does not exist.

    Examples
    --------
    >>> m = mask(smc.lv.loop("quasi_smc"))
    >>> m.set(law__rho=3.0)
    >>> m.target.stages["law"].values["rho"]
    3.0
    """
    return Mask(target, include)
