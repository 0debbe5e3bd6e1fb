"""How curves pass between recorded rows: held, as a band, or not at all."""

import numpy as np

__all__ = ["band", "chatters", "corners", "held", "mean", "once", "reversals"]

STRETCH = 12  # intervals between rows
SEEN = 0.02  # of a panel
LEVEL = 16  # points of a level edge of which one is kept
CELLS = 800  # of a phase portrait, in each direction: what a screen resolves


def corners(t: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a curve without the inner points of its level stretches."""
    keep = np.ones(len(t), bool)
    keep[1:-1] = (y[1:-1] != y[:-2]) | (y[1:-1] != y[2:])
    return t[keep], y[keep]


def held(t: np.ndarray, y: np.ndarray, single: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a curve that is level up to the next row in the intervals that are a `single` sample.

    Elsewhere it goes straight from row to row.
    """
    at = np.flatnonzero(single & (y[1:] != y[:-1])) + 1
    return corners(np.insert(t, at, t[at]), np.insert(y, at, y[at - 1]))


def reversals(y: np.ndarray) -> int:
    """Return how often a curve turns round."""
    step = np.diff(y[np.isfinite(y)])
    step = step[step != 0.0]
    return int(np.count_nonzero(step[1:]*step[:-1] < 0.0))


def _hidden(y, low, high):
    """How far the signal goes beyond the rows that bound an interval, if at all."""
    return np.maximum(np.minimum(y[:-1], y[1:]) - low[1:], high[1:] - np.maximum(y[:-1], y[1:]))


def _runs(mask):
    """First and last index, inclusive, of each stretch of a mask."""
    edge = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return edge[::2], edge[1::2] - 1


def chatters(y: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the intervals between rows in which the signal chatters.

    In such a stretch the rows are accidental samples: in each interval the signal goes beyond the
    rows, or turns round at one of them, but for two intervals at most; and it is `STRETCH` long. A
    smooth signal does so only near its extremes.
    """
    step = np.diff(y)
    turn = step[1:]*step[:-1] < 0.0
    restless = (_hidden(y, low, high) > 0.0) | np.append(turn, False) | np.append(False, turn)
    first, last = _runs(restless)
    if not len(first):
        return restless
    apart = np.flatnonzero(first[1:] - last[:-1] > 3)  # others are one stretch
    first, last = first[np.append(0, apart + 1)], last[np.append(apart, len(last) - 1)]
    last[-1] = len(step) - 1 if len(step) - last[-1] <= 3 else last[-1]
    long = last - first + 1 >= STRETCH
    marks = np.zeros(len(step) + 1, int)
    np.add.at(marks, first[long], 1)
    np.add.at(marks, last[long] + 1, -1)
    return np.cumsum(marks)[:-1] > 0


def band(t: np.ndarray, y: np.ndarray, low: np.ndarray, high: np.ndarray, chattering: np.ndarray
         ) -> tuple[np.ndarray, np.ndarray]:
    """Return the outlines of the bands that a signal fills between rows; nothing between them.

    From each row to the next, a band reaches from the minimum to the maximum there: where the
    signal chatters, and where it goes beyond the rows by more than can be overlooked.
    """
    seen = chattering | (_hidden(y, low, high) > SEEN*(high.max() - low.min()))
    at, n = np.flatnonzero(seen), 8*len(t)
    first = seen & ~np.append(False, seen[:-1])
    stretch = np.cumsum(first)[at]
    upper, lower = np.maximum(high[1:], y[:-1])[at], np.minimum(low[1:], y[:-1])[at]
    ends = np.unique(stretch)
    x = np.concatenate([t[at], t[at + 1], t[at], t[at + 1], np.full(len(ends), np.nan)])
    values = np.concatenate([upper, upper, lower, lower, np.full(len(ends), np.nan)])
    place = np.concatenate([2*at, 2*at + 1, n - 2*at, n - 2*at - 1, np.full(len(ends), n + 1)])
    order = np.argsort(place + np.concatenate([np.tile(stretch, 4), ends])*2*n)
    x, values = x[order], values[order]
    keep = np.arange(len(x)) % LEVEL == 0  # who reads a stretch of it finds points there
    keep[:-1] |= values[1:] != values[:-1]
    keep[1:] |= values[1:] != values[:-1]
    return x[keep], values[keep]


def mean(t: np.ndarray, integral: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return the mean of a signal around each of some rows, from its running integral.

    It is taken over 1 % of the run, at least from the row before to the row after, and within the
    stretch of the rows.
    """
    first, last = _runs(rows)
    at = np.flatnonzero(rows)
    stretch = np.searchsorted(first, at, "right") - 1
    width = 0.005*(t[-1] - t[0])
    a = np.minimum(np.searchsorted(t, t[at] - width), at - 1)
    b = np.maximum(np.searchsorted(t, t[at] + width), at + 1)
    a = np.maximum(a, np.maximum(first[stretch] - 1, 0))
    b = np.minimum(b, np.minimum(last[stretch] + 1, len(t) - 1))
    return (integral[b] - integral[a])/(t[b] - t[a])


def once(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a curve in the plane, each segment of it drawn once; it has gaps where it is NaN.

    Segments that a screen does not tell apart are one.
    """
    there = np.isfinite(x) & np.isfinite(y)
    if not there.any():
        return x[:0], y[:0]
    cells = []
    for q in (x, y):
        low, high = q[there].min(), q[there].max()
        known = np.where(there, q, low).astype(float)
        cells.append(np.round((known - low)/((high - low) or 1.0)*CELLS).astype(np.int64))
    cell = np.where(there, cells[0]*(CELLS + 1) + cells[1], -1)
    moved = np.flatnonzero(np.append(True, cell[1:] != cell[:-1]))
    x, y, cell = x[moved], y[moved], cell[moved]
    a, b = np.minimum(cell[:-1], cell[1:]), np.maximum(cell[:-1], cell[1:])
    new = np.zeros(len(a), bool)
    new[np.unique(a*(CELLS + 1)**2 + b, return_index=True)[1]] = True
    new &= a >= 0
    used = np.append(new, False) | np.append(False, new)
    gaps = np.flatnonzero(~np.append(new, True)[used]) + 1
    return np.insert(x[used], gaps, np.nan), np.insert(y[used], gaps, np.nan)


def coarse(pieces: int, t: np.ndarray, y: np.ndarray, low: np.ndarray, high: np.ndarray,
           integral: np.ndarray | None) -> tuple:
    """Return t, y, low, high and the running integral of fewer rows."""
    k = -(-(len(t) - 1)//pieces)
    kept = np.unique(np.append(np.arange(0, len(t), k), len(t) - 1))
    groups = np.append(0, kept[:-1] + 1)
    return (t[kept], y[kept], np.minimum.reduceat(low, groups), np.maximum.reduceat(high, groups),
            None if integral is None else integral[kept])
