"""The lander: plant, command, pulses, what momentum forbids, landings and what breaks them."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from published import LANDER_PRD, TABLE_1, TABLE_2

import smcaero_nb as smc
from smcaero_nb import ParameterError, rpl, simulate

DEG = math.pi/180
T, M, G = 240.0, 1000.0, 1.6
SLIDING = ["adaptive_smc", "adaptive_super_twisting", "hosm"]


@pytest.fixture(scope="module")
def flights():
    """Runs of the documented descent with a row a sample, each simulated once."""
    made = {}

    def fly(law, preset="recommended", stop=True, **changes):
        key = law, preset, stop, *changes.items()
        if key not in made:
            loop = rpl.loop(law, preset).with_(**changes)
            made[key] = simulate(loop if stop else loop.with_(stop=None), record=4800)
        return made[key]

    return fly


def starts(n, seed=0):
    """Uniform initial conditions.

    Pitch 90 +- 5 deg, rate +- 6 deg/s, altitude 5900 to 6700 m, velocity -15 to -5 m/s.
    """
    rng = np.random.default_rng(seed)
    return [dict(plant__theta=math.pi/2 + rng.uniform(-5, 5)*DEG,
                 plant__dtheta=rng.uniform(-6, 6)*DEG,
                 plant__altitude=rng.uniform(5900, 6700),
                 plant__velocity=rng.uniform(-15, -5)) for _ in range(n)]


# ---- plant, command ------------------------------------------------------------------------------
def test_the_plant_is_its_equation():
    rng = np.random.default_rng(0)
    for _ in range(20):
        theta, w, x, v = rng.normal(size=4)
        u_a, u_d, phi_a, phi_d = rng.normal(size=4)*(15, 2800, 0.1, 0.5)
        rates = rpl.lander((theta, w, x, v), (u_a, u_d), (phi_a, phi_d))
        expected = w, 2.8/300*u_a + phi_a, v, math.sin(theta)/1000*(u_a + u_d) - 1.6 + phi_d
        assert np.allclose(rates, expected, rtol=1e-12)
    # (50), (54)
    assert 2.8/300 == pytest.approx(9.3e-3, rel=5e-3) and 300/2.8 == pytest.approx(107.5, rel=5e-3)


def test_failures_act_where_they_should():
    state, u, d = (math.pi/2, 0.0, 100.0, 0.0), (6.0, 2400.0), (0.0, 0.0)

    def torque_and_force(**changes):
        plant = rpl.lander.with_(**changes)
        _, alpha, _, a = plant(state, u, d)
        return alpha*plant.values["J"], (a + G)*plant.values["m"]

    assert torque_and_force() == pytest.approx((16.8, 2406.0))
    assert torque_and_force(offset=0.015) == pytest.approx((16.8 + 0.015*2400, 2406.0))
    assert torque_and_force(effectiveness=0.5) == pytest.approx((8.4, 2403.0))
    assert torque_and_force(stuck=5.0) == pytest.approx((16.8 + 14.0, 2411.0))
    assert torque_and_force(left=5) == pytest.approx((16.8, 6.0 + 2400*11/12))
    # the right side turns as u_a does
    assert torque_and_force(left=5, l_d=0.1) == pytest.approx((16.8 + 0.1*200, 2206.0))
    assert torque_and_force(m=1100.0, J=250.0, l_a=3.0) == pytest.approx((18.0, 2406.0))
    assert rpl.left_right(2400.0) == (1200.0, 1200.0)


def test_the_exact_cubic_lands_and_the_printed_one_crashes():
    for t in (0.0, 17.0, 120.0, 240.0):
        (theta, dtheta), (x, v) = rpl.command(t)
        assert theta == math.pi/2 and dtheta == 0.0
        h = 1e-4
        ahead, behind = rpl.command(t + h)[1][0], rpl.command(t - h)[1][0]
        assert v == pytest.approx((ahead - behind)/(2*h), abs=1e-6)
    assert rpl.command(0.0)[1] == (6000.0, -10.0) and np.allclose(rpl.command(T)[1], 0.0, atol=1e-9)
    a, b = np.linalg.solve([[T**3, T**2], [3*T**2, 2*T]], [10*T - 6000, 10])
    assert (a, b) == pytest.approx((1/1440, -11/48), rel=1e-12)
    assert (float(f"{a:.1e}"), round(b, 2)) == (6.9e-4, -0.23)  # as the paper rounds them
    printed = rpl.command.with_(printed=True)
    assert printed(T)[1] == pytest.approx((-109.44, -1.168), abs=1e-9)
    assert printed(221.40)[1][0] > 0.0 > printed(221.42)[1][0]
    assert printed(221.41)[1][1] == pytest.approx(-10.37, abs=0.01)
    run = simulate(rpl.loop().with_(reference=printed))
    assert run.stopped_at == pytest.approx(221.4, abs=0.3)
    assert not rpl.landing(run).soft and rpl.landing(run).velocity == pytest.approx(-10.3, abs=0.3)


def test_the_governed_command_blends_in():
    rates = []
    for t in (1e-3, 20.0, 45.0, 59.9, 61.0, 200.0):
        h, v = 1e-4, rpl.governed_command(t)[1][1]
        ahead, behind = rpl.governed_command(t + h)[1][0], rpl.governed_command(t - h)[1][0]
        rates.append(v - (ahead - behind)/(2*h))
        assert (rpl.governed_command(t) == rpl.command(t)) == (t > 60.0)
    assert np.allclose(rates, 0.0, atol=1e-5)
    assert rpl.governed_command(0.0) == ((math.pi/2, 0.0), (6500.0, -10.0))
    assert rpl.governed_command.with_(governed=False)(20.0) == rpl.command(20.0)


def test_vector_relative_degree():
    found = smc.prd.identify(rpl.lander, output=rpl.attitude_and_altitude)
    assert found.prd == LANDER_PRD.value and found.confirmed


def test_perturbations():
    assert rpl.perturbations(0.0) == (0.0, 0.0)
    assert rpl.perturbations(7.0) == pytest.approx((0.06*math.sin(1.4), 0.5*math.sin(1.4)))


# ---- off-pulse modulation ------------------------------------------------------------------------
def test_20_hz_is_no_dither_at_50_ms_and_20_rad_per_second_is():
    times = 0.05*np.arange(400)
    assert max(abs(rpl.dither(t, omega=2*math.pi*20)) for t in times) < 1e-10
    assert max(abs(rpl.dither(t)) for t in times) > 0.0499
    assert abs(np.mean([rpl.dither(t) for t in times])) < 1e-3


def test_table_1():
    for channel, rows in TABLE_1.value.items():
        assert tuple(map(tuple, rows)) == rpl.TABLE_1[channel]
        band = rpl.dead_band.with_(**rpl.dead_bands(rows))
        for begin, end, delta in rows:
            assert band(begin) == band(0.5*(begin + end)) == band(end - 1e-6) == delta
        assert band(1e4) == rows[-1][2]
    assert rpl.dead_band.with_(**rpl.dead_bands([(0, 100, 0.3)]))(500.0) == 0.3


@given(st.lists(st.floats(-0.2, 0.2), min_size=1, max_size=60), st.floats(1e-3, 0.1))
def test_the_modified_sign(values, delta):
    plain, coasting, relay = (rpl.modified_sign.with_(delta=delta, hysteresis=h, coasts=c)
                              for h, c in ((False, True), (True, True), (True, False)))
    held = last = 0.0
    for s in values:
        outside = float(np.sign(s)) if abs(s) > delta else None
        assert plain(s, (held,))[0] == (outside or 0.0)
        got, (after,) = coasting(s, (held,))
        assert got == after == (outside if outside is not None else held if held*s > 0 else 0.0)
        held = got
        got, _ = relay(s, (last,))
        assert got == (outside if outside is not None else last)
        last = got


@given(st.lists(st.floats(-40, 40), min_size=1, max_size=200), st.integers(1, 5), st.booleans())
def test_pulse_modulators_owe_no_more_than_a_pulse_and_hold_each_choice(wanted, n, one_sided):
    low, tau = 0.0 if one_sided else -15.0, 0.01
    block = rpl.pulse_modulator.with_(low=low, high=15.0, pulse=n*tau)
    z, fired = block.z0, []
    for k, u in enumerate(wanted):
        got, z = block(k*tau, u, z, tau)
        assert got in (low, 0.0, 15.0)
        assert abs(z[0]) <= 15.0*tau*n*(1 + 1e-9)
        fired.append(got)
    assert all(len({*fired[k:k + n]}) == 1 for k in range(0, len(fired), n))
    limited = np.clip(wanted, low, 15.0)
    # the impulse wanted is the impulse given
    assert abs(np.sum(limited) - np.sum(fired))*tau <= 15.0*tau*n*(1 + 1e-9)


@given(st.lists(st.floats(-40, 40), min_size=1, max_size=100), st.integers(1, 5))
def test_thrusters_limit_and_hold(wanted, n):
    tau = 0.01
    hold = rpl.sample_and_hold.with_(pulse=n*tau)
    limit = rpl.thruster.with_(low=-2.0, high=5.0, pulse=n*tau)
    z = y = (0.0,)
    for k, u in enumerate(wanted):
        (got, z), (limited, y) = hold(k*tau, u, z, tau), limit(k*tau, u, y, tau)
        assert got == wanted[k//n*n] and limited == min(max(got, -2.0), 5.0)


def test_a_sample_and_hold_in_a_faster_loop_holds(flights):
    loop = rpl.loop().with_(tau=0.01)
    run = simulate(loop, 20.0, record=2000)
    for u in run.u:
        assert np.all(u[:-1].reshape(-1, 5) == u[:-1:5, None])
    assert run.z.law.attitude.rho[-1] > 0.08 and rpl.pulses(run)[0].shortest_on >= 0.05 - 1e-9


# ---- laws ----------------------------------------------------------------------------------------
def test_off_pulse_smc_is_adaptive_smc_where_there_is_no_dead_band():
    law = rpl.off_pulse_smc.with_(delta_1=0.0, delta_2=0.0, delta_3=0.0, capped=False, gamma=3.0,
                                  rho=0.1)
    base = smc.smc1.adaptive_smc.with_(delta=0.0, gamma=3.0, rho=0.1)
    z, y = law.z0, base.z0
    for k, sigma in enumerate(np.random.default_rng(3).normal(size=50)):
        (v, z), (w, y) = law(0.05*k, sigma, z, 0.05), base(sigma, y, 0.05)
        assert v == w and z[0] == y[0]
    v, (rho, _) = law.with_(capped=True, rho_max=2.0, rho=1.99)(0.0, 5.0, (1.99, 0.0), 0.05)
    assert rho == 2.0 and v == 1.99


def test_laws_within_limits_are_the_kits_own_inside_them_and_wait_outside():
    stw, base = rpl.super_twisting_within, smc.smc2.adaptive_super_twisting
    gains = {n: stw.values[n] for n in base.params}
    z = (0.3, 0.01)
    for sigma in (1e-3, -0.02, 0.5):
        v, ahead = base(sigma, z, 0.05, **gains)
        w, (lam, term) = stw(sigma, z, 0.05)
        assert w == v and lam == ahead[0] and (term == z[1] if abs(v) > 0.14 else term == ahead[1])
        assert stw(sigma, z, 0.05, waits=False) == (v, ahead)
    assert {abs(stw(s, z, 0.05)[0]) > 0.14 for s in (1e-3, 0.5)} == {True, False}
    pid, base = rpl.pid_within.with_(k_p=100.0), smc.pid.pid.with_(k_p=100.0, k_i=0.1, k_d=0.5)
    # a command that stands still: then the rate of the error is that of the measurement
    for r in (0.1, 3.0, -3.0):
        v = base((r, 0.0), (0.0, 0.2), (0.4,), 0.05)[0]
        assert pid((r, -0.2), (0.4,), 0.05)[0] == pytest.approx(v, rel=1e-12)
        assert pid((r, -0.2), (0.4,), 0.05)[1] == ((0.4,) if abs(r) > 1.0 else (0.4 + 0.05*r,))


@given(st.floats(-600, 600), st.floats(0.5, 10.0), st.floats(1e-3, 5.0))
def test_the_braking_surface_asks_for_no_more_than_it_may(e, c, a):
    f = rpl.braking.with_(c_0=c, a_b=a)
    h = 1e-6*max(abs(e), 1e-3)
    slope = (f(e + h) - f(e - h))/(2*h)
    assert f(-e) == -f(e) and abs(f(e)) <= c*abs(e)*(1 + 1e-12)
    assert abs(f(e)*slope) <= a*(1 + 1e-3)  # e' = -f(e): |e''| = |f f'|


def test_without_its_extensions_the_surface_is_the_printed_one():
    plain = rpl.braking_surface.with_(limited=False, conditional=False)
    printed = smc.surface.polynomial((7.0, 25.0))
    z, y = plain.z0, printed.z0
    for e in np.random.default_rng(1).normal(size=(40, 2)):
        (a, z), (b, y) = plain(tuple(e), z, 0.05), printed(tuple(e), y, 0.05)
        assert a == pytest.approx(b, rel=1e-12, abs=1e-12)
    w, (ahead,) = rpl.conditional_integral(0.002, (0.006,), 0.05)
    assert (w, ahead) == (0.006, 0.0063)  # at its limit
    assert rpl.conditional_integral(0.004, (0.006,), 0.05)[1] == (0.0,)  # reset


@given(st.floats(0.3, 2.8), st.floats(-0.2, 0.2), st.floats(-1.0, 3.0))
def test_the_allocation_inverts_b(theta, v_a, v_d):
    y = (theta, 0.0), (100.0, 0.0)
    u = rpl.allocation(y, (v_a, v_d), guard=False)
    _, alpha, _, a = rpl.lander((theta, 0.0, 100.0, 0.0), u, (0.0, 0.0))
    assert (alpha, a + G) == pytest.approx((v_a, v_d), abs=1e-12)
    guarded = rpl.allocation(y, (v_a, v_d))
    assert guarded[0] == u[0] and (math.sin(theta) < 0.5 or guarded == u)
    assert abs(guarded[1]) <= 1000*abs(v_d)/0.5 + abs(u[0]) + 1e-9


def test_no_thrust_where_it_would_point_down():
    assert rpl.allocation(((-0.3, 0.0), (100.0, 0.0)), (0.0, 2.0))[1] == 0.0
    assert rpl.allocation(((math.pi + 0.3, 0.0), (100.0, 0.0)), (0.0, 2.0), guard=False)[1] < 0.0
    assert rpl.allocation(((0.0, 0.0), (100.0, 0.0)), (0.0, 2.0), guard=False)[1] == 0.0


# ---- what momentum forbids -----------------------------------------------------------------------
MEAN_PHI = 0.5*(1 - math.cos(0.2*T))/(0.2*T)
#: Mean of (u_a + u_d) sin(theta) of any flight from -10 m/s to rest in 240 s: momentum.
MEAN_FORCE = M*(G + 10.0/T - MEAN_PHI)


def test_the_mean_thrust_of_a_soft_landing_is_fixed_by_momentum(flights):
    assert pytest.approx(1624.6, abs=0.05) == MEAN_FORCE
    for law in SLIDING:
        run = flights(law, stop=False)
        gained = M*(run.x.velocity[-1] + 10.0)/T
        force = np.sum((run.u[0] + run.u[1])[:-1]*np.sin(run.x.theta[:-1]))/4800
        assert force - M*(G - MEAN_PHI) == pytest.approx(gained, abs=0.5), law
        assert run.mean_u[1] >= MEAN_FORCE - run.mean_u[0] - M*0.5/T  # |sin| <= 1, |v(T)| < 0.5


def test_no_law_whatever_can_have_the_descent_thrust_of_table_2():
    """Momentum: mean(u_d sin) + mean(u_a sin) = MEAN_FORCE + m v(T)/T.

    With |u_a| <= 15 N, 0 <= u_d <= 2800 N, |v(T)| < 0.5 m/s: sin(theta) <= 1 bounds mean(u_d)
    below. Above: u_d - u_d sin(theta) = u_d (1 - cos e_a) <= 2800 N * 0.725 |e_a|, whose mean the
    table itself gives, J_ea.
    """
    e = np.linspace(1e-6, 20*math.pi, 200_001)
    assert np.all(1 - np.cos(e) <= 0.725*e)
    slack = 15.0 + M*0.5/T
    for name, row in TABLE_2.items():
        J_ea, _, _, J_ud = row.value
        for unit in (1.0, DEG):  # in rad or in deg; the printed PID row is a tumble if in rad
            most = min(2800.0, MEAN_FORCE + slack + 2800.0*0.725*J_ea*unit)
            assert not MEAN_FORCE - slack <= J_ud <= most, name
    speed = T/M*(TABLE_2["1-SMC"].value[3] - MEAN_FORCE)
    # m/s at T, with all the credit there is
    assert speed == pytest.approx(-26.8, abs=0.1) and speed + T/M*15.0 < -23.0
    assert T/M*(TABLE_2["STW"].value[3] - MEAN_FORCE) == pytest.approx(222.6, abs=0.1)  # upwards


def test_j_ud_of_table_2_cannot_come_out(flights):
    for law, preset, row in (("adaptive_smc", "recommended", "1-SMC"),
                             ("adaptive_super_twisting", "recommended", "STW"),
                             ("pid", "paper", "PID"), ("pid", "recommended", "PID")):
        assert abs(flights(law, preset, stop=False).mean_u[1] - TABLE_2[row].value[3]) > 90.0


# ---- the figures ---------------------------------------------------------------------------------
@pytest.mark.parametrize(("law", "J_ea", "J_ed", "J_ua", "J_ud"), [
    ("adaptive_smc", (0.227, 0.02), (53.11, 0.1), (5.8, 0.4), (1624.9, 1.0)),
    ("adaptive_super_twisting", (0.16, 0.05), (53.04, 0.05), (4.37, 0.2), (1624.8, 1.0)),
    ("hosm", (0.041, 0.005), (60.6, 0.2), (10.4, 0.6), (1624.8, 1.0))])
@pytest.mark.parametrize("dt", [1e-2, 1e-3, 1e-4])
def test_figures_over_240_s(flights, law, J_ea, J_ed, J_ua, J_ud, dt):
    run = flights(law, stop=False, dt=dt)
    figures = run.mean_e[0][0]/DEG, run.mean_e[1][0], *run.mean_u
    for got, (value, band) in zip(figures, (J_ea, J_ed, J_ua, J_ud), strict=True):
        assert abs(got - value) <= band, figures
    assert run.steps == round(T/dt) and run.stopped_at is None


@pytest.mark.parametrize("law", SLIDING)
@pytest.mark.parametrize("stop", [True, False])
def test_soft_landings(flights, law, stop):
    run = flights(law, stop=stop)
    verdict = rpl.landing(run)
    assert verdict.soft
    assert verdict.reasons == ()
    assert verdict.lost_at is None
    assert str(verdict).startswith("Landed softly after 2")
    assert (run.stopped_at is not None and run.stopped_at > 239.0) if stop else verdict.t == T
    assert abs(run.x.altitude[-1]) < 0.5 and abs(run.x.velocity[-1]) < 0.5
    assert abs(run.e[0][0][-1]) < DEG and abs(run.x.dtheta[-1]) < 1.14*DEG
    assert abs(run.x.dtheta[run.t > 235.0]).max() <= 1.14*DEG
    attitude, descent = rpl.pulses(run)
    for train in (attitude, descent):
        assert 0.05 - 1e-9 <= train.shortest_on < 10.0 and 0.05 - 1e-9 <= train.shortest_off < 60.0
        assert 0.0 < train.duty < 1.0
    assert descent.impulse == pytest.approx(1624.8*T, rel=3e-3)


def test_pulses_grow_denser(flights):
    """Those of the 1-SMC; the modulator of the 2-SMC has no dead band, and its pulses do not."""
    attitude, descent = (train.rates for train in rpl.pulses(flights("adaptive_smc", stop=False)))
    assert attitude[0] < attitude[1] < attitude[2]
    constant = rpl.pulses(flights("adaptive_smc", stop=False, law__attitude__delta_2=0.05,
                                  law__attitude__delta_3=0.05))[0].rates
    assert attitude[2] > 2*constant[2]  # the dead band does it
    modulated = rpl.pulses(flights("adaptive_super_twisting", stop=False))[0].rates
    assert max(modulated) < 1.25*min(modulated) and min(modulated) > 4.5
    for law in ("adaptive_smc", "adaptive_super_twisting"):
        first, second, third = rpl.pulses(flights(law, stop=False))[1].rates
        assert (second*100 + third*40)/140 > first


def test_a_plain_dead_band_does_not_make_pulses_denser_and_dither_does_at_a_price(flights):
    plain = dict(law__attitude__hysteresis=False, law__descent__hysteresis=False)
    without = flights("adaptive_smc", **plain)
    dithered = flights("adaptive_smc", **plain, law__attitude__a=0.05, law__descent__a=0.05)
    rates = rpl.pulses(without)[0].rates
    assert rates[2] < 1.2*rates[0]
    rates = rpl.pulses(dithered)[0].rates
    assert rates[0] < rates[1] < rates[2] and rates[2] > 1.5*rates[0]
    assert dithered.mean_u[0] > 1.25*flights("adaptive_smc").mean_u[0]  # attitude thrust


def test_sigma_does_not_stay_within_the_dead_band(flights):
    run = flights("adaptive_smc", stop=False)
    late = run.t > 200.0
    inside = [np.mean(abs(sigma[late]) <= delta)
              for sigma, delta in zip(run.sigma, (0.01, 0.05), strict=True)]
    assert 0.6 < inside[0] < 0.9 and 0.3 < inside[1] < 0.6
    assert run.z.law.descent.rho[-1] == 2.8  # its gain never comes to rest: the limit stops it
    free = flights("adaptive_smc", stop=False, law__descent__capped=False).z.law.descent.rho
    assert free[-1] > 4.0 and free[-1] > free[len(free)//2] + 0.05


def test_the_pid_of_the_paper_hits_the_ground(flights):
    for stop in (True, False):
        verdict = rpl.landing(flights("pid", "paper", stop=stop))
        assert not verdict.soft and verdict.touchdown[0] == pytest.approx(228.6, abs=1.0)
        assert verdict.touchdown[1] == pytest.approx(-37.5, abs=1.0)
        t, v = verdict.touchdown
        assert f"hit the ground after {t:.1f} s at {v:.1f} m/s" in str(verdict)


def test_the_pid_of_the_paper_in_rad_is_unstable(flights):
    law = flights("pid", "paper").loop.stages["law"].values
    # (57) as printed, e in rad
    k_p, k_i, k_d = (law[f"attitude__{k}"]*math.pi/180*2.8/300 for k in ("k_p", "k_i", "k_d"))

    def stable(scale):  # Routh: s^3 + k_d s^2 + k_p s + k_i
        return k_d*scale*k_p*scale > k_i*scale

    assert (k_p, k_i, k_d) == pytest.approx((10*2.8/300, 0.1*2.8/300, 0.5*2.8/300))
    assert stable(1/DEG)
    assert not stable(1.0)
    assert not 0.1/M*30/M > 0.2/M  # the altitude's is unstable as it stands


def test_a_pid_with_other_gains_and_a_governed_command_lands(flights):
    run = flights("pid")
    assert rpl.landing(run).soft and run.mean_u[1] == pytest.approx(1623.5, abs=3.0)
    paper = flights("pid", "paper", stop=False)
    assert paper.mean_e[0][0]/DEG == pytest.approx(0.53, abs=0.05)
    assert paper.mean_e[1][0] == pytest.approx(312.4, abs=2.0)
    # what holds of the paper's comparison: PID is the least accurate
    for law in ("adaptive_smc", "adaptive_super_twisting"):
        means = [q[0] for q in flights(law, stop=False).mean_e]
        assert np.all(np.array(means) < [q[0] for q in paper.mean_e])


@pytest.mark.parametrize("change, said", [
    (dict(plant__m=1800.0), "full thrust, 2800 N, is less than the weight, 2880 N"),
    (dict(actuator__descent__high=1500.0), "full thrust, 1500 N, is less than the weight, 1600 N"),
    (dict(plant__left=0), "full thrust, 1400 N, is less than the weight, 1600 N")])
def test_a_thrust_below_the_weight_is_why(flights, change, said):
    verdict = rpl.landing(smc.simulate(rpl.loop().with_(**change)))
    assert not verdict.soft
    assert said in verdict.reasons
    assert verdict.lost_at == 0.0
    assert verdict.touchdown[1] < -20.0
    assert not any(q.startswith("velocity") for q in verdict.reasons)  # said once


def test_verdict_of_odd_runs():
    beyond = smc.simulate(rpl.loop().with_(plant__altitude=2e6))
    assert beyond.diverged_at == 0.0
    assert "the start is beyond the limits" in str(rpl.landing(beyond))
    own = rpl.loop().with_(allocation=smc.block(
        lambda v: (300.0/2.8*v[0], 1000.0*v[1] - 300.0/2.8*v[0])))
    assert rpl.landing(smc.simulate(own, 10.0)).lost_at is None
    twice = rpl.loop().with_(stop=None, reference__printed=True, plant__altitude=0.001,
                             plant__velocity=-0.1)
    # the second contact is the hard one
    assert rpl.landing(smc.simulate(twice, record=4800)).touchdown[1] < -5.0


def test_the_design_of_the_paper_tumbles(flights):
    run = flights("adaptive_smc", "paper")
    verdict = rpl.landing(run)
    assert not verdict.soft and np.ptp(run.x.theta) > 2*math.pi and verdict.velocity < -50.0
    assert verdict.lost_at < 10.0 and "Authority over the altitude was lost" in str(verdict)
    # (48), (49) ask at the start for what is not there
    e_a, de_a, e_d = math.pi/2 - 1.6, -0.1, -500.0
    assert abs(7*de_a + 25*e_a) > 10*0.14 and abs(4*e_d) > 700*2.8


@pytest.mark.parametrize(("off", "tumbles", "speed"), [
    ("attitude__conditional", True, -105), ("descent__limited", False, -38.6),
    ("attitude__limited attitude__conditional", True, -99)])
def test_switched_off_an_extension_shows_what_it_was_for(flights, off, tumbles, speed):
    run = flights("adaptive_smc", **{f"surface__{s}": False for s in off.split()})
    verdict = rpl.landing(run)
    assert not verdict.soft
    assert (np.ptp(run.x.theta) > 2*math.pi) == (verdict.lost_at is not None) == tumbles
    assert abs(verdict.velocity - speed) < (25.0 if tumbles else 2.0)


def test_the_governed_command_makes_the_linear_altitude_surface_do(flights):
    run = flights("adaptive_smc", "governed")
    assert rpl.landing(run).soft
    x_c = np.array([rpl.command(t)[1][0] for t in run.t])
    # from the command itself, not the governed one
    assert np.mean(abs(x_c - run.x.altitude)) == pytest.approx(62.6, abs=0.5)


def test_compiled_equals_plain_to_the_last_bit():
    pairs = [(law, preset) for law, presets in rpl.PRESETS.items() for preset in presets]
    for law, preset in pairs:
        loop = rpl.loop(law, preset)
        quick, plain = (simulate(loop, 20.0, 0.01, jit=jit, record=400) for jit in (True, False))
        for name in ("theta", "altitude"):
            assert np.array_equal(getattr(quick.x, name), getattr(plain.x, name)), law
        assert np.array_equal(quick.u, plain.u)


# ---- robustness ----------------------------------------------------------------------------------
@pytest.mark.parametrize("law", ["adaptive_smc", "adaptive_super_twisting"])
def test_500_of_500_land_softly(law):
    loop = rpl.loop(law).with_(stop=None)
    hard = [str(v) for s in starts(500)
            if not (v := rpl.landing(simulate(loop.with_(**s), dt=1e-2, record=100))).soft]
    assert hard == []


@pytest.mark.parametrize("law", SLIDING)
@pytest.mark.parametrize("failure", [dict(offset=0.015), dict(effectiveness=0.5),
                                     dict(stuck=5.0), dict(left=5)],
                         ids=lambda f: next(iter(f)))
def test_20_of_20_land_softly_with_a_failure(law, failure):
    loop = rpl.loop(law).with_(**{f"plant__{n}": v for n, v in failure.items()})
    hard = [str(v) for s in starts(20, seed=1)
            if not (v := rpl.landing(simulate(loop.with_(**s), record=500))).soft]
    assert hard == []


def test_15_mm_to_the_other_side_is_more_than_the_attitude_thrusters_hold(flights):
    """Torque of the thrust, plus phi_a, against 15 N times 2.8 m: too much on one side."""
    t = np.linspace(0.0, T, 24001)
    wave = np.sin(0.2*t)
    thrust = M*(t/240 - 11/24 + G - 0.5*wave)

    def most(offset):
        return np.max(abs(offset*thrust/300 + 0.06*wave))

    assert most(0.015) < 15*2.8/300 < most(-0.015)
    verdict = rpl.landing(flights("adaptive_smc", plant__offset=-0.015))
    assert not verdict.soft and verdict.lost_at is not None
    assert rpl.landing(flights("adaptive_smc", plant__offset=-0.008)).soft and most(-0.008) < 0.14


# ---- verdicts and pulse trains -------------------------------------------------------------------
def test_pulse_trains_are_counted_as_a_person_would(flights):
    run = flights("adaptive_smc")
    for train, u, mean in zip(rpl.pulses(run), run.u, run.mean_u, strict=True):
        signs = "".join("-0+"[int(np.sign(q)) + 1] for q in u[:-1])
        runs = [(s, len(list(g))) for s, g in itertools.groupby(signs)]
        assert train.duty == pytest.approx(1 - signs.count("0")/len(signs), abs=2e-4)
        assert train.shortest_on == pytest.approx(0.05*min(n for s, n in runs[1:-1] if s != "0"))
        assert train.shortest_off == pytest.approx(0.05*min(n for s, n in runs[1:-1] if s == "0"))
        total = train.rates[0]*100 + train.rates[1]*100 + train.rates[2]*(run.t[-1] - 200)
        assert total == pytest.approx(sum(s != "0" for s, _ in runs))
        assert train.impulse == pytest.approx(mean*run.t[-1])


def test_pulses_need_a_row_a_sample():
    with pytest.raises(ParameterError, match=r"every 0\.12 s; it must have one every "
                                             r"tau = 0\.05 s: simulate.*4800"):
        rpl.pulses(simulate(rpl.loop(), record=2000))


def test_a_verdict_names_each_reason():
    run = simulate(rpl.loop().with_(duration=60.0))
    verdict = rpl.landing(run)
    assert verdict.touchdown is None and not verdict.soft
    said = str(verdict)
    assert "altitude = " in said and "velocity = " in said and "not within 0.5 m/s" in said
    run = simulate(rpl.loop().with_(plant__theta=150*DEG, plant__dtheta=0.0))
    assert rpl.landing(run).lost_at == 0.0


# ---- bad input -----------------------------------------------------------------------------------
@pytest.mark.parametrize(("table", "words"), [
    ([(0, 100, 0.1), (110, 240, 0.05)], ["table[1] from 110 to 240 s", "gap", "begin at 100 s"]),
    ([(0, 100, 0.1), (90, 240, 0.05)], ["table[1] from 90 to 240 s", "overlap", "begin at 100 s"]),
    ([(5, 100, 0.1)], ["table[0] from 5", "gap", "begin at 0 s"]),
    ([(0, 100, 0.1), (100, 100, 0.1)], ["interval without duration"]),
    ([(0, 100, 0.1), (100, 50, 0.1)], ["interval without duration"]),
    ([(0, 100, -0.1)], ["table[0], delta = -0.1 [sigma]", "at least 0"]),
    ([(0, 100, math.nan)], ["nan"]),
    ([], ["one to three rows"]), ([(0, 100)], ["one to three rows"]),
    ([(k, k + 1, 0.1) for k in range(4)], ["one to three rows"])])
def test_bad_dead_band_tables(table, words):
    with pytest.raises(ParameterError) as why:
        rpl.dead_bands(table)
    for word in ("dead_bands: ", *words):
        assert word in str(why.value)


@pytest.mark.parametrize(("act", "words"), [
    (lambda: rpl.lander.with_(theta=0.0),
     ["lander: theta = 0 rad", "sin(theta) must be larger than 0"]),
    (lambda: rpl.loop().with_(plant__theta=4.0),
     ["lander: theta = 4 rad", "sin(theta) must be larger than 0"]),
    (lambda: rpl.thruster.with_(low=20.0), ["thruster: low = 20 N", "less than high = 15 N"]),
    (lambda: rpl.loop().with_(actuator__descent__high=-1.0),
     ["low = 0 N", "less than high = -1 N"]),
    (lambda: rpl.pulse_modulator.with_(low=15.0), ["pulse_modulator: low = 15 N"]),
    (lambda: rpl.super_twisting_within.with_(high=-1.0),
     ["super_twisting_within: low = -0.14", "high = -1"]),
    (lambda: rpl.dead_band.with_(t_1=250.0), ["dead_band: t_1 = 250 s", "at most t_2 = 200 s"]),
    (lambda: rpl.off_pulse_smc.with_(t_2=50.0),
     ["off_pulse_smc: t_1 = 100 s", "at most t_2 = 50 s"]),
    (lambda: rpl.lander.with_(theta=math.pi),
     ["theta = 3.14159 rad", "sin(theta) must be larger than 0"]),
    (lambda: rpl.dead_bands(5), ["table = 5", "one to three rows of (begin [s], end [s], delta)"]),
    (lambda: rpl.dead_bands([5]),
     ["table = [5]", "one to three rows of (begin [s], end [s], delta)"]),
    (lambda: rpl.lander.with_(left=7), ["left = 7", "a whole number from 0 to 6"]),
    (lambda: simulate(rpl.loop().with_(actuator__attitude__pulse=5e-4)),
     ["attitude__pulse = 0.0005 s", "tau = 0.05 s"]),
    (lambda: simulate(rpl.loop().with_(actuator__attitude__pulse=5e-4, tau=None)),
     ["pulse = 0.0005 s", "tau = 0.001 s"]),
    (lambda: simulate(rpl.loop(), tau=0.0505, dt=1e-3),
     ["tau = 0.0505 s", "a multiple of dt = 0.001 s"]),
    (lambda: rpl.loop("pidd"),
     ["rpl.loop: law = 'pidd'", "'adaptive_smc', 'adaptive_super_twisting', 'hosm', 'pid'"]),
    (lambda: rpl.loop("pid", "best"),
     ["rpl.loop of pid: preset = 'best'", "'recommended', 'paper'"]),
    (lambda: rpl.loop([]), ["rpl.loop: law = [] is not allowed"]),
    (lambda: rpl.landing(simulate(smc.lv.loop("pd"), 0.1)),
     ["landing: a run of the plant launcher", "rpl.lander"]),
    (lambda: rpl.pulses(simulate(smc.lv.loop("pd"), 0.1)),
     ["pulses: a run of the plant launcher", "rpl.lander"]),
    *((lambda q=q: rpl.pulses(simulate(rpl.loop(), 1.0), q),
       [f"pulses: intervals = {q!r} is not allowed"])
      for q in (5, (100.0, 0.0), (0.0, 0.0, 1.0), (1.0,), ((0.0, 1.0), (1.0, 2.0))))])
def test_bad_input_is_told(act, words):
    with pytest.raises(ParameterError) as why:
        act()
    for word in words:
        assert word in str(why.value), str(why.value)


def test_presets_say_what_they_are():
    assert {law: [*presets] for law, presets in rpl.PRESETS.items()} == {
        "adaptive_smc": ["recommended", "paper", "governed"],
        "adaptive_super_twisting": ["recommended"],
        "hosm": ["recommended"], "pid": ["recommended", "paper"]}
    for law, presets in rpl.PRESETS.items():
        for preset in presets:
            loop = rpl.loop(law, preset)
            assert (loop.duration, loop.dt, loop.tau) == (240.0, 1e-3, 0.05)
            assert loop.name == f"{law}, {preset}"
            assert loop.stages["plant"].f is rpl.lander.f and loop.stages["stop"] is rpl.altitude


def test_every_extension_says_so():
    for b in (rpl.braking_surface, rpl.off_pulse_smc, rpl.modified_sign, rpl.allocation,
              rpl.super_twisting_within,
              rpl.pid_within):
        switches = [n for n, kind in b.kinds.items() if kind is bool and n not in ("coasts",)]
        assert switches and all(b.params[n].help.startswith("extension:") for n in switches)
        # what the mask shows
        assert all("extension" in smc.ui.text.label(n, b.params[n]) for n in switches)
        assert "xtension" in b.__doc__
    for b in (rpl.braking, rpl.conditional_integral, rpl.governed_command):
        assert b.__doc__.strip().startswith("Extension")


def test_blocks_of_the_lander_serve_other_loops():
    """Off-pulse control of the double integrator, by 3 N either way for at least 50 ms."""
    base = smc.applications.double_integrator("sign_smc")
    loop = base.with_(surface=rpl.braking_surface.with_(c_0=2.5, c_int=0.0, a_b=1.0),
                      actuator=rpl.thruster.with_(low=-3.0, high=3.0),
                      law=rpl.off_pulse_smc.with_(rho=3.0, rho_max=3.0, delta_1=0.02))
    run = simulate(loop, 10.0)
    assert run.tail_e < 0.1 and {*np.unique(run.u)} == {-3.0, 0.0, 3.0}
    held = np.diff(np.flatnonzero(np.diff(simulate(loop, 10.0, record=10_000).u)))
    assert held.min() >= 50  # samples of 1 ms
    modulator = rpl.pulse_modulator.with_(low=-4.0, high=4.0, pulse=1e-3)
    assert simulate(base.with_(actuator=modulator), 8.0).tail_e < 0.05
    # one sample long, it changes nothing
    held = simulate(base.with_(actuator=rpl.sample_and_hold.with_(pulse=1e-3)), 1.0)
    assert held.mean_u == simulate(base, 1.0).mean_u
