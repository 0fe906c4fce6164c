"""The literal filter is warned of exactly where its gain is too large."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zenoh_cbef.scenario.checks import check
from zenoh_cbef.scenario.load import load, parse
from zenoh_cbef.scenario.plan import Plan


def contraction(scenario):
    """The warnings that the literal filter may not converge."""
    return [warning for warning in check(Plan(scenario)) if warning.startswith("cbef may not converge")]


def placed(positions, kind="cbef", **keys):
    filter_ = {"kind": kind, **keys}
    return parse({"agents": {"positions": positions}, "network": {"graph": "complete"}, "filter": filter_}, "test")


# Agent 0 has neighbours on both sides, so that the eigenvalue of its H^T H is twice the squared distance.
EDGES = [[0, 1], [0, 2]]


@pytest.mark.parametrize(("distance", "warned"), [(1.0, True), (0.999999, False), (1.000001, True)])
def test_the_limit_itself_is_warned_of_and_less_is_not(distance, warned):
    agents = {"positions": [[0, 0, 0], [distance, 0, 0], [-distance, 0, 0]]}
    scenario = parse({"agents": agents, "network": {"edges": EDGES}, "filter": {"kind": "cbef"}}, "test")
    warnings = contraction(scenario)
    assert len(warnings) == warned
    if warned:
        assert "at agent 0 (1 of 3 agents" in warnings[0]
        assert "filter.kind = 'sicf'" in warnings[0]


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 6), st.sampled_from([None, 0.0]))
def test_a_warning_comes_exactly_when_an_eigenvalue_reaches_two(seed, count, height):
    places = np.random.default_rng(seed).uniform(0.0, 1.3, (count, 3))
    axes = 3 if height is None else 2
    largest = max(
        np.linalg.norm(np.delete(places, agent, axis=0)[:, :axes] - places[agent, :axes], 2) ** 2
        for agent in range(count)
    )
    keys = {} if height is None else {"planar_height": height}
    assert len(contraction(placed(places.tolist(), **keys))) == (largest >= 2.0)


def test_other_filters_are_not_warned_of():
    far = [[0, 0, 0], [100, 0, 0], [0, 100, 0]]
    assert contraction(placed(far))
    for kind in ("sicf", "icf", "local"):
        assert contraction(placed(far, kind)) == []


def test_the_built_in_paper_scenario_stays_where_its_filter_contracts():
    for seed in range(20):
        assert check(load("paper", [f"seed={seed}"]).plan) == []
    assert check(load("tracking", ["filter.kind=cbef"]).plan)


def test_chebyshev_on_links_that_lose_messages_is_warned_of():
    loss, chebyshev = [{"kind": "loss", "probability": 0.1}], {"acceleration": "chebyshev"}
    assert "plain averaging" in check(Plan(parse({"consensus": chebyshev, "fault": loss}, "test")))[0]
    assert check(Plan(parse({"consensus": chebyshev}, "test"))) == []
    assert check(Plan(parse({"fault": loss}, "test"))) == []
    assert check(Plan(parse({"fault": [{"kind": "byzantine", "agents": [0]}]}, "test"))) == []


@pytest.mark.parametrize(
    ("agents", "rounds", "warned"), [(100, 6, True), (100, 10, False), (24, 3, True), (2, 1, False)]
)
def test_chebyshev_in_too_few_rounds_for_the_graph_is_warned_of(agents, rounds, warned):
    keys = {"agents": {"count": agents}, "network": {"graph": "grid"}}
    stage = {"acceleration": "chebyshev", "rounds": rounds}
    told = check(Plan(parse({**keys, "consensus": stage}, "test")))
    assert any("of the disagreement here" in one for one in told) == warned
    assert not any("of the disagreement" in one for one in check(Plan(parse({**keys, "consensus": {}}, "test"))))


def test_a_graph_too_sparse_for_trimming_is_warned_of():
    ring = {"network": {"graph": "ring"}, "consensus": {"trim": 1}}
    assert "3 neighbours or more, but agent 0 has 2" in check(Plan(parse(ring, "test")))[0]
    assert check(Plan(parse({**ring, "network": {"graph": "complete"}}, "test"))) == []


def test_a_liar_that_is_the_only_link_between_others_is_warned_of():
    path = {"network": {"graph": "path"}, "fault": [{"kind": "byzantine", "agents": [0, 2]}]}
    [warning] = check(Plan(parse(path, "test")))
    assert "agent 2, which sends wrong values, is the only link between agents [0, 1] and [3, 4, 5]" in warning


def test_a_fault_on_agents_that_are_no_neighbours_is_warned_of():
    overrides = ["network.graph=path", "fault=[{kind='loss', probability=0.5, links=[[1, 0], [0, 3]]}]"]
    [warning] = check(load("tracking", overrides).plan)
    assert "names the link [0, 3]" in warning
    overrides[1] = "fault=[{kind='loss', probability=0.5, links=[[1, 0], [2, 3]]}]"
    assert check(load("tracking", overrides).plan) == []


def test_agents_that_all_lie_are_warned_of():
    def told(agents):
        return check(load("tracking", [f"fault=[{{kind='byzantine', agents={agents}}}]"]).plan)

    assert any("all 6 agents send wrong values" in one for one in told([0, 1, 2, 3, 4, 5]))
    assert not any("wrong values, so" in one for one in told([0, 1, 2, 3, 4]))


@pytest.mark.parametrize(
    ("overrides", "warned"),
    [
        (["sensor.bias=0.4"], True),
        (["sensor.bias_std=0.2"], True),
        ([], False),
        (["sensor.bias=0.4", "filter.bias=none"], False),
        (["sensor.bias=0.4", "filter.kind=ci"], False),
    ],
)
def test_biases_that_no_agent_estimates_as_others_lie_are_warned_of(overrides, warned):
    found = check(load("tracking", ["fault=[{kind='byzantine', agents=[3]}]", *overrides]).plan)
    assert any("filter.bias = 'auto' is 'none' here" in one for one in found) == warned
    assert not any("'none' here" in one for one in check(load("tracking", overrides).plan))


@pytest.mark.parametrize(
    ("times", "warned"),
    [
        ("from=500", True),
        ("from=4.01", True),
        ("from=4", False),
        ("from=1.11, until=1.19", True),
        ("from=0, until=0.05", True),
        ("from=0, until=0.11", False),
        ("from=0.7", False),
    ],
)
def test_a_fault_that_is_on_in_no_step_is_warned_of(times, warned):
    found = check(load("tracking", ["steps=40", f"fault=[{{kind='loss', probability=0.5, {times}}}]"]).plan)
    assert any("fault 0 (loss) is on in no step of the run, which ends at 4 s" in one for one in found) == warned


def test_a_fault_between_groups_names_no_single_link():
    fault = "fault=[{kind='partition', links={between=[[0, 1, 2], [3, 4, 5]]}}]"
    assert check(load("tracking", [fault]).plan) == []
