"""Plants from python-control against `control.forced_response`; what is refused, and why."""

import control
import numpy as np
import pytest

import smcaero_nb as smc
from smcaero_nb import BlockError, ClosedLoop, ParameterError, block, channels, interop, simulate
from smcaero_nb.ui.curves import panels

TAU = 0.01


@block
def wave(t):
    return np.sign(np.sin(3.0*t + 0.1))*(1.0 + 0.5*t)


@block
def two_waves(t):
    return 1.0 + t, np.cos(2.0*t)


@block
def three_waves(t):
    return 1.0 + t, np.cos(2.0*t), -0.5*t


@block
def ramp(t):
    return 0.3 - 0.4*t


@block
def two_ramps(t):
    return 0.3 - 0.4*t, 0.5*t


def realised(sys):
    """A state space made without the kit: of a matrix, those of its entries side by side."""
    if isinstance(sys, control.StateSpace):
        return sys
    p, m = sys.noutputs, sys.ninputs
    entries = control.append(*(control.ss(sys[i, j]) for i in range(p) for j in range(m)))
    return np.kron(np.eye(p), np.ones((1, m)))*entries*np.kron(np.ones((p, 1)), np.eye(m))


def compare(sys, law, tolerance=1e-9, duration=2.0, jit=False, perturbation=None):
    """The block's outputs are those of `control.forced_response`, relative to the largest."""
    plant = interop.from_control(sys)
    dt = TAU/10
    loop = ClosedLoop(plant, output=plant.y, law=law, perturbation=perturbation)
    run = simulate(loop, duration, dt, TAU, method="rk4", record=10**6, jit=jit)
    # forced_response joins inputs by straight lines, so it is given each interval of the hold by
    # itself
    ss = realised(sys)
    x, before, wanted = np.zeros(ss.nstates), np.zeros(ss.ninputs), []
    T = np.arange(11)*dt
    for k in range(round(duration/TAU)):
        u = np.atleast_1d(law(k*TAU))
        d = [np.atleast_1d(perturbation(k*TAU + q)) if perturbation else 0.0*u for q in T]
        part = control.forced_response(ss, T, (u + d).T, x, squeeze=False)
        wanted.append(part.outputs[:, :-1])
        # a sample measures y under the control of the sample before
        wanted[-1][:, 0] += ss.D @ (before - u)
        x, before = part.states[:, -1], u
    wanted = np.concatenate(wanted, axis=1)
    got = np.array([q for q, in run.y] if isinstance(run.y, tuple) else [run.y])[:, :-1]
    assert np.abs(got - wanted).max() <= tolerance*np.abs(wanted).max()


SISO = {
    "lag": control.tf([2.0], [0.5, 1.0]),
    "zeros and a fast pole": control.tf([1.0, 3.0, 1.0], [0.05, 1.0, 2.0, 5.0]),
    "eq (7)": smc.lv.transfer_function(),
    "unstable": control.tf([1.0, -1.0], [1.0, 0.2, -1.0]),
    "integrators": control.tf([1.0], [1.0, 0.0, 0.0, 0.0]),
    "state space": control.ss([[0.0, 1.0], [-4.0, -0.4]], [[0.0], [2.0]], [[1.0, 0.5]], [[0.0]],
                              states=["angle", "rate"]),
    "zero-pole-gain": control.zpk([-1.0], [-2.0, -3.0, -4.0], 5.0),
    "biproper": control.tf([2.0, 1.0, 3.0], [1.0, 0.8, 2.0]),
    "biproper state space": control.ss([[0.0, 1.0], [-4.0, -0.4]], [[0.0], [2.0]], [[1.0, 0.5]],
                                       [[-0.7]]),
}


@pytest.mark.parametrize("name", SISO)
def test_one_input_and_output_as_forced_response(name):
    compare(SISO[name], wave, 1e-7 if "zeros" in name else 1e-9, jit=name in ("eq (7)", "biproper"))


@pytest.mark.parametrize("name", ["lag", "biproper", "biproper state space"])
def test_with_a_perturbation_as_forced_response(name):
    compare(SISO[name], wave, perturbation=ramp)


def test_the_transfer_function_itself_as_forced_response():
    sys = SISO["zeros and a fast pole"]
    plant = interop.from_control(sys)
    step = block(lambda t: 1.0)
    run = simulate(ClosedLoop(plant, output=plant.y, law=step), 3.0, 1e-3, method="rk4",
                   record=10**6, jit=False)
    assert run.y == pytest.approx(control.forced_response(sys, run.t, np.ones_like(run.t)).outputs,
                                  abs=1e-7)


MIMO = {
    "transfer matrix": control.tf([[[1.0], [2.0, 1.0]], [[3.0], [1.0]]],
                                  [[[1.0, 1.0], [1.0, 3.0, 2.0]], [[1.0, 1.0], [1.0, 4.0]]]),
    "wide transfer matrix": control.tf([[[1.0], [2.0, 1.0], [0.0]],
                                        [[3.0, 0.0, 1.0], [5.0], [-1.0, 4.0]]],
                                       [[[1.0, 2.0], [1.0, 3.0, 2.0], [1.0]],
                                        [[1.0, 2.0, 2.0], [2.0, 1.0], [1.0, 0.0, 4.0]]]),
    "state space": control.ss([[0.0, 1.0, 0.0], [-2.0, -1.0, 0.5], [0.0, 0.0, -3.0]],
                              [[0.0, 0.0], [1.0, 0.2], [0.0, 1.0]],
                              [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 1.0]],
                              np.zeros((3, 2))),
    "biproper transfer matrix": control.tf([[[1.0, 3.0], [2.0, 1.0]], [[3.0], [-2.0]]],
                                           [[[1.0, 1.0], [1.0, 3.0, 2.0]], [[1.0, 1.0], [1.0]]]),
    "biproper state space": control.ss(np.diag([-1.0, -2.0]), [[1.0, 0.0], [0.5, 1.0]],
                                       [[1.0, 1.0], [0.0, 0.0], [1.0, 0.0]],
                                       [[0.0, 0.0], [0.3, -2.0], [0.0, 1.0]]),
}


@pytest.mark.parametrize("name", MIMO)
def test_many_inputs_and_outputs_as_forced_response(name):
    compare(MIMO[name], three_waves if "wide" in name else two_waves, jit="state space" in name)


@pytest.mark.parametrize("sys", [*SISO.values(), *MIMO.values()],
                         ids=[*SISO, *(f"{n}, many" for n in MIMO)])
def test_realisations_have_the_transfer_functions_of_their_systems(sys):
    A, B, C, D, _ = interop.matrices(sys)
    for s in (0.3 + 0.2j, -0.7 + 2.0j, 1.0 - 5.0j):
        assert C @ np.linalg.solve(s*np.eye(len(A)) - A,
                                   B) + D == pytest.approx(sys(s, squeeze=False), rel=1e-9,
                                                           abs=1e-12)


@pytest.mark.parametrize("perturbation", [ramp, two_ramps])
def test_many_inputs_with_a_perturbation_as_forced_response(perturbation):
    compare(MIMO["biproper state space"], two_waves, perturbation=perturbation)


# ---- several outputs are channels ----
COUPLED = control.tf([[[1.0], [0.5]], [[0.2], [1.0]]],
                     [[[1.0, 1.0], [1.0, 2.0]], [[1.0, 1.5], [1.0, 1.0]]])
ONE_EACH = block(lambda t: (1.0, -2.0))
each = block(lambda e, k=2.0: (k*e[0][0], k*e[1][0]))


def coupled(reference=ONE_EACH, law=each, **stages):
    plant = interop.from_control(COUPLED)
    loop = ClosedLoop(plant, output=plant.y, reference=reference, law=law, **stages)
    return simulate(loop, 2.0, 1e-3, TAU, record=10**6, jit=False)


def test_several_outputs_are_channels_and_one_is_a_number():
    assert interop.from_control(COUPLED).y((1.0, 1.0, 1.0, 1.0)) == ((1.5,), (1.2,))
    assert interop.from_control(SISO["lag"]).y((1.0,)) == 4.0


def test_the_mean_error_of_a_2_x_2_system_has_one_figure_per_output():
    run = coupled()
    figures, held = run.metrics(), slice(-1)  # the last row is the end of the last step
    for i, target in enumerate((1.0, -2.0)):
        error = np.abs(target - run.y[i][0])
        assert figures.J_e[i] == pytest.approx(error[held].mean(), rel=1e-9)
        assert figures.tail_e[i] == pytest.approx(error[-401:].max(), rel=1e-9)
    assert figures.J_e[1] > 1.5*figures.J_e[0]


def test_both_outputs_of_a_2_x_2_system_are_drawn_as_outputs():
    curves = {c.key: (c.row, c.column) for c in panels(coupled())}
    assert not any(row == "rate" for row, _ in curves.values())
    assert [curves[n] for n in ("y[0]", "r[0]", "y[1]", "r[1]")] == [
        ("output", 0), ("output", 0), ("output", 1), ("output", 1)]


def test_a_number_as_reference_for_several_outputs_is_refused():
    with pytest.raises(BlockError, match="reference"):
        coupled(block(lambda t: 1.0))


def test_a_reference_per_output_may_be_nested_or_a_tuple_of_numbers():
    runs = [coupled(r) for r in (ONE_EACH, block(lambda t: ((1.0,), (-2.0,))))]
    assert all((a[0] == b[0]).all() for a, b in zip(*(run.e for run in runs), strict=True))


def test_the_perturbation_of_each_channel_is_found():
    law = channels(a=smc.smc2.super_twisting, b=smc.smc2.super_twisting)
    stage = channels(a=smc.differentiators.differentiator(0),
                     b=smc.differentiators.differentiator(0))
    run = coupled(law=law, differentiator=stage)
    assert len(run.xi) == 2 and all(np.isfinite(xi).all() for xi in run.xi) and run.doubts() == []


@pytest.mark.parametrize("law", [channels(a=smc.smc2.super_twisting, b=smc.smc2.super_twisting),
                                 smc.smc1.unit_vector.with_(rho=5.0)],
                         ids=["a law per channel", "one law for all"])
def test_a_law_acts_on_the_outputs_without_a_surface(law):
    run = coupled(law=law)
    assert run.metrics().tail_e[0] < 0.1*abs(run.e[0][0][0]) and len(run.xi) == 2


def test_entries_of_a_column_with_the_same_denominator_share_their_states():
    assert len(interop.from_control(MIMO["transfer matrix"]).z0) == 4  # not 5


@pytest.mark.parametrize("name", ["eq (7)", "biproper"])
def test_compiled_and_plain_runs_agree_to_the_last_bit(name):
    plant = interop.from_control(SISO[name])
    loop = ClosedLoop(plant, output=plant.y, law=wave, perturbation=ramp)
    a, b = (simulate(loop, 0.2, 1e-3, TAU, jit=q) for q in (True, False))
    assert (a.y == b.y).all()


def test_an_output_asks_for_the_control_only_where_there_is_a_feedthrough():
    assert interop.from_control(SISO["lag"]).y.signals == ("x",)
    y = interop.from_control(SISO["biproper"]).y
    assert y.signals == ("x", "u", "d") and y((0.0, 0.0), 1.0, 0.5) == 3.0
    assert "D (u + d)" in y.__doc__


@pytest.mark.parametrize(("gain", "settles"), [(0.9, True), (1.1, False)])
def test_feedback_through_the_feedthrough_settles_for_gains_below_1_over_d(gain, settles):
    # D = 1, by feedback of any gain stable if continuous
    plant = interop.from_control(control.tf([1.0, 2.0], [1.0, 1.0]))
    law = block(lambda sigma, k=1.0: k*sigma).with_(k=gain)
    run = simulate(ClosedLoop(plant, output=plant.y, reference=block(lambda t: 1.0), law=law), 5.0,
                   1e-3, jit=False)
    assert (run.diverged_at is None) == settles
    assert not settles or run.y[-1] == pytest.approx(2.0*gain/(1.0 + 2.0*gain), rel=1e-3)


def test_states_keep_their_names_and_can_be_set():
    plant = interop.from_control(SISO["state space"])
    assert list(plant.states) == ["angle", "rate"]
    loop = ClosedLoop(plant, output=plant.y).with_(plant__angle=1.0)
    assert simulate(loop, 0.1, 1e-3, jit=False).x.angle[0] == 1.0
    odd = control.ss(-np.eye(3), np.eye(3), np.eye(3), 0.0, states=["2nd", "a b", "a.b"],
                     name="my plant, 2")
    assert list(interop.from_control(odd).states) == ["x_2nd", "a_b", "a_b_2"]
    assert interop.from_control(odd).name == "my_plant_2"
    for name in ("lambda", "total", "f"):
        named = interop.from_control(control.tf([1.0], [1.0, 1.0], name=name))
        assert named.name == ("x_lambda" if name == "lambda" else name)
        assert named((1.0,), 3.0, 0.0) == (2.0,)


def test_perturbations_act_at_the_input():
    plant = interop.from_control(MIMO["state space"])
    both, one = block(lambda t, x: (0.5, 0.5)), block(lambda t, x: 0.5)
    runs = [simulate(ClosedLoop(plant, output=plant.y, law=block(lambda t: (0.0, 0.0)),
                                perturbation=d), 1.0, 1e-2,
                     jit=False)
            for d in (both, one)]
    a, b = (run.y[0][0] for run in runs)
    assert (a == b).all() and a[-1] > 0.05


def test_zeros_are_not_in_the_text():
    plant = interop.from_control(control.ss(np.diag([-1.0, -2.0, -3.0]), np.ones((3, 1)),
                                            np.ones((1, 3)), 0.0))
    assert len(plant.f.__code__.co_consts) <= 5  # None, 0 and three coefficients
    assert plant((1.0, 1.0, 1.0), 2.0, 0.5) == (1.5, 0.5, -0.5)


REFUSED = {
    "improper from input 1 to output 1: degree 2 over 1": control.tf([1.0, 2.0, 1.0], [1.0, 1.0]),
    "discrete-time, with steps of 0.1 s": control.tf([1.0], [1.0, 0.5], 0.1),
    "discrete-time, with steps of unspecified length":
        control.ss([[0.5]], [[1.0]], [[1.0]], [[0.0]], True),
    "no states": control.ss([], [], [], [[0.0]]),
    "it must be a control.TransferFunction or control.StateSpace":
        control.nlsys(lambda t, x, u, p: -x, None, inputs=1, states=1),
    "Write them as a plant:\n\n@block(state=dict(x0=0.0, x1=0.0))\ndef plant(x, u, d):":
        control.interconnect([control.nlsys(lambda t, x, u, p: -x, None, inputs=["u"], states=1,
                                            outputs=["y"], name="body")],
                             inputs=["u"], outputs=["y"]),
    "fit a transfer function to them":
        control.frd(control.tf([1.0], [1.0, 1.0]), np.logspace(-1, 1, 20)),
    "before control.c2d; a sampled controller or filter is a block with memory":
        control.c2d(control.ss(control.tf([1.0], [1.0, 1.0])), 0.1),
    "float is not allowed": 3.0,
    "not a finite number": control.ss([[np.nan]], [[1.0]], [[1.0]], [[0.0]]),
}


@pytest.mark.parametrize("said", REFUSED)
def test_what_is_refused_and_why(said):
    with pytest.raises(ParameterError) as error:
        interop.from_control(REFUSED[said])
    assert said in str(error.value) and str(error.value).startswith("interop.from_control: ")


def test_the_ways_out_work():
    @block(state=dict(x0=0.0, x1=0.0))
    def plant(x, u, d):
        return x[1], -x[0] + u + d

    sys = control.nlsys(lambda t, x, u, p: [x[1], -x[0] + u[0]], None, inputs=1, states=2)
    linear = interop.from_control(sys.linearize([0.0, 0.0], [0.0]))
    one = block(lambda t: 1.0)
    a, b = (simulate(ClosedLoop(q, law=one), 2.0, 1e-3, method="rk4", jit=False).y
            for q in (plant, linear))
    assert a[0] == pytest.approx(b[0], abs=1e-5)


@pytest.mark.parametrize("name", ["state space", "biproper state space"])
def test_a_perturbation_of_the_wrong_size_is_named(name):
    plant = interop.from_control(MIMO[name])
    with pytest.raises(smc.BlockError, match="the perturbation has 3 components, but the input has "
                                             "2"):
        simulate(ClosedLoop(plant, output=plant.y, law=two_waves,
                            perturbation=block(lambda t, x: (0.0, 0.0, 0.0))), 0.1, 1e-3)
    with pytest.raises(smc.BlockError, match="from_control|values to unpack|of which the plant "
                                             "takes 2, but"):
        simulate(ClosedLoop(plant, output=plant.y, law=wave), 0.1, 1e-3)
