"""The numbers of injected faults are those by which a run names its faults."""

import re

import pytest

from zenoh_cbef.errors import UserError
from zenoh_cbef.nodes.target.injection import Injection, StepTime
from zenoh_cbef.scenario.injected import STEER
from zenoh_cbef.scenario.load import load

OWN = 'fault=[{kind="loss", probability=0.1}, {kind="outage", agents=[0], from=5, until=6}]'


def injection(*keys: str) -> Injection:
    return Injection(load("tracking", keys).plan, StepTime(0.1, lambda: 10))


def test_they_go_on_from_the_scenarios_own():
    one = injection(OWN, "target.motion=manual")
    one.add({"kind": STEER, "to": [0, 0, 0]}, None)
    for number, kind in ((2, "outage"), (3, "sensor-stuck")):
        assert one.add({"kind": kind, "agents": [1]}, 3.0) == (number, [])
        assert one.plan.scenario.fault[number].kind == kind
    assert [(fault["number"], fault["kind"]) for fault in one.listed()[1:]] == [(2, "outage"), (3, "sensor-stuck")]
    with pytest.raises(UserError) as caught:
        one.add({"kind": "outage", "agents": [9]}, None)
    assert re.match(r"fault 4 \(outage\) names agent 9", str(caught.value))


def test_only_injected_ones_are_cleared():
    one = injection(OWN)
    one.add({"kind": "outage", "agents": [1]}, 3.0)
    with pytest.raises(UserError, match="no injected fault 0"):
        one.clear([0])
    assert one.clear([2]) == [2]
    own, cleared = one.plan.scenario.fault[0], one.plan.scenario.fault[2]
    assert own.until is None
    assert cleared.until is not None
    assert cleared.until < 1.3


def test_it_warns_of_what_is_likely_a_mistake_once():
    one = injection()
    said = [one.add({"kind": "byzantine", "agents": [agent]}, None)[1] for agent in (5, 4)]
    warning = (
        r"fault {} \(byzantine\): agents of this run leave out no neighbour .* start with consensus.isolate = true"
    )
    assert [len(found) for found in said] == [1, 1]
    assert all(re.match(warning.format(number), found[0]) for number, found in enumerate(said))
    _, (late,) = one.add({"kind": "loss", "probability": 0.5, "from": 5000.0}, None)
    assert re.match(r"fault 2 \(loss\) is on in no step", late)
    for key in ("consensus.isolate=true", "consensus.trim=1", 'fault=[{kind="byzantine", agents=[0]}]'):
        assert injection(key).add({"kind": "byzantine", "agents": [5]}, None)[1] == []
