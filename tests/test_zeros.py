"""Zero dynamics: zeros against python-control, and what is said of those that grow."""

import control
import numpy as np
import pytest

import smcaero_nb as smc
from smcaero_nb import ClosedLoop, block, channels, interop, prd, simulate
from smcaero_nb.core.zeros import of_run, unstable, zeros

relay = smc.smc1.sign_smc.with_(rho=5.0)
SYSTEMS = [control.tf(b, a) for b, a in (
    ([1.0, -1.0], [1.0, 2.0, 3.0]), ([1.0, 0.0, 4.0], [1.0, 2.0, 3.0, 4.0, 5.0]),
    ([1.0, -0.2, 4.0], [1.0, 2.0, 3.0, 4.0, 5.0]), ([1.0, -3.0, 2.0], [1.0, 2.0, 3.0, 4.0]),
    ([2.0, 1.0, -3.0], [1.0, 0.8, 2.0]), ([-1.0, 2.0], np.poly([-1.0, -10.0, -1e3, -1e4])),
    ([5.0], [1.0, 2.0, 3.0, 4.0]))]


@pytest.mark.parametrize("sys", SYSTEMS, ids=[f"{q.num[0][0]}" for q in SYSTEMS])
def test_zeros_are_the_roots_of_the_numerator(sys):
    found, wanted = zeros(*interop.matrices(sys)[:4]), np.roots(sys.num[0][0])
    assert np.sort_complex(found.round(9)) == pytest.approx(np.sort_complex(wanted.round(9)))


@pytest.mark.parametrize("seed", range(20))
def test_transmission_zeros_are_those_of_python_control(seed):
    rng = np.random.default_rng(seed)
    A, B, C = (rng.standard_normal(q) for q in ((6, 6), (6, 2), (2, 6)))
    if seed % 2:  # relative degree 2
        B[:4] = C[:, 4:] = 0.0
    sys = control.ss(A, B, C, np.zeros((2, 2)))
    found, wanted = zeros(A, B, C, np.zeros((2, 2))), sys.zeros()
    if seed % 2:
        wanted = wanted[np.abs(wanted) < 1e3]
    assert np.poly(found) == pytest.approx(np.poly(wanted), rel=1e-5, abs=1e-5)


def test_nothing_is_said_without_a_vector_relative_degree():
    A, B = np.diag([-1.0, -2.0, -3.0]), np.ones((3, 2))
    C = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    assert not len(zeros(A, B, C, np.zeros((2, 2))))
    assert not len(zeros(A, B, C[:1], np.zeros((1, 2))))


def sliding(num, den, law=relay):
    plant = interop.from_control(control.tf(num, den))
    return ClosedLoop(plant, output=plant.y, law=law)


@block(state=dict(x=0.0, v=0.0, tank=0.1))
def leaning(x, u, d):
    """x'' = u, beside a state that grows while x is held."""
    return x[1], u - 0.5*x[1]*abs(x[1]), 0.8*x[2] + x[0]


@block
def behind(x):
    return x[0] - x[2], x[1] - (0.8*x[2] + x[0])


GROWING = {
    "one zero": (sliding([1.0, -1.0], [1.0, 2.0, 3.0]), "a zero at 1 1/s"),
    "a pair": (sliding([1.0, -1.0, 4.0], [1.0, 2.0, 3.0, 4.0]), "zeros at 0.5 +- 1.94j 1/s"),
    "super-twisting": (sliding([-1.0, 2.0], [1.0, 2.0, 1.0], smc.smc2.super_twisting),
                       "a zero at 2 1/s"),
    "your own plant and surface": (
        ClosedLoop(leaning, output=behind, law=relay,
                   surface=smc.surface.polynomial((1.0,), integral=False)), "a zero at 1.8 1/s"),
    "a law of your own": (sliding([1.0, -1.0], [1.0, 2.0, 3.0], block(
        lambda sigma: 3.0 if sigma > 0.0 else -3.0)), "a zero at 1 1/s"),
}


@pytest.mark.parametrize("name", GROWING)
def test_a_loop_that_slides_on_an_unstable_zero_says_so(name):
    loop, word = GROWING[name]
    said = [q for q in simulate(loop, 8.0, 1e-3, jit=False).doubts() if "right half plane" in q]
    assert len(said) == 1 and word in said[0] and "while sigma is held at zero" in said[0]


def test_the_states_beside_sigma_grow_as_the_zero_says():
    run = simulate(sliding([1.0, -2.0], [1.0, 2.0, 1.0], relay.with_(rho=50.0)).with_(
        plant__x0=1e-3, plant__x1=2e-3), 2.0, 1e-5)
    half = len(run.t)//2
    assert np.abs(run.y[half:]).max() < 2e-3  # sigma is held
    rate = np.polyfit(run.t[half:], np.log(np.abs(run.x.x0[half:])), 1)[0]
    assert rate == pytest.approx(2.0, rel=0.02)


def test_loops_that_do_not_slide_or_have_no_such_zero_say_nothing():
    gentle = block(lambda sigma: 0.1*sigma)
    for loop in (sliding([1.0, 1.0], [1.0, 2.0, 3.0]), sliding([5.0], [1.0, 2.0, 3.0]),
                 smc.lv.loop("pid"),
                 sliding([1.0, -1.0], [1.0, 2.0, 3.0], gentle).with_(
                     reference=block(lambda t: 1.0)),
                 smc.lv.loop("quasi_smc"), smc.rpl.loop("adaptive_smc")):
        assert not any("right half plane" in q for q in simulate(loop, 5.0, 1e-3).doubts())


def test_the_launch_vehicle_has_its_zeros_from_v_to_sigma():
    p = smc.lv.launcher.values
    run = simulate(smc.lv.loop("quasi_smc"), 0.01, 1e-3, jit=False)
    # the engine's inertia against its thrust: nearly on the imaginary axis, doubling in 2 minutes
    tail = np.sqrt(p["l_g"]*p["R"]/(p["l_g"]*p["S_n"] + p["I_n"]))
    pair, = unstable(of_run(run))
    assert pair.imag == pytest.approx(tail, rel=0.06) and 0.0 < pair.real < 0.006


@pytest.mark.parametrize("source", [
    SYSTEMS[0], control.ss(SYSTEMS[0]), interop.from_control(SYSTEMS[0]),
    sliding([1.0, -1.0], [1.0, 2.0, 3.0])], ids=["tf", "ss", "block", "loop"])
def test_identify_names_the_zeros_of_a_model(source):
    found = prd.identify(source)
    assert found.prd == 1 and found.zeros == pytest.approx((1.0,))
    assert "a zero at 1 1/s in the right half plane" in str(found)
    assert "its other states grow as exp(1 t)" in found.explain()


def test_identify_says_nothing_of_the_zeros_of_a_record_or_of_a_plant_with_good_ones():
    good = prd.identify(control.tf([1.0, 1.0], [1.0, 2.0, 3.0]))
    assert good.zeros == () and "half plane" not in str(good) + good.explain()
    assert prd.identify((good.t, good.y, good.step_time, 1.0)).zeros == ()


def test_the_help_of_a_plant_names_its_zeros():
    assert "a zero at 1 1/s in the right half plane" in interop.from_control(SYSTEMS[0]).__doc__
    assert "half plane" not in interop.from_control(SYSTEMS[-1]).__doc__


def test_two_channels_have_the_zeros_of_the_matrix():
    sys = control.tf([[[1.0], [2.0]], [[1.0], [1.0]]],
                     [[[1.0, 1.0], [1.0, 3.0]], [[1.0, 1.0], [1.0, 1.0]]])
    plant = interop.from_control(sys)  # the textbook's: each entry has no zero, the matrix has +1
    loop = ClosedLoop(plant, output=plant.y, surface=block(lambda e: (e[0][0], e[1][0])),
                      law=channels(a=relay, b=relay))
    found = unstable(of_run(simulate(loop, 0.1, 1e-2, jit=False)))
    assert found == pytest.approx((1.0,), abs=1e-6)
