"""Assumptions of a law's theorem about the perturbation, and the perturbation of a run."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from .block import Block
from .growth import step_doubts
from .param import switch, texted
from .signal import flat
from .zeros import zero_doubts

if TYPE_CHECKING:
    from .run import Run

__all__ = ["degree", "doubts", "exceeds", "laws", "perturbation"]

Condition = Callable[[dict[str, Any], float, float], str | None]
ROWS = 50  # at which an allocation's condition is checked
MARGIN = 1.001  # relative tolerance of the bound


def exceeds(name: str, symbol: str = "|xi|", rate: bool = False) -> Condition:
    r"""Make the `assumes` of a `Law` whose parameter bounds the perturbation or its derivative.

    Parameters
    ----------
    name : str
        The parameter that is the bound.
    symbol : str
        The bounded quantity, as the message writes it.
    rate : bool
        Whether the derivative is bounded.

    Returns
    -------
    function
        ``f(values, xi, dxi)``: None, or a sentence on the violation.

    Raises
    ------
    ParameterError
        A name or symbol that is not text, a rate that is not a switch.
    """
    name, symbol = texted("exceeds", "name", name), texted("exceeds", "symbol", symbol)
    rate = switch("exceeds", "rate", rate)

    def condition(values: dict[str, Any], xi: float, dxi: float) -> str | None:
        size, unit = (dxi, "[v]/s") if rate else (xi, "[v]")
        if size > MARGIN*values[name]:
            return f"{symbol} reaches {size:.3g}, more than {name} = {values[name]:g} {unit}"
        return None

    return condition


def laws(run: "Run") -> list[tuple[Block, Any, Any, Any]]:
    """Return (block, sigma, v, integral of v) of the law, channel by channel."""
    return _channels(run.loop.stages["law"], run.sigma, run.v, run.integral_v)


def _channels(law: Any, sigma: Any, v: Any, integral: Any) -> list[tuple[Block, Any, Any, Any]]:
    if not hasattr(law, "parts"):
        return [(law, sigma, v, integral)]
    return list(zip(law.parts.values(), sigma, v, integral, strict=True))


def _row(s: Any, i: int) -> Any:
    """A recorded signal at one row."""
    return tuple(_row(q, i) for q in s) if isinstance(s, tuple) else float(s[i])


def degree(b: Block, sigma: Any, v: Any) -> int:
    """Return the relative degree that a law is for."""
    return b.r or (1 if isinstance(v, tuple) else len(flat(sigma)))


def perturbation(law: Any, t: np.ndarray, sigma: Any, v: Any, integral_v: Any, tau: float) -> Any:
    r"""Return the perturbation that the law faces, xi = sigma^(r) + v, averaged between rows.

    It includes all that the law does not know: the perturbation of the plant, errors of the model,
    and the actuator's lag. Nested as v; None where v and sigma do not match, or where the run is
    too short.
    """
    if len(t) < 3:
        return None
    sample = np.floor(t/tau + 1e-6)
    kept = np.flatnonzero(np.diff(sample, prepend=-1.0) > 0)  # rows with a sample of their own
    row = np.searchsorted(kept, np.arange(len(t)), "right") - 1
    if len(kept) < 2:
        return None
    step = np.diff(sample[kept])*tau

    def mean(s, integral):
        xi = (np.diff(s[kept]) + np.diff(integral[kept]))/step
        return np.append(xi[0], xi)[row]

    found = []
    for b, s, w, integral in _channels(law, sigma, v, integral_v):
        parts, r = flat(s), degree(b, s, w)
        if isinstance(w, tuple) and len(parts) == len(flat(w)):
            found.append(tuple(map(mean, parts, integral)))
        elif not isinstance(w, tuple) and len(parts) >= r:
            found.append(mean(parts[r - 1], integral))
        else:
            return None
    return tuple(found) if hasattr(law, "parts") else found[0]


def doubts(run: "Run") -> list[str]:
    r"""Return the assumptions of the law's convergence theorem that this run violates, in words.

    Returns
    -------
    list of str
        Empty if all hold, if the law declares none (``Law(assumes=...)``), or if the run is too
        short to tell.

    Notes
    -----
    The perturbation is `Run.xi`, computed from the run, in its second half: on the way to sigma = 0
    the plant itself may perturb more. A peak of a single row, as from a step in the command, does
    not count. Changes faster than the recorded rows are averaged out.
    """
    law, allocation, said = run.loop.stages["law"], run.loop.stages["allocation"], []
    said += step_doubts(run) + zero_doubts(run)
    if getattr(allocation, "theorem", None):
        rows = np.unique(np.linspace(0, len(run.t) - 1, ROWS).astype(int))
        why = allocation.theorem(dict(allocation.values), [_row(run.y, i) for i in rows])
        said += [why] if why else []
    half = len(run.t)//2
    if run.xi is None or half < 6:
        return said
    xis = run.xi if hasattr(law, "parts") else (run.xi,)
    for (b, *_), xi, channel in zip(laws(run), xis, getattr(law, "parts", [""]), strict=True):
        if b.theorem is None:
            continue
        xi = np.array(xi)[..., half:]
        rate = np.diff(xi)/np.diff(run.t[half:])
        size, rate = (np.abs(q) if q.ndim == 1 else np.sqrt((q*q).sum(axis=0)) for q in (xi, rate))
        why = b.theorem(dict(b.values), np.minimum(size[1:], size[:-1]).max(),
                        np.minimum(np.minimum(rate[2:], rate[1:-1]), rate[:-2]).max())
        if why:
            said.append(f"{channel}: {why}" if channel else why)
    return said
