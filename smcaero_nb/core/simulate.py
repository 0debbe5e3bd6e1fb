"""Simulation: check the request, then run the loop in chunks of steps."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from .build import built
from .exact import constants
from .loop import ClosedLoop
from .param import (
    Param,
    ParameterError,
    chosen,
    function,
    given,
    listed,
    positive,
    refused,
    switch,
)
from .program import Program, methods, paths
from .run import Run, result
from .signal import flat

__all__ = ["simulate", "timed"]

CHUNK = 0.02  # s of machine time between two looks at Ctrl-C, cancel and progress
ROWS = 100_000_000  # maximum number of rows of a run
MOST = 100_000  # maximum number of samples of a latency
STEPS = 1e11  # maximum number of steps of a run
RECORD, SINCE, TAIL = Param(low=1), Param(low=0.0, unit="s"), Param(low=0.0, high=1.0)


def timed(owner: str, loop: Any, duration: Any, dt: Any, tau: Any) -> tuple[Any, float, float]:
    """Return duration (or None), dt and tau [s]: those given, otherwise the loop's own."""
    given(owner, "loop", loop, ClosedLoop, "a ClosedLoop, such as lv.loop() makes")
    duration, dt, tau = (getattr(loop, n) if v is None else positive(owner, n, v)
                         for n, v in dict(duration=duration, dt=dt, tau=tau).items())
    if dt is None:
        raise ParameterError(f"{owner}: dt [s] is not given, and the loop has none of its own")
    return duration, dt, dt if tau is None else tau


def simulate(loop: ClosedLoop, duration: float | None = None, dt: float | None = None,
             tau: float | None = None, *, method: str | None = None, record: int = 2000,
             since: float = 0.0, tail: float = 0.2, jit: bool = True,
             progress: Callable[[float], Any] | None = None) -> Run:
    r"""Run a closed loop: the controller acts every `tau`, the plant is integrated with `dt`.

    Parameters
    ----------
    loop : ClosedLoop
    duration, dt, tau : float
        Simulated time (to the nearest step), integration step, sampling step (a multiple of `dt`;
        default `dt`) [s]; default: the loop's own.
    method : str, optional
        ``"euler"``, ``"midpoint"``, ``"rk4"``, or for plants of `interop.from_control` ``"exact"``.
        Default: ``"exact"`` for these, ``"euler"`` for all others.
    record : int
        Approximate number of rows kept, at least 1; sums, maxima and variations use every step in
        any case.
    since : float
        Time of the first row [s]: a run that is repeated up to the end of a stretch, with the rows
        of that stretch alone, shows it at full resolution.
    tail : float
        Fraction of the run, at its end, that the tail figures cover.
    jit : bool
        False runs the same loop as plain Python: slow, for breakpoints in blocks.
    progress : callable, optional
        Called with the fraction done (0 to 1) at least every 50 ms of machine time or so; an
        exception that it raises ends the run.

    Returns
    -------
    Run
        Its valid part, with `Run.diverged_at` set, if it diverged.

    Raises
    ------
    ParameterError
        Something other than a `ClosedLoop`; a time, method, switch or number of rows that is not
        allowed.
    BlockError
        A block that does not fit its stage, fails at t = 0 or cannot be compiled.

    Notes
    -----
    Ctrl-C acts between two chunks of steps, about every 20 ms. The result does not
    depend on the chunks.

    The exact step of x' = A x + B (u + d) is

    .. math:: x(t + dt) = x + \int_0^{dt} e^{A s}\,ds\ \dot x

    with u and d held. It has no error where the perturbation is constant over a step: without one,
    with one that has memory, or with a constant. One that depends on t or x is taken at the middle
    of the step, with an error of the order dt^2 in what it does; the motion of the plant itself
    stays exact at any dt, however stiff or lightly damped.
    """
    duration, dt, tau = timed("simulate", loop, duration, dt, tau)
    if duration is None:
        raise ParameterError(
            "simulate: duration [s] is not given, and the loop has none of its own")
    jit, progress = switch("simulate", "jit", jit), function("simulate", "progress", progress)
    m, n, lag = _steps(loop, duration, dt, tau)
    method = _method(loop, method)
    record = RECORD.check("simulate", "record", record, int)
    since = SINCE.check("simulate", "since", since)
    if since > duration:
        raise refused("simulate", "since", since, f"at most the duration, {duration:g} s", "s")
    tail = TAIL.check("simulate", "tail", tail)
    if min(record, n) > ROWS:
        raise refused("simulate", "record", record, f"at most {ROWS:g}, as there are {n:g} steps")
    if jit:
        from numba import config

        jit = not config.DISABLE_JIT  # pyright: ignore[reportAttributeAccessIssue]
    f, program = built(loop, method, m*dt, m, lag, jit)
    first, k_tail = min(round(since/dt), n), n - round(n*tail)
    every = max(-(-(n - first)//record), 1)
    rec = np.empty((-(-(n - first)//every) + 1, len(program.columns)))
    rec, end, before, k, stopped, diverged = _driven(
        f, program, loop, rec, dt, m, n, every, first, k_tail, jit, progress)
    return result(loop, program, rec, end, before, k, k_tail, dt, m, method, stopped, diverged)


def _method(loop: ClosedLoop, method: str | None) -> str:
    """The method asked for, otherwise the plant's own."""
    allowed = methods(loop)
    if isinstance(method, str) and method == "exact" and method not in allowed:
        raise ParameterError(
            "simulate: method = 'exact' is not allowed for plant "
            f"'{loop.stages['plant'].name}'; it is for linear plants made by interop.from_control. "
            f"It must be {listed(allowed)}")
    return chosen("simulate", "method", allowed[0] if method is None else method, allowed)


def _steps(loop: ClosedLoop, duration: float, dt: float, tau: float) -> tuple[int, int, int]:
    """Check times against one another; return the steps per sample, run and latency."""
    longest = max(tau, duration, loop.latency)
    if not longest/dt <= STEPS:
        raise ParameterError(f"simulate: dt = {dt:g} s is not allowed; {longest:g} s would take "
                             f"{longest/dt:.3g} steps; at most {STEPS:g}, half an hour of "
                             "computing or so, are allowed; give a larger dt or a shorter "
                             "duration")
    m, n, lag = round(tau/dt), round(duration/dt), round(loop.latency/dt)
    if m < 1 or abs(m*dt - tau) > 1e-9*tau:
        raise ParameterError(f"simulate: tau = {tau:g} s is not allowed; it must be a multiple of "
                             f"dt = {dt:g} s")
    if abs(lag*dt - loop.latency) > 1e-9*loop.latency or lag > MOST*m:
        raise ParameterError(f"simulate: latency = {loop.latency:g} s is not allowed; it must be "
                             f"a multiple of dt = {dt:g} s, of at most {MOST} samples of {tau:g} s")
    if lag >= n and lag:
        raise ParameterError(f"simulate: latency = {loop.latency:g} s is not allowed; it must be "
                             f"less than the duration of {duration:g} s, or no control ever acts")
    if duration < tau*(1 - 1e-9):
        raise ParameterError(f"simulate: duration = {duration:g} s is not allowed; it must be at "
                             f"least tau = {tau:g} s")
    for path, block in (q for stage, b in loop.stages.items() for q in paths(stage, b)):
        for name, meta in block.params.items():
            for v in flat(block.values[name]) if meta.samples else ():
                count = v/tau
                if not 0.5 < count < 1e15 or abs(count - round(count)) >= 1e-9*count:
                    raise ParameterError(f"simulate: {path}__{name} = {v:g} s is not allowed; it "
                                         f"must be a multiple of tau = {tau:g} s")
    return m, n, lag


def _driven(f: Callable, program: Program, loop: ClosedLoop, rec: np.ndarray, dt: float, m: int,
            n: int, every: int, row: int, k_tail: int, jit: bool,
            progress: Callable | None) -> tuple:
    """Run a loop in chunks; return records, figures at the end and before the tail, and the end."""
    values = dict(zip(program.params, loop.numbers(), strict=True))
    held = np.array if jit else list  # plain blocks see floats, not those of numpy
    P = held([*map(float, values.values()), *constants(program, loop, dt)])
    x, z = loop.start()
    S, R = held([*(program.state | x | z).values()]), held(program.ring(values))
    names, chunk = [*program.state], 1000 if jit else 20
    peaks = [i for i, q in enumerate(program.state) if q.startswith("max_")]
    before = dict.fromkeys(names, 0.0)
    k = sample = line = 0
    diverged, planned = False, n
    while k <= n and not diverged:
        stop = min(k + chunk, k_tail if k < k_tail else n + 1)
        began, first = time.perf_counter(), k
        k, sample, row, line, n, diverged = f(
            S, P, R, rec, dt, m*dt, m, every, n, k, stop, sample, row, line)
        if k == k_tail and first < k:
            before = dict(zip(names, map(float, S), strict=True))
            for i in peaks:
                S[i] = 0.0
        chunk = max(1, int((k - first)*min(8.0, CHUNK/max(time.perf_counter() - began, 1e-6))))
        if progress:
            progress(min(k/n, 1.0) if n else 1.0)
    end = dict(zip(names, map(float, S), strict=True))
    return rec[:line], end, before, min(k, n), n < planned, diverged
