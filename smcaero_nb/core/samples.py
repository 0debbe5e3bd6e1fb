"""Samples given by a user: the one place where arrays of foreign kinds become arrays of float."""

import numpy as np

from .param import ParameterError, real, said

__all__ = ["finite", "numbers", "record"]

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
