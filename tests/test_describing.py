"""Describing functions: the first harmonic of each law, and the limit cycles that they predict."""

import math

import numpy as np
import pytest
from scipy.optimize import fsolve

import smcaero_nb as smc
from smcaero_nb import block, simulate
from smcaero_nb.applications import perturbed_chain
from smcaero_nb.hosmc import nested, quasi_continuous
from smcaero_nb.smc1 import quasi_smc, saturation_smc, sign_smc
from smcaero_nb.smc2 import super_twisting, twisting

ANGLES = (np.arange(20_000) + 0.5)*2*np.pi/20_000
STATIC = [sign_smc.with_(rho=1.7), saturation_smc.with_(rho=1.7), quasi_smc.with_(rho=1.7),
          nested(1).with_(L=3.0, lam=2.0), quasi_continuous(1).with_(alpha=2.5),
          nested(2).with_(alpha=1.4, L=3.0, lam=2.0)]
#: Law, number of equal lags that make it oscillate.
CYCLES = [(sign_smc, 2), (saturation_smc.with_(eps=0.005), 2), (quasi_smc.with_(eps=0.005), 2),
          (super_twisting, 1), (super_twisting.with_(lam=2.5), 1), (twisting, 1), (nested(2), 1)]
LAG = 0.02


def harmonic(v):
    """Gain of the first harmonic of v over sigma = sin, complex."""
    return 2.0*np.mean(v*(np.sin(ANGLES) + 1j*np.cos(ANGLES)))


@pytest.mark.parametrize("law", STATIC, ids=lambda b: b.name)
@pytest.mark.parametrize("a", [0.01, 0.1, 0.3, 2.0])
def test_a_describing_function_is_the_first_harmonic(law, a):
    omega = 3.0
    if law.r == 2:
        v = [law((a*math.sin(q), a*omega*math.cos(q))) for q in ANGLES]
    else:
        v = [law(a*math.sin(q)) for q in ANGLES]
    found = law.card.describing(law.values, a, omega)
    assert found == pytest.approx(harmonic(np.array(v))/a, rel=2e-3, abs=1e-3/a)


@pytest.mark.parametrize("law", [super_twisting, twisting], ids=lambda b: b.name)
def test_the_describing_function_of_a_law_with_memory_is_that_of_its_motion(law):
    a, omega = 1e-3, 60.0
    tau, z, v = 2*np.pi/omega/len(ANGLES), law.z0, []
    for q in np.concatenate([ANGLES, ANGLES]):
        s = a*math.sin(q)
        out, z = law((s, a*omega*math.cos(q)) if law is twisting else s, z, tau)
        v.append(out)
    v = np.array(v[len(ANGLES):])
    found = law.card.describing(law.values, a, omega)
    assert found == pytest.approx(harmonic(v - v.mean())/a, rel=2e-3)


@block(state=dict(first=0.0, second=0.0))
def lags(u, z, tau, many=2.0):
    """One lag or two, exact for a held input but for a step between them."""
    a, b = z
    f = 1.0 - math.exp(-tau/LAG)
    a_next = a + f*(u - a)
    b_next = a_next if many == 1.0 else b + f*(a - b)
    return b_next, (a_next, b_next)


@pytest.mark.parametrize(("law", "many"), CYCLES, ids=lambda q: getattr(q, "name", str(q)))
def test_the_limit_cycle_behind_lags_is_the_one_predicted(law, many):
    """Harmonic balance, N W = -1 with W = 1/(s^r (1 + T s)^n), to 6 per cent."""
    r = 2 if law.name == "nested_2" else 1

    def balance(q):
        a, omega = np.exp(q)
        s = 1j*omega
        rest = law.card.describing(law.values, a, omega)/(s**r*(1.0 + s*LAG)**many) + 1.0
        return rest.real, rest.imag

    a, omega = np.exp(fsolve(balance, np.log((0.02 if many == 2 else 1e-3, 1.0/LAG))))
    loop = perturbed_chain(law, r).with_(actuator=lags, actuator__many=float(many),
                                         perturbation__xi_1=0.0, plant__s0=0.05)
    run = simulate(loop, 15.0, 2e-5, 2e-5, tail=0.2, record=75_000)
    late = run.t > 12.0
    sigma = (run.sigma[0] if isinstance(run.sigma, tuple) else run.sigma)[late]
    crossings = np.count_nonzero(sigma[:-1]*sigma[1:] < 0.0)
    assert abs(sigma).max() == pytest.approx(a, rel=0.06)
    assert crossings*np.pi/3.0 == pytest.approx(omega, rel=0.06)


def test_where_none_is_derived_there_is_none():
    for law in (smc.smc1.adaptive_smc, smc.smc1.dual_layer_smc, smc.smc1.tanh_smc, nested(3),
                smc.smc2.adaptive_super_twisting, quasi_continuous(2)):
        assert law.card.describing is None
