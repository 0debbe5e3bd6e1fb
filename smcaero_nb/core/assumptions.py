r"""What a law's theorem assumes of the perturbation, and what the perturbation of a run was."""

import numpy as np

from .param import switch, texted
from .signal import flat

__all__ = ["degree", "doubts", "exceeds", "laws", "perturbation"]

ROWS = 50  # at which an allocation's condition is looked at
MARGIN = 1.001  # a bound that is met to within this is met


def exceeds(name, symbol="|xi|", rate=False):
    r"""The condition that the perturbation, or its derivative, stays within a parameter: `assumes` of a `Law`.

    Parameters
    ----------
    name : str
        The parameter that is its bound.
    symbol : str
        What the bound is of, as the sentence says it.
    rate : bool
        Whether it bounds the derivative.

    Returns
    -------
    function
        ``f(values, xi, dxi)``: None, or the sentence that says what does not hold.

    Raises
    ------
    ParameterError
        A name or symbol that is not text, a rate that is not a switch.
    """
    name, symbol = texted("exceeds", "name", name), texted("exceeds", "symbol", symbol)
    rate = switch("exceeds", "rate", rate)

    def condition(values, xi, dxi):
        size, unit = (dxi, "[v]/s") if rate else (xi, "[v]")
        if size > MARGIN*values[name]:
            return f"{symbol} reaches {size:.3g}, more than {name} = {values[name]:g} {unit}"

    return condition


def laws(run):
    """(block, sigma, v, integral of v) of the law, channel by channel."""
    return _channels(run.loop.stages["law"], run.sigma, run.v, run.integral_v)


def _channels(law, sigma, v, integral):
    parts = getattr(law, "parts", None)
    return [(law, sigma, v, integral)] if parts is None else list(zip(parts.values(), sigma, v, integral, strict=True))


def _row(s, i):
    """A recorded signal at one row."""
    return tuple(_row(q, i) for q in s) if isinstance(s, tuple) else float(s[i])


def degree(b, sigma, v):
    """Relative degree that a law is for."""
    return b.r or (1 if isinstance(v, tuple) else len(flat(sigma)))


def perturbation(law, t, sigma, v, integral_v, tau):
    r"""The perturbation as the law meets it, xi = sigma^(r) + v: its mean since the row before.

    It holds all that the law does not know: the perturbation of the plant, what the model of it
    leaves out, and an actuator's lag. Nested as v; None where v and sigma do not belong together,
    or the run is too short.
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


def doubts(run):
    r"""Why the theorem of the law does not speak of this run: conditions on the perturbation that it breaks, in words.

    Returns
    -------
    list of str
        Empty if all hold, if the law declares none (``Law(assumes=...)``), or if the run is too
        short to tell.

    Notes
    -----
    The perturbation is `Run.xi`, found from the run itself, in its second half: on the
    way to sigma = 0 the plant itself may perturb more. One that is large for a single row, as when
    a command jumps, does not count. Faster changes than the recorded rows are averaged out.
    """
    law, allocation, said = run.loop.stages["law"], run.loop.stages["allocation"], []
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
