"""Results of an identification: the answer, its time scale, and the evidence."""

from dataclasses import dataclass

import numpy as np

from ..core.zeros import named
from .analyser import HEARD, Analysis
from .power_law import PowerLaw

__all__ = ["PRDResult", "PRDSweep", "VectorPRD"]


SLOW = 1e-3  # of a zero: a real part that only the full account names


@dataclass(frozen=True, eq=False)
class PRDResult:
    r"""Practical relative degree of one input and output, with its evidence.

    Made by `identify`.

    Attributes
    ----------
    prd : int or None
        The answer: that of both methods, or of the one that is trusted (see `identify`); None
        where neither can tell.
    confirmed : bool
        Both methods agree.
    time_scale : float
        The window [s]: what happens within it counts as instantaneous, and the answer holds for
        designs no faster than it.
    alpha : float
        The paper's parameter of the analyser.
    analyser : Analysis
        Evidence of the paper's method.
    power : PowerLaw
        Evidence of the power law.
    gain : float
        Step of the derivative of that order per unit of input, the high-frequency gain; NaN without
        an answer.
    noise_floor : float
        Noise of the record relative to the maximum response in the window.
    reason : str
        Why there is no answer, or why it is not confirmed; empty where it is.
    t, y : ndarray
        What was used of the record [s], [y]; `analyser.derivatives` and `analyser.jump_times`
        belong to it.
    step_time, amplitude : float
        The step [s], [u].
    name : str
        Of the record or plant.
    zeros : tuple of complex
        Zeros of a model in the right half plane, one of each pair [1/s]: as fast as they say, the
        other states grow while y is held at zero. A record does not show them.
    """

    prd: int | None
    confirmed: bool
    time_scale: float
    alpha: float
    analyser: Analysis
    power: PowerLaw
    gain: float
    noise_floor: float
    reason: str
    t: np.ndarray
    y: np.ndarray
    step_time: float
    amplitude: float
    name: str
    zeros: tuple[complex, ...] = ()

    def __str__(self) -> str:
        if self.prd is None:
            return f"The PRD is unresolved: {self.reason}"
        doubt = "" if self.confirmed else f" (not confirmed: {self.reason})"
        return f"The experimentally determined PRD is equal to {self.prd}{doubt}{_fast(self.zeros)}"

    def explain(self) -> str:
        """Describe the answer and the evidence of both methods."""
        a, b, r = self.analyser, self.power, self.prd
        lines = [f"{self.name}: {self}.",
                 f"Time scale: {self.time_scale:.4g} s. What the plant does within it counts as "
                 "instantaneous; another time scale may have another answer."]
        if a.jumps:
            share = ", ".join(f"y^({k}) {q:.0%}" for k, q in enumerate(a.jumps, 1))
            lines.append(f"Performance analyser, alpha = {self.alpha:g}: within the window the "
                         f"derivatives cover these shares of their excursions: {share}; the "
                         f"first with {1 - self.alpha:.0%} or more is the step.")
        if a.prd:
            k = a.prd
            before = "y" if k == 1 else f"y^({k - 1})"
            lines.append(f"y^({k}) steps at {a.jump_times[k - 1]:.5g} s, and {before} changes its "
                         f"slope there: in the first half of the window it is {a.bends[k - 1]:.2f} "
                         "of that in the second. Its noise before the step is "
                         f"{a.noise[k - 1]:.2g} of the step (allowed: {HEARD:g}).")
        elif a.reason:
            lines.append(f"The analyser gives no answer: {a.reason}.")
        if b.slope == b.slope:
            lines.append(f"Power law: y grows as t^{b.slope:.2f} from {b.octave[0]:.4g} to "
                         f"{b.octave[1]:.4g} s after the step, extrapolated to the step as "
                         f"t^{b.onset:.2f}.")
        if b.reason:
            lines.append(f"The power law gives no answer: {b.reason}.")
        elif r and a.prd not in (None, r):
            lines.append("The power law is trusted: extrapolated to the step, its slope is a "
                         "whole number.")
        if r:
            lines.append(f"High-frequency gain: y^({r}) steps by {self.gain:.4g} per unit of "
                         "input.")
        if self.zeros:
            lines.append(_grows(self.zeros))
        return "\n".join([*lines, f"Noise: {self.noise_floor:.2g} of the maximum response in the "
                                  "window."])


def _fast(zeros: tuple[complex, ...]) -> str:
    """The zeros in the right half plane, in short, if they grow within a few swings."""
    fast = tuple(q for q in zeros if q.real > SLOW*abs(q))
    return f"; {named(fast)} in the right half plane" if fast else ""


def _grows(zeros: tuple[complex, ...]) -> str:
    """What zeros in the right half plane do, in words."""
    return (f"The plant has {named(zeros)} in the right half plane: while the output is held at "
            f"zero, as in sliding mode, its other states grow as exp({zeros[0].real:.3g} t).")


@dataclass(frozen=True, eq=False)
class VectorPRD:
    """Practical relative degrees of a plant with several inputs or outputs; made by `identify`.

    Attributes
    ----------
    results : list of lists of PRDResult
        One row per output, one column per input.
    prd : tuple of int or None
        The vector relative degree: of each output, the lowest over the inputs; None where an input
        that acts on it cannot be told.
    confirmed : bool
        All entries that decide it are confirmed, and the matrix of their gains is regular.
    time_scale : float
        The window [s].
    reason : str
        Why it is not confirmed; empty where it is.
    zeros : tuple of complex
        Zeros of the model in the right half plane, as in `PRDResult`; empty, too, where it has no
        vector relative degree.
    """

    results: list
    prd: tuple
    confirmed: bool
    time_scale: float
    reason: str
    zeros: tuple[complex, ...] = ()

    def __str__(self) -> str:
        if not any(self.prd):
            return f"The vector PRD is unresolved: {self.reason}"
        said = ", ".join("-" if r is None else str(r) for r in self.prd)
        doubt = "" if self.confirmed else f" (not confirmed: {self.reason})"
        return (f"The experimentally determined vector PRD is equal to [{said}]{doubt}"
                f"{_fast(self.zeros)}")

    def explain(self) -> str:
        """Describe the answer and each entry."""
        return "\n\n".join([str(self) + ".", *(q.explain() for row in self.results for q in row),
                            *([_grows(self.zeros)] if self.zeros else [])])


@dataclass(frozen=True, eq=False)
class PRDSweep:
    """Practical relative degree against the time scale; made by `sweep`.

    Attributes
    ----------
    windows : tuple of float
        Time scales [s].
    results : tuple of PRDResult or VectorPRD
        One per window.
    """

    windows: tuple
    results: tuple

    prd = property(lambda self: tuple(q.prd for q in self.results))

    def __str__(self) -> str:
        said = [str(q).replace("None", "-") for q in self.prd]
        n = max(map(len, ["PRD", *said]))
        return "\n".join([f"window [s]   {'PRD':<{n}}   confirmed", *(
            f"{w:10.4g}   {r:<{n}}   {'yes' if q.confirmed else 'no'}" for w, r,
            q in zip(self.windows, said, self.results,
                  strict=True))])
