"""Masks and live plots: the only home of ipywidgets, anywidget and plotly."""

from .board import Live, live
from .form import Mask, mask
from .panels import plot
from .studies import Certificate, Compare, certificate, compare

__all__ = ["Certificate", "Compare", "Live", "Mask", "certificate", "compare", "live", "mask", "plot"]
