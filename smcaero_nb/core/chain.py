"""Chains: blocks in series in one stage of a loop."""

from .block import Block, Channels
from .param import Param

__all__ = ["Chain", "chain"]


class Chain(Channels):
    """Blocks in series, made by `chain`; each sees what the one before it gives."""

    name = "chain"

    @property
    def output(self) -> Param | tuple | None:
        """Metadata of what the last block returns, or of the last that declares some."""
        return next((b.output for b in reversed(self.parts.values()) if b.output), None)


def chain(**parts: Block) -> Chain:
    """Run blocks in series in one stage.

    The first sees the signals of the stage. To each of the others the signal that the stage passes
    on, y of a sensor, e of a differentiator or surface, v of an allocation, u of an actuator, x of
    an output, is what the block before it gives.

    Parameters
    ----------
    **parts : Block
        ``chain(noise=a, adc=b)``.

    Returns
    -------
    Chain
        Used as a block; its parameters are ``noise__std`` and so on.

    Raises
    ------
    BlockError
        A part that is not a block, or none at all.

    Examples
    --------
    >>> @block
    ... def offset(y, by=0.1):
    ...     return y + by
    >>> chain(first=offset, second=offset.with_(by=-0.1)).values
    {'first__by': 0.1, 'second__by': -0.1}
    """
    return Chain(parts)
