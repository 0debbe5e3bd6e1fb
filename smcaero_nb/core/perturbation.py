"""The perturbation that a law faces, found from what a run records."""

from typing import TYPE_CHECKING, Any

import numpy as np

from .block import Block
from .rows import evaluated
from .signal import flat

if TYPE_CHECKING:
    from .run import Run

__all__ = ["UNFIT", "degree", "jumps", "laws", "perturbation", "slope", "true_sigma"]

# Where derivatives are estimated, 1/SIDE of the rows on either side of one count, but FEW samples
# at least: what other channels chatter from sample to sample is no perturbation.
SIDE, FEW = 200, 4
UNFIT = "v does not match sigma"
FEWEST = 20  # rows to differentiate
SURE = 6.0  # standard deviations of an estimated xi
MOST = 6  # differences that sigma may be made of, and one
JUMP = 8.0  # times as far as its neighbours, and a step is a jump of the command


def laws(run: "Run") -> list[tuple[Block, Any, Any, Any]]:
    """Return (block, sigma, v, integral of v) of the law, channel by channel."""
    return _channels(run.loop.stages["law"], run.sigma, run.v, run.integral_v)


def _channels(law: Any, sigma: Any, v: Any, integral: Any) -> list[tuple[Block, Any, Any, Any]]:
    if not hasattr(law, "parts"):
        return [(law, sigma, v, integral)]
    return list(zip(law.parts.values(), sigma, v, integral, strict=True))


def degree(b: Block, sigma: Any, v: Any) -> int:
    """Return the relative degree that a law is for."""
    return b.r or (1 if isinstance(v, tuple) else len(flat(sigma)))


def perturbation(run: "Run") -> tuple[Any, str, list[float]]:
    r"""Return the perturbation that the law faces, xi = sigma^(r) + v, or why there is none.

    The third is what it is uncertain by, channel by channel: 0 where nothing is estimated.

    Between rows it is averaged. Where the control sees estimates or a sensor, sigma is made of the
    true error instead, its missing derivatives being differences of recorded rows, and xi is the
    slope of sigma^(r-1) + int v over 1 % of the rows: what a differentiator or noise adds to sigma
    moves nothing. The slope is taken, too, where sigma^(r-1) is a difference of samples.
    """
    stages = run.loop.stages
    if stages["law"] is None:
        return None, "", []
    if len(run.t) < 3:
        return None, "the run has fewer than three rows", []
    sigma, why = run._true
    if why:
        return None, why, []
    seen, mean, found, errors = sigma is not run.sigma, _averaged(run), [], []
    e = run.e_hat
    nested = isinstance(e, tuple) and isinstance(e[0], tuple)
    for c, (b, s, w, integral) in enumerate(
            _channels(stages["law"], sigma, run.v, run.integral_v)):
        parts, r = flat(s), degree(b, s, w)
        many = isinstance(w, tuple)
        if many and len(parts) != len(flat(w)) or not many and len(parts) < r:
            return None, UNFIT, []
        s, w, integral = ((parts, w, integral) if many else ([parts[r - 1]], [w], [integral]))
        differs = not many and r > len(flat(e[c] if nested else e))
        if seen or differs and len(run.t) >= FEWEST:
            made = [_sloped(run, r, *q) for q in zip(s, w, integral, strict=True)]
            xi, unsure = tuple(q for q, _ in made), max(q for _, q in made)
        elif mean is None:
            return None, "the run has fewer than two samples", []
        else:
            xi, unsure = tuple(mean(*q) for q in zip(s, integral, strict=True)), 0.0
        found.append(xi if many else xi[0])
        errors.append(unsure)
    return (tuple(found) if hasattr(stages["law"], "parts") else found[0]), "", errors


def _averaged(run: "Run") -> Any:
    """A function of sigma^(r-1) and int v: the mean of xi since the row before."""
    sample = np.floor(run.t/run.tau + 1e-6)
    kept = np.flatnonzero(np.diff(sample, prepend=-1.0) > 0)  # rows with a sample of their own
    row = np.searchsorted(kept, np.arange(len(run.t)), "right") - 1
    if len(kept) < 2:
        return None
    step = np.diff(sample[kept])*run.tau

    def mean(s, integral):
        xi = (np.diff(s[kept]) + np.diff(integral[kept]))/step
        return np.append(xi[0], xi)[row]

    return mean


# ---- estimates -----------------------------------------------------------------------------------
def slope(t: np.ndarray, q: np.ndarray, tau: float, times: float = 1.0) -> np.ndarray:
    """Return the slope of a recorded quantity, fitted to the rows around each; held at the ends."""
    steps = np.diff(t[:-1])  # the last row may come early
    if len(steps) and steps.max() > 1.01*steps.min():
        even = np.linspace(t[0], t[-1], len(t))
        return np.interp(t, even, slope(even, np.interp(even, t, q), tau, times))
    n = len(t) - 1
    step = (t[n - 1] - t[0])/(n - 1)
    side = _side(n, tau/step, times)
    k = np.arange(-side, side + 1.0)
    inner = np.convolve(q[:n], -k/(k @ k*step), "valid")
    return np.concatenate([np.full(side, inner[0]), inner, np.full(side + 1, inner[-1])])


def _side(n: int, sample: float, times: float) -> int:
    """How many of n rows, of which so many make a sample, count on either side of one."""
    return min(max(4, round(times*n/SIDE), round(FEW*sample)), (n - 1)//2)


def jumps(steps: np.ndarray) -> np.ndarray:
    """Return which steps of a signal are jumps, much larger than their neighbours."""
    size = np.pad(np.abs(steps), 3, "edge")
    near = np.max([size[:-6], size[1:-5], size[5:-1], size[6:]], axis=0)
    return np.abs(steps) > JUMP*near + 1e-12*size.max()


def _smooth(steps: np.ndarray) -> np.ndarray:
    """Steps of a signal, those of a jump replaced by the ones before it."""
    jumped = jumps(steps)
    if not jumped.any():
        return steps
    kept = np.flatnonzero(~jumped)
    return np.interp(np.arange(len(steps)), kept, steps[kept]) if len(kept) else 0.0*steps


def _sloped(run: "Run", r: int, s: np.ndarray, v: np.ndarray,
            integral: np.ndarray) -> tuple[np.ndarray, float]:
    """Xi = (sigma^(r-1) + int v)', without the jumps of the command.

    Each difference of rows has averaged sigma over two of them: int v has to be averaged as often,
    which is found by what leaves the smoothest sum. What that keeps of the chattering, in the
    second half of the run, is the uncertainty.
    """
    sample = np.floor(run.t/run.tau + 1e-6)*run.tau
    pushed, best = integral + v*(run.t - sample), np.empty(0)
    for _ in range(MOST):
        total = _smooth(np.diff(s + pushed))
        if not len(best) or np.abs(np.diff(total)).sum() < np.abs(np.diff(best)).sum():
            best = total
        pushed = np.convolve(np.pad(pushed, 1, "edge"), (0.25, 0.5, 0.25), "valid")
    total, times = np.append(0.0, np.cumsum(best)), max(1.0, r/2)
    step = (run.t[-2] - run.t[0])/(len(total) - 2)
    side, late = _side(len(total) - 1, run.tau/step, times), total[len(total)//2:-1]
    width = min(2*side + 1, len(late))
    around = np.convolve(late, np.full(width, 1.0/width), "valid")
    ripple = late[width//2:width//2 + len(around)] - around
    return slope(run.t, total, run.tau, times), SURE*float(ripple.std())/(step*(2/3*side**3)**0.5)


def true_sigma(run: "Run") -> tuple[Any, str]:
    """Return sigma of the true error, where the control sees another one; or why there is none."""
    if not (run.loop.stages["differentiator"] or run.loop.stages["sensor"]):
        return run.sigma, ""
    if len(run.t) < FEWEST:
        return None, f"the run has fewer than {FEWEST} rows, too few to differentiate the error"
    try:
        return _true(run), ""
    except Exception as why:  # a surface is anybody's
        return None, f"sigma of the true error cannot be evaluated ({type(why).__name__}: {why})"


def _true(run: "Run") -> Any:
    """Sigma of the true error, with the memory of the surface as it was."""
    estimated, surface = run.e_hat, run.loop.stages["surface"]
    if isinstance(estimated, tuple) and isinstance(estimated[0], tuple):
        e = tuple(_derived(run, *q) for q in zip(run.e, run.y, estimated, strict=True))
    else:
        e = _derived(run, run.e, run.y, estimated)
    if surface is None:
        alike = zip(e, run.sigma, strict=True) if isinstance(run.sigma, tuple) else ()
        return tuple(q if isinstance(s, tuple) or not isinstance(q, tuple) else q[0]
                     for q, s in alike) or e
    return evaluated(run, "surface", {"e": e, "y": run.y})


def _derived(run: "Run", e: Any, y: Any, wanted: Any) -> Any:
    """An error with as many derivatives as `wanted`: measured, and differences beyond these."""
    known, outputs, count = flat(e), flat(y), len(flat(wanted))
    parts, rest = known[:count], known[-1]
    if count > len(known):
        y, r = outputs[-1], rest + outputs[-1]
        for _ in range(count - len(known)):
            y, r = np.gradient(y, run.t), _rate(run.t, r)
            parts.append(r - y)
    return tuple(parts) if isinstance(wanted, tuple) else parts[0]


def _rate(t: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Derivative of a command, that of a jump left out."""
    rates = _smooth(np.diff(r)/np.diff(t))
    return 0.5*(np.append(rates[:1], rates) + np.append(rates, rates[-1:]))
