"""What speaks against a run: assumptions of its law's theorem, a sigma that does not rest."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from .answer import answer
from .block import Block
from .card import Law
from .param import switch, texted
from .perturbation import UNFIT, laws, slope
from .rows import row
from .signal import flat
from .sliding import apart, at_limit, gains, growing, rows_of, tail_rows

if TYPE_CHECKING:
    from .run import Run

__all__ = ["doubts", "exceeds"]

Condition = Callable[[dict[str, Any], float, float], str | None]
ROWS = 50  # at which an allocation's condition is checked
MARGIN = 1.001  # relative tolerance of the bound
SHARE = 0.05  # of the tail: an actuator at its limit for less is not worth a word


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
            reached, _ = apart(size, values[name])
            return f"{symbol} reaches {reached}, more than {name} = {values[name]:g} {unit}"
        return None

    return condition


def doubts(run: "Run") -> list[str]:
    r"""Return what speaks against this run as one that slides, in words.

    Returns
    -------
    list of str
        Of each law: the assumption of its convergence theorem that the run violates
        (``Law(assumes=...)``), that sigma does not come to rest, that the gain still grows; of each
        input, that the actuator is at its limit. Empty if there is nothing to say, if the law is
        not one of sliding mode control, or if the run is too short to tell.

    Notes
    -----
    The perturbation is `Run.xi`, computed from the run, in its second half: on the way to sigma = 0
    the plant itself may perturb more. A peak of a single row, as from a step in the command, does
    not count. Changes faster than the recorded rows are averaged out. Where sigma is estimated and
    no xi can be found, the reason is said. Where sigma rests, the control that holds it there shows
    what is needed, too: its mean over 1 % of the rows counts if it is less than xi, since what
    chattering leaves in xi, behind a latency or a plant whose gain is not 1, does not perturb.

    sigma does not come to rest where it leaves the band of `reaching_time` in the tail and does not
    fall from each tenth of the run to the next, at last by a tenth or as steadily as before. The
    loop is latched where sigma then moves at less than a thousandth of |v|. A gain still grows if
    it is 2 % larger at the end than at the start of the tail, and was never as large before. The
    actuator is at its limit where it gives its minimum or maximum of the run, less than it is asked
    for, and would not give more if it were asked for twice as much; without an actuator, where u
    reaches a bound of its metadata: at 5 % of 100 rows of the tail, or more. One that is switched
    from limit to limit, as by a relay, is not accused while sigma rests. Where sigma keeps its
    sign, the plant is led on from the last row with a little more of v, which has to move the error
    down; otherwise the gain has the wrong sign.
    """
    from .growth import step_doubts  # most processes judge no run
    from .zeros import zero_doubts

    names = [f"{n}: " for n in getattr(run.loop.stages["law"], "parts", ())] or [""]
    of_laws = ("; ".join(filter(None, q)) for q in zip(_assumed(run), _moving(run), strict=True))
    said = [name + q for name, q in zip(names, of_laws, strict=True) if q]
    return [*step_doubts(run), *zero_doubts(run), *_allocated(run), *said, *_limited(run)]


def _allocated(run: "Run") -> list[str]:
    """What an allocation assumes of the plant."""
    allocation = run.loop.stages["allocation"]
    if not getattr(allocation, "theorem", None):
        return []
    rows = np.unique(np.linspace(0, len(run.t) - 1, ROWS).astype(int))
    why = allocation.theorem(dict(allocation.values), [row(run.y, i) for i in rows])
    return [why] if why else []


def _assumed(run: "Run") -> list[str | None]:
    """What the theorem of each law assumes of the perturbation, and the run violates."""
    law, half = run.loop.stages["law"], len(run.t)//2
    if law is None:
        return [None]
    known = half >= 6 and run.xi is not None
    reason = f"xi is not known: {run.no_xi}" if half >= 6 and run.no_xi not in ("", UNFIT) else None
    unsure = run._perturbation[2] if known else [0.0]*len(laws(run))
    said = []
    for i, ((b, _, _, integral), xi, less) in enumerate(
            zip(laws(run), _each(run, run.xi if known else None), unsure, strict=True)):
        if b.theorem is None or xi is None:
            said.append(reason if b.theorem else None)
            continue
        size, rate = _greatest(run, xi)
        size = max(0.0, size - less)
        if all(run._motions[j].rests for j in _mine(run, i)):
            held = integral if isinstance(integral, tuple) else (integral,)
            equivalent = np.array([slope(run.t, q, run.tau) for q in held])
            size, rate = np.minimum((size, rate), _greatest(run, equivalent))
        said.append(b.theorem(dict(b.values), float(size), float(rate)))
    return said


def _greatest(run: "Run", xi: Any) -> tuple[float, float]:
    """Greatest |xi| and |xi'| of the second half of a run, without peaks of a single row."""
    half = len(run.t)//2
    xi = np.atleast_2d(np.array(xi))[:, half:]
    rate = np.diff(xi)/np.diff(run.t[half:])
    size, rate = (np.sqrt((q*q).sum(axis=0)) for q in (xi, rate))
    return (np.minimum(size[1:], size[:-1]).max(),
            np.minimum(np.minimum(rate[2:], rate[1:-1]), rate[:-2]).max())


def _mine(run: "Run", i: int) -> Any:
    """Which sliding variables are those of a law."""
    count = len(run._motions)
    return [i] if count == len(laws(run)) else range(count)


def _moving(run: "Run") -> list[str]:
    """Where the sigma of each law does not come to rest, or its gain has not settled."""
    if run.loop.stages["law"] is None:
        return [""]
    blocks = [q[0] for q in laws(run)]
    if len(run.t) < 12:
        return [""]*len(blocks)
    leaves, found = [q for q in run.leaves("sigma") if not q.derivative], run._motions
    said = []
    for i, (b, (symbol, k), xi) in enumerate(
            zip(blocks, gains(run), _each(run, run.xi), strict=True)):
        mine = _mine(run, i)
        ways = [found[j].said(leaves[j].key) for j in mine if isinstance(b.card, Law)
                and not found[j].rests and not found[j].approaches]
        lost = ways if run.diverged_at is None else []
        adapts = b.card.adapts if isinstance(b.card, Law) else None
        if ways and not any(found[j].crosses for j in mine):
            lost += _wrong(answer(run))
        grows = k is not None and growing(run, k)
        if (lost or grows) and adapts and xi is not None:
            lost += filter(None, [_outrun(run, b, adapts, xi, i)])
        if k is not None and grows:
            first = k[tail_rows(run).start - 1]
            lost.append(f"{symbol} still grows at the end: {k[-1]:.3g}, "
                        f"{100.0*(k[-1]/first - 1.0):.0f} % more than at the beginning of the tail")
        said.append("; ".join(lost))
    return said


def _wrong(moved: float | None) -> list[str]:
    """What is wrong with how v moves sigma, in words."""
    if moved is None or moved < 0.0:
        return []
    return ["more of v moves sigma up, not down: the gain has the wrong sign" if moved > 0.0 else
            "v does not move sigma"]


def _each(run: "Run", xi: Any) -> list:
    """The perturbation of each law; None where there is none."""
    many = hasattr(run.loop.stages["law"], "parts")
    return list(xi) if many and xi is not None else [xi]*len(laws(run))


def _outrun(run: "Run", b: Block, adapts: Callable, xi: Any, i: int) -> str | None:
    """Which condition of an adaptation fails."""
    law, half = run.loop.stages["law"], len(run.t)//2
    if isinstance(xi, tuple):
        xi = np.sqrt(np.square(xi).sum(axis=0))
    z = getattr(run.z.law, [*law.parts][i]) if hasattr(law, "parts") else run.z.law
    left = {n: float(q[-1]) for n, q in vars(z).items() if isinstance(q, np.ndarray)}
    once = slope(run.t, xi, run.tau)
    twice = slope(run.t, once, run.tau)
    return adapts(b.values | left, np.abs(once[half:]).max(), np.abs(twice[half:]).max())


def _limited(run: "Run") -> list[str]:
    """Where the actuator is at its limit in the tail."""
    law = run.loop.stages["law"]
    if law is None or len(run.t) < 12 or not any(isinstance(b.card, Law) for b, *_ in laws(run)):
        return []
    rows, said = rows_of(tail_rows(run)), []
    rests = all(m.rests for m in run._motions)
    for i, beyond in enumerate(at_limit(run, rows) or ()):
        u, low, high = (flat(q)[i] for q in (run.u, run.low.u, run.high.u))
        both = min(np.mean(u[rows] <= low.min()), np.mean(u[rows] >= high.max())) >= SHARE
        if beyond.mean() >= SHARE and not (both and rests):
            said.append(f"{run.leaves('u')[i].key} is at the limit of the actuator for "
                        f"{100.0*beyond.mean():.0f} % of the tail")
    return said
