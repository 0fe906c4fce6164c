"""Moving agents that hear each other only while they are in range."""

import numpy as np

from zenoh_cbef.scenario import network
from zenoh_cbef.scenario.build import fates_into
from zenoh_cbef.scenario.load import parse
from zenoh_cbef.scenario.paths import agent_positions
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate

# Two agents rest, 10 m apart; the third passes both of them.
PASSING = {
    "steps": 60,
    "agents": {
        "motion": "waypoints",
        "speed": 5.0,
        "waypoints": [[[0.0, 0.0, 0.0]], [[10.0, 0.0, 0.0]], [[-10.0, 2.0, 0.0], [20.0, 2.0, 0.0]]],
        "count": 3,
    },
    "network": {"graph": "radio", "radius": 10.5},
}


def test_links_exist_while_their_ends_are_in_range():
    scenario = parse(PASSING, "test")
    assert network.edges(scenario).tolist() == [[0, 1], [0, 2], [1, 2]]
    fates = fates_into(Plan(scenario), 2, [0, 1])
    assert not fates.quiet
    third = agent_positions(scenario)[2]
    for step in range(1, 61):
        apart = [np.hypot(third[step - 1, 0] - other, 2.0) for other in (0.0, 10.0)]
        assert fates.of(step, 1).due.tolist() == [one <= 10.5 for one in apart], step
        assert fates.reaches(step).tolist() == [one <= 10.5 for one in apart], step


def test_what_cannot_be_heard_was_never_sent_and_far_agents_are_alone():
    [trace] = simulate([parse(PASSING, "test")], keep_payloads=True)
    links = trace.links
    heard = {
        (int(source), int(destination)): int(sent)
        for source, destination, sent in zip(links.source, links.destination, links.sent, strict=True)
    }
    near = network.in_range(parse(PASSING, "test")).sum(axis=2)
    assert heard == {(a, b): 10 * int(near[a, b]) for a in range(3) for b in range(3) if a != b}
    assert not links.lost.any()
    assert heard[0, 1] == 600 > heard[0, 2] == heard[2, 0] > 0
    last = trace.estimates[:, -1, :3]
    assert np.linalg.norm(last[0] - last[1]) < np.linalg.norm(last[0] - last[2])


def test_a_batch_of_seeds_has_each_its_own_places():
    drawn = {"steps": 20, "network": {"graph": "radio", "radius": 14.0}, "agents": {"count": 6}, "seed": 5}
    one = parse(drawn, "test")
    scenarios = [one.changed(seed=seed) for seed in (5, 6, 7)]
    for together in simulate(scenarios):
        [alone] = simulate([together.scenario])
        assert alone.estimates.tobytes() == together.estimates.tobytes()
        assert (alone.links.sent == together.links.sent).all()
