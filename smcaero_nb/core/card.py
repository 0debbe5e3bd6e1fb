"""Cards: what a block is for, what it needs and guarantees, and where it comes from."""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple, TypeAlias, get_args, get_origin, get_type_hints

from .param import Param, chosen, function, given, switch, texted

__all__ = ["Actuator", "Allocation", "Baseline", "Card", "Differentiator", "Law", "Output", "Part",
           "Perturbation", "Plant", "Reference", "Source", "Stop", "Surface"]


Function: TypeAlias = Callable | None


class Source(NamedTuple):
    """A publication; the year is None where it states none."""

    authors: str
    year: int | None
    title: str
    journal: str

    def __str__(self):
        return f"{self.authors} ({self.year or 'n.d.'}). {self.title}. {self.journal}."


_kinds = functools.cache(get_type_hints)  # of a class of cards


@dataclass(frozen=True, kw_only=True)
class Card:
    """Description of a block; the kind of card says for which stage of a loop it is.

    Parameters
    ----------
    source : tuple of Source
        Where it was published; empty: nowhere.
    """

    stage: ClassVar[str | None] = None
    source: tuple[Source, ...] = ()

    def __post_init__(self):
        owner = type(self).__name__
        given(owner, "source", self.source, tuple,
              "a tuple of Source(authors, year, title, journal)")
        for i, s in enumerate(self.source):
            given(owner, f"source[{i}]", s, Source, "a Source(authors, year, title, journal)")
        for name, kind in _kinds(type(self)).items():
            value = getattr(self, name)
            if kind is bool:
                switch(owner, name, value)
            elif kind is str:
                texted(owner, name, value)
            elif kind is float:
                Param(low=0.0).check(owner, name, value)
            elif kind == int | None and value is not None:
                Param(low=1).check(owner, name, value, int)
            elif kind == Function:
                function(owner, name, value)
            elif get_origin(kind) is Literal:
                chosen(owner, name, value, get_args(kind))


@dataclass(frozen=True, kw_only=True)
class Law(Card):
    r"""Card of a sliding mode law, sigma^(r) = xi - v.

    Parameters
    ----------
    order : int, optional
        Order of sliding, p of \|sigma\| ~ tau^p; None: sigma only becomes small, or, of a family,
        the order depends on the arguments.
    r : int, optional
        Relative degree that it is for; None, of a family: one of its arguments.
    sees : str
        ``"sigma"``, or ``"derivatives"``: (sigma, sigma', ...).
    adaptive : bool
        Whether its gains follow the perturbation, so that no bound has to be known.
    continuous : bool
        Whether v is continuous.
    channels : bool
        Whether one law takes the sliding variables of all inputs together.
    needs, guarantees : str
        What has to be known of the perturbation, and what sigma then does.
    assumes : function, optional
        What its theorem assumes of the perturbation. It is given ``{name: value}`` and the maximum
        \|xi\| and \|xi'\| of a run, and returns None, or the sentence that says which condition
        does not hold; see `Run.doubts`.
    adapts : function, optional
        What its adaptation assumes, where that is sufficient but not necessary: it is asked only
        where sigma does not come to rest or the gain still grows. It is given ``{name: value}``,
        states as the run left them, and the maximum \|xi'\| and \|xi''\|, and returns the like.
    gain : str
        The state that is the gain which it adapts; empty: none.
    describing : function, optional
        Its describing function: given ``{name: value}``, the amplitude of sigma and its frequency
        [rad/s], it returns the gain of the first harmonic; complex where v is not in phase.
    band : function, optional
        The size of sigma that it accepts, drawn in pictures. It is given a time and
        ``{name: value}``.
    within : float
        How many times its band sigma may be, and is still where its theorem allows it.
    source : tuple of Source
        Where it was published.
    """

    stage = "law"
    order: int | None = None
    r: int | None = None
    sees: Literal["sigma", "derivatives"] = "sigma"
    adaptive: bool = False
    continuous: bool = False
    channels: bool = False
    needs: str = ""
    guarantees: str = ""
    assumes: Function = None
    adapts: Function = None
    gain: str = ""
    describing: Function = None
    band: Function = None
    within: float = 1.0


class Baseline(Card):
    """Card of a law that is not of sliding mode control."""

    stage = "law"


class Surface(Card):
    """Card of a sliding variable."""

    stage = "surface"


class Differentiator(Card):
    """Card of a differentiator."""

    stage = "differentiator"


@dataclass(frozen=True, kw_only=True)
class Allocation(Card):
    """Card of an allocation: the inputs of the plant from the law's v.

    Parameters
    ----------
    assumes : function, optional
        What it assumes of the plant: it is given ``{name: value}`` and a list of outputs y of the
        run, and returns None, or the sentence that says which condition does not hold.
    source : tuple of Source
        Where it was published.
    """

    stage = "allocation"
    assumes: Function = None


class Actuator(Card):
    """Card of an actuator."""

    stage = "actuator"


class Plant(Card):
    """Card of a plant."""

    stage = "plant"


class Output(Card):
    """Card of what is measured of a plant."""

    stage = "output"


class Reference(Card):
    """Card of a command."""

    stage = "reference"


class Perturbation(Card):
    """Card of a perturbation."""

    stage = "perturbation"


class Stop(Card):
    """Card of what ends a run."""

    stage = "stop"


class Part(Card):
    """Card of a block that other blocks are built of."""
