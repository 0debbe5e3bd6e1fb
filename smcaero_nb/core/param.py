"""Parameters: metadata, declared once, and their validation."""

import difflib
import inspect
import math
import numbers
import sys
from dataclasses import dataclass
from typing import get_args

__all__ = ["Param", "ParameterError", "chosen", "declared", "positive", "unknown"]


class ParameterError(ValueError):
    """A parameter that does not exist, or a value that is not allowed; the message says what is."""


@dataclass(frozen=True)
class Param:
    """What a mask shows and what validation enforces of one number.

    Parameters
    ----------
    symbol : str
        LaTeX symbol, without dollars, of letters, accents, roman type and indices; any other text is
        shown as it stands; empty: the name in the code.
    unit : str
        Unit as text, ``"1"`` if dimensionless; ``"[sigma]"`` stands for the unit of a signal.
    low, high : float
        Hard bounds. Of a plant's state or of an output, they are also its limits: a run that leaves them has diverged.
    log : bool
        The slider is logarithmic.
    help : str
        One line for the mask.
    slider : tuple of two floats
        Range of the slider, where it is narrower than the bounds.
    samples : bool
        It is a time that the block counts in samples: `simulate` takes only multiples of its sampling step.
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

    def check(self, owner, name, value, kind=float):
        """Return `value` as `kind` (float, int, bool or a Literal) if it is allowed, else raise `ParameterError`."""
        if choices := get_args(kind):
            return chosen(owner, name, value, choices)
        if kind is bool:
            if isinstance(value, bool) or type(value).__name__ == "bool":
                return bool(value)
            raise ParameterError(f"{owner}: {name} = {value!r} is not allowed; it is a switch, True or False")
        good = isinstance(value, numbers.Real) and not isinstance(value, bool) and abs(value) <= sys.float_info.max
        if not (good and self.low <= value <= self.high and (kind is float or value == int(value))):
            raise ParameterError(f"{owner}: {name} = {_said(value, self.unit)} is not allowed; it must be {self.allowed(kind)}")
        return kind(value)

    def allowed(self, kind=float):
        """The admissible values, in words."""
        what = "a whole number" if kind is int else "a finite number"
        low, high = math.isfinite(self.low), math.isfinite(self.high)
        if low and high:
            what += f" from {self.low:g} to {self.high:g}"
        elif low or high:
            what += f", at least {self.low:g}" if low else f", at most {self.high:g}"
        return what + (f"{' ' if low or high else ', in '}{self.unit}" if self.unit != "1" else "")


def _said(value, unit):
    said = f"{value:g}" if isinstance(value, float) else repr(value)
    if isinstance(value, float) and float(said) != value:  # 1.0000001, not "1 is not allowed; it must be at most 1"
        said = repr(float(value))
    return said + (f" {unit}" if unit != "1" and isinstance(value, numbers.Real) else "")


def chosen(owner, name, value, allowed):
    """Return `value` if it is one of the texts `allowed`, else raise `ParameterError`."""
    if not (isinstance(value, str) and value in allowed):
        raise ParameterError(f"{owner}: {name} = {value!r} is not allowed; it must be one of {', '.join(map(repr, allowed))}")
    return value


def positive(owner, name, value, unit="s"):
    """Return a positive finite number as float, else raise `ParameterError`."""
    value = Param(unit=unit).check(owner, name, value)
    if value <= 0.0:
        raise ParameterError(f"{owner}: {name} = {_said(value, unit)} is not allowed; it must be larger than 0 {unit}")
    return value


def declared(f):
    """Signals, parameters, kinds, defaults and output metadata of the plain function `f`.

    Arguments without a default are signals, those with one are parameters; the return annotation, where there is
    one, is a `Param` or a (nested) tuple of them.
    """
    signature = inspect.signature(f, eval_str=True)
    signals, params, kinds, values = [], {}, {}, {}
    for name, a in signature.parameters.items():
        if a.default is a.empty:
            signals.append(name)
            continue
        params[name] = _meta(a.annotation) or Param()
        kind = a.annotation.__origin__ if hasattr(a.annotation, "__metadata__") else a.annotation
        kinds[name] = kind if kind in (int, bool, float) or get_args(kind) else bool if isinstance(a.default, bool) else float
        values[name] = params[name].check(f.__name__, name, a.default, kinds[name])
    return tuple(signals), params, kinds, values, _meta(signature.return_annotation)


def _meta(annotation):
    """The metadata in an annotation: ``Param(...)``, ``Annotated[float, Param(...)]``, or a tuple of these; else None."""
    if isinstance(annotation, tuple):
        return tuple(map(_meta, annotation))
    return next((m for m in (annotation, *getattr(annotation, "__metadata__", ())) if isinstance(m, Param)), None)


def unknown(owner, name, known):
    """The error for a name that `owner` does not have."""
    near = difflib.get_close_matches(name, known, 1)
    return ParameterError(f"{owner} has no '{name}'" + (f"; did you mean '{near[0]}'?" if near else ".")
                          + f" It has: {', '.join(known) or 'nothing to set'}")
