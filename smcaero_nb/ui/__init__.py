"""Masks and live plots: the only home of ipywidgets, anywidget and plotly."""

from .figures import plot
from .files import transfer_function, upload
from .lander import Flight, flight
from .live import Live, live
from .mask import Mask, mask
from .studies import Certificate, Compare, certificate, compare

__all__ = ["Certificate", "Compare", "Flight", "Live", "Mask", "certificate", "compare", "flight",
           "live", "mask", "plot", "transfer_function", "upload"]
