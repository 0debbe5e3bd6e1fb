"""The identification as a function of numbers, for a mask."""

import functools
import warnings
from typing import Annotated, Any, NamedTuple

import numpy as np

from ..core import Block, Param, ParameterError, block
from .identify import DEFAULT, check_names, checked_source, identify
from .results import PRDResult, PRDSweep, VectorPRD
from .step_response import Record
from .time_scale import SHORTEST, longest_window

__all__ = ["Probe", "experiment"]

SCALES = (1e-3, 10.0)  # windows of models [s]
COUNT = 17

Window = Annotated[float, Param("w", "s", low=1e-15, log=True, slider=SCALES,
                                help="what happens within it counts as instantaneous")]
Alpha = Annotated[float, Param(r"\alpha", low=0.01, high=0.15,
                               help="share of its step that a derivative may still lack")]
Height = Annotated[float, Param(r"\Delta u", "[u]", help="height of the step", slider=(-2.0, 2.0))]
Noise = Annotated[float, Param("noise", low=0.0, high=1.0, slider=(0.0, 0.01),
                               help="white noise added to the output, as a share of its range")]
Found = Annotated[bool,
                  Param("find w", help="use the shortest window at which both methods agree")]


class Probe(NamedTuple):
    """Result of an `experiment`.

    Attributes
    ----------
    result : PRDResult or VectorPRD
    sweep : PRDSweep
        The same, at other windows.
    """

    result: PRDResult | VectorPRD
    sweep: PRDSweep

    def __str__(self) -> str:
        return str(self.result)


def _of_record(source, swept):
    """The identification of a record, whose window is found."""
    end = longest_window(source)
    windows = tuple(np.geomspace(min(SHORTEST*source.h, end), end, COUNT))

    def identification(found: Found = True, window: Window = end/4, alpha: Alpha = 0.1,
                       noise: Noise = 0.0):
        how: dict[str, Any] = dict(alpha=alpha, noise=noise)
        if found and window != end/4:
            warnings.warn("w is chosen automatically, so the value you set is ignored; turn off "
                          "'find w' to use it", UserWarning, stacklevel=2)
        return Probe(identify(source, window=None if found else window, **how),
                     swept(windows, **how))

    return identification


def _of_model(source, start, settings, swept):
    """The identification of a model, with a window to start with."""
    windows = tuple(np.geomspace(*SCALES, COUNT))

    def identification(window: Window = start, amplitude: Height = 1.0, alpha: Alpha = 0.1,
                       noise: Noise = 0.0):
        how: dict[str, Any] = dict(alpha=alpha, noise=noise, amplitude=amplitude)
        return Probe(identify(source, window=window, **settings, **how), swept(windows, **how))

    return identification


def experiment(source: Any, window: float = DEFAULT, **settings: Any) -> Block:
    r"""Identification of a source as a function of its numbers.

    ``ui.live(experiment(source))`` shows it with a mask.

    .. math:: r(w) = \text{the lowest } k \text{ of which } y^{(k)} \text{ steps within } w

    Parameters
    ----------
    source
        As in `identify`.
    window : float
        Window to start with [s]; a record starts with the one that is found.
    **settings
        `output`, `surface`, `x0` as in `identify`.

    Returns
    -------
    Block
        Without signals; called, it gives a `Probe`: the result at the window, and a sweep of
        windows.

    Raises
    ------
    ParameterError, BlockError
        As `identify`, when it is called; a source or a setting that does not exist, immediately.

    Notes
    -----
    The sweep leaves out the windows for which a plant diverges or a record is too short. Not in the
    paper.

    Examples
    --------
    >>> print(experiment(smc.lv.transfer_function())())
    The experimentally determined PRD is equal to 5
    """
    source = checked_source("prd.experiment", source)
    check_names("prd.experiment", settings, ("output", "surface", "x0"))

    @functools.lru_cache(8)
    def swept(windows, **how):
        found = []
        for w in windows:
            try:
                found.append((w, identify(source, window=w, **settings, **how)))
            except ParameterError:
                continue
        return PRDSweep(*map(tuple, zip(*found, strict=True))) if found else PRDSweep((), ())

    identification = (_of_record(source, swept) if isinstance(source, Record) else
                      _of_model(source, window, settings, swept))
    identification.__doc__ = identify.__doc__
    return block(identification)
