"""Scenarios: designs as data, and what a law needs around it."""

import inspect

import pytest

from smcaero_nb import ClosedLoop, ParameterError, applications, block, hosmc, lv, rpl, smc1, smc2
from smcaero_nb.applications.dc_motor import SCENARIOS
from smcaero_nb.applications.double_integrator import SCENARIO as DOUBLE_INTEGRATOR
from smcaero_nb.core.scenario import Scenario
from smcaero_nb.lv.scenario import SCENARIO as ASCENT
from smcaero_nb.rpl.scenario import SCENARIO as DESCENT

MADE = [(ASCENT, lv.loop), (DESCENT, rpl.loop), (DOUBLE_INTEGRATOR, applications.double_integrator),
        *((scenario, applications.dc_motor) for scenario in SCENARIOS.values())]
made = pytest.mark.parametrize(("scenario", "function"), MADE,
                               ids=["lv", "rpl", "double_integrator", *SCENARIOS])


@block
def mass(x, u, d):
    return (d - u,)


@made
def test_a_design_is_the_task_with_its_stages(scenario, function):
    for (law, preset), stages in scenario.designs.items():
        loop = scenario.loop(law, preset)
        assert (loop.duration, loop.dt, loop.tau) == (
            scenario.task.duration, scenario.task.dt, scenario.task.tau)
        expected = {**scenario.task.stages, **scenario.fit(stages["law"]), **stages}
        assert all(loop.stages[name] is b for name, b in expected.items())
        assert loop.stages["law"] is not None and scenario.task.stages["law"] is None


@made
def test_presets_are_the_designs_by_law(scenario, function):
    pairs = [(law, preset) for law, presets in scenario.presets.items() for preset in presets]
    assert sorted(pairs) == sorted(scenario.designs)
    assert all("recommended" in presets for presets in scenario.presets.values())


@made
def test_the_function_names_the_sources_of_its_scenario(scenario, function):
    said = " ".join(inspect.getdoc(function).split())
    assert scenario.sources and all(source in said for source in scenario.sources)
    assert scenario.name.rpartition(".")[2] == function.__name__


def test_a_law_gets_the_same_around_it_by_name_and_as_a_block():
    for scenario in (DOUBLE_INTEGRATOR, *SCENARIOS.values()):
        for law, presets in scenario.presets.items():
            by_name = scenario.loop(law)
            as_block = scenario.loop(presets["recommended"]["law"])
            assert repr(as_block) == repr(by_name)


def test_what_a_law_sees_decides_its_surface():
    fit = DOUBLE_INTEGRATOR.fit
    assert fit(smc1.sign_smc)["surface"]((0.5, 0.25)) == 1.5  # e' + 2.5 e
    assert fit(smc2.twisting)["surface"]((0.5, 0.25), (0.0, 0.0), 0.1)[0] == (1.5, 0.0)
    assert fit(hosmc.nested(2)) == {}
    for scenario in (DOUBLE_INTEGRATOR, *SCENARIOS.values()):
        with pytest.raises(ParameterError, match=f"^{scenario.name}: nested_3 is for relative "
                                                 "degree 3; it must be 1, on a sliding variable, "
                                                 "or 2$"):
            scenario.fit(hosmc.nested(3))


def test_a_scenario_for_higher_laws_only_says_which():
    scenario = Scenario("mine", ClosedLoop(mass), {}, around={2: {}, 3: {}})
    for law, r in ((smc1.sign_smc, 1), (smc2.twisting, 1), (hosmc.nested(4), 4)):
        with pytest.raises(ParameterError, match=f"^mine: {law.name} is for relative degree {r}; "
                                                 "it must be 2 or 3$"):
            scenario.loop(law)


def test_a_scenario_of_complete_designs_takes_no_other_law():
    for scenario in (ASCENT, DESCENT):
        with pytest.raises(ParameterError, match=f"^{scenario.name}: law = sign_smc.* is not "
                                                 "allowed; it must be one of '"):
            scenario.loop(smc1.sign_smc)


def test_your_own_scenario():
    task = ClosedLoop(mass, duration=1.0, dt=1e-3)
    scenario = Scenario("mine", task, {("relay", "strong"): dict(law=smc1.sign_smc.with_(rho=9.0)),
                                       ("relay", "weak"): dict(law=smc1.sign_smc)})
    loop = scenario.loop("relay", "strong")
    assert loop.name == "relay, strong" and loop.stages["law"].values["rho"] == 9.0
    assert (loop.duration, loop.dt, loop.stages["plant"]) == (1.0, 1e-3, mass)
    with pytest.raises(ParameterError, match="^mine of relay: preset = 'recommended' is not allowed"
                                             "; it must be one of 'strong', 'weak'$"):
        scenario.loop("relay")


def test_titles_name_the_law_and_the_task_or_the_preset():
    assert ASCENT.loop("hosm", "r3").name == "hosm, r3"
    assert DOUBLE_INTEGRATOR.loop("levant2005").name == "levant2005_2, double integrator"
    assert SCENARIOS["speed"].loop(smc1.tanh_smc).name == "tanh_smc, motor's speed"
    around = Scenario("mine", ClosedLoop(mass), {}, around={None: {}})
    assert around.loop(smc1.sign_smc).name == "sign_smc, recommended"
