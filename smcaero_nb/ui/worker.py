"""A thread that does the newest of its jobs."""

import threading
import time

__all__ = ["Dropped", "Newest"]


class Dropped(Exception):
    """A job that was cancelled, or overtaken by a newer one."""


class Newest:
    """Does the newest of the jobs it is given, in a thread of its own; older ones are dropped.

    Parameters
    ----------
    do : callable
        ``do(job, progress)`` does one; it calls ``progress(fraction)`` often, which raises `Dropped` where it is to end.
    rest : callable
        Called, with the lock held, when there is nothing more to do.
    """

    NEARLY = 0.2  # s: an overtaken job that will be done within this is not dropped, so that a drag keeps drawing

    def __init__(self, do, rest):
        self.do, self.rest, self.lock, self.idle = do, rest, threading.RLock(), threading.Event()
        self.job, self.cancelled, self.fraction = None, False, None
        self.idle.set()

    def ask(self, job):
        """Do `job` as soon as possible, instead of all asked for before."""
        with self.lock:
            self.job = job
            if self.idle.is_set():
                self.idle.clear()
                threading.Thread(target=self._work, daemon=True).start()

    def cancel(self):
        """Drop the job at work, and the one waiting."""
        with self.lock:
            self.job, self.cancelled = None, True

    def _work(self):
        while True:
            with self.lock:
                if self.job is None:
                    self.rest()
                    self.idle.set()
                    return
                job, self.job, self.cancelled, self.fraction = self.job, None, False, None
            began = time.perf_counter()

            def progress(fraction, began=began):
                self.fraction = fraction
                left = (time.perf_counter() - began)*(1/max(fraction, 1e-9) - 1)
                if self.cancelled or self.job is not None and left > self.NEARLY:
                    raise Dropped("cancelled" if self.cancelled else "overtaken")

            self.do(job, progress)
