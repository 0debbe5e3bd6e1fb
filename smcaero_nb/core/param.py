"""Parameters: metadata, declared once, and their validation."""

import difflib
import functools
import inspect
import math
import numbers
import reprlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Literal, get_args, get_origin

import numpy as np

from .signal import leaves, shape, size

__all__ = ["Param", "ParameterError", "checked", "chosen", "declared", "function", "given",
           "listed", "number", "positive", "real", "refused", "relative_degree", "said", "several",
           "switch", "texted", "unknown"]

MOST, MANY = 160, 400  # characters of a value, and of a list of names, that a message shows
ENTRIES = 100  # maximum number of entries of a parameter


class ParameterError(ValueError):
    """A parameter that does not exist, or a value that is not allowed; the message says what is."""


@dataclass(frozen=True)
class Param:
    """Metadata of a number: what a mask shows and what validation enforces.

    Parameters
    ----------
    symbol : str
        LaTeX symbol, without dollars, of letters, accents, roman type and indices; any other text
        is shown as it stands; empty: the name in the code.
    unit : str
        Unit as text, ``"1"`` if dimensionless; ``"[sigma]"`` stands for the unit of a signal.
    low, high : float
        Hard bounds. Of a plant's state or of an output, they are also its limits: a run that leaves
        them has diverged.
    log : bool
        The slider is logarithmic.
    help : str
        One line for the mask.
    slider : tuple of two floats
        Range of the slider, where it is narrower than the bounds.
    samples : bool
        It is a time that the block counts in samples: `simulate` takes only multiples of its
        sampling step.
    hidden : bool
        Of a state: pictures and masks leave it out.
    """

    symbol: str = ""
    unit: str = "1"
    low: float = -math.inf
    high: float = math.inf
    log: bool = False
    help: str = ""
    slider: tuple = ()
    samples: bool = False
    hidden: bool = False

    def __post_init__(self):
        for n in ("symbol", "unit", "help"):
            texted("Param", n, getattr(self, n))
        for n in ("log", "samples", "hidden"):
            switch("Param", n, getattr(self, n))
        slider = self.slider if isinstance(self.slider, (tuple, list)) else (math.nan,)
        bounds = (("low", self.low), ("high", self.high), *(("slider", v) for v in slider))
        for n, v in bounds:
            if not (isinstance(v, float) or abs(number(v)) < math.inf) or v != v:
                what = "two numbers that rise" if n == "slider" else "a number"
                raise refused("Param", n, getattr(self, n), what)
        if slider and not (len(slider) == 2 and slider[0] <= slider[1]):
            raise refused("Param", "slider", self.slider, "two numbers that rise")
        if self.low > self.high:
            raise refused("Param", "low", self.low, f"at most high = {said(self.high)}")
        for n, v in (("low", self.low), ("high", self.high)):
            if not isinstance(v, (int, float)):  # a fraction or a number of numpy
                object.__setattr__(self, n, float(v))

    def check(self, owner: str, name: str, value: Any, kind: Any = float) -> Any:
        """Return `value` as `kind` (float, int, bool, Literal) if allowed, or `ParameterError`."""
        if choices := get_args(kind):
            return chosen(owner, name, value, choices)
        if kind is bool:
            return switch(owner, name, value)
        size = number(value)
        whole = kind is float or size.is_integer()
        if not (self.low <= size <= self.high and math.isfinite(size) and whole):
            raise refused(owner, name, value, self.allowed(kind), self.unit)
        return kind(value)

    def allowed(self, kind: type = float) -> str:
        """The admissible values, in words."""
        what = "a whole number" if kind is int else "a finite number"
        low, high = math.isfinite(self.low), math.isfinite(self.high)
        if low and high:
            what += f" from {self.low:g} to {self.high:g}"
        elif low or high:
            what += f", at least {self.low:g}" if low else f", at most {self.high:g}"
        return what + (f"{' ' if low or high else ', in '}{self.unit}" if self.unit != "1" else "")


def checked(owner: str, name: str, meta: Param, value: Any, kind: Any = float,
            like: Any = None) -> Any:
    """Return a value if it is allowed: a number, a tuple of numbers or a tuple of rows of numbers.

    Lists and arrays become tuples. A tuple must have as many entries as `like`, if that is given.
    """
    entries = _tupled(value)
    if not isinstance(entries if like is None else like, tuple):
        return meta.check(owner, name, value, kind)
    form = shape(entries)
    if like is not None and form != shape(like):
        rows = " numbers"*isinstance(like[0], tuple)
        raise refused(owner, name, value, size(shape(like)) + rows, meta.unit)
    deep = any(q is not None for row in form if row is not None for q in row)
    if deep or () in (form, *form) or len(leaves(form)) > ENTRIES:
        raise refused(owner, name, value, "a number, a tuple of numbers or a tuple of rows of "
                      f"numbers, of at most {ENTRIES}; a block reads more from an array")
    return _checked(owner, name, meta, entries, kind)


def _tupled(value: Any) -> Any:
    """Tuples for lists and arrays, nested as they are."""
    sequence = isinstance(value, (tuple, list)) or isinstance(value, np.ndarray) and value.ndim
    return tuple(map(_tupled, value)) if sequence else value


def _checked(owner: str, name: str, meta: Param, value: Any, kind: Any) -> Any:
    if isinstance(value, tuple):
        return tuple(_checked(owner, f"{name}[{i}]", meta, v, kind) for i, v in enumerate(value))
    return meta.check(owner, name, value, kind)


def real(value: Any) -> bool:
    """Return whether a value is a real number; a switch is not, nor a duration of numpy."""
    return isinstance(value, numbers.Real) and not isinstance(value, (bool, np.timedelta64))


def number(value: Any) -> float:
    """A real number as float; NaN of anything else, and infinity of what is beyond float64."""
    try:
        return float(value) if real(value) else math.nan
    except OverflowError:  # a whole number of more than 308 digits
        return math.inf


class _Short(reprlib.Repr):
    """Texts of values of any size, in one line."""

    def __init__(self):
        super().__init__()
        self.maxstring = self.maxlong = 60
        self.maxother, self.maxlevel = MOST, 3

    def repr_int(self, x, level):
        if abs(x) >= 10**self.maxlong:  # Python itself refuses to write thousands of digits
            return f"{'-'*(x < 0)}1e{int(x.bit_length()*math.log10(2))} or so"
        return repr(x)

    def repr_instance(self, x, level):
        return " ".join(super().repr_instance(x, level).split())


_short = _Short()


def said(value: Any, unit: str = "1") -> str:
    """Text of any value for a message: a number with its unit, anything else in short."""
    number = real(value)
    if number and not isinstance(value, numbers.Rational):
        value = float(value)
        text = f"{value:g}"
        text = text if float(text) == value or value != value else repr(value)  # 1.0000001, not 1
    else:
        text = _short.repr(int(value) if number and isinstance(value, numbers.Integral) else value)
    text = text if len(text) <= MOST else f"{text[:MOST - 3]}..."
    return text + (f" {unit}" if unit != "1" and number else "")


def listed(names: Iterable, none: str = "nothing") -> str:
    """Text of a list of names for a message, cut where it gets long."""
    names, text = [str(n) if len(str(n)) <= 60 else said(str(n)) for n in names], ""
    for i, n in enumerate(names):
        if len(text) + len(n) > MANY:
            return f"{text}, ... ({len(names)} in all)"
        text += ", "*(i > 0) + n
    return text or none


def refused(owner: str, name: str, value: Any, must: str, unit: str = "1") -> ParameterError:
    """The error for a value that is not allowed; `must` says what it must be."""
    value = said(value, unit)
    return ParameterError(f"{owner}: {name} = {value} is not allowed; it must be {must}")


def relative_degree(owner: str, r: Any, high: int, low: int = 1) -> int:
    """Return a relative degree from `low` to `high`, else raise `ParameterError`; names the way on.

    Higher ones are rare in a design, and a law of first order takes any.
    """
    try:
        return Param(low=low, high=high).check(owner, "r", r, int)
    except ParameterError as why:
        if not number(r) > high:
            raise
        raise ParameterError(
            f"{why}. On a longer time scale it may be lower (prd.sweep); or write the sliding "
            "variable of any r as a block, e^(r-1) + c_(r-2) e^(r-2) + ... + c_0 e with c of "
            "np.poly([-w]*(r - 1)), for a law of relative degree 1") from None


def chosen(owner: str, name: str, value: Any, allowed: Iterable[str]) -> str:
    """Return `value` if it is one of the texts `allowed`, else raise `ParameterError`."""
    if not (isinstance(value, str) and value in allowed):
        raise refused(owner, name, value, f"one of {listed(map(repr, allowed))}")
    return value


def switch(owner: str, name: str, value: Any) -> bool:
    """Return `value` as bool if it is True or False, else raise `ParameterError`."""
    if not isinstance(value, (bool, np.bool_)):
        raise ParameterError(f"{owner}: {name} = {said(value)} is not allowed; it is a switch, "
                             "True or False")
    return bool(value)


def texted(owner: str, name: str, value: Any) -> str:
    """Return `value` if it is text, else raise `ParameterError`."""
    if not isinstance(value, str):
        raise refused(owner, name, value, "text")
    return value


def function(owner: str, name: str, value: Any) -> Callable | None:
    """Return `value` if it can be called or is None, else raise `ParameterError`."""
    if not (value is None or callable(value)):
        raise refused(owner, name, value, "a function")
    return value


def given(owner: str, name: str, value: Any, kind: Any, what: str) -> Any:
    """Return `value` if it is of `kind`, `what` in words, else raise `ParameterError`."""
    if not isinstance(value, kind):
        raise refused(owner, name, value, what)
    return value


def positive(owner: str, name: str, value: Any, unit: str = "s") -> float:
    """Return a positive finite number as float, else raise `ParameterError`."""
    value = _of(unit).check(owner, name, value)
    if value <= 0.0:
        raise refused(owner, name, value, f"larger than 0 {unit}", unit)
    return value


@functools.cache
def _of(unit: str) -> Param:
    return Param(unit=unit)


def declared(f: Callable) -> tuple[tuple, dict, dict, dict, Any]:
    """Signals, parameters, kinds, defaults and output metadata of the plain function `f`.

    Arguments without a default are signals, those with one are parameters; the return annotation,
    where there is one, is a `Param` or a (nested) tuple of them.
    """
    signature = inspect.signature(f, eval_str=True)
    signals, params, kinds, values = [], {}, {}, {}
    for name, a in signature.parameters.items():
        if a.default is a.empty:
            signals.append(name)
            continue
        meta = _meta(a.annotation)
        params[name] = meta if isinstance(meta, Param) else Param()
        kind = a.annotation.__origin__ if hasattr(a.annotation, "__metadata__") else a.annotation
        if kind not in (int, bool, float) and get_origin(kind) is not Literal:
            kind = bool if isinstance(a.default, bool) else float
        kinds[name] = kind
        values[name] = checked(f.__name__, name, params[name], a.default, kind)
    return tuple(signals), params, kinds, values, _meta(signature.return_annotation)


def _meta(annotation):
    """Metadata of an annotation, ``Annotated[float, Param(...)]`` or a tuple of these, or None."""
    if isinstance(annotation, tuple) or get_origin(annotation) is tuple:
        parts = annotation if isinstance(annotation, tuple) else get_args(annotation)
        return tuple(map(_meta, parts))
    found = annotation, *getattr(annotation, "__metadata__", ())
    return next((m for m in found if isinstance(m, Param)), None)


def several(owner: str, name: str, values: Any) -> tuple:
    """The items of any sequence but a text, as a tuple, else `ParameterError`."""
    if isinstance(values, (str, bytes)) or not np.iterable(values):
        raise refused(owner, name, values, "a sequence of numbers")
    return tuple(values)


def unknown(owner: str, name: str, known: Iterable[str],
            inside: Iterable[str] = ()) -> ParameterError:
    """The error for a name that `owner` does not have; `inside` are names that reach into parts."""
    known, inside = [*known], [*inside]
    near = [n for n in inside if n.endswith(f"__{name}")][:3]
    near = near or difflib.get_close_matches(name, [*known, *inside], 1)
    return ParameterError(f"{owner} has no {said(name)}"
                          + (f"; did you mean {' or '.join(map(said, near))}?" if near else ".")
                          + f" It has: {listed(known, 'nothing to set')}")
