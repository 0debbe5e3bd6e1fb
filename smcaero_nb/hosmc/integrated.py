"""Continuous control by raising the relative degree by one: v is the derivative of the control."""

from typing import Annotated

from ..core import Param, block
from ..core.card import Allocation
from ..sources import LEVANT_1993

__all__ = ["integrated"]


def no_gain(values):
    """Say that G0 must not be 0."""
    return None if values["G0"] else "G0 = 0 is not allowed; it must not be 0"


INTEGRAL = Param(r"\int v", "[v] s", help="integral to start with", slider=(-10.0, 10.0))
Gain = Annotated[float, Param("G_0", "[v] s/[u]", help="nominal gain, not 0", slider=(-10.0, 10.0))]
Limit = Annotated[float,
                  Param(r"u_{max}", "[u]", low=0.0, log=True, slider=(1e-2, 1e9),
                        help="maximum |u|; the integral stops there")]


@block(state=dict(integral=(0.0, INTEGRAL)), output=Param("u"), check=no_gain,
       card=Allocation(source=(LEVANT_1993,)))
def integrated(v, z, tau, G0: Gain = 1.0, limit: Limit = 1e9):
    r"""Continuous control from any law: an integrator between law and plant.

    .. math:: u = \frac{1}{G_0}\int v\,dt, \qquad |u| \le u_{max}

    Parameters
    ----------
    v : float
        Output of a law for relative degree r + 1, r that of the plant.
    G0 : float
        Nominal gain of the plant from u to the derivative r of sigma, with its sign; not 0.
    limit : float
        Maximum \|u\| [u]: the integral stops there, so that it does not wind up.

    Returns
    -------
    float
        u, continuous.

    Notes
    -----
    An allocation stage. With :math:`\sigma^{(r)} = \xi - G_0 u` the law sees
    :math:`\sigma^{(r+1)} = \dot\xi - v`: it needs one more derivative of sigma, and the bound L of
    :math:`|\dot\xi|`. It is then du/dt that is discontinuous; the control itself does not chatter,
    and an actuator slower than tau, behind which a discontinuous law ends in a limit cycle, does
    less harm. The integral takes time: after a jump of the perturbation the control follows at the
    rate alpha L at most.

    References
    ----------
    A. Levant, Int. J. Control 58 (1993) 1247; the paper's sections on relative degree name it.

    Examples
    --------
    ``ClosedLoop(plant, law=quasi_continuous(3).with_(L=0.5), allocation=integrated, ...)`` for a
    plant of relative degree 2.
    """
    integral, = z
    most = limit*abs(G0)
    return integral/G0, (max(-most, min(most, integral + tau*v)),)
