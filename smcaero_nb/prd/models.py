"""Step responses of models: plant blocks, loops, systems of python-control."""

import math
import sys
from typing import Any

import numpy as np

from ..core import Block, BlockError, ClosedLoop, ParameterError, block, simulate
from ..core.family import written
from ..core.leaves import heads
from ..core.linear import vector
from ..core.param import given
from ..core.signal import filled, shape
from ..core.writer import inputs
from ..core.zeros import of_run, unstable, zeros
from ..interop import matrices
from ..records import numbers
from .step_response import Record

__all__ = ["model", "responses"]

SAMPLES = 200  # in one window
REST, MOTION = 250, 260  # before and after the step
FINE = 2.0  # integration steps in the fastest time constant of a model, at least
COMPILED, PLAIN = 20000, 100  # at most in one sample


def model(owner, source):
    """Return the source if it is a model, else raise `ParameterError`."""
    control = sys.modules.get("control")  # who has a system of python-control has imported it
    names = ("TransferFunction", "StateSpace", "NonlinearIOSystem") if control else ()
    kinds = (Block, ClosedLoop, *(getattr(control, n) for n in names))
    if control and isinstance(source, control.FrequencyResponseData):
        matrices(source, owner)
    return given(owner, "source", source, kinds, "a plant block, a ClosedLoop, a control system, a "
                 "Record or (t, y, step_time, amplitude)")


def responses(source, output, surface, window, amplitude, x0):
    """Return records of a model as [output][input], and its zeros in the right half plane.

    Each input is stepped by itself, and the unforced motion is subtracted.
    """
    h = window/SAMPLES
    control = sys.modules.get("control")
    if isinstance(source, (Block, ClosedLoop)):
        name, runs, found = _block(source, output, surface, h, amplitude)
    elif control and isinstance(source, (control.TransferFunction, control.StateSpace)):
        if x0 is not None:
            raise ParameterError("prd.identify: x0 is for a NonlinearIOSystem that is not linear; "
                                 f"the response of {source.name} to a step does not depend on it")
        name, (runs, found) = source.name, _linear(source, h, amplitude)
    else:
        name, (runs, found) = source.name, _nonlinear(source, h, amplitude, x0)
    t = (np.arange(REST + MOTION) - REST)*h
    many = len(runs[0]) > 1 or len(runs) > 1

    def named(i, j):
        return f"{name}, input {j + 1} to output {i + 1}" if many else name

    return [[Record(t, y, 0.0, amplitude, name=named(i, j)) for j, y in enumerate(row)]
            for i, row in enumerate(np.swapaxes(runs, 0, 1))], unstable(found)


def _finer(name, f, x, h, most):
    """Return the integration steps per sample that the fastest mode of x' = f(x) needs at first."""
    rate, steps = f(x), 1e-6*(1.0 + np.abs(x))
    jacobian = np.column_stack([(f(x + s*e) - rate)/s
                                for s, e in zip(steps, np.eye(len(x)), strict=True)])
    fastest = np.abs(np.linalg.eigvals(jacobian)).max() if np.isfinite(jacobian).all() else 0.0
    if FINE*h*fastest > most:
        raise ParameterError(f"prd.identify: window = {SAMPLES*h:.3g} s is not allowed for {name}, "
                             f"whose fastest time constant is {1/fastest:.3g} s; it must be at "
                             f"most {SAMPLES*most/FINE/fastest:.3g} s")
    return max(1, math.ceil(FINE*h*fastest))


def _diverged(name, since):
    """The error for a model that does not stay finite."""
    if since > 0.0:
        why = f"diverges {since:.3g} s after the step; take a shorter window or a smaller amplitude"
    else:
        why = "does not stay finite even before the step; check its equations and initial state"
    return ParameterError(f"prd.identify: {name} {why}")


# ---- each gives [input][output] of arrays of REST + MOTION samples, and the zeros ----------------
def _linear(source, h, amplitude):
    """Respond exactly at the samples."""
    from scipy.linalg import expm  # slow to import, so only here

    A, B, C, D, _ = matrices(source, "prd.identify")
    n, m = B.shape
    ys = np.zeros((m, len(C), REST + MOTION))
    x = np.zeros((n, m))
    with np.errstate(all="ignore"):
        E = expm(np.block([[A, B], [np.zeros((m, n + m))]])*h)
        for k in range(MOTION):  # all inputs at once, one a column
            ys[:, :, REST + k] = (C @ x + D).T*amplitude
            x = E[:n, :n] @ x + E[:n, n:]
    if len(wrong := np.flatnonzero(~np.isfinite(ys).all(axis=(0, 1)))):
        raise _diverged(source.name, (wrong[0] - REST)*h)
    return ys, zeros(A, B, C, D)


def _nonlinear(source, h, amplitude, x0):
    """Run the system as a block from `x0`, plain: a compiler does not know its code."""
    if not (source.nstates and source.ninputs and source.isctime()):
        raise ParameterError(f"prd.identify: source '{source.name}' has no states, no inputs or is "
                             "discrete-time; it must have both, and be continuous. A record of "
                             "its step response is a source, too: (t, y, step_time, amplitude)")
    x0 = np.zeros(source.nstates) if x0 is None else numbers("prd.identify", "x0", x0)
    if x0.shape != (source.nstates,):
        raise ParameterError(f"prd.identify: x0 has the shape {x0.shape}; source '{source.name}' "
                             f"has {source.nstates} states")

    def motion(t, x, u, d):
        if np.size(u) != source.ninputs:
            raise ValueError(f"{source.ninputs} inputs")
        return tuple(map(float, source.dynamics(t, np.array(x), np.atleast_1d(u))))

    def output(t, x, u):
        y = np.atleast_1d(source.output(t, np.array(x), np.atleast_1d(u)))
        return tuple((float(q),) for q in y) if len(y) > 1 else float(y[0])

    try:
        motion(0.0, x0, np.zeros(source.ninputs), 0.0)
        output(0.0, x0, np.zeros(source.ninputs))
    except Exception as why:
        raise BlockError(f"source '{source.name}' cannot be evaluated at its initial state: "
                         f"{type(why).__name__}: {why}") from why
    motion.__name__ = source.name
    plant = block(state={f"x{i}": v for i, v in enumerate(x0.tolist())})(motion)
    return _block(plant, block(output), None, h, amplitude, PLAIN)[1:]


def _block(source, output, surface, h, amplitude, most=COMPILED):
    """Run the block in its loop, with the step in place of the law, by Runge-Kutta of order 4.

    It is compiled where there are many steps.
    """
    plant: Any = source
    if isinstance(source, ClosedLoop):
        stages, plant = source.stages, source.stages["plant"]
        output = stages["output"] if output is None else output
        surface = stages["surface"] if surface is None else surface
    else:
        output = getattr(source, "y", None) if output is None else output
    u, d = inputs(plant)
    m = len(u) if isinstance(u, tuple) else 1
    first = m == 1 and output is None and surface is None  # of the states
    form = shape(plant.z0)

    def rate(x):
        at = {"t": 0.0, "x": filled(form, iter(x.tolist())), "u": u, "d": d}
        return vector(plant(*(at[n] for n in plant.signals)))

    finer = _finer(plant.name, rate, vector(plant.z0), h, most)
    heights = [f"u_{j}" for j in range(m)]
    step = written("step", f"t, start=0.0, {', '.join(f'{q}=0.0' for q in heights)}",
                   "on = 1.0 if t >= start else 0.0\n"
                   f"return {', '.join(f'on*{q}' for q in heights)}",
                   {"__name__": __name__})
    loop = ClosedLoop(plant, output=output, surface=surface,
                      law=block(step).with_(start=(REST - 0.5)*h),
                      perturbation=block(lambda t: d))

    def moved(**height):
        run = simulate(loop.with_(**height), (REST + MOTION)*h, h/finer, h, method="rk4",
                       record=REST + MOTION,
                       jit=finer > 4 and most > PLAIN)
        if run.diverged_at is not None:
            raise _diverged(plant.name, run.diverged_at - REST*h)
        seen = "y" if surface is None else "sigma"
        outputs = heads(run.leaves(seen), getattr(run, seen))
        return run, np.array(outputs[:1] if first else outputs)[:, :REST + MOTION]

    run, free = moved()
    return (plant.name, [moved(**{f"law__u_{j}": amplitude})[1] - free for j in range(m)],
            of_run(run))
