"""Recorded step responses, checked when they are made, and their reader."""

import math
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np

from ..core import Param, ParameterError
from ..core.param import listed, texted
from ..records import Table, record

__all__ = ["Record", "read_csv"]

BEFORE = 20  # samples before the step, at least
AFTER = 53  # samples after it: 1.25 of the shortest window, 50, and what rounding may take
# of the range of an input, and times its median change, by which it changes at once where it steps
EDGE, USUAL = 0.05, 8.0
JITTER = 0.1  # of a sampling step, by which a time may miss the even grid


def refuse(name: str, said: str) -> NoReturn:
    """Raise the error for a part of a record."""
    raise ParameterError(f"prd.Record: {name} {said}")


@dataclass(frozen=True, eq=False)
class Record:
    """Measured response of one output to a step of one input.

    Parameters
    ----------
    t : array_like
        Times [s], evenly spaced to a tenth of a sampling step.
    y : array_like
        The output [y], at rest before the step.
    step_time : float
        Time at which the input steps [s].
    amplitude : float
        Height of that step [u], not 0.
    until : float
        End of what may be used [s]: where the input changes again; at most the end of the record.
    name : str
        For titles.
    about : str
        Its origin, in words.

    Raises
    ------
    ParameterError
        If the shapes do not fit, samples are not real finite numbers (but masked, complex, dates,
        text, switches), times do not increase or are uneven, or the step lies outside the record,
        or with fewer than 20 samples before it or 53 after it.

    Notes
    -----
    `h` is the sampling step [s], `start` the index of the first sample at or after the step. Not in
    the paper.
    """

    t: np.ndarray
    y: np.ndarray
    step_time: float
    amplitude: float = 1.0
    until: float = math.inf
    name: str = "record"
    about: str = ""

    def __post_init__(self) -> None:
        for n, q in zip("ty", record("prd.Record", self.t, self.y), strict=True):
            object.__setattr__(self, n, q)
        t, n = self.t, len(self.t)
        if n < BEFORE + AFTER:
            refuse("t", f"has {n} values; there must be at least {BEFORE} before the step and "
                        f"{AFTER} after it")
        off = np.abs(t - np.linspace(t[0], t[-1], n))
        if off.max() > JITTER*self.h:
            k = np.argmax(np.abs(np.diff(t) - np.median(np.diff(t)))) + 1
            refuse(f"t[{k}]",
                   f"= {t[k]:.10g} s comes {t[k] - t[k - 1]:.4g} s after the sample before, the "
                   f"median step being {np.median(np.diff(t)):.4g} s; times must be evenly spaced "
                   "(resample the record)")
        if isinstance(self.until, float) and self.until == math.inf:
            object.__setattr__(self, "until", t[-1])
        for name in ("name", "about"):
            texted("prd.Record", name, getattr(self, name))
        for name, unit in (("step_time", "s"), ("amplitude", "[u]"), ("until", "s")):
            object.__setattr__(self, name,
                               Param(unit=unit).check("prd.Record", name, getattr(self, name)))
        if self.amplitude == 0.0:
            refuse("amplitude", "= 0 [u] is not allowed; without a step there is no response")
        if not t[0] < self.step_time < t[-1]:
            refuse("step_time",
                   f"= {self.step_time:g} s is not allowed; it must be inside the record, {t[0]:g} "
                   f"to {t[-1]:g} s")
        object.__setattr__(self, "until", min(self.until, t[-1]))
        before, after = self.start, int((t[self.start:] <= self.until).sum())
        if before < BEFORE:
            refuse("step_time",
                   f"= {self.step_time:g} s leaves {before} samples before the step; at least "
                   f"{BEFORE} are needed, at rest, to know the equilibrium and the noise")
        if after < AFTER:
            refuse("until",
                   f"= {self.until:g} s leaves {after} samples after the step; at least {AFTER} "
                   "are needed")

    h = property(lambda self: (self.t[-1] - self.t[0])/(len(self.t) - 1))
    start = property(lambda self: int(np.searchsorted(self.t, self.step_time - 1e-6*self.h)))

    def __str__(self) -> str:
        return self.about or (f"{self.name}: {len(self.t)} samples, every {self.h:.6g} s, from "
                              f"{self.t[0]:g} to {self.t[-1]:g} s; step of {self.amplitude:g} at "
                              f"{self.step_time:g} s")


def _step(table: Table, u: str, t: np.ndarray, step_time: Any,
          amplitude: Any) -> tuple[float, float, float]:
    """Return when the input steps and how high, unless given, and when it changes again."""
    values, _ = table.column("u", u)
    change, least = np.abs(np.diff(values)), EDGE*np.ptp(values)
    jumps = np.flatnonzero(change > max(least, USUAL*np.median(change))) + 1
    first = jumps[np.diff(jumps, prepend=-9) > 1]  # an edge may take several samples
    if not len(first) and (step_time is None or amplitude is None):
        table.refuse(f"the input '{u}' never steps: from sample to sample it changes by less than "
                     f"{EDGE:.0%} of its range, or than {USUAL:g} times its median change")
    near = 1.5*np.median(np.diff(t))
    here = first[t[first] >= (-math.inf if step_time is None else step_time - near)]
    if step_time is None or amplitude is None:
        if not len(here) or step_time is not None and t[here[0]] > step_time + near:
            steps = ", ".join(f"{q:g}" for q in t[first[:4]])
            table.refuse(f"the input '{u}' does not step at step_time = {step_time:g} s, but at "
                         f"{steps} s; give the amplitude as well")
        end = here[1] if len(here) > 1 else len(values)
        height = float(np.median(values[here[0]:end]) - np.median(values[:here[0]]))
        if abs(height) <= least:
            table.refuse(f"the input '{u}' changes at {t[here[0]]:g} s, but not to stay: its "
                         f"medians before and after differ by {height:.3g}, less than {EDGE:.0%} "
                         "of its range; give step_time and amplitude")
        amplitude = height if amplitude is None else amplitude
    step_time = t[here[0]] if step_time is None else step_time
    later = here[t[here] > step_time + near]
    return step_time, amplitude, float(t[later[0]]) if len(later) else math.inf


def read_csv(path: Any, t: str | None = None, y: str | None = None, u: str | None = None, *,
             step_time: float | None = None, amplitude: float | None = None) -> Record:
    """Read the record of a step response from a text file.

    Parameters
    ----------
    path : str, path or open file
        Lines of numbers, separated by commas, semicolons, tabs or blanks, under a line of names;
        lines that begin with ``#`` or ``%`` are skipped. A unit follows the name in brackets:
        ``time [ms]``, ``theta (rad)``.
    t, y, u : str, optional
        Names of the columns of time, output and input. Default: the first, the second, and the
        remaining one of three; with ``u=""`` there is no input.
    step_time, amplitude : float, optional
        When the input steps [s], and how high [u]. Default: found in the column `u`, where a
        change from one sample to the next by more than 5 % of its range and more than 8 times its
        median change begins an edge.

    Returns
    -------
    Record
        ``print(record)`` shows which delimiter, columns and units were found. Times in ms, us, min
        or h are converted to s; a second change of the input ends the part that is used
        (`Record.until`).

    Raises
    ------
    ParameterError
        If the file cannot be read, a field is not a finite number, a line has too few or too many
        fields (named by line and column), a column does not exist or is used twice, the input does
        not step or has a spike before, or `Record` refuses the result.

    Notes
    -----
    Unless commas separate the fields, a comma in a number is its decimal point. If some numbers
    have commas and others points, one that may have a separator of thousands is refused, such as
    1.234 beside 0,5. Not in the paper.
    """
    for what, n in (("t", t), ("y", y), ("u", u)):
        if n is not None:
            texted("prd.read_csv", what, n)
    table = Table("prd.read_csv", path)
    if len(table.names) > 3 and (t is None or y is None):
        table.refuse(f"there are {len(table.names)} columns ({listed(table.names)}): say which are "
                     "t and y, and u where there is an input")
    t, y = table.chosen(t, y)
    if u is None and len(table.names) == 3:
        u = next((n for n in table.names if n not in (t, y)), None)
    for name, value, unit in (("step_time", step_time, "s"), ("amplitude", amplitude, "[u]")):
        if value is not None:
            Param(unit=unit).check("prd.read_csv", name, value)
    step_time, amplitude = (v if v is None else float(v) for v in (step_time, amplitude))
    seconds, (output, _), until = table.times(t), table.column("y", y), math.inf
    if u:
        step_time, amplitude, until = _step(table, u, seconds, step_time, amplitude)
    elif step_time is None:
        table.refuse("there is no column of the input: give step_time [s]")
    amplitude = 1.0 if amplitude is None else amplitude
    about = f"{table.about(t=t, y=y, u=u)}; step of {amplitude:g} at {step_time:g} s"
    return Record(seconds, output, step_time, amplitude, until, table.name, about)
