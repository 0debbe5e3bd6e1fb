"""Recorded signals, read from text files."""

from typing import Any, NamedTuple

import numpy as np

from ..records import Table

__all__ = ["Signal", "read_csv"]


class Signal(NamedTuple):
    """Recorded signal: times `t` [s], samples `f`, its `name`, and `about`, its origin in words.

    Made by `read_csv`.
    """

    t: np.ndarray
    f: np.ndarray
    name: str
    about: str


def read_csv(path: Any, t: str | None = None, f: str | None = None) -> Signal:
    """Read a sampled signal from a text file.

    Parameters
    ----------
    path : str, path or open file
        As in `prd.read_csv`.
    t, f : str, optional
        Names of the columns of time and signal; default: the first two.

    Returns
    -------
    Signal
        ``trial(read_csv(path))`` tries differentiators on it.

    Raises
    ------
    ParameterError
        A file that cannot be read; a field that is not a finite number, a line with a field too few
        or too many, times that do not increase, by line and column; a column that is not there.

    Notes
    -----
    Not in the paper.
    """
    table = Table("differentiators.read_csv", path)
    t, f = table.chosen(t, f)
    return Signal(table.times(t), table.column("f", f)[0], table.name, table.about(t=t, f=f))
