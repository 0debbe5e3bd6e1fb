"""What `differentiate` and `lipschitz` ask of a record."""

import numpy as np

from ..core import ParameterError

__all__ = ["EVEN", "gap", "record", "refuse"]

GAP = 10.0  # times the step that nine of ten do not exceed; a longer one is a gap
EVEN = 0.01  # of the mean step; steps that differ by less are taken as equal


def record(owner, t, f):
    """The record as two arrays of float."""
    if wrong := [n for n, q in (("t", t), ("f", f)) if np.ma.is_masked(q) or getattr(q, "dtype", np.dtype(float)).kind in "mM"]:
        raise ParameterError(f"{owner}: {wrong[0]} is masked, or dates; it must be numbers, t in seconds from some time on")
    try:
        t, f = (np.ascontiguousarray(q, dtype=float) for q in (t, f))
    except (TypeError, ValueError) as why:
        raise ParameterError(f"{owner}: t and f must be arrays of real numbers: {why}") from None
    if t.ndim != 1 or t.shape != f.shape or len(t) < 2:
        raise ParameterError(f"{owner}: t and f must be two sequences of the same length, 2 or more; "
                             f"they have the shapes {t.shape} and {f.shape}")
    return t, f


def refuse(owner, t, f):
    """Raise `ParameterError` if times do not increase or samples are no numbers."""
    if len(bad := np.flatnonzero(~np.isfinite(f))):
        raise ParameterError(f"{owner}: f[{bad[0]}] = {f[bad[0]]} at t = {t[bad[0]]:g} s, the first of {len(bad)} samples "
                             "that are no finite numbers; drop them and their times")
    steps = np.diff(t)
    if len(bad := np.flatnonzero(~((steps > 0.0) & (steps < np.inf)))):
        raise ParameterError(f"{owner}: t must increase from sample to sample, but t[{bad[0]}] = {t[bad[0]]:g} s and "
                             f"t[{bad[0] + 1}] = {t[bad[0] + 1]:g} s")


def gap(t):
    """Length from which a step is a gap, from about ten thousand of the steps."""
    stride = max(1, len(t)//10_000)
    return GAP*float(np.quantile(t[1::stride] - t[:-1:stride], 0.9, method="lower"))
