"""A scenario whose agents, or those that faults leave, cannot see the target is warned of; others are not."""

from __future__ import annotations

import pytest

from zenoh_cbef.analysis.metrics import analyze, notes
from zenoh_cbef.scenario.checks import check
from zenoh_cbef.scenario.load import load, parse
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate

FLAT = [[0, 0, 0], [10, 1, 0], [5, 5, 0], [9, 0, 0]]
LINE = [[0, 0, 0], [1, 1, 1], [5, 5, 5], [9, 9, 9]]


def scenario(**keys):
    base = {"steps": 100, "agents": {"count": 3}, "network": {"graph": "complete"}, "consensus": {"rounds": 3}}
    return parse(base | keys, "test")


def away(kind, agent, since, until=None):
    return {"kind": kind, "agents": [agent], "from": since} | ({} if until is None else {"until": until})


@pytest.mark.parametrize("name", ["tracking", "paper", "scale24", "outliers"])
def test_built_in_scenarios_are_fine(name):
    assert check(load(name).plan) == []


@pytest.mark.parametrize(
    ("agents", "height", "words"),
    [
        ({"count": 1}, None, "ranges of 1 agent fit every point of a sphere; let four"),
        ({"count": 2}, None, "ranges of 2 agents fit every point of a circle; let four"),
        ({"positions": LINE}, None, "ranges of 4 agents on one line fit every point of a circle"),
        ({"count": 3}, None, "ranges of 3 agents fit a mirror image of the target, too"),
        ({"positions": FLAT}, None, "ranges of 4 agents in one plane fit a mirror image"),
        ({"count": 1}, 0.0, "ranges of 1 agent fit every point of a circle; let three"),
        ({"positions": LINE}, 0.0, "ranges of 4 agents on one line fit a mirror image"),
        ({"positions": FLAT}, 0.0, None),
        ({"motion": "formation", "positions": LINE, "velocity": [1, 2, 3]}, None, "on one line fit every point"),
    ],
)
def test_too_few_agents_and_flat_ones_are_warned_of(agents, height, words):
    warnings = check(Plan(scenario(agents=agents, filter={} if height is None else {"planar_height": height})))
    assert len(warnings) == (words is not None)
    assert all(words in warning for warning in warnings)
    assert all(("filter.planar_height" in warning) == (height is None) for warning in warnings)


@pytest.mark.parametrize(
    ("kept", "words"),
    [
        ({"consensus": {"rounds": 0}}, "consensus.rounds is 0, and ranges of 1 agent fit every point of a sphere"),
        ({"filter": {"kind": "local"}}, "agents of local exchange nothing, and ranges of 1 agent fit every point"),
        ({"agents": {"count": 6}, "filter": {"kind": "local", "measurement": "difference"}}, None),
        ({"consensus": {"rounds": 0}, "filter": {"defaults": 15}}, "consensus.rounds is 0"),
    ],
)
def test_agents_that_are_alone_are_warned_of_and_say_that_they_acquire(kept, words):
    plan = Plan(scenario(**kept))
    warnings = check(plan)
    assert len(warnings) == (words is not None)
    assert all(words in warning for warning in warnings)
    assert plan.settings.undetermined == ("rounds is 0" in (words or "") and plan.scenario.filter.defaults > 15)


def test_agents_whose_ways_vary_are_not_warned_of():
    ways = [[[0, 0, 0], [9, 0, 3], [9, 9, 0]], [[5, 0, 0], [5, 9, 9], [0, 0, 2]], [[0, 5, 9], [7, 7, 0], [0, 0, 0]]]
    assert check(Plan(scenario(agents={"count": 3, "motion": "waypoints", "waypoints": ways, "speed": 4.0}))) == []


def test_absences_that_leave_too_few_are_warned_of_by_their_steps():
    faults = [away("crash", 0, 3.0), away("pause", 1, 5.0, 6.0), away("pause", 2, 0.5, 1.0)]
    agents = {"count": 5}
    assert check(Plan(scenario(agents=agents, fault=faults))) == [], "three are left at any time"
    faults.append(away("pause", 4, 3.5, 7.0))
    assert check(Plan(scenario(agents=agents, fault=faults))) == [], (
        "two are left for a second, which the estimate bridges"
    )
    faults[1] = away("pause", 1, 5.0, 9.0)
    faults[3] = away("pause", 4, 3.5, 8.0)
    [warning] = check(Plan(scenario(agents=agents, fault=faults)))
    assert warning.startswith("from step 50 to 79 faults leave only 2 agents: ranges of 2 agents fit every point of a ")


@pytest.mark.slow
def test_an_analysis_names_the_steps_in_which_nothing_can_be_seen():
    faults = [away("crash", 0, 6.0), away("pause", 1, 1.0, 1.5)]
    [found] = analyze(simulate([scenario(fault=faults)]))
    assert found.metrics.unobservable_steps == [[60, 100]], "half a second is bridged"
    [note] = notes(found.metrics)
    assert "in steps 60 to 100 ranges did not determine the position" in note
    deaf = [{"kind": "sensor-dropout", "agents": [0], "from": 2.0, "until": 5.0}]
    [found] = analyze(simulate([scenario(fault=deaf)]))
    assert found.metrics.unobservable_steps == [[20, 49]], "receivers that hear nothing see nothing"
    [found] = analyze(simulate([scenario()]))
    assert found.metrics.unobservable_steps == []
    assert all("too sure" in note for note in notes(found.metrics)), "three agents may be on the wrong side"
