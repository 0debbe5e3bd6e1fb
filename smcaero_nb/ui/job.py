"""Work in a thread of its own, with a progress bar and a button that cancels it."""

import math
import time

import ipywidgets as W

from .worker import Newest

__all__ = ["Job"]


class Job(W.HBox):
    """Progress bar and Cancel of what is done for a widget; a newer request takes the place of the one at work.

    Parameters
    ----------
    do : callable
        ``do(asked, progress)``; it calls ``progress(fraction)`` often, which raises `Dropped` where it is to end.
    """

    def __init__(self, do):
        self.bar = W.FloatProgress(max=1.0, layout=W.Layout(width="auto", flex="1 1 auto"))
        self.stop = W.Button(description="Cancel", icon="stop", tooltip="Stop this run")
        self.stop.on_click(lambda _: self.cancel())
        super().__init__([self.bar, self.stop], layout=W.Layout(visibility="hidden"))
        self.add_class("smcaero-busy")
        self._do, self.worker = do, Newest(self._work, self._hide)

    @property
    def here(self):
        """Whether this is called by what is at work, which does not wait for itself."""
        return self.worker.here

    def ask(self, asked, patience):
        """Do it; return whether it was done within `patience` [s]. If not, it goes on by itself, with a bar; Ctrl-C ends it."""
        self.worker.ask(asked)
        if self._waited(patience):
            return True
        self.layout.visibility = "visible"
        if self.worker.idle.is_set():  # just now
            self._hide()
        return self.worker.idle.is_set()

    def wait(self):
        """Wait until nothing is left to do; Ctrl-C cancels it."""
        self._waited(math.inf)

    def _waited(self, patience):
        try:
            return self.worker.idle.wait(patience)
        except KeyboardInterrupt:
            self.cancel()
            raise

    def cancel(self):
        """Stop what is at work."""
        self.worker.cancel()

    def _hide(self):
        self.layout.visibility = "hidden"

    def _work(self, asked, progress):
        told = [0.0]

        def watched(*fraction):
            progress(*fraction)
            now = time.perf_counter()
            if fraction and now - told[0] > 0.1:
                told[0], self.bar.value = now, fraction[0]

        self._do(asked, watched)
