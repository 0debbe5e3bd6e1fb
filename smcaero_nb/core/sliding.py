"""Whether a run slides: sigma at rest, the actuator within its limits, the gain settled."""

import itertools
import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .answer import answer, direct, gain, told
from .card import Law
from .leaves import at
from .param import Param
from .perturbation import degree, jumps, laws
from .program import parts
from .rows import evaluated, taken
from .signal import flat

if TYPE_CHECKING:
    from .block import Block
    from .run import Run

__all__ = ["Motion", "apart", "at_limit", "gains", "growing", "motions", "rows_of",
           "slides", "tail_rows"]

LAST = 0.2  # of the run: its tail, where `simulate` made none
SHORTEST, LONGEST = 0.1, 0.5  # of the run: the tail that is judged
CALM = 0.3  # of the tail, in which no command jumps: it alone is judged
SAMPLES, ESTIMATED = (5.0, 2.0), (3.0, 3.0)  # see `reaching_time`
FLOOR, ROUGH = 1e-5, 2e-3  # of the maximum |sigma|: that is zero; where it is estimated
WRONG = 0.05  # of the maximum |sigma|: as much of what an estimate is wrong by is excused
# A sigma that still approaches zero falls by SLOW at least from part to part of the second half,
# and at last to FALLS, or as steadily as before.
PARTS, FALLS, SLOW = 5, 0.9, 0.005
NEAR = 0.1  # of the maximum |sigma|: what sampling allows beyond is not the way to rest
HELD = 0.95  # of the tail: an actuator at its limit for as long controls nothing
STILL = 1e-3  # of |v|: a sigma' as small does not move sigma
GROWS = 0.02  # of the gain: growth in the tail
ROWS = 100  # at which the actuator and a band that changes are judged
TINY = 1e-9


class Motion(NamedTuple):
    """How a sliding variable ends.

    Attributes
    ----------
    size : ndarray
        Greatest |sigma| since the row before, row by row.
    tail, band : float
        Greatest |sigma| of the tail, and that at which it counts as rest.
    near : float
        |sigma| from which on it is there: the band that the law accepts and what sampling allows,
        at most a tenth of the greatest, or twice the tail.
    rests : bool
        Whether it stays within the band throughout the tail.
    approaches : bool
        Whether it still falls.
    crosses : bool
        Whether it changes its sign in the tail.
    still : bool
        Whether it stands still in the tail, however large v is.
    direct : bool
        Whether it depends on u itself.
    """

    size: np.ndarray
    tail: float
    band: float
    near: float
    rests: bool
    approaches: bool
    crosses: bool
    still: bool
    direct: bool

    def said(self, key: str) -> str:
        """Return that it does not rest, in words."""
        if self.still:
            return (f"{key} stands still at {self.tail:.3g} while v pushes: the loop is latched, "
                    "and the xi that is found is v itself")
        tail, band = apart(self.tail, self.band)
        how = f"swings within {tail}" if self.crosses else f"is {tail} away from 0"
        why = (f"; {key} depends on u itself (relative degree 0), so that nothing slides: put the "
               "lag of the actuator, or of the sensor, into the plant")*self.direct
        return (f"{key} does not come to rest: it {how}, where sliding would keep it within "
                f"{band}{why}")


def apart(size: float, bound: float) -> tuple[str, str]:
    """Return a size and its bound as text, with as many digits as tell them apart."""
    n = 3 if f"{size:.3g}" != f"{bound:.3g}" else 6
    return f"{size:.{n}g}", f"{bound:.{n}g}"


def slides(b: "Block | None") -> bool:
    """Return whether a law may slide: a sliding mode law, or one without a card that sees sigma."""
    return b is not None and (isinstance(b.card, Law) or b.card is None and "sigma" in b.signals)


def tail_rows(run: "Run") -> slice:
    """Return the rows of the tail, a tenth to a half of the run; else those of its last fifth."""
    end = run.t[-1]
    last = min(max(run.tail or LAST*end, SHORTEST*end), LONGEST*end)
    first = int(np.searchsorted(run.t, end - last*(1.0 + TINY), "right"))
    first = max(first, int(run.t[0] > 0.0))  # the first row of a stretch tells of all before it
    return slice(min(first, len(run.t) - 1), len(run.t))


def _calm(run: "Run") -> slice:
    """The longest part of the tail without a jump of the command; all of it if that is short.

    Of each part that begins with a jump, in the tail or up to half its length before, the first
    half is left out: sigma is on its way.
    """
    tail = tail_rows(run)
    count = tail.stop - tail.start
    if count < 8:
        return tail
    first = max(tail.start - count//2, 0)
    jumped = np.any([jumps(np.diff(r[first:], append=r[-1])) for r in flat(run.r)], axis=0)[:-1]
    cuts = [first, *(first + 1 + np.flatnonzero(jumped)).tolist(), tail.stop]
    parts = [(max(a + (b - a)//2*(a > first), tail.start), b) for a, b in itertools.pairwise(cuts)]
    start, stop = max(parts, key=lambda q: q[1] - q[0])
    return slice(start, stop) if stop - start >= CALM*count else tail


def motions(run: "Run") -> list[Motion]:
    """Return how each sliding variable ends; `reaching_time` has the rule by which it rests."""
    leaves = [q for q in run.leaves("sigma") if not q.derivative and len(run.t)]
    blocks, itself = _blocks(run, len(leaves)), direct(run) or []
    itself = itself if len(itself) == len(leaves) else [False]*len(leaves)
    return [_motion(run, q.path, *b, direct=d)
            for q, b, d in zip(leaves, blocks, itself, strict=True)]


def _blocks(run: "Run", count: int) -> list[tuple]:
    """(law, its sigma and v, xi) of each sliding variable; (None, ...) where there is none."""
    if run.loop.stages["law"] is None:
        return [(None, None, None, None)]*count
    many = hasattr(run.loop.stages["law"], "parts")
    xis = run.xi if many and run.xi is not None else [run.xi]*len(laws(run))
    found = []
    for (b, s, v, _), xi in zip(laws(run), xis, strict=True):
        if isinstance(v, tuple) and len(v) == len(flat(s)):
            rows = zip(flat(s), v, xi or [None]*len(v), strict=True)
            found += [(b, one, w, x) for one, w, x in rows]
        else:
            found.append((b, s, v, xi))
    if len(found) != count:  # states of a plant without an output
        found = [(found[0][0], None, None, None)]*count
    return found


def _motion(run: "Run", path: tuple, b: Any, sigma: Any, v: Any, xi: Any, *,
            direct: bool) -> Motion:
    low, high = at(run.low.sigma, path), at(run.high.sigma, path)
    size, tail = np.maximum(np.abs(low), np.abs(high)), _calm(run)
    t, last = run.t[tail], size[tail]
    crosses = bool(low[tail].min() < 0.0 < high[tail].max())
    flips = crosses and isinstance(getattr(b, "card", None), Law) and not b.card.continuous
    speed = _speed(run, path, tail, sigma, v, xi, flips)
    estimated = bool(run.loop.stages["differentiator"] or run.loop.stages["sensor"])
    samples = 0.0 if direct else _samples(run, path, b, sigma, v)
    move = speed*samples + (ROUGH if estimated else FLOOR)*size.max()
    if estimated and isinstance(sigma, np.ndarray) and (true := run.true_sigma) is not None:
        wrong = float(np.abs(at(run.sigma, path) - at(true, path))[tail].max())
        move += min(2.0*wrong, WRONG*size.max())
    bands, near = np.full(len(t), move), min(move, NEAR*float(size.max()))
    if b is not None and b.band:
        some = rows_of(slice(0, len(t)))
        own = np.array([b.band(q, b.values) for q in t[some].tolist()])
        own, near = own[np.searchsorted(some, np.arange(len(t)), "right") - 1], near + own[-1]
        wide = (last > bands + own).any() and (last <= bands + b.card.within*own).all()
        held = not wide or _holds(run, b, None if xi is None else xi[tail])
        bands = bands + (b.card.within if held else 1.0)*own
    push = 0.0 if v is None or isinstance(v, tuple) else float(np.abs(v[tail]).min())
    return Motion(size, float(last.max()), float(bands.min()),
                  max(2.0*float(last.max()), float(near)), bool((last <= bands).all()),
                  _falls(size), crosses, not crosses and speed <= STILL*push, direct)


def _holds(run: "Run", b: "Block", xi: np.ndarray | None) -> bool:
    """Whether a law holds sigma where it rests beside 0: its bound, the actuator and the sign."""
    if b.theorem and xi is not None and b.theorem(dict(b.values), _peak(np.abs(xi)), 0.0):
        return False
    limits, moved = at_limit(run, rows_of(tail_rows(run))), answer(run)
    saturated = limits and all(q.mean() > HELD for q in limits)
    return not saturated and (moved is None or moved < 0.0)


def _peak(size: np.ndarray) -> float:
    """The greatest but two: a jump of the command is one row."""
    return float(np.sort(size)[-min(3, len(size))])


def _falls(size: np.ndarray) -> bool:
    """Whether sigma still approaches zero, in five parts of the second half of a run."""
    parts = [q.max() for q in np.array_split(size[len(size)//2:], PARTS) if len(q)]
    steps = -np.diff(parts)
    return bool(len(parts) == PARTS and (steps > SLOW*np.array(parts[:-1])).all()
                and (parts[-1] < FALLS*parts[-2] or steps[-1] > 0.5*steps.mean()))


def _speed(run: "Run", path: tuple, tail: slice, sigma: Any, v: Any, xi: Any,
           flips: bool) -> float:
    """Greatest |sigma'| of the tail; of a v that flips between rows, that when it does."""
    if isinstance(sigma, tuple) and len(sigma) > 1:
        rate = (*path[:-1], path[-1] + 1)
        return float(max(np.abs(at(q, rate)[tail]).max() for q in (run.low.sigma, run.high.sigma)))
    if xi is not None:
        push = (gain(run) or 1.0)*np.abs(v[tail]).max() if flips else 0.0
        rate = np.abs(xi[tail]) + push if flips else np.abs(xi - v)[tail]
    else:
        s = at(run.sigma, path)
        rate = np.abs(np.diff(s, prepend=s[:1])/np.diff(run.t, prepend=-run.tau))[tail]
    return _peak(rate)


def _samples(run: "Run", path: tuple, b: Any, sigma: Any, v: Any) -> float:
    """Time in which sigma may move away and come back [s]."""
    p = (b.card.order if isinstance(getattr(b, "card", None), Law) else None) or (
        1 if b is None else degree(b, sigma, v))
    (count, base), n = SAMPLES, p - 1
    if run.loop.stages["differentiator"]:
        (count, base), e = ESTIMATED, run.e_hat
        many = isinstance(e, tuple) and isinstance(e[0], tuple) and path
        n = max(n, len(flat(e[path[0]] if many else e)) - 1)
    return count*base**n*run.tau


# ---- the gain, and the actuator ------------------------------------------------------------------
def gains(run: "Run") -> list[tuple[str, np.ndarray | None]]:
    """Return name and values, row by row, of the gain that each law adapts; None where none is."""
    law = run.loop.stages["law"]
    many, found = hasattr(law, "parts"), []
    for name, b in (law.parts if many else {"": law}).items():
        state = b.card.gain if isinstance(b.card, Law) else ""
        z = getattr(run.z.law, name) if many else run.z.law
        found.append((state, getattr(z, state) if state else None))
    return found


def growing(run: "Run", k: np.ndarray | None) -> bool:
    """Whether a gain grows in the tail by 2 % or more, and is larger there than ever before."""
    tail = tail_rows(run)
    if k is None or tail.start < 3:
        return False
    return bool(k[-1] > (1.0 + GROWS)*k[tail.start - 1]
                and k[tail].min() >= k[tail.start//2:tail.start].max() > 0.0)


@told
def at_limit(run: "Run", rows: Any) -> list[np.ndarray] | None:
    """Return, for each input, at which of these rows it is at its limit; None where none is known.

    It is where the actuator gives its minimum or maximum of the run, less than it is asked for, and
    would not give more if it were asked for twice as much; an actuator with memory need not be
    asked twice. Without an actuator, it is where u reaches a limit of its metadata.
    """
    given = [q[rows] for q in flat(run.u)]
    if run.loop.stages["actuator"] is None:
        metas = flat(run.loop.metadata("u") or ())
        if not any(isinstance(m, Param) and (m.high < math.inf or m.low > -math.inf)
                   for m in metas):
            return None
        return [(u >= m.high) | (u <= m.low) for u, m in zip(given, metas, strict=False)]
    if run.loop.stages["allocation"]:
        asked = evaluated(run, "allocation", {}, rows)
    else:
        asked = taken(run.v, rows)
    twice = _doubled(run, asked, rows)
    found = []
    for i, (u, c) in enumerate(zip(given, flat(asked), strict=True)):
        high, low = flat(run.high.u)[i].max(), flat(run.low.u)[i].min()
        least = TINY*max(abs(high), abs(low))
        beyond = (u >= high - least) & (c > u + least) | (u <= low + least) & (c < u - least)
        found.append(beyond & (np.abs(twice[i] - u) <= least) if twice else beyond)
    return found


def _doubled(run: "Run", asked: Any, rows: Any) -> list[np.ndarray] | None:
    """What an actuator gives if it is asked for twice as much; None where it has memory."""
    if any(b.states for b in parts(run.loop.stages["actuator"])):
        return None

    def double(s):
        return tuple(map(double, s)) if isinstance(s, tuple) else 2.0*s

    return flat(evaluated(run, "actuator", {"u": double(asked)}, rows))


def rows_of(rows: slice) -> np.ndarray:
    """At most ROWS of some rows, evenly spaced."""
    return np.unique(np.linspace(rows.start, rows.stop - 1, ROWS).astype(int))
