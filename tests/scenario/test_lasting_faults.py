"""A receiver that is lastingly wrong, and a target that turns: several motions, or one with biases beside it."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.stress import cases, scenario_of
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate

CIRCLE = "target.motion=circle", "target.radius=5", "target.period=8"
WRONG = 'fault=[{kind="sensor-bias",bias=3.0,agents=[1]}]'


@pytest.mark.parametrize(
    ("more", "several", "bias", "told"),
    [
        ([], True, "none", True),
        (["filter.defaults=25"], False, "none", True),
        # Agents that average weigh their own ranges by how likely these are right, if they may.
        (["agents.count=13"], True, "none", False),
        (["timing.mode=realtime"], True, "none", False),
        (["filter.kind=icf"], False, "auto", False),
        (["filter.saturation=bounded"], False, "auto", False),
        # Constant errors of all receivers, and those too small to show, are biases.
        (["sensor.bias=0.5"], False, "estimate", False),
        (["sensor.bias_std=0.2"], True, "estimate", True),
        ([WRONG.replace("3.0", "0.3")], True, "estimate", True),
        (["sensor.real=true"], False, "auto", False),
        # What the scenario decides.
        (["filter.bias=estimate"], False, "estimate", False),
        (["filter.motion=ncv"], False, "none", True),
    ],
    ids=lambda one: " ".join(one) if isinstance(one, list) else None,
)
def test_a_receiver_with_a_large_fault_is_wrong_and_not_biased(more, several, bias, told):
    plan = Plan(load("tracking", [*CIRCLE, WRONG, *more]).scenario)
    assert (bool(plan.models), plan.bias, plan.tells_ranges) == (several, bias, told)


@pytest.mark.parametrize("case", ["circle-and-a-biased-agent", "many-agents-circle-and-a-biased-one"])
def test_several_motions_follow_a_turn_beside_a_wrong_receiver(case):
    errors = []
    for rules in (26, 25):
        (trace,) = simulate([scenario_of(cases()[case], [f"filter.defaults={rules}", "seed=1002", "steps=160"])])
        off = (trace.estimates - trace.truth)[:, 40:, :3]
        errors.append(float(np.sqrt(np.mean(np.sum(off * off, axis=2)))))
    today, before = errors
    assert today < 0.08
    assert before > 1.8 * today
