"""A fault that is injected into a run changes what happens, and nothing of what its agents have decided."""

import numpy as np
import pytest

from zenoh_cbef.errors import UserError
from zenoh_cbef.plain import Json, read_toml
from zenoh_cbef.scenario.injected import liars, with_faults
from zenoh_cbef.scenario.load import load, parse, to_toml
from zenoh_cbef.scenario.plan import Plan

SCENARIOS: dict[str, list[str]] = {
    "sure": [],
    "out of reach": ["sensor.reach=9"],
    "told outliers": ["sensor.outlier_probability=0.3"],
    "biases": ["sensor.bias=0.4", "sensor.bias_std=0.15"],
    "a circle": ['target.motion="circle"'],
    "integers": ['consensus.precision="int16"'],
}
FAULTS: list[dict[str, Json]] = [
    {"kind": "byzantine", "agents": [5]},
    {"kind": "loss", "probability": 0.5},
    {"kind": "crash", "agents": [2]},
    {"kind": "sensor-dropout", "agents": [1, 2, 3]},
    {"kind": "sensor-bias", "agents": [1], "bias": 5.0},
]


@pytest.mark.parametrize("keys", SCENARIOS.values(), ids=SCENARIOS.keys())
def test_agents_go_on_as_they_began(keys):
    plan = load("tracking", ["agents.count=6", *keys]).plan
    for fault in FAULTS:
        extended = with_faults(plan, [{**fault, "from": 5.0}])
        # So it is, too, in the scenario that repeats the run.
        for one in (extended, Plan(parse(read_toml(to_toml(extended.scenario)), "it"))):
            assert repr(one.settings) == repr(plan.settings)
            assert (one.message_size, one.scheme, one.isolates) == (plan.message_size, plan.scheme, plan.isolates)
            assert np.array_equal(one.initial_covariance, plan.initial_covariance)
            assert one.absences.any == (fault["kind"] == "crash")


def test_who_lies_is_known_from_the_scenario_and_from_what_was_injected():
    plan = load("tracking", ['fault=[{kind="byzantine", agents=[1]}]']).plan
    assert liars(plan, "") == {1}
    assert liars(plan, '[{"kind": "byzantine", "agents": [4]}, {"kind": "loss", "probability": 0.5}]') == {1, 4}
    with pytest.raises(UserError, match="no JSON"):
        liars(plan, "[")
