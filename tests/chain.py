"""The motion sigma' = xi - v on which the laws of first and second order are tested: blocks, runs,
transcription."""

import math

import numpy as np

from smcaero_nb import ClosedLoop, block, channels, simulate, smc1

STARTS = (-3.0, -1.0, -0.3, -0.01, 0.01, 0.3, 1.0, 3.0)
#: Perturbations within 1; where they are not constant, with derivatives within 1 too.
WAVES = (dict(a=0.0), dict(a=0.0, c=1.0), dict(a=0.0, c=-1.0), dict(a=1.0),
         dict(a=0.5, w=0.7, b=0.5, q=1.3))
TWO = dict(a=1.0, b=0.5)  # |xi| <= 1.5, |xi'| <= 2.5


@block(state=dict(sigma=1.0))
def motion(u, d):
    return (d - u,)


@block
def itself(x):
    return -x[0]


@block
def wave(t, c=0.0, a=0.0, w=1.0, b=0.0, q=3.0, change=1e9, then=0.0):
    return c + a*math.sin(w*t) + b*math.sin(q*t) if t < change else then*math.sin(t)


@block(state=dict(last=1.0))
def with_rate(e, z, tau):
    """sigma and its first difference, which is sigma' of the step before: what twisting needs,
    without a differentiator."""
    return (e, (e - z[0])/tau), (e,)


def loop(law, start=1.0, **xi):
    """The motion under a law, from sigma = start."""
    changes = {"plant__sigma": start, **{f"perturbation__{k}": v for k, v in xi.items()}}
    if law.name.endswith("twisting") and "super" not in law.name:
        changes.update(surface=with_rate, surface__last=start)
    return ClosedLoop(motion, output=itself, perturbation=wave, law=law).with_(**changes)


def sigma_of(run):
    """sigma of a run, also where the surface gives its derivative too."""
    return run.sigma[0] if isinstance(run.sigma, tuple) else run.sigma


def tail(run):
    """sum |sigma^(i)|^(1/(r - i)) over the tail: r = 2 where the surface gives the derivative too,
    else r = 1."""
    s = run.tail_peaks.sigma
    return math.inf if run.diverged_at else math.sqrt(s[0]) + s[1] if isinstance(s, tuple) else s


def slope(law, steps, starts=(1.0, -0.5, 0.3), **xi):
    """Slope of the greatest |sigma| of the tail over the step, both logarithmic."""
    tails = [max(np.ravel(simulate(loop(law, s, **xi), 100.0, h).tail_peaks.sigma)[0]
                 for s in starts) for h in steps]
    return np.polyfit(np.log(steps), np.log(tails), 1)[0]


def transcribed(step, memory, n, h, start, a=1.0, b=0.5):
    """sigma and v of n samples of a law written as ``v, memory = step(sigma, memory, h)``."""
    sigma, rows = start, []
    for k in range(n):
        v, memory = step(sigma, memory, h)
        rows.append((sigma, v))
        sigma = sigma + h*(a*math.sin(k*h) + b*math.sin(3.0*(k*h)) - v)
    return np.array(rows).T


# ---- two inputs: sigma' = xi - G u ---------------------------------------------------------------
@block(state=dict(a=3.0, b=4.0))
def pair(x, u, d, g_11=1.0, g_12=0.0, g_21=0.0, g_22=1.0):
    return d[0] - (g_11*u[0] + g_12*u[1]), d[1] - (g_21*u[0] + g_22*u[1])


@block
def outputs(x):
    return (-x[0],), (-x[1],)


@block
def waves(t, a=0.0, b=0.0):
    return a*math.cos(1.3*t), b*math.sin(2.0*t)


@block
def heads(e):
    return e[0][0], e[1][0]


def loop_of_two(law, start=(3.0, 4.0), G=((1.0, 0.0), (0.0, 1.0)), G0=((1.0, 0.0), (0.0, 1.0)),
                a=0.0, b=0.0):
    """Two motions that share their inputs, decoupled with G0."""
    g = dict(zip(("plant__g_11", "plant__g_12", "plant__g_21", "plant__g_22"), np.ravel(G).tolist(),
                 strict=True))
    two = ClosedLoop(pair, output=outputs, surface=heads, perturbation=waves, law=law,
                     allocation=smc1.decoupling(G0))
    return two.with_(plant__a=start[0], plant__b=start[1], perturbation__a=a, perturbation__b=b,
                     **g)


def signs(rho=2.0):
    """R SIGN(sigma)."""
    return channels(a=smc1.sign_smc.with_(rho=rho), b=smc1.sign_smc.with_(rho=rho))
