"""How wary a filter is of ranges: of real ones more than of emulated ones, and by the rules of its scenario."""

import pytest

from zenoh_cbef.scenario import trust
from zenoh_cbef.scenario.load import load, parse
from zenoh_cbef.scenario.plan import Plan

OUTLIERS, REAL, OLD = {"outlier_probability": 0.1}, {"real": True}, {"defaults": 1}
DATASET = {"target": {"motion": "dataset", "path": "set"}, "agents": {"positions": [[0, 0, 0], [9, 0, 0], [0, 9, 0]]}}


@pytest.mark.parametrize(
    ("keys", "power", "xi"),
    [
        ({}, 2, 2.0),
        # Where a scenario tells of no outliers: only with a first fix, and a motion that the filter knows.
        ({"filter": {"defaults": 2}}, 1, 1.5),
        ({"filter": {"start": "given"}}, 1, 1.5),
        ({"filter": {"kind": "ci"}}, 1, 1.5),
        ({"target": {"motion": "circle"}}, 1, 1.5),
        ({"sensor": OUTLIERS}, 2, 2.0),
        ({"sensor": REAL}, 2, 2.0),
        (DATASET, 2, 2.0),
        ({**DATASET, "filter": {"bias": "none"}}, 2, 2.0),
        ({"sensor": OUTLIERS, "filter": {"saturation": "bounded"}}, 1, 1.5),
        ({"filter": {"saturation": "redescending", "xi": 3.0}}, 2, 3.0),
        # The first rules, as logs of 0.2.0 have them: always with a level of their own.
        ({**DATASET, "filter": {**OLD, "xi": 1.5}}, 2, 1.5),
        ({**DATASET, "filter": {**OLD, "xi": 1.5, "bias": "none"}}, 1, 1.5),
        ({**DATASET, "filter": {**OLD, "xi": 1.5, "range_std": "auto"}}, 1, 1.5),
    ],
)
def test_saturation_redescends_where_there_may_be_outliers(keys, power, xi):
    plan = Plan(parse(keys, "test"))
    assert (plan.power, plan.xi) == (power, xi)
    assert (plan.settings.power, plan.settings.xi) == (power, xi)


@pytest.mark.parametrize(
    ("keys", "widens"),
    [
        ({}, 0.0),
        ({"sensor": OUTLIERS}, 0.0),
        ({"sensor": REAL}, 0.5),
        ({"sensor": REAL, "filter": {"defaults": 23}}, 1.0),
        (DATASET, 0.5),
        ({**DATASET, "filter": {"defaults": 23}}, 1.0),
        ({**DATASET, "filter": {"motion": "imm"}}, 1.0),
        ({**DATASET, "filter": {"saturation": "bounded"}}, 0.0),
        ({**DATASET, "filter": {"defaults": 6}}, 0.0),
        ({"dt": 5.0, "filter": {"defaults": 11}}, 1.0),
        ({"target": {"motion": "circle"}}, 0.0),
        ({"target": {"motion": "circle"}, "sensor": OUTLIERS}, 1.0),
        ({"target": {"motion": "circle"}, "sensor": OUTLIERS, "filter": {"defaults": 6}}, 0.0),
    ],
)
def test_ranges_far_off_widen_their_innovation_where_priors_may_be_wide(keys, widens):
    assert Plan(parse(keys, "test")).settings.widens == widens


TOLD = {"sensor": {"bias_std": 0.5}}


@pytest.mark.parametrize(
    ("keys", "bias", "own"),
    [
        (TOLD, "estimate", 0.5),
        ({**TOLD, "filter": {"defaults": 6}}, "auto", 0.015),
        ({**TOLD, "filter": {"bias": "auto", "bias_own_std": 0.2}}, "estimate", 0.2),
        ({**TOLD, "filter": {"bias": "none"}}, "none", 0.5),
        ({**TOLD, "filter": {"motion": "turn"}}, "none", 0.5),
        ({"sensor": {"bias_std": 0.5, "real": True}}, "auto", 0.02),
        ({"sensor": {"bias_std": 0.5, "real": True}, "filter": {"defaults": 27}}, "auto", 0.015),
        ({"sensor": {"bias": 0.3}}, "estimate", 0.015),
        ({"sensor": {"bias": 0.3}, "filter": {"defaults": 11}}, "auto", 0.015),
        ({"sensor": {"bias": 0.3, "real": True}}, "auto", 0.02),
        ({"sensor": {"bias": [3, 0, 0, 0, 0, 0]}}, "auto", 0.015),  # a single one is found by other means
        ({"sensor": {"bias": [1, -1, 1, -1, 1, -1]}}, "estimate", 1.0),
        ({"sensor": {"bias": [0.5, 0.5, 0.1, 0.9, 0.5, 0.9], "bias_std": 0.3}}, "estimate", 0.3606),
        ({}, "none", 0.015),
    ],
)
def test_a_bias_of_which_the_scenario_tells_is_estimated_with_what_it_tells(keys, bias, own):
    plan = Plan(parse(keys, "test"))
    assert plan.bias == bias
    assert plan.settings.own_bias_std == pytest.approx(own, rel=1e-3)


@pytest.mark.parametrize(
    ("bias", "together"),
    [
        (0.0, True),
        (0.3, True),
        ([3, 0, 0, 0, 0, 0], False),
        ([1, -1, 1, -1, 1, -1], True),
        ([2, 1, 3, 1, 3, 2], True),
    ],
)
def test_biases_are_estimated_together_but_where_a_single_receiver_has_another(bias, together):
    assert Plan(parse({"sensor": {"bias": bias, "bias_std": 0.1}}, "test")).settings.joint_biases == together


@pytest.mark.parametrize("kind", ["cbef", "cbef-scaled"])
def test_the_papers_filters_saturate_in_units_of_their_own(kind):
    assert Plan(parse({"sensor": REAL, "filter": {"kind": kind}}, "test")).xi == 1.5


@pytest.mark.parametrize(
    ("keys", "distrusts", "bias"),
    [
        ({}, False, "none"),
        ({"sensor": REAL}, True, "auto"),
        (DATASET, True, "auto"),
        ({**DATASET, "filter": OLD}, False, "auto"),
        ({"sensor": REAL, "filter": {"distrust": False, "bias": "none"}}, False, "none"),
        ({"sensor": REAL, "consensus": {"trim": 1}}, False, "none"),
    ],
)
def test_real_receivers_may_be_wrong_in_every_range(keys, distrusts, bias):
    plan = Plan(parse(keys, "test"))
    assert (plan.distrusts_own, plan.bias) == (distrusts, bias)


SILENT = '{kind="sensor-dropout",probability=1.0,agents=[1]}'
SPIKES = '{kind="sensor-spikes",probability=0.3}'
STUCK = '{kind="sensor-stuck",agents=[2]}'
BIASED = '{kind="sensor-bias",bias=0.3,agents=[1]}'


@pytest.mark.parametrize(
    ("fault", "rules", "models", "power"),
    [
        (SILENT, 15, 5, 1),
        (SPIKES, 15, 4, 2),
        (STUCK, 15, 4, 1),
        (BIASED, 15, 0, 1),
        (f"{SILENT},{BIASED}", 15, 0, 1),
        (SILENT, 14, 0, 1),
        (SPIKES, 14, 0, 1),
        (STUCK, 14, 0, 1),
    ],
)
def test_of_faults_only_such_as_last_are_taken_for_biases_and_spikes_for_outliers(fault, rules, models, power):
    keys = "target.motion=circle", f"filter.defaults={rules}", f"fault=[{fault}]"
    plan = Plan(load("tracking", keys).scenario)
    assert (len(plan.models), plan.power, plan.distrusts_own) == (models, power, True)


def biased(*faults, rules=16, **keys):
    """The plan of faults that make ranges longer."""
    return Plan(
        parse(
            {"filter": {"defaults": rules}, "fault": [{"kind": "sensor-bias", **one} for one in faults], **keys}, "test"
        )
    )


@pytest.mark.parametrize(
    ("faults", "keys", "size"),
    [
        ([{"bias": 0.3, "agents": [1]}], {}, 0.3 / 6**0.5),
        ([{"bias": -0.3}], {}, 0.3),
        ([{"bias": 0.3, "agents": [1]}, {"bias": -0.2, "agents": [2, 3]}], {}, ((0.09 + 0.08) / 6) ** 0.5),
        ([{"bias": 0.7, "agents": [1]}], {}, 0.0),
        ([{"bias": 0.3, "agents": [1]}, {"bias": 3.0, "agents": [2]}], {}, 0.0),
        ([{"bias": 0.3, "agents": [1], "from": 5.0}], {}, 0.0),
        ([{"bias": 0.3, "agents": [1]}], {"rules": 15}, 0.0),
        ([{"bias": 0.3, "agents": [1]}], {"agents": {"count": 13}}, 0.0),
        ([{"bias": 3.0, "agents": [2]}], {"sensor": {"bias_std": 0.5}}, 3.0 / 6**0.5),
    ],
    ids=[
        "one of six",
        "all",
        "three",
        "one that shows",
        "another that shows",
        "a later one",
        "older rules",
        "many agents",
        "beside drawn ones",
    ],
)
def test_biases_that_no_range_shows_are_estimated_by_their_size(faults, keys, size):
    plan = biased(*faults, **keys)
    assert trust.hidden_bias(plan.scenario) == pytest.approx(size)
    assert (plan.bias == "estimate") == (size > 0.0)
