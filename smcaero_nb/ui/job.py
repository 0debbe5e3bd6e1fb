"""Work in a thread of its own, the newest request first; its progress bar, and a button that cancels it."""

import math
import threading
import time

import ipywidgets as W

__all__ = ["RAISED", "Dropped", "Job", "Newest", "interrupted"]

RAISED = (Exception, SystemExit, GeneratorExit)  # what a block may raise and a mask says


class Dropped(Exception):
    """A job that was cancelled, or overtaken by a newer one."""


def interrupted(error):
    """Whether it is Ctrl-C, which comes in the main thread only; elsewhere a block raised it."""
    main = threading.current_thread() is threading.main_thread()
    return isinstance(error, KeyboardInterrupt) and main


class _Idle:
    """Whether a worker has nothing left to do: no Event, which Ctrl-C may leave locked."""

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
    """Does the newest of the jobs it is given, in a thread of its own; older ones are dropped.

    Where no thread can start, it does them in the calling one. Each change of state is one
    assignment, so that Ctrl-C leaves no job half asked for.

    Parameters
    ----------
    do : callable
        ``do(job, progress)`` does one; it calls ``progress(fraction)`` often, which raises Dropped
        where it is to end, and ``progress()`` first, for one that was cancelled before it began.
    rest : callable
        Called when there is nothing more to do.

    Attributes
    ----------
    asked, done, cancelled : tuple or None
        The newest job asked for, the last one done, and the one up to which all are cancelled, each
        in a tuple of its own.
    fraction : float or None
        Of the job at work.
    """

    NEARLY = 0.2  # s: an overtaken job that will be done within this is not dropped, so that a drag keeps drawing

    def __init__(self, do, rest):
        self.do, self.rest, self.working, self.idle = do, rest, threading.Lock(), _Idle(self)
        self.asked = self.done = self.cancelled = self.fraction = self._taken = self._thread = None

    @property
    def pending(self):
        """Whether a job is not done yet."""
        return self.asked is not self.done

    @property
    def job(self):
        """The job that waits for another one to end, or None."""
        waits = self.pending and self.asked is not self._taken
        return self.asked[0] if waits else None

    @property
    def here(self):
        """Whether this is called by the job at work."""
        return self.working.locked() and self._thread == threading.get_ident()

    def ask(self, job):
        """Do `job` as soon as possible, instead of all asked for before."""
        self.asked = (job,)
        self.start()

    def cancel(self):
        """Drop the job at work, and the one waiting."""
        self.cancelled = self.asked

    def start(self):
        """Have what is asked for done, if nobody is at it."""
        if not self.pending or self.working.locked():  # who is at it looks again when done
            return
        try:
            threading.Thread(target=self._work, daemon=True).start()
        except RuntimeError:  # no thread can start: in a browser's Python, on a restricted host
            self._work_here()

    def _work_here(self):
        """Do it in this thread, where Ctrl-C may come at any moment."""
        try:
            self._work()
        except KeyboardInterrupt:
            self.cancel()
            self._work()  # which says so
            raise

    def _work(self):
        while self.pending:
            with self.working:  # held by who works, and let go however that ends
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
                raise Dropped("cancelled")
            if fraction is not None:
                self.fraction = fraction
                left = (time.perf_counter() - began)*(1/max(fraction, 1e-9) - 1)
                if self.asked is not asked and left > self.NEARLY:
                    raise Dropped("overtaken")

        try:
            self.do(asked[0], progress)
        except Exception:  # not to be tried for ever
            self.done = asked
            raise
        self.done = asked


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
