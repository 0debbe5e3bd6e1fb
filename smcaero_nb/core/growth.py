r"""Whether the integration step follows the plant: its modes grow and decay as they should.

One step of a method multiplies a mode :math:`e^{\lambda t}` of the plant by :math:`R(\lambda dt)`
in place of :math:`e^{\lambda dt}`. Growth is judged, not stability: an unstable mode that is
followed passes, a decaying one that becomes a growing one does not.
"""

import functools
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from .exact import integral
from .linear import given, jacobian, motion, vector
from .program import METHODS, methods
from .rows import row
from .signal import flat

if TYPE_CHECKING:
    from .run import Run

__all__ = ["faithful", "step_doubts"]

TOLERANCE = 0.15  # of the amplitude
PROPOSED = 0.05  # the same of a step or method that is proposed
SHORT = 4.0  # steps: a mode that dies out within them does no harm
OVERSHOOT = 0.1  # of a first-order lag that changes its sign from step to step
ROWS = 5  # at which a nonlinear plant is linearised
SEEN = 12  # rows at which the motion of a mode is looked at
LIGHT, RESOLVED = 0.1, 1.0  # of |lambda|: a mode that may ring; its phase from row to row
FREE = 0.1  # share of a mode's motion that has to be its own
BLOWN = 10.0  # growth of a mode, as a logarithm, that makes a run diverge
FINEST = 1e-6  # of the step, the finest that is proposed


def faithful(modes: np.ndarray, factors: np.ndarray, dt: float, steps: int,
             tolerance: float = TOLERANCE) -> np.ndarray:
    r"""Return which modes a method follows over a run.

    Parameters
    ----------
    modes : ndarray of complex
        Eigenvalues :math:`\lambda` of the plant [1/s].
    factors : ndarray of complex
        What one step multiplies each mode by, :math:`R`.
    dt : float
        Integration step [s].
    steps : int
        Number of steps of the run.
    tolerance : float
        Of the amplitude.

    Notes
    -----
    With the error of the exponent, :math:`\epsilon = \ln R - \lambda dt`, and the memory of the
    mode, :math:`n = 1/|\mathrm{Re}\,\lambda dt|` steps or, if fewer, those of the run, a mode is
    followed if the amplitude that it is driven to at its own frequency, proportional to
    :math:`1/|1 \pm n\epsilon|` (minus for one that decays), is right to 15 %. For a mode that does
    not decay within the run that is the error of its growth over the run; for a lightly damped one
    it is the error of its damping, and of its frequency as far as it leaves the resonance. Longer
    than its memory no error of a mode adds up.

    A mode that in truth and in the run dies out within 4 steps is at its quasi-static value, which
    every method has right; it passes, unless it overshoots by more than 10 %, changing its sign
    from step to step.
    """
    z = modes*dt
    rate = np.real(z)
    with np.errstate(all="ignore"):
        error = np.log(factors.astype(complex)) - z
        error.imag = (error.imag + math.pi) % (2.0*math.pi) - math.pi
        memory = np.minimum(steps, 1.0/np.abs(rate))
        drift = 1.0 + np.where(rate > 0.0, memory, -memory)*error
        near = (np.real(drift) > 0.0) & (np.abs(np.log(np.abs(drift))) <= tolerance)
    dead = (rate < -1.0/SHORT) & (np.abs(factors) < math.exp(-1.0/SHORT))
    return near | dead & (np.real(factors) > -OVERSHOOT)


class _Plant:
    """A linearised plant: its modes, and the factor of each in one step of a method."""

    modes: np.ndarray
    vectors: np.ndarray

    def __init__(self, J: np.ndarray, A: Any):
        self.J, self.A = J, A
        self.modes, self.vectors = (q.astype(complex) for q in np.linalg.eig(J))

    def factors(self, method: str, dt: float) -> np.ndarray:
        """What one step multiplies each mode by."""
        z = self.modes*dt
        if method == "exact":
            return self._exact(dt)
        rate, total = np.zeros_like(z), np.ones_like(z)
        for node, weight in METHODS[method]:
            rate = z*(1.0 + node*rate)
            total = total + weight*rate
        return total

    def _exact(self, dt: float) -> np.ndarray:
        """Those of the exact step; a perturbation that follows x is taken at its middle."""
        if np.allclose(self.J, self.A, rtol=1e-6, atol=1e-9*np.abs(self.J).max()):
            return np.exp(self.modes*dt)
        whole, half = integral(self.A, dt), integral(self.A, 0.5*dt)
        change = whole @ (self.J + (self.J - self.A) @ half @ self.J) @ self.vectors
        return 1.0 + np.diag(np.linalg.pinv(self.vectors) @ change)

    def wrong(self, method: str, dt: float, steps: int,
              tolerance: float = TOLERANCE) -> np.ndarray:
        """The modes that the method does not follow, one of each pair."""
        followed = faithful(self.modes, self.factors(method, dt), dt, steps, tolerance)
        return np.flatnonzero(~followed & (np.imag(self.modes) >= 0.0))


def step_doubts(run: "Run") -> list[str]:
    """Return what the integration step does to a mode of the plant, in words.

    The plant is linearised at the start of the run and, unless it is linear, at four rows more, u
    held, and its modes are judged by `faithful`. A mode counts if the recorded motion contains it
    (`_moves`).

    Returns
    -------
    list of str
        Empty, or one sentence about the mode that fares worst: its frequency and damping, what it
        does in truth and in the run, and the longest dt = tau/k, and the methods, that would do. Of
        a run that diverged because of it, the first row that has such a mode is judged.
    """
    plants = _linearised(run)
    found = [(i, plant, j) for i, plant in plants
             for j in plant.wrong(run.method, run.dt, run.steps)
             if _moves(run, i, plant, j, len(plants) > 1)]
    if not found:
        return []
    because = any(_diverged(run, complex(p.factors(run.method, run.dt)[j])) for _, p, j in found)
    if because:  # the state of the row that shows it may have lost all bounds: an earlier one tells
        found = [(i, p, j) for i, p in plants for j in p.wrong(run.method, run.dt, run.steps)
                 if i <= found[0][0] and np.real(p.modes[j]) <= 0.0]
        first = found[0][0]
        plants = [q for q in plants if q[0] == first]
        found = [q for q in found if q[0] == first]

    def miss(one):
        _, plant, j = one
        return abs(math.log(abs(plant.factors(run.method, run.dt)[j]) or 1e-300)
                   - plant.modes[j].real*run.dt)

    _, plant, j = max(found, key=miss)
    factor = complex(plant.factors(run.method, run.dt)[j])
    why = "; the run diverged because of it"*because
    said = _said(run, complex(plant.modes[j]), factor)
    return [said + why + _way_out(run, [p for _, p in plants])]


def _linearised(run: "Run") -> list[tuple[int, _Plant]]:
    """(row, plant) where it can be linearised: one of a linear plant, at most `ROWS` of another."""
    last, rate, plants = len(run.t) - 1, motion(run), []
    A = getattr(run.loop.stages["plant"], "A", None)
    for i in sorted({last*k//(ROWS - 1) for k in range(ROWS if last >= 0 else 0)}):
        at = given(run, i)
        with np.errstate(all="ignore"):
            f, x = functools.partial(rate, at), vector(at["x"])
            J = jacobian(f, x, 1e-3/(run.steps*run.dt or 1.0))
            if J is None or not np.isfinite(J).all():
                continue
            plants.append((i, _Plant(J, A)))
            if len(plants) == 1 and _linear(rate, given(run, last), J):
                break
    return plants


def _linear(rate: Callable, at: dict, J: np.ndarray) -> bool:
    """Whether dx/dt at another row has the same derivative, in two directions."""
    x = vector(at["x"])
    here, step = rate(at, x), 1e-3*(1.0 + np.abs(x))
    for v in (step, step*np.cos(np.arange(len(x)))):
        rise, wanted = rate(at, x + v) - here, J @ v
        bound = 1e-6*np.abs(J) @ np.abs(v) + 1e-13*(np.abs(here) + np.abs(rise))
        if not (np.abs(rise - wanted) <= bound).all():
            return False
    return True


def _moves(run: "Run", i: int, plant: _Plant, j: int, several: bool) -> bool:
    r"""Whether the recorded motion contains a mode, and moves as the mode does by itself.

    Of its coordinate m = w x (w the left eigenvector), less its mean, m' = lambda m + force. The
    mode moves by itself if :math:`\epsilon/dt` is not small against the force that acts on m, and
    if m' is not small against lambda m, as where m only follows the force; or if it rings beside a
    larger, slower motion that is forced on it (`_rings`). Looked at are, of a
    linear plant, the run and its last third; of another, what is near the row.
    """
    lam, factor = plant.modes[j], plant.factors(run.method, run.dt)[j]
    if run.diverged_at is not None and lam.real > 0.0:
        return False  # it diverges in truth, too, however well it is followed
    if _diverged(run, factor):
        return True
    last, span = len(run.t) - 1, len(run.t)//8
    spans = [(max(i - span, 0), min(i + span, last))] if several else [(0, last),
                                                                       (2*last//3, last)]
    values, left = np.linalg.eig(plant.J.T)
    w = left[:, np.argmin(np.abs(values - lam))]
    error = abs(np.log(complex(factor)) - lam*run.dt)/run.dt
    return any(_free(run, np.linspace(*q, SEEN).astype(int), w, lam, error)
               or _rings(run, slice(*q), w, factor, error) for q in spans)


def _free(run: "Run", rows: np.ndarray, w: np.ndarray, lam: complex, error: float) -> bool:
    """Whether the mode of left eigenvector w moves by itself at some rows; see `_moves`.

    They take the least and the greatest u since the row before in turn: rows alone may all see the
    same side of a chattering u.
    """
    rate = motion(run)
    seen = [given(run, k) | {"u": row((run.low.u, run.high.u)[n % 2], k)}
            for n, k in enumerate(np.unique(rows))]
    x = np.array([vector(at["x"]) for at in seen])
    rates = np.array([rate(at, q) for at, q in zip(seen, x, strict=True)])
    scale = np.abs(x) @ np.abs(w)
    m, rates = (q @ w - (q @ w).mean() for q in (x, rates))
    size = (np.abs(m)**2).sum()
    if not size > (1e-9*scale.max())**2:
        return False
    force = abs((rates*m.conj()).sum()/size - lam)
    own = (np.abs(rates)**2).sum() >= (FREE*abs(lam))**2*size
    return bool(own and error > TOLERANCE*force)


def _rings(run: "Run", rows: slice, w: np.ndarray, factor: complex, error: float) -> bool:
    r"""Whether a lightly damped mode of left eigenvector w rings beside a slower, forced motion.

    Two differences from row to row leave of the coordinate w x what rings. The mode rings by itself
    if that goes on from row to row as in the run, but for less than :math:`\epsilon/dt` allows.
    """
    h = run.t[1] - run.t[0] if len(run.t) > 1 else math.inf
    swing = np.log(complex(factor))/run.dt
    if abs(swing.real) > LIGHT*abs(swing) or error > LIGHT*abs(swing) or abs(swing)*h > RESOLVED:
        return False
    m = np.column_stack([q[rows] for q in flat(tuple(vars(run.x).values()))]) @ w
    next_, size = np.exp(swing*h), np.abs(m - m.mean()).max(initial=0.0)
    rings = np.diff(m, 2)/(next_ - 1.0)**2
    if len(rings) < SEEN or not np.abs(rings).max() > max(FREE*size, 1e-9*np.abs(m).max()):
        return False
    seen = (rings[1:]*rings[:-1].conj()).sum()/(np.abs(rings[:-1])**2).sum()
    return bool(error > TOLERANCE*abs(np.log(seen/next_))/h)


def _diverged(run: "Run", factor: complex) -> bool:
    """Whether a run diverged, and a factor in each step is enough for it."""
    return run.ended == "diverged" and run.steps*math.log(abs(factor) or 1e-300) > BLOWN


def _said(run: "Run", lam: complex, factor: complex) -> str:
    """What the step does to a mode, in words."""
    damping = -lam.real/abs(lam) if abs(lam.real) > 1e-9*abs(lam) else 0.0
    truth, seen = lam.real, math.log(abs(factor) or 1e-300)/run.dt

    def does(rate):
        verb = "grows" if rate > 0.0 else "decays"
        return f"{verb} at {abs(rate):.3g} 1/s" if abs(rate)*run.dt*run.steps > 1e-3 else (
            "keeps its amplitude")

    if factor.real < 0.0 and abs(factor.imag) < 1e-9*abs(factor):
        does_now = f"changes its sign at every step and {does(seen)}"
    elif does(truth) == does(seen):
        does_now = f"has a frequency of {abs(np.log(factor).imag)/run.dt:.5g} rad/s"
    else:
        does_now = does(seen)
    return (f"{run.method} with dt = {run.dt:g} s does not follow the plant's mode of "
            f"{abs(lam):.3g} rad/s (damping ratio {damping:.3g}), which {does(truth)}: in "
            f"the run it {does_now}")


def _way_out(run: "Run", plants: list[_Plant]) -> str:
    """The longest step, and the methods, that would do, in words."""
    time = run.steps*run.dt
    if run.diverged_at is not None:  # it has to do to the end that was planned
        time = max(time, run.loop.duration or 0.0)

    def does(method, dt):
        return not any(len(p.wrong(method, dt, round(time/dt), PROPOSED)) for p in plants)

    others = [repr(q) for q in methods(run.loop) if q != run.method and does(q, run.dt)]
    counts = (round(c*10.0**k) for k in range(15) for c in (1.0, 2.0, 5.0))
    steps = (run.tau/c for c in counts if FINEST*run.dt < run.tau/c < run.dt*(1.0 - 1e-9))
    dt = next((q for q in steps if does(run.method, q)), None)
    ways = [f"dt = {dt:.6g} s"] if dt else []
    ways += [f"method = {' or '.join(others)}"] if others else []
    return f"; {' or '.join(ways)} would do" if ways else ""
