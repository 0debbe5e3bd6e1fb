"""A differentiator tried on a signal, as a function of its numbers, for a mask."""

import io
import math
import warnings
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np

from ..core import Block, Param, ParameterError, block
from ..core.param import refused
from ..records import record
from .differentiate import differentiate
from .differentiator import LOW, per
from .lipschitz import lipschitz

__all__ = ["Trial", "trial"]

FACTORS = (4.0, 2.0, 1.0, 0.5, 0.25)  # times tau: sampling steps of the accuracy
LEAST, MOST = 100, 500_000  # samples of a trial
GUESS = 2.0  # of L, to start with
EXACT = 1e-14  # of the signal; less is rounding

Order = Annotated[int, Param("n_d", low=0, high=12, help="highest derivative estimated")]
Filter = Annotated[int, Param("n_f", low=0, high=12, slider=(0, 6), help="order of the filter")]
Method = Annotated[Literal["levant", "implicit", "matching", "euler"],
                   Param("method", help="how a step is made")]
Bound = Annotated[float, Param("L", "[f]/s^n", low=LOW, log=True, slider=(1e-2, 1e4),
                               help="bound of the derivative n, n_d + 1")]
Found = Annotated[bool, Param("find L", help="estimate the bound from the samples")]
Sine = Annotated[float, Param("a_1", "[f]", slider=(0.0, 5.0), help="size of the sine")]
Cosine = Annotated[float, Param("a_2", "[f]", slider=(0.0, 5.0), help="size of the cosine")]
Omega1 = Annotated[float, Param(r"\omega_1", "rad/s", low=0.0, high=1e4, slider=(0.0, 5.0))]
Omega2 = Annotated[float, Param(r"\omega_2", "rad/s", low=0.0, high=1e4, slider=(0.0, 5.0))]
Noise = Annotated[Literal["white", "tone"], Param("noise", help="uniform, or a fast cosine")]
Eps = Annotated[float, Param(r"\varepsilon", "[f]", low=0.0, slider=(0.0, 0.5),
                             help="size of the noise")]
Tone = Annotated[float, Param(r"\omega_n", "rad/s", low=0.0, slider=(10.0, 2000.0),
                              help="frequency of the tone")]
Tau = Annotated[float, Param(r"\tau", "s", low=1e-6, log=True, slider=(5e-4, 0.1),
                             help="sampling step")]
Jitter = Annotated[float, Param("jitter", low=0.0, high=0.9,
                                help="of the times, as a share of tau")]
Duration = Annotated[float, Param("T", "s", low=0.1, high=1000.0, slider=(5.0, 50.0))]


@dataclass(frozen=True, eq=False)
class Trial:
    r"""Estimates beside the truth; made by calling a `trial`.

    Attributes
    ----------
    t, f : ndarray, shape (N,)
        Times [s] and samples.
    estimates : ndarray, shape (n_d + 1, N)
        z_0, z_1, ...
    truth : ndarray, shape (n_d + 1, N), or None
        The signal without noise, and its derivatives; None of a record.
    L : float
        The bound used.
    tau : ndarray
        Sampling steps at which the accuracy was measured [s]; of a record, NaN.
    sizes : ndarray, shape (n_d + 1, len(tau))
        Maximum of \|z_i - f^(i)\| over the second half; of a record, NaN.
    """

    t: np.ndarray
    f: np.ndarray
    estimates: np.ndarray
    truth: np.ndarray | None
    L: float
    tau: np.ndarray
    sizes: np.ndarray

    @property
    def slopes(self) -> tuple[float, ...]:
        """Slope of each size over tau, both logarithmic; NaN without truth or without error."""
        good = self.sizes > EXACT*np.abs(self.f).max()
        return tuple(float(np.polyfit(np.log(self.tau[m]), np.log(s[m]), 1)[0]) if m.sum() > 3
                     else math.nan
                     for s, m in zip(self.sizes, good, strict=True))

    @property
    def errors(self) -> np.ndarray:
        r"""Maximum of \|z_i - f^(i)\| over the second half, at the trial's sampling step."""
        return self.sizes[:, np.argmin(np.abs(np.array(FACTORS) - 1.0))]

    def to_csv(self) -> str:
        """The times, samples and estimates as the text of a CSV file."""
        head = ["t [s]", "f", *(f"z_{i} [{per('f', i)}]" for i in range(len(self.estimates)))]
        text = io.StringIO()
        digits = ["%.17g", *["%.10g"]*(len(head) - 1)]  # times since 1970 need them
        np.savetxt(text, np.column_stack([self.t, self.f, *self.estimates]), digits, ",",
                   header=",".join(head), comments="")
        return text.getvalue()

    def __str__(self) -> str:
        if self.truth is None:
            return f"{len(self.t)} samples, L = {self.L:.3g}"
        return f"L = {self.L:.3g}; maximum errors in the second half: " + ", ".join(
            f"|z_{i} - f^({i})| {e:.2g}" for i, e in enumerate(self.errors))


def _samples(signal):
    """Times and samples of a signal, checked."""
    try:
        t, f = signal[:2]
    except (TypeError, ValueError, LookupError):
        raise refused("differentiators.trial", "signal", signal,
                      "(t, f), or what read_csv gives") from None
    return record("differentiators.trial", t, f, "f")


def _estimated(t, f, L, found, how):
    """Estimates and the bound used: the one found, or L."""
    if found and L != GUESS:
        warnings.warn("L is chosen automatically, so the value you set is ignored; turn off 'find "
                      "L' to use it", UserWarning, stacklevel=3)
    used = lipschitz(t, f, how["n_d"]) if found else L
    return differentiate(t, f, "auto" if found else L, **how), used


def _of_record(t, f):
    """The trial of a record, whose derivatives are not known."""
    def differentiation(n_d: Order = 2, n_f: Filter = 0, method: Method = "levant",
                        found: Found = True, L: Bound = GUESS):
        z, L = _estimated(t, f, L, found, dict(n_d=n_d, n_f=n_f, method=method))
        nothing = np.full((n_d + 1, len(FACTORS)), math.nan)
        return Trial(t, f, z, None, L, nothing[0], nothing)

    return differentiation


def _of_tones():
    """The trial of two tones in noise, whose derivatives are known."""
    def differentiation(n_d: Order = 2, n_f: Filter = 0, method: Method = "levant",
                        L: Bound = GUESS, found: Found = False, a_1: Sine = 1.0,
                        omega_1: Omega1 = 1.0,
                        a_2: Cosine = 0.5, omega_2: Omega2 = 0.5, noise: Noise = "white",
                        eps: Eps = 0.0, omega_n: Tone = 1000.0, tau: Tau = 1e-2,
                        jitter: Jitter = 0.0, duration: Duration = 20.0):
        if not LEAST <= duration/tau <= MOST:
            raise ParameterError(f"differentiators.trial: tau = {tau:g} s is not allowed; with T = "
                                 f"{duration:g} s it must be from {duration/MOST:.3g} to "
                                 f"{duration/LEAST:.3g} s ({MOST} to {LEAST} samples)")
        reached = abs(a_1)*omega_1**(n_d + 1) + abs(a_2)*omega_2**(n_d + 1)
        if not found and L < reached:
            warnings.warn(f"L = {L:g} is less than the {reached:.3g} that derivative {n_d + 1} of "
                          "f may reach: the theorem does not cover this", UserWarning, stacklevel=2)
        rng, how = np.random.default_rng(0), dict(n_d=n_d, n_f=n_f, method=method)
        made, sizes = [], []
        powers = np.arange(n_d + 1)[:, None]
        shift = 0.5*math.pi*powers
        for factor in FACTORS:
            n = round(duration/(factor*tau)) + 1
            t = factor*tau*(np.arange(n) + 0.5*jitter*rng.uniform(-1.0, 1.0, n))
            truth = (a_1*omega_1**powers*np.sin(omega_1*t + shift)
                     + a_2*omega_2**powers*np.cos(omega_2*t + shift))
            white = noise == "white"
            f = truth[0] + eps*(rng.uniform(-1.0, 1.0, len(t)) if white else np.cos(omega_n*t))
            z, used = _estimated(t, f, L, found, how)
            sizes.append(np.abs(z - truth)[:, len(t)//2:].max(1))
            made.append((t, f, z, truth, used))
        t, f, z, truth, used = made[FACTORS.index(1.0)]
        return Trial(t, f, z, truth, used, tau*np.array(FACTORS), np.array(sizes).T)

    return differentiation


def trial(signal: Any = None) -> Block:
    r"""A differentiator at work, as a function of its numbers.

    ``ui.live(trial())`` shows it with a mask.

    .. math:: f(t) = a_1 \sin\omega_1 t + a_2 \cos\omega_2 t + \text{noise}

    Parameters
    ----------
    signal : Signal or (t, f), optional
        A record to differentiate instead [s], [f]; its derivatives are not known, so there are no
        errors.

    Returns
    -------
    Block
        Without signals; called, it gives a `Trial`.

    Raises
    ------
    ParameterError
        A record that `differentiate` would refuse. When it is called: what `differentiate` raises;
        fewer than 100 or more than 500 000 samples.

    Warns
    -----
    UserWarning
        When it is called: an L below the bound of the signal; and as `differentiate`.

    Notes
    -----
    With four other sampling steps, 4, 2, 1/2 and 1/4 of the chosen one, the accuracy is measured:
    without noise the slopes are n_d + 1, n_d, ..., 1 if the method keeps the order (`implicit`: z_0
    exact). The noise is seeded. Not in the paper.

    Examples
    --------
    >>> [round(s) for s in trial().with_(n_d=1, eps=0.0)().slopes]
    [2, 1]
    """
    differentiation = _of_tones() if signal is None else _of_record(*_samples(signal))
    differentiation.__doc__ = differentiate.__doc__
    return block(differentiation)
