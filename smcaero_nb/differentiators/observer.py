"""Higher-order sliding mode observer."""

import functools
from typing import Annotated

from ..core import Block, Param, block
from ..core.card import Allocation
from ..core.family import family
from ..core.param import relative_degree
from ..sources import KODE, LEVANT_2003
from .differentiator import LOW, differentiator, equation, memory

__all__ = ["observer"]

Bound = Annotated[float, Param("L", "[v]/s", low=LOW, log=True, slider=(1e-2, 1e4),
                               help="bound of the speed of xi")]
Gain = Annotated[float, Param("G_0", "[v]/[u]", help="nominal gain, not 0", slider=(-10.0, 10.0))]

DOC = r"""Higher-order sliding mode observer of sigma^({r}) = xi - v.

    .. math::

        {equation}

    with :math:`s = z_0 - \sigma`, :math:`\lfloor x\rceil^a = |x|^a\,\mathrm{{sign}}(x)` and
    :math:`\lambda_i` of ``LAMBDA[{r}]``.

    Parameters
    ----------
    sigma : float or tuple of float
        Sliding variable; of a tuple, only the first is used.
    v : float
        Output of the law.
    L : float
        Bound of :math:`|\dot\xi|` [v]/s.
    G0 : float
        Nominal gain of the plant from u to the derivative {r} of sigma, not 0.

    Returns
    -------
    float
        u = v/G0. The estimates are its states: z_0, ..., and xi.

    Notes
    -----
    See `observer`.

    References
    ----------
    Paper eqs (26), (41). A. Levant, Int. J. Control 76 (2003) 924.
    """


def no_gain(values: dict) -> str | None:
    """Return why G0 is not allowed, or None."""
    return None if values["G0"] else "G0 = 0 is not allowed; it must not be 0"


@family(card=Allocation(source=(KODE, LEVANT_2003)))
def observer(r: int) -> Block:
    r"""Higher-order sliding mode observer.

    It estimates sigma, its derivatives and the perturbation xi while the loop runs.

    .. math:: \sigma^{(r)} = \xi - v, \qquad z_i \to \sigma^{(i)}, \qquad \hat\xi \to \xi

    Parameters
    ----------
    r : int
        Relative degree, 1 to 6.

    Returns
    -------
    Block
        An allocation stage, u = v/G0, with the parameters `L`, `G0` and the states z_0..z_(r-1),
        xi, started. A run has the estimate of xi in ``run.z.allocation.xi``.

    Raises
    ------
    ParameterError
        If `r` is not a whole number from 1 to 6.

    Notes
    -----
    It is the differentiator of order r that knows v: its highest derivative is that of sigma with v
    removed: the lumped perturbation, for any law, continuous or not. L has to bound the speed of xi
    only. Without noise xi is found after a finite time, to the order tau; with noise of size eps in
    sigma, to the order :math:`\varepsilon^{1/(r+1)}`. The part of v that an actuator does not
    apply counts as perturbation, too.

    A differentiator stage of order r - 1 gives the law the derivatives, so that the loop measures
    only its output. Where v is itself Lipschitz (``integrated``), a differentiator of order r gives
    xi, too: ``run.e_hat[r] + run.v``, L then bounding the speed of xi - v.

    References
    ----------
    Paper eqs (26), (41). A. Levant, Int. J. Control 76 (2003) 924.

    Examples
    --------
    ``ClosedLoop(plant, differentiator=differentiator(2), law=quasi_continuous(3),
    allocation=observer(3), ...)``
    """
    return _made(relative_degree("observer", r, 6))


@functools.cache
def _made(r):
    """The differentiator of order r that knows v: its highest derivative is xi - v."""
    step = differentiator(r).f

    def observer(sigma, v, z, tau, L: Bound = 1.0, G0: Gain = 1.0):
        _, n = step(sigma, (*z[:-2], z[-2] - v, z[-1]), tau, L)
        return v/G0, (*n[:-2], n[-2] + v, 1.0)

    observer.__name__ = f"observer_{r}"
    x = [f"z_{i}" for i in range(r)]
    observer.__doc__ = DOC.format(r=r, equation=equation([*x, r"{\hat\xi}"], {r - 1: " - v"}))
    z = memory(r - 1, "[sigma]")
    started = z.pop("started")
    xi = 0.0, Param(r"\hat\xi(0)", "[v]", help="perturbation to start with", slider=(-10.0, 10.0))
    return block(output=Param("u"), state={**z, "xi": xi, "started": started},
                 check=no_gain)(observer)
