"""PD and PID control: the baseline against which sliding mode laws are compared."""

from typing import Annotated

from .core import Param, block
from .core.card import Baseline
from .core.signal import first
from .sources import ASTROM_1995, KODE

__all__ = ["pd", "pid"]

K_P = Param("k_p", "[v]/[e]", low=0.0, help="proportional gain", slider=(0.0, 10.0))
K_D = Param("k_d", "[v] s/[e]", low=0.0, help="derivative gain", slider=(0.0, 10.0))


@block(output=Param("v"), card=Baseline(source=(KODE,)))
def pd(e, k_p: Annotated[float, K_P] = 1.0, k_d: Annotated[float, K_D] = 1.0):
    r"""Proportional-derivative control.

    .. math:: v = k_p\,e + k_d\,\dot e

    Parameters
    ----------
    e : tuple of float
        Error and its derivative.
    k_p, k_d : float
        Gains.

    Returns
    -------
    float
        v.

    Notes
    -----
    A constant perturbation leaves a constant error.

    References
    ----------
    Paper eq (66).
    """
    return k_p*e[0] + k_d*e[1]


INTEGRAL = Param(r"\int e", "[e] s", help="integral to start with", slider=(-1.0, 1.0))
Integral = Annotated[float,
                     Param("k_i", "[v]/([e] s)", low=0.0, help="integral gain", slider=(0.0, 10.0))]


@block(state=dict(integral=(0.0, INTEGRAL)), output=Param("v"),
       card=Baseline(source=(ASTROM_1995, KODE)))
def pid(r, y, z, tau, k_p: Annotated[float, K_P] = 1.0, k_i: Integral = 0.1,
        k_d: Annotated[float, K_D] = 1.0):
    r"""Proportional-integral-derivative control, the derivative taken from the measurement.

    .. math:: v = k_p\,e + k_i \int e\,dt - k_d\,\dot y, \qquad e = r - y

    Parameters
    ----------
    r : float or tuple of float
        Reference; its derivatives are not used, so that a step gives no kick.
    y : tuple of float
        Output and its derivative.
    k_p, k_i, k_d : float
        Gains.

    Returns
    -------
    float
        v.

    Notes
    -----
    The integral does not know of the actuator's limits, and winds up behind them.

    References
    ----------
    K. J. Astrom and T. Hagglund, PID Controllers, ISA, 1995. Paper eq (57) for the lander.
    """
    integral, = z
    e = first(r) - y[0]
    return k_p*e + k_i*integral - k_d*y[1], (integral + tau*e,)
