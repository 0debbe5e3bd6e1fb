"""Masks and live plots: the only home of ipywidgets, anywidget and plotly."""

from .board import Live, live
from .charts import plot
from .flight import Flight, flight
from .form import Mask, mask
from .own import transfer_function, upload
from .studies import Certificate, Compare, certificate, compare

__all__ = ["Certificate", "Compare", "Flight", "Live", "Mask", "certificate", "compare", "flight", "live", "mask", "plot",
           "transfer_function", "upload"]
