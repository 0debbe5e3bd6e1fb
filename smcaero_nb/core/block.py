"""Blocks: one plain function each.

Arguments without a default are signals, wired by name; arguments with a default are parameters. A block with memory
names its state and asks for `z` and `tau`; it returns (output, next z). A plant returns dx/dt.
"""

import copy
import functools
import inspect

from .content import fingerprint
from .param import Param, ParameterError, declared, function, given, said, unknown
from .signal import flat

__all__ = ["Block", "BlockError", "Channels", "block", "channels", "routed", "wanted"]


class BlockError(TypeError):
    """A block that is wired, shaped or written so that it cannot run; the message names block, stage and line."""


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
        Values of the parameters and initial values of the states.
    output : Param, tuple or None
        Metadata of what it returns.
    check : function or None
        What the values have to satisfy together.
    theorem : function or None
        What a law's theorem assumes of the perturbation, or an allocation of the output.
    r : int or None
        Relative degree that a law of (sigma, sigma', ...) is for.
    band : function or None
        Size of sigma that a law accepts.
    """

    def __init__(self, f, state, output=None, check=None, theorem=None, r=None, band=None):
        if not inspect.isfunction(f):
            raise BlockError(f"block: a block is made of a plain function, not of {said(f)}")
        self.f, self.name, self.__doc__ = f, f.__name__, f.__doc__
        self.signals, self.params, self.kinds, self.values, self.output = declared(f)
        self.output = output or self.output
        self.states = {}
        for name, v in state.items():
            v, meta = v if isinstance(v, tuple) and len(v) == 2 else (v, Param())
            if isinstance(v, (tuple, list)) or not isinstance(meta, Param):
                raise BlockError(f"{self.name}: state {name} = {said(state[name])} is not allowed; a state is a number, or "
                                 f"(number, Param(...)): name one for each number, {name}_0, {name}_1, ...")
            if name in self.params:
                raise BlockError(f"{self.name}: '{name}' is both a parameter and a state")
            self.states[name], self.values[name] = meta, meta.check(self.name, name, v)
        if "z" in self.signals and not state:
            raise BlockError(f"{self.name} asks for z, but names no state: @block(state=dict(...))")
        self.check, self.theorem, self.r, self.band = check, theorem, r, band
        self._together()

    def _together(self):
        """Raise `ParameterError` if the values, each allowed by itself, do not go together."""
        if self.check and (why := self.check(dict(self.values))):
            raise ParameterError(f"{self.name}: {why}")

    settable = property(lambda self: {**self.params, **self.states})
    p = property(lambda self: tuple(self.values[n] for n in self.params))
    z0 = property(lambda self: tuple(self.values[n] for n in self.states))

    def with_(self, **changes):
        """Return a copy with other parameters or initial states.

        Raises
        ------
        ParameterError
            An unknown name, a value that its metadata does not allow, or values that do not go together.
        """
        new, known = copy.copy(self), self.settable
        new.values = dict(self.values)
        for name, v in changes.items():
            if name not in known:
                raise unknown(self.name, name, known)
            new.values[name] = known[name].check(self.name, name, v, self.kinds.get(name, float))
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
                params[name] = self.params[name].check(self.name, name, v, self.kinds[name])
            elif name not in self.signals:
                raise unknown(self.name, name, [*self.signals, *self.params])
        return self.f(*args, **{**{n: self.values[n] for n in rest}, **params})

    def __repr__(self):
        say = (f"{n}={v if isinstance(v := self.values[n], str) else f'{v:g}'}" + (f" {m.unit}" if m.unit != "1" else "")
               for n, m in self.settable.items())
        return f"{self.name}({', '.join(say)})"

    def content(self):
        """What the compiled block depends on."""
        def bounds(m):
            return (m.low, m.high) if isinstance(m, Param) else m and tuple(map(bounds, m))

        return fingerprint(self.f), {n: bounds(m) for n, m in self.states.items()}, bounds(self.output), self.kinds


class Channels:
    """Independent blocks side by side, made by `channels`; each sees its own component of every signal."""

    def __init__(self, parts):
        if not parts:
            raise BlockError("channels: at least one block is needed: channels(attitude=..., ...)")
        for name, b in parts.items():
            wanted(f"channels: {name}", b)
        self.parts, self.name = parts, "channels"
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
    output = property(lambda self: tuple(q) if any(q := [b.output for b in self.parts.values()]) else None)

    def with_(self, **changes):
        """Return a copy: ``part=block`` replaces a part, ``part__name=value`` sets something in it."""
        return Channels(routed(self.name, self.parts, changes))

    def __repr__(self):
        return f"channels({', '.join(f'{c}={b!r}' for c, b in self.parts.items())})"

    def content(self):
        """What the compiled blocks depend on."""
        return [(c, b.content()) for c, b in self.parts.items()]


def routed(owner, parts, changes):
    """Parts with changes applied: part=block replaces it, part__name=value sets something in it."""
    new, inner = dict(parts), {}
    for key, v in changes.items():
        part, _, name = key.partition("__")
        if part not in parts:
            raise unknown(owner, part, parts)
        if name:
            inner.setdefault(part, {})[name] = v
        else:
            new[part] = v
    for part, values in inner.items():
        if new[part] is None:
            raise ParameterError(f"{owner}: {part} is not used, so it has no '{next(iter(values))}'")
        new[part] = wanted(part, new[part], Block, Channels).with_(**values)
    return new


def wanted(name, value, *kinds):
    """Return `value` if it is a block, or of one of `kinds`, else raise `BlockError`."""
    if isinstance(value, kinds or Block):
        return value
    hint = "; give the block itself, not its name" if isinstance(value, str) else (
        "; put @block over it, or call it if it makes blocks" if inspect.isroutine(value) else "")
    raise BlockError(f"{name} must be a block (a function under @block), not {said(value)}{hint}")


def block(f=None, *, state=None, output=None, check=None, theorem=None, r=None, band=None):
    r"""Make a block of a plain function.

    Parameters
    ----------
    f : function
        Arguments without a default are signals, wired by name; arguments with one are parameters, and their
        annotation ``Annotated[float, Param(...)]`` says what a mask and a validation need. A stage of a loop may use floats,
        tuples, `math` and other plain functions; write ``x*x`` rather than ``x**2`` where compiled and plain runs
        must agree to the last bit. What a mask only calls (`ui.live`) may be anything, and have parameters that are a choice:
        ``Annotated[Literal["a", "b"], Param(...)]``.
    state : dict, optional
        ``{name: initial value}`` or ``{name: (initial value, Param)}``.
    output : Param or tuple of Param, optional
        Metadata of what it returns, nested as that is; of a block with memory, without its states. The
        return annotation ``Annotated[float, Param(...)]``, or a tuple of these, says the same.
    check : function, optional
        What parameters and initial states must satisfy together: it is given ``{name: value}`` of all of them, each
        allowed by itself, and returns None, or the sentence that says which condition does not hold.
    theorem : function, optional
        Of a law: what its theorem assumes of the perturbation. It is given ``{name: value}`` and the greatest \|xi\| and
        \|xi'\| of a run, and returns None, or the sentence that says which condition does not hold; see `Run.doubts`. Of an
        allocation: it is given the values and a list of outputs y of the run.
    r : int, optional
        Of a law that sees a tuple (sigma, sigma', ...): the relative degree it is for, if it is one law and not one for several
        inputs; default: as many as it sees.
    band : function, optional
        Of a law: the size of sigma that it accepts. It is given a time and ``{name: value}``; pictures draw it.

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
        raise BlockError(f"block: output = {said(output)} is not allowed; it must be a Param, or a tuple of them")
    for name, v in dict(check=check, theorem=theorem, band=band).items():
        function("block", name, v)
    r = None if r is None else Param(low=1).check("block", "r", r, int)
    made = functools.partial(Block, state=state, output=output, check=check, theorem=theorem, r=r, band=band)
    return made if f is None else made(f)


def channels(**parts):
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
