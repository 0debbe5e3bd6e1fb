"""Loops that people bring, with answers that this code did not make."""

import math

import control
import numpy as np
import pytest

import smcaero_nb as smc
from smcaero_nb import ClosedLoop, block, channels, simulate


def sign(q):
    return (q > 0.0)*1.0 - (q < 0.0)*1.0


@pytest.mark.parametrize("method", ["euler", "rk4"])
@pytest.mark.parametrize("dt", [1e-3, 1e-4, 1e-5])
def test_two_equations_that_switch_on_one_surface_slide_as_filippov_says(dt, method):
    """s = x - y falls at 3.5 and rises at 5: from s = 0 on x' = -2 + 4*3.5/8.5."""
    @block(state=dict(a=1.5, b=1.0))
    def pair(x):
        above = x[0] > x[1]
        return (-2.0 if above else 2.0), (1.5 if above else -3.0)

    run = simulate(ClosedLoop(pair, duration=1.0, dt=dt), method=method)
    right = 1.5 - 2.0/7.0 - 6.0/17.0*(1.0 - 1.0/7.0)
    assert abs(run.x.a[-1] - right) < 5.0*dt and abs(run.x.b[-1] - right) < 5.0*dt


def test_a_hysteresis_beside_a_decay_misses_no_switch():
    two = block(state=dict(a=1.0, b=1.0))(lambda x, u: (u, -x[1]))
    law = block(state=dict(direction=-1.0))(
        lambda y, z: ((s := -1.0 if y >= 1.0 else 1.0 if y <= -1.0 else z[0]), (s,)))
    run = simulate(ClosedLoop(two, output=block(lambda x: x[0]), law=law, duration=5.0, dt=1e-4))
    assert abs(run.x.a[-1]) < 5e-4 and abs(run.x.b[-1] - math.exp(-5.0)) < 1e-5


def test_a_short_pulse_after_a_long_rest_is_not_missed():
    g = control.tf([1.0], [1.0, 1.0, 1.0])
    plant = smc.interop.from_control(g)
    pulse = block(lambda t: 1.0 if 3.0 - 1e-9 <= t < 3.1 - 1e-9 else 0.0)
    run = simulate(ClosedLoop(plant, output=plant.y, law=pulse, duration=10.0, dt=1e-3),
                   record=10_000)
    t = run.t - 3.0
    w = math.sqrt(0.75)

    def stepped(t):
        t = np.maximum(t, 0.0)
        return 1.0 - np.exp(-0.5*t)*(np.cos(w*t) + 0.5/w*np.sin(w*t))

    np.testing.assert_allclose(run.y, stepped(t) - stepped(t - 0.1), atol=1e-9)


def test_an_observer_that_knows_u_finds_the_speed():
    """Generalised super-twisting of Moreno, k_1 = 3, k_2 = 4.4; |delta| <= 0.8."""
    plant = block(state=dict(x1=1.0, x2=-0.5))(lambda x, u, d: (x[1], u + d))
    push = block(lambda t: 0.8*math.sin(2.0*t))
    feedback = block(lambda e: 2.0*e[0] + 3.0*e[1])

    @block(state=dict(z1=0.0, z2=0.0))
    def observer(e, u, z, tau):
        z1, z2 = z
        s = z1 - e
        root = math.sqrt(abs(s))*sign(s)
        return (z1, z2), (z1 + tau*(z2 - 3.0*(root + s)),
                          z2 + tau*(-u - 4.4*(0.5*sign(s) + 1.5*root + s)))

    wrong = []
    for tau in (1e-3, 1e-4):
        run = simulate(ClosedLoop(plant, output=block(lambda x: x[0]), differentiator=observer,
                                  law=feedback, perturbation=push, duration=10.0, dt=tau))
        wrong.append(np.abs(run.z.differentiator.z2 + run.x.x2)[run.t > 5.0].max())
    assert wrong[0] < 0.02 and 5.0 < wrong[0]/wrong[1] < 20.0  # of the order of tau


M, G, J = 0.65, 9.81, (7.5e-3, 7.5e-3, 1.3e-2)


@block(state=dict(h=(0.0, 0.0), angles=(0.3, -0.2, 0.1), rates=(0.0, 0.0, 0.0),
                  forces=(M*G, 0.0, 0.0, 0.0)))
def quadrotor(x, u, lag=0.05):
    (_, climb), (phi, th, _), (p, q, r), (T, L, N, K) = x
    sp, cp, st, ct = math.sin(phi), math.cos(phi), math.sin(th), math.cos(th)
    return ((climb, cp*ct*T/M - G),
            (p + sp*st/ct*q + cp*st/ct*r, cp*q - sp*r, (sp*q + cp*r)/ct),
            (((J[1] - J[2])*q*r + L)/J[0], ((J[2] - J[0])*p*r + N)/J[1],
             ((J[0] - J[1])*p*q + K)/J[2]),
            ((u[0] - T)/lag, (u[1] - L)/lag, (u[2] - N)/lag, (u[3] - K)/lag))


def test_a_quadrotor_follows_and_a_rotor_that_lags_is_said():
    """Super-twisting at 250 Hz; rotors of 50 ms make it swing, as a plain loop of numpy does."""
    sta, line = smc.smc2.super_twisting.with_(lam=3.0, beta=4.0), block(lambda e: e[1] + 3.0*e[0])
    names = ("h", "a", "b", "c")
    loop = ClosedLoop(
        quadrotor, duration=10.0, dt=5e-4, tau=4e-3,
        output=block(lambda x: ((x[0][0], x[0][1]), (x[1][0], x[2][0]), (x[1][1], x[2][1]),
                                (x[1][2], x[2][2]))),
        reference=block(lambda t: ((1.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0))),
        surface=channels(**dict.fromkeys(names, line)), law=channels(**dict.fromkeys(names, sta)),
        allocation=block(lambda v: (M*(v[0] + G), J[0]*v[1], J[1]*v[2], J[2]*v[3])))
    good, slow = (simulate(loop.with_(plant__lag=lag), method="rk4") for lag in (1e-3, 0.05))
    assert max(good.metrics().tail_e) < 1e-4 and good.doubts() == []
    said = slow.doubts()
    assert np.allclose(slow.metrics().tail_e, 6.5e-4, atol=1e-4)  # 0.0006 in the plain loop
    assert [q[:2] for q in said] == ["h:", "a:", "b:", "c:"] and all("does not" in q for q in said)
