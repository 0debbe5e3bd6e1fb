"""Which steps of a record are even, and which are gaps."""

import numpy as np

__all__ = ["EVEN", "gap"]

GAP = 10.0  # times the step that nine of ten do not exceed; a longer one is a gap
EVEN = 0.01  # of the mean step; steps that differ by less are taken as equal


def gap(t):
    """Length from which a step is a gap, from about ten thousand of the steps."""
    stride = max(1, len(t)//10_000)
    with np.errstate(over="ignore"):
        return GAP*float(np.quantile(t[1::stride] - t[:-1:stride], 0.9, method="lower"))
