"""Phase planes: sigma' over sigma, and e' over e with the line on which sigma is zero."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..core import Param, Run
from ..core.chain import Chain
from ..core.leaves import at
from ..core.perturbation import degree, laws
from ..core.program import parts
from ..core.rows import evaluated, taken
from ..core.signal import flat

__all__ = ["ERRORS", "PHASE", "planes"]

PHASE, ERRORS = "phase portrait", "error plane"  # the rows whose abscissa is not time
POINTS = 101  # of the line sigma = 0

Plane = tuple[str, str, int, np.ndarray, np.ndarray, tuple[Param, Param]]


def planes(run: Run) -> Iterator[Plane]:
    """Yield row, key, channel, abscissa, ordinate and their metadata of each curve in a plane."""
    for c, (mark, x, y) in enumerate(_portraits(run)):
        about = Param(r"\dot\sigma"), Param(r"\sigma")
        yield PHASE, f"phase{mark}", c, *_drawn(run.t, x, y), about
    if run.loop.stages["surface"]:
        yield from _errors(run)


def _drawn(t, x, y):
    """A trajectory, x' = y, without the jumps of a command, which are no motion of the plant."""
    with np.errstate(invalid="ignore", over="ignore"):
        moved = 0.5*(y[1:] + y[:-1])*np.diff(t)
        jumps = np.append(False, np.abs(np.diff(x) - moved) > 0.02*np.ptp(x))
    return np.where(jumps, np.nan, x), np.where(jumps, np.nan, y)


def _portraits(run):
    """(mark, sigma, sigma') of each sliding variable; xi - v is sigma' if a law is of degree 1."""
    if run.xi is None:
        return
    many = hasattr(run.loop.stages["law"], "parts")
    xis = run.xi if many else (run.xi,)
    for c, ((b, sigma, v, _), xi) in enumerate(zip(laws(run), xis, strict=True)):
        s = flat(sigma)
        if isinstance(v, tuple):
            yield from ((f"[{i}]", q, _smooth(a) - w)
                        for i, (q, a, w) in enumerate(zip(s, xi, v, strict=True)))
        else:
            rate = s[1] if degree(b, sigma, v) > 1 else _smooth(xi) - v
            yield f"[{c}]"*many, s[0], rate


def _smooth(xi):
    """Remove single-row spikes: a step in the command makes sigma jump, the plant stays."""
    return np.median([np.append(xi[:1], xi[:-1]), xi, np.append(xi[1:], xi[-1:])], axis=0)


def _errors(run) -> Iterator[Plane]:
    """The error, its derivative and the sliding line of each channel of relative degree 2."""
    for signal in ("e", "e_hat"):
        found = run.leaves(signal) if signal == "e" or run.loop.stages["differentiator"] else ()
        pairs: dict[int, dict[int | None, Any]] = {}
        for q in found:
            pairs.setdefault(q.channel, {})[q.derivative] = q
        pairs = {c: q for c, q in pairs.items() if set(q) == {0, 1}}
        for c, pair in pairs.items():
            mark = f"[{c}]"*(len({q.channel for q in found}) > 1)
            (x, across), (y, meta) = ((at(getattr(run, signal), pair[i].path), pair[i].meta)
                                      for i in (0, 1))
            names = "e", r"\dot e"
            across, up = (Param(n, q.unit) for n, q in zip(names, (across, meta), strict=True))
            yield ERRORS, f"plane{mark}", c, *_drawn(run.t, x, y), (up, across)
            line = _line(run, signal, pair[0].path, len(pairs), x, y)
            if line:
                yield ERRORS, f"line{mark}", c, *line, (Param(r"\sigma\,=\,0", meta.unit), across)
        if pairs:
            return


def _line(run, signal, path, channels, x, y):
    """Where sigma is zero in the plane of e and e', with the memory of the end of the run."""
    surface = run.loop.stages["surface"]
    each = hasattr(surface, "parts") and not isinstance(surface, Chain)
    asked = {n for b in parts(surface) for n in b.signals}
    if asked - {"t", "e", "z", "tau"} or channels > 1 and not each:
        return None
    reach, last = float(np.max(np.abs(y))) or 1.0, np.full(POINTS, len(run.t) - 1)
    es = np.linspace(min(x.min(), 0.0), max(x.max(), 0.0), POINTS)

    def sigma(rate):
        e = es, np.full(POINTS, rate)
        if len(path) > 1:
            e = tuple(e if i == path[0] else q
                      for i, q in enumerate(taken(getattr(run, signal), last)))
        found = evaluated(run, "surface", {"e": e}, last)
        return flat(found[path[0]] if each else found)[0]

    try:
        at_0, at_1, at_2 = (sigma(k*reach) for k in (0.0, 1.0, 2.0))
    except (ArithmeticError, LookupError, TypeError, ValueError):
        return None  # not defined there, or it remembers what is not recorded
    slope = at_1 - at_0
    if not np.allclose(at_2 - at_1, slope, rtol=1e-6) or not np.all(slope):
        return None  # not linear in e'
    rates = -at_0/slope*reach
    rates[np.abs(rates) > 1.1*reach] = math.nan
    return es, rates
