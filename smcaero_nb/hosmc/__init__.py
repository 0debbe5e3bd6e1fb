"""Higher-order sliding mode control: sigma^(r) = xi - v, sigma and its derivatives to zero."""

from .adaptive_continuous import adaptive_continuous
from .integrated import integrated
from .nested import nested
from .quasi_continuous import quasi_continuous

__all__ = ["adaptive_continuous", "integrated", "nested", "quasi_continuous"]
