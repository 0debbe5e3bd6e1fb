"""Blocks: one plain function each.

Arguments without a default are signals, wired by name; arguments with a default are parameters. A
block with memory names its state and asks for `z` and `tau`; it returns (output, next z). A plant
returns dx/dt.
"""

import copy
import functools
import inspect
import keyword
from collections.abc import Callable
from typing import Any, NamedTuple, overload

from .card import Card, Law
from .content import fingerprint
from .family import found, home, public, rebuilt, spelt
from .param import Param, ParameterError, checked, declared, function, given, said, unknown
from .signal import flat, shape

__all__ = ["Block", "BlockError", "Buffer", "Channels", "block", "channels", "routed", "wanted"]


class BlockError(TypeError):
    """A block that cannot run as wired, shaped or written; the message names stage and line."""


class Buffer(NamedTuple):
    """A state that remembers n samples: ``@block(state=dict(late=Buffer(5)))``.

    In z, the block finds what it gave `n` samples ago, in the first `n` samples `start`; in its
    next z, it gives the number to remember. Compile time and the time of a step do not depend
    on `n`, which ``with_(late=7)`` changes. The numbers on their way are not recorded.

    Parameters
    ----------
    n : int
        Number of samples, from 1 to 1e7.
    start : float
        Finite.
    """

    n: int
    start: float = 0.0


SAMPLES = Param(unit="samples", low=1.0, high=1e7, help="samples until it is seen again")


class Block:
    """A plain function with its parameters, made by `block`.

    Attributes
    ----------
    f : function
        The function itself.
    signals : tuple of str
        Names of the signals it asks for.
    params, states : dict of str to Param
        Metadata.
    kinds : dict of str to type
        float, int, bool or a Literal of texts, of each parameter.
    values : dict
        Values of the parameters and initial values of the states: numbers, tuples of numbers or
        tuples of rows of them; of a `Buffer`, its n.
    buffers : dict of str to float
        What each `Buffer` among the states holds at the start.
    output : Param, tuple or None
        Metadata of what it returns.
    check : function or None
        What the values have to satisfy together.
    card : Card or None
        What it is for, what it needs and guarantees, and where it was published.
    factory : tuple or None
        The function that made it, and the arguments that it was given, where there is one.
    """

    def __init__(self, f: Callable, state: dict, output: Param | tuple | None = None,
                 check: Callable | None = None, card: Card | None = None):
        if not inspect.isfunction(f):
            way = ("; write a function of x, u, ... and make the object's numbers its parameters, "
                   f"def {f.__name__}(x, u, d, k=2.0)") if inspect.ismethod(f) else ""
            raise BlockError(f"block: a block is made of a plain function, not of {said(f)}{way}")
        if f.__code__.co_flags & (inspect.CO_VARARGS | inspect.CO_VARKEYWORDS):
            raise BlockError(f"block: {f.__name__} takes *args or **kwargs, but arguments are "
                             "wired by their names; write out each signal and parameter")
        self.f, self.name, self.__doc__ = f, f.__name__, f.__doc__
        self.signals, self.params, self.kinds, self.values, self.output = declared(f)
        self.output = output or self.output
        self.states, self.buffers = {}, {}
        for name, v in state.items():
            if name in self.params:
                raise BlockError(f"{self.name}: '{name}' is both a parameter and a state")
            pair = isinstance(v, tuple) and len(v) == 2 and isinstance(v[1], Param)
            v, meta = v if pair else (v, Param())
            if isinstance(v, Buffer):
                self.buffers[name] = Param().check(self.name, f"start of {name}", v.start)
                self.states[name], self.kinds[name] = SAMPLES, int
                self.values[name] = SAMPLES.check(self.name, name, v.n, int)
            else:
                self.states[name] = meta
                self.values[name] = checked(self.name, name, meta, v)
        if "z" in self.signals and not state:
            raise BlockError(f"{self.name} asks for z, but names no state: @block(state=dict(...))")
        self.check, self.card, self.factory = check, card, None
        self._born = self.values  # before any `with_`
        self._together()

    def _together(self):
        """Raise `ParameterError` if the values, each allowed by itself, do not go together."""
        if self.check and (why := self.check(dict(self.values))):
            raise ParameterError(f"{self.name}: {why}")

    settable = property(lambda self: {**self.params, **self.states})
    p = property(lambda self: tuple(self.values[n] for n in self.params))
    z0 = property(lambda self: tuple(self.buffers.get(n, self.values[n]) for n in self.states))
    theorem = property(lambda self: getattr(self.card, "assumes", None))
    band = property(lambda self: getattr(self.card, "band", None))

    @property
    def r(self) -> int | None:
        """Relative degree that a law of (sigma, sigma', ...) is for."""
        card = self.card
        return card.r if isinstance(card, Law) and card.sees == "derivatives" else None

    @property
    def made(self) -> tuple[str, dict] | None:
        """Name, ``"hosmc.nested"``, and arguments of what made it; None where no module has it."""
        _, arguments = self.factory or (self.f, {})
        return (public(*at), arguments) if (at := self._home) else None

    @property
    def _home(self) -> tuple[str, str] | None:
        """Module and name of what made it; none where another block of the same function is."""
        if self.factory:
            return home(self.factory[0])
        at = home(self.f)
        return at if at and found(*at)._born is self._born else None

    def code(self) -> str:
        """Return a Python expression for this block, as ``smc.hosmc.nested(2).with_(L=3.0)``.

        The name of a block of the kit begins with ``smc``, that of a block of your own with its
        module; a block from a notebook cell is called by its name alone.
        """
        maker, arguments = self.factory or (self.f, None)
        own = arguments is None
        born = found(*at).values if own and (at := self._home) else self._born
        changed = ", ".join(f"{n}={v!r}" for n, v in self.values.items() if v != born[n])
        text = self.name if own and not self._home else spelt(maker, arguments)
        return text + (f".with_({changed})" if changed else "")

    def __reduce__(self):
        maker, arguments = self.factory or (self.f, None)
        at, functions = self._home, filter(inspect.isfunction, (arguments or {}).values())
        if lost := maker if not at else next((f for f in functions if not home(f)), None):
            why = "is another block of this function" if home(lost) else (
                "is defined in the script or notebook itself" if lost.__module__ == "__main__" else
                "cannot be imported")
            raise BlockError(
                f"block '{self.name}' cannot be pickled, because {lost.__module__}."
                f"{lost.__qualname__} {why}; move it to a module (a .py file) and "
                "import it from there")
        return rebuilt, (at, arguments, self.values)

    def __copy__(self):
        new = object.__new__(type(self))
        new.__dict__.update(self.__dict__, values=dict(self.values))
        return new

    def __deepcopy__(self, memo):
        return copy.copy(self)

    def __eq__(self, other):
        if not isinstance(other, Block):
            return NotImplemented
        return self is other or (self.values, self.made) == (other.values, other.made) and (
            self.content() == other.content())

    def __hash__(self):
        return hash(tuple(sorted(self.values.items())))

    def with_(self, **changes: Any) -> "Block":
        """Return a copy with other parameters or initial states.

        Raises
        ------
        ParameterError
            An unknown name, a value that its metadata does not allow, or values that do not go
            together.
        """
        new, known = copy.copy(self), self.settable
        for name, v in changes.items():
            if name not in known:
                raise unknown(self.name, name, known)
            new.values[name] = checked(self.name, name, known[name], v,
                                       self.kinds.get(name, float), self._born[name])
        new._together()
        return new

    def __call__(self, *args, **params):
        """Evaluate the block as plain Python; parameters not given have the block's values.

        Raises
        ------
        ParameterError
            A parameter, given by its name, that does not exist or has a value that is not allowed.
        """
        rest = list(self.params)[max(0, len(args) - len(self.signals)):]
        for name, v in params.items():
            if name in self.params:
                params[name] = checked(self.name, name, self.params[name], v, self.kinds[name],
                                       self._born[name])
            elif name not in self.signals:
                raise unknown(self.name, name, [*self.signals, *self.params])
        return self.f(*args, **{**{n: self.values[n] for n in rest}, **params})

    def __repr__(self):
        values = {n: _short(v) for n, v in self.values.items()}
        say = (f"{n}={values[n]}" + f" {m.unit}"*(m.unit != "1") for n, m in self.settable.items())
        return f"{self.name}({', '.join(say)})"

    def content(self) -> tuple:
        """Return what the compiled block depends on."""
        def bounds(m):
            return (m.low, m.high) if isinstance(m, Param) else m and tuple(map(bounds, m))

        states = {n: bounds(m) for n, m in self.states.items()}
        entries = {n: shape(v) for n, v in self.values.items() if isinstance(v, tuple)}
        return (fingerprint(self.f), states, bounds(self.output), self.kinds, entries,
                self.buffers)


def _short(value: Any) -> str:
    """Text of a value, in short."""
    if isinstance(value, tuple):
        return f"({', '.join(map(_short, value))})"
    return value if isinstance(value, str) else f"{value:g}"


class Channels:
    """Independent blocks side by side, made by `channels`; each sees its component of a signal."""

    name = "channels"

    def __init__(self, parts: dict[str, Block]):
        if not parts:
            raise BlockError(f"{self.name}: at least one block is needed: {self.name}(a=..., ...)")
        for name, b in parts.items():
            if not name.isidentifier() or keyword.iskeyword(name) or "__" in name:
                raise BlockError(f"{self.name}: a part cannot be called {said(name)}; it must be "
                                 "a name in Python, without two underscores in a row")
            wanted(f"{self.name}: {name}", b)
        self.parts = parts
        self.__doc__ = "\n\n".join(f"{c}: {b.__doc__}" for c, b in parts.items())

    def _joined(self, what):
        return {f"{c}__{n}": v for c, b in self.parts.items() for n, v in getattr(b, what).items()}

    signals = property(lambda self: tuple(n for b in self.parts.values() for n in b.signals))
    params = property(lambda self: self._joined("params"))
    kinds = property(lambda self: self._joined("kinds"))
    values = property(lambda self: self._joined("values"))
    settable = property(lambda self: self._joined("settable"))
    states = property(lambda self: {c: b.states for c, b in self.parts.items()})
    p = property(lambda self: tuple(v for b in self.parts.values() for v in b.p))
    z0 = property(lambda self: tuple(v for b in self.parts.values() for v in b.z0))

    @property
    def output(self) -> tuple | None:
        """Metadata of what the blocks return, where any of them declares some."""
        found = tuple(b.output for b in self.parts.values())
        return found if any(found) else None

    def code(self) -> str:
        """Return a Python expression that makes these blocks; see `Block.code`."""
        return f"smc.{self.name}({', '.join(f'{c}={b.code()}' for c, b in self.parts.items())})"

    def __reduce__(self):
        return type(self), (self.parts,)

    def __eq__(self, other):
        if type(other) is not type(self):
            return NotImplemented
        return list(self.parts.items()) == list(other.parts.items())

    def __hash__(self):
        return hash(tuple(self.parts.items()))

    def with_(self, **changes: Any) -> "Channels":
        """Return a copy: ``part=block`` replaces it, ``part__name=value`` sets something in it."""
        return type(self)(routed(self.name, self.parts, changes))

    def __repr__(self):
        return f"{self.name}({', '.join(f'{c}={b!r}' for c, b in self.parts.items())})"

    def content(self) -> tuple:
        """Return what the compiled blocks depend on; side by side and in series differ."""
        return self.name, [(c, b.content()) for c, b in self.parts.items()]


def routed(owner: str, parts: dict, changes: dict) -> dict:
    """Parts with changes applied: part=block replaces it, part__name=value sets something in it."""
    new, inner = dict(parts), {}
    for key, v in changes.items():
        part, _, name = key.partition("__")
        if part not in parts:
            inside = [f"{p}__{n}" for p, b in parts.items() if b for n in b.settable]
            raise unknown(owner, part, parts, inside)
        if name:
            inner.setdefault(part, {})[name] = v
        else:
            new[part] = v
    for part, values in inner.items():
        if new[part] is None:
            raise ParameterError(
                f"{owner}: {part} is not used, so it has no '{next(iter(values))}'")
        new[part] = wanted(part, new[part], Block, Channels).with_(**values)
    return new


def wanted(name: str, value: Any, *kinds: type) -> Any:
    """Return `value` if it is a block, or of one of `kinds`, else raise `BlockError`."""
    if isinstance(value, kinds or Block):
        return value
    hint = "; give the block itself, not its name" if isinstance(value, str) else (
        "; put @block over it, or call it if it makes blocks" if inspect.isroutine(value) else "")
    raise BlockError(f"{name} must be a block (a function under @block), not {said(value)}{hint}")


@overload
def block(f: Callable, *, state: dict | None = None, output: Param | tuple | None = None,
          check: Callable | None = None, card: Card | None = None) -> Block: ...


@overload
def block(f: None = None, *, state: dict | None = None, output: Param | tuple | None = None,
          check: Callable | None = None, card: Card | None = None
          ) -> Callable[[Callable], Block]: ...


def block(f=None, *, state=None, output=None, check=None, card=None) -> Any:
    r"""Make a block of a plain function.

    Parameters
    ----------
    f : function
        Arguments without a default are signals, wired by name; arguments with one are parameters,
        and their annotation ``Annotated[float, Param(...)]`` says what a mask and a validation
        need. A stage of a loop may use floats, tuples, `math` and other plain functions; write
        ``x*x`` rather than ``x**2`` where compiled and plain runs must agree to the last bit. What
        a mask only calls (`ui.live`) may be anything, and have parameters that are a choice:
        ``Annotated[Literal["a", "b"], Param(...)]``.
    state : dict, optional
        ``{name: initial value}`` or ``{name: (initial value, Param)}``; a value may be a number, a
        tuple (a quaternion) or a tuple of rows (a matrix), as that of a parameter may. A state that
        is a `Buffer` remembers samples.
    output : Param or tuple of Param, optional
        Metadata of what it returns, nested as that is; of a block with memory, without its states.
        The return annotation ``Annotated[float, Param(...)]``, or a tuple of these, says the same.
    check : function, optional
        What parameters and initial states must satisfy together: it is given ``{name: value}`` of
        all of them, each allowed by itself, and returns None, or the sentence that says which
        condition does not hold.
    card : Card, optional
        What the block is for, what it needs and guarantees, and where it was published: for a law
        ``smc.card.Law(...)``.

    Returns
    -------
    Block

    Raises
    ------
    BlockError, ParameterError
        The declaration contradicts itself, or the defaults do not satisfy `check`; something other
        than a function or a dict where one is wanted.

    Examples
    --------
    >>> @block
    ... def sign_law(sigma, rho: Annotated[float, Param(r"\rho", "[v]", low=0.0)] = 1.0):
    ...     return rho*((sigma > 0.0) - (sigma < 0.0))
    """
    state = {} if state is None else state
    given("block", "state", state, dict, "a dict of initial values by name")
    if not (output is None or all(isinstance(m, Param) for m in flat(output))):
        raise BlockError(f"block: output = {said(output)} is not allowed; it must be a Param, or a "
                         "tuple of them")
    function("block", "check", check)
    if card is not None:
        given("block", "card", card, Card, "a card, such as smc.card.Law(...)")
    made = functools.partial(Block, state=state, output=output, check=check, card=card)
    return made if f is None else made(f)


def channels(**parts: Block) -> Channels:
    """Run independent blocks side by side, one for each component of the signals.

    Parameters
    ----------
    **parts : Block
        ``channels(attitude=a, descent=b)``: `a` sees component 0 of every signal, `b` component 1.

    Returns
    -------
    Channels
        Used as a block; its parameters are ``attitude__lam`` and so on.

    Raises
    ------
    BlockError
        A part that is not a block, or none at all.
    """
    return Channels(parts)
