"""Plants from python-control: against `control.forced_response`, in every shape; what is refused, and why."""

import control
import numpy as np
import pytest

import smcaero_nb as smc
from smcaero_nb import ClosedLoop, ParameterError, block, interop, simulate

TAU = 0.01


@block
def wave(t):
    return np.sign(np.sin(3.0*t + 0.1))*(1.0 + 0.5*t)


@block
def two_waves(t):
    return 1.0 + t, np.cos(2.0*t)


def held(f, times):
    """Samples of a law's signal, held between them."""
    return np.array([f(TAU*np.floor(q/TAU + 1e-9)) for q in times]).T


def compare(sys, law, tolerance=1e-9, duration=2.0, jit=False):
    """Largest deviation of the block's outputs from `control.forced_response`, relative to the largest output."""
    plant = interop.from_control(sys)
    dt = TAU/10
    run = simulate(ClosedLoop(plant, output=plant.y, law=law), duration, dt, TAU, method="rk4", record=10**6, jit=jit)
    # forced_response joins inputs by straight lines, so it is given each interval of the hold by itself
    ss = control.ss(*interop.matrices(sys)[:4])
    x, wanted = np.zeros(ss.nstates), []
    T = np.arange(11)*dt
    for k in range(round(duration/TAU)):
        u = np.repeat(np.atleast_1d(law(k*TAU))[:, None], len(T), axis=1)
        part = control.forced_response(ss, T, u, x, squeeze=False)
        wanted.append(part.outputs[:, :-1])
        x = part.states[:, -1]
    wanted = np.concatenate(wanted, axis=1)
    got = np.array(run.y if isinstance(run.y, tuple) else (run.y,))[:, :-1]
    assert np.abs(got - wanted).max() <= tolerance*np.abs(wanted).max()


SISO = {
    "lag": control.tf([2.0], [0.5, 1.0]),
    "zeros and a fast pole": control.tf([1.0, 3.0, 1.0], [0.05, 1.0, 2.0, 5.0]),
    "eq (7)": smc.lv.transfer_function(),
    "unstable": control.tf([1.0, -1.0], [1.0, 0.2, -1.0]),
    "integrators": control.tf([1.0], [1.0, 0.0, 0.0, 0.0]),
    "state space": control.ss([[0.0, 1.0], [-4.0, -0.4]], [[0.0], [2.0]], [[1.0, 0.5]], [[0.0]], states=["angle", "rate"]),
    "zero-pole-gain": control.zpk([-1.0], [-2.0, -3.0, -4.0], 5.0),
}


@pytest.mark.parametrize("name", SISO)
def test_one_input_and_output_as_forced_response(name):
    compare(SISO[name], wave, 1e-7 if "zeros" in name else 1e-9, jit=name == "eq (7)")


def test_the_transfer_function_itself_as_forced_response():
    sys = SISO["zeros and a fast pole"]
    plant = interop.from_control(sys)
    step = block(lambda t: 1.0)
    run = simulate(ClosedLoop(plant, output=plant.y, law=step), 3.0, 1e-3, method="rk4", record=10**6, jit=False)
    assert run.y == pytest.approx(control.forced_response(sys, run.t, np.ones_like(run.t)).outputs, abs=1e-7)


MIMO = {
    "transfer matrix": control.tf([[[1.0], [2.0, 1.0]], [[3.0], [1.0]]],
                                  [[[1.0, 1.0], [1.0, 3.0, 2.0]], [[1.0, 1.0], [1.0, 4.0]]]),
    "state space": control.ss([[0.0, 1.0, 0.0], [-2.0, -1.0, 0.5], [0.0, 0.0, -3.0]], [[0.0, 0.0], [1.0, 0.2], [0.0, 1.0]],
                              [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 1.0]], np.zeros((3, 2))),
}


@pytest.mark.parametrize("name", MIMO)
def test_many_inputs_and_outputs_as_forced_response(name):
    compare(MIMO[name], two_waves, jit=name == "state space")


def test_entries_of_a_column_with_the_same_denominator_share_their_states():
    assert len(interop.from_control(MIMO["transfer matrix"]).z0) == 4  # not 5


def test_compiled_and_plain_runs_agree_to_the_last_bit():
    plant = interop.from_control(SISO["eq (7)"])
    loop = ClosedLoop(plant, output=plant.y, law=wave)
    a, b = (simulate(loop, 0.2, 1e-3, TAU, jit=q) for q in (True, False))
    assert (a.y == b.y).all()


def test_states_keep_their_names_and_can_be_set():
    plant = interop.from_control(SISO["state space"])
    assert list(plant.states) == ["angle", "rate"]
    loop = ClosedLoop(plant, output=plant.y).with_(plant__angle=1.0)
    assert simulate(loop, 0.1, 1e-3, jit=False).x.angle[0] == 1.0
    odd = control.ss(-np.eye(3), np.eye(3), np.eye(3), 0.0, states=["2nd", "a b", "a.b"], name="my plant, 2")
    assert list(interop.from_control(odd).states) == ["x_2nd", "a_b", "a_b_2"]
    assert interop.from_control(odd).name == "my_plant_2"
    for name in ("lambda", "driven", "f"):
        named = interop.from_control(control.tf([1.0], [1.0, 1.0], name=name))
        assert named.name == ("x_lambda" if name == "lambda" else name) and named((1.0,), 3.0, 0.0) == (2.0,)


def test_perturbations_act_at_the_input():
    plant = interop.from_control(MIMO["state space"])
    both, one = block(lambda t, x: (0.5, 0.5)), block(lambda t, x: 0.5)
    runs = [simulate(ClosedLoop(plant, output=plant.y, law=block(lambda t: (0.0, 0.0)), perturbation=d), 1.0, 1e-2,
                     jit=False)
            for d in (both, one)]
    assert (runs[0].y[0] == runs[1].y[0]).all() and runs[0].y[0][-1] > 0.05


def test_zeros_are_not_in_the_text():
    plant = interop.from_control(control.ss(np.diag([-1.0, -2.0, -3.0]), np.ones((3, 1)), np.ones((1, 3)), 0.0))
    assert len(plant.f.__code__.co_consts) <= 5  # None, 0 and three coefficients
    assert plant((1.0, 1.0, 1.0), 2.0, 0.5) == (1.5, 0.5, -0.5)


REFUSED = {
    "improper from input 1 to output 1: degree 2 over 1": control.tf([1.0, 2.0, 1.0], [1.0, 1.0]),
    "discrete-time, with steps of 0.1 s": control.tf([1.0], [1.0, 0.5], 0.1),
    "discrete-time, with steps of unspecified length": control.ss([[0.5]], [[1.0]], [[1.0]], [[0.0]], True),
    "direct feedthrough, D = 1 from input 1 to output 1": control.tf([1.0, 2.0], [1.0, 1.0]),
    "no states": control.ss([], [], [], [[0.0]]),
    "it must be a control.TransferFunction or control.StateSpace": control.nlsys(lambda t, x, u, p: -x, None, inputs=1, states=1),
    "float is not allowed": 3.0,
    "not a finite number": control.ss([[np.nan]], [[1.0]], [[1.0]], [[0.0]]),
}


@pytest.mark.parametrize("said", REFUSED)
def test_what_is_refused_and_why(said):
    with pytest.raises(ParameterError) as error:
        interop.from_control(REFUSED[said])
    assert said in str(error.value) and str(error.value).startswith("interop.from_control: ")


def test_a_perturbation_of_the_wrong_size_is_named():
    plant = interop.from_control(MIMO["state space"])
    with pytest.raises(smc.BlockError, match="the perturbation has 3 components, but the input has 2"):
        simulate(ClosedLoop(plant, output=plant.y, law=two_waves, perturbation=block(lambda t, x: (0.0, 0.0, 0.0))), 0.1, 1e-3)
    with pytest.raises(smc.BlockError, match="from_control|values to unpack"):
        simulate(ClosedLoop(plant, output=plant.y, law=wave), 0.1, 1e-3)
