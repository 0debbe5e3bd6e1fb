"""Figures of merit: exact values on runs that can be worked out by hand."""

import math

import numpy as np

import smcaero_nb as smc
from smcaero_nb import ClosedLoop, Metrics, block, simulate
from smcaero_nb.core import reaching_time


@block(state=dict(s=1.0))
def falls(u):
    return (-u,)


@block
def itself(x):
    return x[0]


@block
def minus(x):
    return -x[0]


@block
def triangle(t):
    """1, 0, -1, 0, 1, ... one step of 1/8 s each."""
    k = round(t*8) % 4
    return 1.0 - k if k < 2 else k - 3.0


def test_means_and_chattering_of_a_wave_that_is_known():
    run = simulate(ClosedLoop(falls, output=minus, allocation=triangle), 4.0, 1/8, tail=0.5,
                   record=32, jit=False)
    assert list(run.u[:5]) == [1.0, 0.0, -1.0, 0.0, 1.0]
    m = run.metrics()
    assert m.J_u == 0.5 and m.max_u == 1.0
    assert m.J_e == np.abs(run.e[:-1]).mean()
    assert run.variation_u == 33.0  # 32 steps of one, and the first from rest
    assert run.tail_variation_u == 17.0 and m.variation_u == 17.0/2.0
    assert run.tail_turns_u == 8.0 and m.turns_u == 4.0  # twice a period of 1/2 s
    assert m.tail_e == np.abs(run.e[16:]).max() and m.diverged_at is None


def test_reaching_time_of_a_relay_is_exact_to_a_row():
    loop = ClosedLoop(falls, output=minus, law=smc.smc1.sign_smc.with_(rho=0.5))
    run = simulate(loop, 4.0, 1/64, record=256, jit=False)
    # 1 - t/2 <= 1/4 from 1.5 on; a row covers what came before it
    assert reaching_time(run, band=0.25) == [1.5 + 1/64]
    assert (run.tail_sigma == 0.0
            and reaching_time(run) == [2.0 + 1/64] == [run.metrics().reaching_time])
    assert reaching_time(run, band=2.0) == [0.0]
    assert reaching_time(simulate(loop, 1.0, 1/64, jit=False), band=0.25) == [math.inf]


def test_reaching_time_is_the_same_from_either_side_and_its_default_band_is_twice_the_tail():
    loop = ClosedLoop(falls, output=minus, law=smc.smc1.sign_smc.with_(rho=0.7))
    down, up = (simulate(loop.with_(plant__s=s), 4.0, 1/64, record=256, jit=False)
                for s in (1.0, -1.0))
    assert down.tail_sigma == up.tail_sigma > 0.0
    for band in (0.5, 2*up.tail_sigma):
        assert reaching_time(down, band) == reaching_time(up, band)
    assert (reaching_time(up)
            == reaching_time(up, 2*up.tail_sigma) != reaching_time(up, 3*up.tail_sigma))
    assert reaching_time(up, 0.999*up.tail_sigma) == [math.inf]


def test_a_band_is_judged_on_every_step_not_on_the_rows():
    @block(state=dict(k=0.0))
    def spikes(e, z):
        """Zero at every even step."""
        return e*(z[0] % 2.0), (z[0] + 1.0,)

    run = simulate(ClosedLoop(falls, output=minus, surface=spikes, allocation=triangle), 4.0, 1/8,
                   record=16, jit=False)
    assert np.all(run.sigma[:-1] == 0.0)
    assert reaching_time(run, band=0.1) == [math.inf]


def test_a_reference_that_is_met_from_the_start():
    run = simulate(ClosedLoop(falls, reference=one, output=itself, law=smc.smc1.sign_smc), 1.0, 0.1,
                   jit=False)
    m = run.metrics()
    assert m == Metrics(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, None)


@block
def one(t):
    return 1.0


def test_rows_text_and_table_say_the_same():
    m = Metrics(0.5, (1.0, 2.0), 3.0, 0.25, 0.125, math.inf, 12345.678, 4.0, None)
    assert m.rows() == [("J_e", "0.5", ""), ("J_u", "1, 2", ""), ("max_u", "3", ""),
                        ("tail_e", "0.25", ""),
                        ("tail_sigma", "0.125", ""), ("reaching_time", "inf", "s"),
                        ("variation_u", "1.235e+04", "1/s"),
                        ("turns_u", "4", "1/s")]
    assert str(m) == ("J_e = 0.5   J_u = 1, 2   max_u = 3   tail_e = 0.25   tail_sigma = 0.125   "
                      "reaching_time = inf s   "
                      "variation_u = 1.235e+04 1/s   turns_u = 4 1/s")
    table = m._repr_html_()
    assert table.count("<th>") == table.count("<td>") == 8
    assert "<th>reaching_time [s]</th>" in table and "<td>1.235e+04</td>" in table
    assert "diverged_at = 2.5 s" in str(Metrics(0.5, 1.0, 3.0, 0.25, 0.125, math.inf, 1.0, 4.0,
                                                2.5))
