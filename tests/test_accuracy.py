"""The order of sliding, measured."""

import math

import numpy as np
import pytest
from chain import loop_of_two, signs

import smcaero_nb as smc
from smcaero_nb import (
    ClosedLoop,
    ParameterError,
    accuracy,
    applications,
    block,
    hosmc,
    simulate,
    smc1,
    smc2,
)
from smcaero_nb.applications import perturbed_chain


@pytest.mark.parametrize(("law", "r", "order"), [
    (smc1.sign_smc, 1, 1), (smc1.dual_layer_smc, 1, 1), (smc2.super_twisting, 1, 2),
    (smc2.twisting, 1, 2),
    (hosmc.quasi_continuous(2), 2, 2), (hosmc.quasi_continuous(3), 3, 3),
    (hosmc.quasi_continuous(4), 4, 4),
    (hosmc.quasi_continuous(5), 5, 5), (hosmc.nested(3), 3, 3)],
                         ids=lambda q: getattr(q, "name", ""))
def test_order_of_the_laws(law, r, order):
    found = accuracy(perturbed_chain(law, r))
    assert found.order == order and found.why == ""
    assert found.slopes == pytest.approx([order - i for i in range(len(found.slopes))], abs=0.25)
    assert len(found.names) == r and found.sizes.shape == (r, 5)
    assert found.explain().startswith(f"Sliding of order {order}: |sigma| ~ "
                                      f"tau^{found.slopes[0]:.2f}")
    assert found.explain().endswith("; shown from this start and under this perturbation.")


def test_several_inputs():
    for law, names in ((smc1.unit_vector, ("sigma[0]", "sigma[1]")),
                       (signs(), ("sigma[0]", "sigma[1]"))):
        found = accuracy(loop_of_two(law, a=0.7, b=0.4), 10.0, 1e-3)
        assert found.names == names and found.order == 1


def test_what_hides_the_order():
    layer = accuracy(perturbed_chain(smc1.quasi_smc, 1))
    assert (layer.order is None and abs(layer.slopes[0]) < 0.01
            and "does not come from sampling" in str(layer))
    lag = accuracy(applications.dc_motor("super_twisting"))  # the motor's inductance
    assert lag.order != 2 and lag.slopes[0] < 1.5


def test_what_is_left_out_is_said():
    loop = perturbed_chain(hosmc.quasi_continuous(3), 3)
    early = accuracy(loop, 6.0)
    assert early.order is None and all(map(math.isnan, early.slopes))
    assert (early.explain().startswith("No order of sliding was found: tau = 0.004")
            and "still converging" in early.why)
    lost = accuracy(smc.lv.loop("quasi_smc", "paper"), 20.0, 1e-3)
    assert lost.order is None and "diverged" in lost.why


def test_progress_and_cancel():
    told = []
    accuracy(perturbed_chain(smc1.sign_smc, 1), 5.0, progress=told.append)
    assert told == sorted(told) and told[-1] == pytest.approx(1.0)

    def stop(fraction):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        accuracy(perturbed_chain(smc1.sign_smc, 1), progress=stop)


@pytest.mark.parametrize(("call", "message"), [
    (lambda: accuracy(perturbed_chain(smc1.sign_smc, 1), factors=(1.0, 2.0, 1.0, 0.5)),
     "at least four different numbers"),
    (lambda: accuracy(perturbed_chain(smc1.sign_smc, 1), factors=(1.0, 2.0, 0.0, 0.5)),
     r"factors\[2\] = 0 is not allowed"),
    (lambda: accuracy(perturbed_chain(smc1.sign_smc, 1).with_(law=None)), "no law"),
    (lambda: accuracy(perturbed_chain(smc1.sign_smc, 1).with_(dt=None)), "dt .s. is not given")])
def test_bad_input(call, message):
    with pytest.raises(ParameterError, match=message):
        call()


def test_a_loop_that_ends_before_its_second_half_has_no_order():
    """Nothing was measured there, and that is the reason given."""
    @block
    def early(t, x):
        return 1.0 - t

    found = accuracy(perturbed_chain(smc1.sign_smc, 1).with_(stop=early), duration=4.0)
    assert (found.order is None and np.isnan(found.sizes).all()
            and "ended before its second half" in str(found))


def test_what_is_measured_has_the_names_of_its_leaves():
    """One law for two channels with derivatives: sigma[0], sigma[0]', ..., not sigma[0] to [3]."""
    one = hosmc.quasi_continuous(2).with_(L=2.0)

    @block(card=smc.card.Law(r=2, sees="derivatives", channels=True))
    def law(sigma):
        return one(sigma[0]), one(sigma[1])

    @block(state=dict(a=1.0, da=0.0, b=0.5, db=0.0))
    def motions(x, u, d):
        return x[1], u[0] + d, x[3], u[1] + d

    loop = ClosedLoop(motions, output=block(lambda x: ((x[0], x[1]), (x[2], x[3]))), law=law,
                      perturbation=block(lambda t: 0.3*math.sin(t)))
    found = accuracy(loop, 15.0, 1e-3)
    leaves = simulate(loop, 1.0, 1e-3, jit=False).leaves("sigma")
    assert found.names == tuple(q.key for q in leaves) == ("sigma[0]", "sigma[0]'", "sigma[1]",
                                                           "sigma[1]'")
    assert found.slopes == pytest.approx([2.0, 1.0, 2.0, 1.0], abs=0.25) and found.order == 2


def test_times_that_the_factors_make_impossible_are_said_to_come_from_them():
    """A latency of 3 ms is a multiple of dt = 1 ms, but not of the 4 ms of the first factor."""
    loop = perturbed_chain(smc1.sign_smc, 1).with_(latency=3e-3, dt=1e-3)
    with pytest.raises(ParameterError, match=(
            "accuracy: tau and dt are multiplied by the factors, here by 4, and then: simulate: "
            r"latency = 0.003 s is not allowed; .* multiple of dt = 0.004 s.*other factors\)$")):
        accuracy(loop)
    with pytest.raises(ParameterError, match="here by 4, and then: .*pulse = 0.05 s.*tau = 0.2 s"):
        accuracy(smc.rpl.loop())
    assert len(accuracy(loop, 2.0, factors=(3.0, 1.0, 0.5, 0.25)).tau) == 4
