"""Masks and live plots: the only home of ipywidgets, anywidget and plotly."""

from .board import Live, live
from .form import Mask, mask
from .panels import plot

__all__ = ["Live", "Mask", "live", "mask", "plot"]
