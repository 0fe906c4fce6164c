"""A neighbour that lies is found by its messages and left out; a neighbour that is only surprised is not."""

import numpy as np
import pytest

from zenoh_cbef.errors import UserError
from zenoh_cbef.scenario.load import load, parse
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.consensus import Average
from zenoh_cbef.tracking.filters import Belief
from zenoh_cbef.tracking.filters.information_form import pack
from zenoh_cbef.tracking.isolating import ENOUGH, Isolating
from zenoh_cbef.tracking.knowable import most_information
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.payloads import InformationPayloads
from zenoh_cbef.tracking.reference import centralized_beliefs, each_step
from zenoh_cbef.tracking.status import TRACKING

LIAR = 'fault=[{kind="byzantine", agents=[3]}]'
MOTION, SIZE = NearlyConstantVelocity(0.1, 0.5), 6
BELIEF = Belief(np.zeros((1, SIZE)), 0.01 * np.eye(SIZE)[None])
NOTHING_NEW = np.zeros(1, dtype=bool)


def stage(neighbours, *, only=True):
    present = np.ones((1, neighbours), dtype=bool)
    weights = np.full((1, neighbours), 1.0 / (1.0 + neighbours))
    names = np.arange(neighbours)[None] + 10
    return Isolating(Average(weights), MOTION, InformationPayloads(3, SIZE).claims, present, names, only=only)


def says(*places, certainty=100.0):
    """Messages (1, m, d) of neighbours that say that the target is at (x, 0, 0)."""
    matrix = np.repeat(certainty * np.eye(SIZE)[None], len(places), axis=0)
    vector = np.zeros((len(places), SIZE))
    vector[:, 0] = certainty * np.array(places)
    return pack(vector, matrix)[None]


def step(isolating, received, delivered=None, nis=1.0):
    """One step of one round; where the average puts the target along x, and who is isolated."""
    isolating.look(BELIEF, NOTHING_NEW, np.array([nis]))
    isolating.start(says(0.0)[0])
    isolating.mix(received, delivered)
    mixed = isolating.result()
    return mixed[0, 0] / 100.0, isolating.judge()[0]


def test_the_statistic_is_half_the_squared_distance_in_standard_deviations():
    # One step of prediction from standard deviations of 0.1: of the position 0.1 * sqrt(1 + 0.1^2), hardly more.
    deviation = np.sqrt(MOTION.predict_covariance(BELIEF.known_covariance, BELIEF.state)[0, 0, 0])
    for size, believed in ((5.0, True), (6.0, False)):  # 12.5 and 18 of at most 15; velocities correlate a little.
        place, _ = step(stage(1), says(size * deviation))
        assert (place != 0.0) == believed


def test_a_liar_is_left_out_at_once_and_for_good_after_some_steps():
    isolating, named = stage(3), []
    for _ in range(8):
        place, name = step(isolating, says(0.1, 5.0, 0.1))
        assert place == pytest.approx(0.05)
        named.append(name)
    assert np.isnan(named[: int(ENOUGH) - 1]).all()
    assert named[int(ENOUGH) - 1 :] == [11.0] * (9 - int(ENOUGH))
    assert step(isolating, says(0.1, 0.1, 0.1))[0] == pytest.approx(0.05)


def test_what_is_wrong_now_and_then_is_forgiven():
    isolating = stage(3)
    for k in range(60):
        assert np.isnan(step(isolating, says(0.1, 5.0 if k % 3 == 0 else 0.1, 0.1))[1])


def test_an_agent_that_disagrees_with_most_neighbours_isolates_none():
    isolating = stage(3)
    for _ in range(10):
        place, name = step(isolating, says(5.0, 5.0, 0.0))
        assert (place, np.isnan(name)) == (0.0, True)
    assert step(isolating, says(0.1, 0.1, 0.0))[0] == pytest.approx(0.05)


def test_the_only_neighbour_is_isolated_while_the_own_ranges_fit_and_by_the_rules_of_before_never():
    for only, nis, isolates in ((True, 1.0, True), (True, np.nan, True), (True, 9.0, False), (False, 1.0, False)):
        isolating = stage(1, only=only)
        for _ in range(3):
            step(isolating, says(0.1), nis=nis)
        named = [step(isolating, says(5.0), nis=nis)[1] for _ in range(8)]
        assert np.isfinite(named).tolist() == [isolates and k >= ENOUGH - 1 for k in range(8)]


def test_an_agent_whose_ranges_fit_again_isolates_its_only_neighbour_then():
    isolating = stage(1)
    assert all(np.isnan(step(isolating, says(5.0), nis=9.0)[1]) for _ in range(8))
    named = [step(isolating, says(5.0), nis=0.5)[1] for _ in range(6)]
    assert np.isnan(named[0])
    assert named[-1] == 10.0


def test_an_agent_that_begins_without_a_memory_accuses_no_neighbour_of_what_was():
    isolating = stage(3)
    for _ in range(7):
        _, name = step(isolating, says(0.1, 5.0, 0.1))
    assert name == 11.0
    isolating.look(BELIEF, ~NOTHING_NEW, np.ones(1))
    isolating.start(says(0.0)[0])
    isolating.mix(says(0.1, 0.1, 0.1), None)
    assert isolating.result()[0, 0] / 100.0 == pytest.approx(0.075)
    assert np.isnan(isolating.judge()[0])
    # And it counts from the beginning.
    named = [step(isolating, says(0.1, 5.0, 0.1))[1] for _ in range(5)]
    assert np.isnan(named[:4]).all()
    assert named[4] == 11.0


def test_a_second_liar_is_isolated_too_and_named_as_the_last_one():
    isolating = stage(5)
    named = [step(isolating, says(0.1, 5.0, 0.1, 0.1 if k < 6 else -5.0, 0.1))[1] for k in range(14)]
    assert named[4:10] == [11.0] * 6
    assert named[10:] == [13.0] * 4


def test_a_message_counts_by_what_it_adds_to_the_prediction_of_the_next_step():
    """The prior is carried ahead by the motion: a target that moves is expected where it moves to."""
    moving = Belief(np.array([[0.0, 0.0, 0.0, 20.0, 0.0, 0.0]]), BELIEF.covariance)
    isolating = stage(2)
    isolating.look(moving, NOTHING_NEW, np.ones(1))
    isolating.start(says(0.0)[0])
    there, here = says(2.0), says(0.0)
    for message in (there, here):
        message[0, 0, 3] = 20.0 * 100.0
    isolating.mix(np.concatenate([there, here], axis=1), None)
    assert isolating.result()[0, 3] == pytest.approx(2000.0 / 3.0)  # Of the two that say this speed, one is heard.


def test_what_was_not_delivered_accuses_no_neighbour():
    isolating, delivered = stage(3), np.array([[True, False, True]])
    for _ in range(10):
        assert np.isnan(step(isolating, says(0.1, np.nan, 0.1), delivered)[1])


@pytest.mark.parametrize("wrong", [says(np.inf), says(np.nan), says(0.0, certainty=-1.0), np.zeros((1, 1, 27))])
def test_a_message_that_is_no_information_is_left_out(wrong):
    others = says(0.1, 0.1)
    assert step(stage(3), np.concatenate([others, wrong], axis=1))[0] == pytest.approx(0.05)


def linked(links):
    """Agents that agent 0 reaches over these links."""
    reached = {0}
    for _ in links:
        reached |= {end for link in links if reached & link for end in link}
    return reached


def honest_central(trace):
    """Position RMSE of one filter that has the ranges of the five honest agents."""
    plan, ranges = trace.plan, trace.ranges.copy()
    ranges[3] = np.nan
    initial = Belief(np.delete(trace.initial, 3, axis=0).mean(axis=0)[None], plan.initial_covariance[None])
    seen = {"positions": trace.positions[None], "ranges": ranges[None], "age": trace.age[None]}
    beliefs = centralized_beliefs(
        initial, plan.motion, plan.space, each_step(**seen, range_std=plan.range_std), xi=np.inf
    )
    places = np.array([belief.state[0, :3] for belief in beliefs])
    return np.sqrt(((places - trace.truth[:, :3])[30:] ** 2).sum(axis=1).mean())


@pytest.mark.slow
def test_one_liar_of_six_on_sparse_graphs_is_named_within_twenty_steps_and_does_no_harm():
    one, honest, judged = load("tracking", [LIAR, "steps=90"]).scenario, [0, 1, 2, 4, 5], 0
    for trace in simulate([one.changed(seed=seed) for seed in range(1, 13)]):
        links = [set(link) for link in trace.edges.tolist()]
        if linked([link for link in links if 3 not in link]) != set(honest):
            continue  # The liar is the only way between honest agents.
        isolated = trace.diagnostics.isolated
        assert any(isolated[agent, 19] == 3.0 for agent in honest if {agent, 3} in links)
        assert set(isolated[honest][np.isfinite(isolated[honest])]) == {3.0}
        errors = trace.estimates[honest, 30:, :3] - trace.truth[30:, :3]
        assert np.sqrt((errors**2).sum(axis=2).mean()) < 1.3 * honest_central(trace)
        judged += 1
    assert judged >= 8


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "groups"), [(1006, ([0], [1, 2], [4, 5])), (1017, ([0, 1, 4, 5], [2])), (1046, ([0, 2, 4], [1, 5]))]
)
def test_groups_that_a_liar_parts_are_honest_and_those_that_can_track_do(seed, groups):
    (trace,) = simulate([load("tracking", [LIAR, f"seed={seed}"]).scenario])
    status, error = trace.diagnostics.status[:, 150:], trace.estimates[:, 150:] - trace.truth[150:]
    nees = np.einsum("aki,akij,akj->ak", error, np.linalg.inv(trace.covariances[:, 150:]), error) / SIZE
    for group in groups:
        assert (status[group] == TRACKING).mean() == (len(group) > 2)
        assert nees[group].mean() < 3.0


def test_without_a_liar_nothing_changes_but_what_is_asked_for():
    # Where neighbours are suspected there is no first fix, so both begin as the scenario says.
    keys = ["steps=60", "filter.start=given"]
    one, asked = (load("tracking", [*keys, f"consensus.isolate={value}"]).scenario for value in ("false", "true"))
    [first], [second] = simulate([one]), simulate([asked])
    assert np.isnan(first.diagnostics.isolated).all()
    np.testing.assert_array_equal(first.estimates, second.estimates)


@pytest.mark.parametrize(
    ("keys", "wanted"),
    [
        ({}, False),
        ({"fault": [{"kind": "byzantine", "agents": [1]}]}, True),
        ({"fault": [{"kind": "byzantine", "agents": [1]}], "consensus": {"trim": 1}}, False),
        ({"fault": [{"kind": "byzantine", "agents": [1]}], "consensus": {"acceleration": "chebyshev"}}, False),
        ({"fault": [{"kind": "byzantine", "agents": [1]}], "filter": {"kind": "kcf"}}, False),
        ({"fault": [{"kind": "byzantine", "agents": [1]}], "filter": {"motion": "imm"}}, False),
        ({"consensus": {"isolate": True, "trim": 1}}, True),
        ({"fault": [{"kind": "byzantine", "agents": [1]}], "consensus": {"isolate": False}}, False),
    ],
)
def test_auto_is_for_scenarios_with_liars_whose_messages_can_be_judged(keys, wanted):
    assert Plan(parse(keys, "test")).isolates is wanted


@pytest.mark.parametrize(
    "keys",
    [
        {"consensus": {"acceleration": "chebyshev"}},
        {"consensus": {"lag": 1}, "filter": {"kind": "ci"}},
        {"filter": {"kind": "kcf"}},
        {"filter": {"bias": "estimate"}},
        {"filter": {"motion": "imm"}},
    ],
)
def test_it_is_refused_where_messages_cannot_be_judged(keys):
    consensus = {**keys.get("consensus", {}), "isolate": True}
    with pytest.raises(UserError, match=r"consensus\.isolate = true"):
        parse({**keys, "consensus": consensus}, "test")


def test_no_honest_network_knows_more_than_the_most_that_its_ranges_can_tell():
    """A filter with all ranges, of agents around the target and at rest, for as long as anything changes."""
    start, count, variance = np.diag([1.0] * 3 + [4.0] * 3), 6, 0.09
    most = most_information(MOTION, start, count / variance, 3)
    rows = np.concatenate([np.eye(3), -np.eye(3)])
    information = np.asarray(np.linalg.inv(start), dtype=np.float64)
    for _ in range(500):
        covariance = MOTION.transition @ np.linalg.inv(information) @ MOTION.transition.T + MOTION.process_noise
        information = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
        information[:3, :3] += rows.T @ rows / variance
        assert np.linalg.eigvalsh(most - information)[0] > 0.0
    # The most is not far off, or it would tell nothing.
    assert np.trace(np.linalg.solve(most, information)) / SIZE > 0.4


def test_a_neighbour_that_exaggerates_its_certainty_is_named():
    traces = simulate(
        [
            load(
                "tracking", [LIAR.replace("[3]", '[3], mode="scale", magnitude=10'), f"seed={seed}", "steps=40"]
            ).scenario
            for seed in range(1, 9)
        ]
    )
    for trace in traces:
        named, neighbours = trace.diagnostics.isolated[:, -1], trace.plan.neighbours.ids
        assert all(named[agent] == 3.0 for agent in range(6) if 3 in neighbours[agent])
        assert all(np.isnan(named[agent]) for agent in range(6) if 3 not in neighbours[agent] and agent != 3)
