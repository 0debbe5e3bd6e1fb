"""Work in a thread of its own, newest request first, with a progress bar and a Cancel button."""

import math
import threading
import time
from collections.abc import Callable
from typing import Any

import ipywidgets as W

__all__ = ["RAISED", "Cancelled", "Job", "Newest", "Overtaken", "interrupted"]

RAISED = (Exception, SystemExit, GeneratorExit)  # what a block may raise and a mask reports


class Cancelled(Exception):
    """Ends a job that was cancelled."""


class Overtaken(Exception):
    """Ends a job that was overtaken by a newer one."""


def interrupted(error: BaseException) -> bool:
    """Return whether a person pressed Ctrl-C; outside the main thread a block raised it."""
    main = threading.current_thread() is threading.main_thread()
    return isinstance(error, KeyboardInterrupt) and main


class _Idle:
    """Whether a worker has nothing left to do; not an Event, which Ctrl-C may leave locked."""

    def __init__(self, worker):
        self.worker = worker

    def is_set(self):
        """Return whether nothing is left to do."""
        return not (self.worker.pending or self.worker.working.locked())

    def wait(self, patience=math.inf):
        """Wait up to `patience` [s]; return whether all is done. A job does not wait for itself."""
        began = time.monotonic()
        while not self.is_set():
            self.worker.start()
            waited = time.monotonic() - began
            if waited >= patience or self.worker.here:
                return self.is_set()
            time.sleep(min(max(waited/20, 5e-4), 0.02, patience - waited))
        return True


class Newest:
    """Do the newest of the jobs given, in a thread of its own; older ones are dropped.

    Where no thread can start, jobs are done in the calling one. Each change of state is one
    assignment, so that Ctrl-C leaves no job half requested.

    Parameters
    ----------
    do : callable
        ``do(job, progress)`` does one job. It calls ``progress()`` first, in case the job was
        cancelled before it began, and ``progress(fraction)`` often; when the job has to end, these
        raise `Cancelled` or `Overtaken`.
    rest : callable
        Called when there is nothing more to do.

    Attributes
    ----------
    asked, done, cancelled : tuple or None
        The newest job requested, the last one done, and the one up to which all are cancelled, each
        in a tuple of its own.
    fraction : float or None
        How much of the current job is done.
    """

    # s: an overtaken job that needs less than this is finished, so that a drag keeps drawing
    NEARLY = 0.2

    def __init__(self, do: Callable[[Any, Callable], object], rest: Callable[[], object]):
        self.do, self.rest = do, rest
        self.working, self.idle = threading.Lock(), _Idle(self)
        self.asked: tuple | None = None
        self.done: tuple | None = None
        self.cancelled: tuple | None = None
        self.fraction: float | None = None
        self._taken = self._thread = None

    @property
    def pending(self) -> bool:
        """Whether a job is not done yet."""
        return self.asked is not self.done

    @property
    def job(self) -> Any:
        """The job that waits for another one to end, or None."""
        asked, waits = self.asked, self.pending and self.asked is not self._taken
        return asked[0] if asked and waits else None

    @property
    def here(self) -> bool:
        """Whether the caller is the current job."""
        return self.working.locked() and self._thread == threading.get_ident()

    def ask(self, job: Any) -> None:
        """Do `job` as soon as possible, instead of all jobs requested before."""
        self.asked = (job,)
        self.start()

    def cancel(self) -> None:
        """Drop the current job and the one waiting."""
        self.cancelled = self.asked

    def start(self) -> None:
        """Start the work that is requested, unless it is under way."""
        if not self.pending or self.working.locked():  # the thread at work looks again when done
            return
        try:
            threading.Thread(target=self._work, daemon=True).start()
        except RuntimeError:  # no thread can start: in a browser's Python, on a restricted host
            self._work_here()

    def _work_here(self):
        """Work in this thread, where Ctrl-C may come at any moment."""
        try:
            self._work()
        except KeyboardInterrupt:
            self.cancel()
            self._work()  # which reports it
            raise

    def _work(self):
        while self.pending:
            with self.working:  # released however the work ends
                self._thread = threading.get_ident()
                while self.pending:
                    self._one(self.asked)
                self.rest()
        if self.idle.is_set():
            self.rest()  # once more: a bar may have been shown just before the end

    def _one(self, asked):
        """Do one job."""
        self._taken, self.fraction, began = asked, None, time.perf_counter()

        def progress(fraction=None):
            if self.cancelled is self.asked:
                raise Cancelled
            if fraction is not None:
                self.fraction = fraction
                left = (time.perf_counter() - began)*(1/max(fraction, 1e-9) - 1)
                if self.asked is not asked and left > self.NEARLY:
                    raise Overtaken

        try:
            self.do(asked[0], progress)
        except Exception:  # not to be tried again and again
            self.done = asked
            raise
        self.done = asked


class Job(W.HBox):
    """Run a widget's work in a thread, with a progress bar and a Cancel button.

    A newer request replaces the running one.

    Parameters
    ----------
    do : callable
        ``do(asked, progress)``, as in `Newest`.
    """

    def __init__(self, do: Callable[[Any, Callable], object]):
        self.bar = W.FloatProgress(max=1.0, layout=W.Layout(width="auto", flex="1 1 auto"))
        self.stop = W.Button(description="Cancel", icon="stop", tooltip="Stop this run")
        self.stop.on_click(lambda _: self.cancel())
        super().__init__([self.bar, self.stop], layout=W.Layout(visibility="hidden"))
        self.add_class("smcaero-busy")
        self._do, self.worker = do, Newest(self._work, self._hide)

    @property
    def here(self) -> bool:
        """Whether the caller is the work itself, which does not wait for itself."""
        return self.worker.here

    def ask(self, asked: Any, patience: float) -> bool:
        """Do it; return whether it was done within `patience` [s].

        If not, it goes on by itself, with a bar. Ctrl-C ends it.
        """
        self.worker.ask(asked)
        if self._waited(patience):
            return True
        self.layout.visibility = "visible"
        if self.worker.idle.is_set():  # just now
            self._hide()
        return self.worker.idle.is_set()

    def wait(self) -> None:
        """Wait until nothing is left to do; Ctrl-C cancels it."""
        self._waited(math.inf)

    def _waited(self, patience):
        try:
            return self.worker.idle.wait(patience)
        except KeyboardInterrupt:
            self.cancel()
            raise

    def cancel(self) -> None:
        """Stop the current work."""
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
