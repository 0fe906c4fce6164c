"""Agents that are cut off from the others know that they are, and count their ranges once."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.errors import UserError
from zenoh_cbef.scenario.checks import check
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters import Belief
from zenoh_cbef.tracking.filters.around.cut_off import CutOff
from zenoh_cbef.tracking.filters.around.roll_call import faintest
from zenoh_cbef.tracking.filters.finding.knowing import Knowing
from zenoh_cbef.tracking.filters.finding.reacquiring import Reacquiring
from zenoh_cbef.tracking.filters.kinds.sicf import SaturatedInformation
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.graph import components, make_edges, neighbours
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Measurement, Space, no_neighbours, own_range
from zenoh_cbef.tracking.status import COASTING, TRACKING, Status
from zenoh_cbef.tracking.weights import metropolis_weights, weight_matrix

HALVES = 'fault=[{kind="partition",links={between=[[0,1,2],[3,4,5]]},from=6.0,until=20.0}]'
PLACES = np.array([[-9.0, -7.0, 0.0], [8.0, -6.0, 0.0], [7.0, 8.0, 0.0], [-6.0, 9.0, 0.0], [0.0, -9.0, 0.0]])
GROUPS = (np.array([0, 1, 2]), np.array([3, 4]))
TOGETHER = (np.arange(5),)


@pytest.fixture
def five():
    """Five agents in a plane."""
    settings = FilterSettings(
        motion=NearlyConstantVelocity(0.1, 1.0, 2),
        space=Space(0.0),
        range_std=0.1,
        xi=np.inf,
        network_size=5,
        cut_off=10,
    )
    return CutOff(SaturatedInformation.of(settings), settings)


def begun():
    wide = np.diag([4.0, 3.0, 2.0, 1.0])
    return Belief(np.tile([1.0, -2.0, 0.5, 0.2], (5, 1)), np.tile(wide, (5, 1, 1)))


def heard(position=(1.3, -2.2, 0.0)):
    distance = np.linalg.norm(PLACES - position, axis=1)
    return Measurement(PLACES, distance, np.zeros(5), *no_neighbours(5), agent=np.arange(5))


def step(chosen, belief, groups):
    """One step in which each group averages perfectly."""
    update = chosen.update(belief, heard())
    payload = update.payload.copy()
    for group in groups:
        payload[group] = payload[group].mean(axis=0)
    return chosen.conclude(payload, update)


def test_a_group_counts_its_ranges_once_each(five):
    belief = begun()
    for _ in range(6):
        belief = step(five, belief, GROUPS)
    motion, space = five.settings.motion, five.settings.space
    after = step(five, belief, GROUPS)
    for group in GROUPS:
        state = motion.predict_state(belief.state)[group]
        prior = motion.predict_covariance(belief.known_covariance, belief.state)[group[0]]
        _, rows = own_range(space, state, PLACES[group], np.zeros(len(group)))
        alone = np.linalg.inv(np.linalg.inv(prior) + rows.T @ rows / five.settings.range_std**2)
        np.testing.assert_allclose(after.known_covariance[group], np.tile(alone, (len(group), 1, 1)), rtol=1e-9)


@pytest.mark.parametrize(
    ("bend", "presumes", "times"), [(None, False, np.inf), (None, True, 20.0), (100.0, False, 100.0)]
)
def test_an_agent_alone_takes_in_its_range_as_far_as_it_is_straight(five, bend, presumes, times):
    """By earlier rules (None) it goes on by prediction, and by the eleventh it is like one of few."""
    settings = replace(five.settings, alone_bend=bend, presumes=presumes)
    chosen = CutOff(SaturatedInformation.of(settings), settings)
    belief, alone = begun(), 4
    for _ in range(6):
        belief = step(chosen, belief, ([0, 1, 2, 3], [alone]))
    after = step(chosen, belief, ([0, 1, 2, 3], [alone]))
    motion, space = settings.motion, settings.space
    state = motion.predict_state(belief.state)[alone : alone + 1]
    prior = motion.predict_covariance(belief.known_covariance, belief.state)[alone]
    _, row = own_range(space, state, PLACES[[alone]], np.zeros(1))
    distance, before = own_range(space, belief.state[[alone]], PLACES[[alone]], np.zeros(1))
    across = np.eye(2) - np.outer(before[0, :2], before[0, :2])
    curved = across @ belief.known_covariance[alone, :2, :2] / distance
    noise = settings.range_std**2 + times * 0.5 * np.trace(curved @ curved)
    expected = prior - np.outer(prior @ row[0], row[0] @ prior) / (row[0] @ prior @ row[0] + noise)
    np.testing.assert_allclose(after.known_covariance[alone], expected, rtol=1e-9)


def test_an_agent_that_only_a_liar_links_stays_nearer_by_its_own_ranges():
    keys = ["seed=1006", "steps=200", 'fault=[{kind="byzantine",mode="constant",magnitude=5.0,agents=[3]}]']
    errors = []
    for more in ([], ["filter.defaults=19"]):
        (trace,) = simulate([load("tracking", [*keys, *more]).scenario])
        errors.append(np.sqrt(np.mean((trace.estimates - trace.truth)[0, 75:, :3] ** 2) * 3.0))
        assert not (trace.diagnostics.status[0] == TRACKING).any()
    assert errors[0] < 0.8 * errors[1]


def test_all_together_estimate_what_they_would_without_it(five):
    belief, plain = begun(), begun()
    for _ in range(4):
        belief = step(five, belief, TOGETHER)
        update = five.filter.update(plain, heard())
        plain = five.filter.conclude(np.tile(update.payload.mean(axis=0), (5, 1)), update)
        assert belief.state.tobytes() == plain.state.tobytes()


def test_agents_of_a_group_that_is_too_small_do_not_vote_on_another_fix():
    motion, space, anywhere = NearlyConstantVelocity(0.1, 1.0), Space(), (np.zeros((1, 6)), np.eye(6)[None])
    settings = FilterSettings(motion, space, 0.1, 2.0, 5, reacquires=10, says_status=True, anywhere=anywhere)
    chosen = Reacquiring.of(settings, Knowing(SaturatedInformation.of(settings), settings), 2.0, 29)
    search = chosen._begun(Belief(np.zeros((2, 6)), np.tile(np.eye(6), (2, 1, 1))))  # noqa: SLF001 - a first step
    tracks = replace(Status.first(2), which=np.full(2, TRACKING))
    few, both = np.array([True, False]), np.array([True, True])
    assert chosen._tag(search, np.ones(2), tracks, both, few).tolist() == [0.0, -1.0]  # noqa: SLF001


@pytest.mark.parametrize("motion", ["ncv", "imm"])
def test_two_that_hear_each_other_agree(motion):
    keys = ["agents.count=2", "network.graph=ring", "filter.membership=true", "steps=15", f"filter.motion={motion}"]
    [trace] = simulate([load("tracking", keys).scenario])
    np.testing.assert_allclose(trace.estimates[0], trace.estimates[1], rtol=1e-9, atol=1e-9)


def test_agents_that_go_fade_and_agents_that_come_back_are_heard_at_once(five):
    belief = step(five, begun(), TOGETHER)
    shares = []
    for groups in (GROUPS, GROUPS, GROUPS, GROUPS, TOGETHER):
        belief = step(five, belief, groups)
        shares.append(belief.memory[1])
    np.testing.assert_allclose(shares[3], [0.6, 0.6, 0.6, 0.4, 0.4])
    np.testing.assert_allclose(shares[4], 1.0)


@given(
    st.integers(2, 12),
    st.integers(1, 12),
    st.sampled_from(["erdos-renyi", "path", "star", "ring"]),
    st.integers(0, 999),
)
def test_on_no_connected_graph_an_agent_passes_for_gone(agents, rounds, kind, seed):
    edges = make_edges(kind, np.zeros((agents, 3)), seed=seed, probability=0.3, radius=1.0)
    near = neighbours(agents, edges)
    assert len(components(agents, edges)) == 1
    averaged = np.linalg.matrix_power(weight_matrix(near, metropolis_weights(near)), rounds)
    known = np.ones((agents, agents))
    for _ in range(100):
        known = known / 4.0
        np.fill_diagonal(known, 1.0)
        known = averaged @ known
        assert known.min() > faintest(agents, rounds)


def nees(*overrides):
    """The mean NEES over its ideal while agents say `tracking`, and how often they do and are a metre off, unawares."""
    runs = analyze(simulate([load("tracking", [HALVES, *overrides, f"seed={1001 + k}"]).scenario for k in range(8)]))
    told = [(run.metrics.status or {})["tracking"].nees or np.nan for run in runs]
    off = [(run.position_error > 1.0) & (run.trace.diagnostics.status == TRACKING) for run in runs]
    spread = [np.sqrt(np.trace(run.trace.covariances[:, :, :3, :3], axis1=2, axis2=3)) for run in runs]
    sure = [(one & (run.position_error > 5.0 * std)).mean() for one, run, std in zip(off, runs, spread, strict=True)]
    return np.mean(told) / 6.0, np.mean(sure)


@pytest.mark.slow
@pytest.mark.parametrize("more", [(), ("consensus.rounds=3",), ("filter.kind=icf",)])
def test_halves_of_a_network_are_as_sure_as_they_may_be(more):
    before, falsely = nees("filter.defaults=10", *more)
    assert before > 2.0
    assert falsely > 0.003
    today, falsely = nees(*more)
    assert 0.8 < today < 1.4
    assert falsely == 0.0


@pytest.mark.parametrize(("rules", "falsely"), [(19, True), (20, False)])
def test_a_few_of_many_agents_know_how_few_they_are(rules, falsely):
    parts = f'fault=[{{kind="partition",links={{between=[[0,1,2],{list(range(3, 16))}]}},from=6.0,until=14.0}}]'
    keys = (parts, "agents.count=16", "steps=150", f"filter.defaults={rules}")
    for trace in simulate([load("tracking", [*keys, f"seed={seed}"]).scenario for seed in (1013, 1016)]):
        error = np.linalg.norm((trace.estimates - trace.truth)[:, :, :3], axis=2)
        spread = np.sqrt(np.trace(trace.covariances[:, :, :3, :3], axis1=2, axis2=3))
        sure = (error > 0.5) & (error > 5.0 * spread) & (trace.diagnostics.status == TRACKING)
        assert sure.any() == falsely


def test_a_coasting_agent_that_is_alone_does_not_track_again():
    keys = (
        *("filter.planar_height=0", "agents.low=[-10,-10,0]", "agents.high=[10,10,0]", "seed=1016", "steps=100"),
        *("target.motion=waypoints", "target.speed=3"),
        "target.waypoints=[[-9,0,0],[0,9,0],[9,0,0],[0,-9,0],[-9,0,0]]",
        'fault=[{kind="partition",links={between=[[0,1],[2,3,4,5]]},from=6,until=14}]',
    )
    (trace,) = simulate([load("tracking", keys).scenario])
    off = np.linalg.norm((trace.estimates - trace.truth)[1, :, :3], axis=1)
    sure = np.sqrt(np.trace(trace.covariances[1, :, :3, :3], axis1=1, axis2=2))
    assert (off > 20.0 * sure)[90:].any()  # By rules 19 it says that it tracks then.
    assert (trace.diagnostics.status[1, 64:] == COASTING).all()


def halves(rules):
    """Errors and status of six agents in halves that tell each other their ranges."""
    wide = ("filter.initial_position=[50,0,0]", "filter.initial_position_std=50", "seed=5048", "steps=230")
    (trace,) = simulate([load("tracking", [HALVES, *wide, f"filter.defaults={rules}"]).scenario])
    return np.linalg.norm((trace.estimates - trace.truth)[:, :, :3], axis=2), trace.diagnostics.status


@pytest.mark.slow
def test_agents_that_come_back_with_another_place_say_so_and_look_for_it_again():
    error, status = halves(20)
    assert error[:3, 198].min() > 10.0
    assert error[:, 210:].max() < 0.5
    assert (status[:, 210:] == TRACKING).all()
    assert not ((error > 1.0) & (status == TRACKING)).any()
    error, status = halves(19)
    assert error[:3, 210:].min() > 10.0
    assert (status[:3, 210:] == TRACKING).all()


def test_loss_of_all_messages_is_a_cut():
    def tells(probability, *more):
        fault = f'fault=[{{kind="loss",probability={probability},links="agent:2"}}]'
        return Plan(load("tracking", [fault, *more]).scenario).settings.cut_off > 0

    assert tells(1.0)
    assert not tells(0.99)
    assert not tells(1.0, "filter.defaults=19")


@pytest.mark.parametrize(("rules", "said"), [(10, TRACKING), (11, COASTING)])
def test_a_pair_does_not_say_that_it_tracks(rules, said):
    pairs = 'fault=[{kind="partition",links={between=[[0,1],[2,3]]},from=6.0,until=12.0}]'
    keys = (pairs, "agents.count=4", "network.edges=[[0,1],[1,2],[2,3]]", "steps=120", f"filter.defaults={rules}")
    (trace,) = simulate([load("tracking", keys).scenario])
    np.testing.assert_array_equal(trace.diagnostics.status[:, 55], TRACKING)
    np.testing.assert_array_equal(trace.diagnostics.status[:, 115], said)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1012, 1013])
def test_agents_that_begin_anew_take_part_in_another_fix(seed):
    keys = (
        *("agents.count=5", f"seed={seed}", "steps=125"),
        'fault=[{kind="crash",agents=[1,2],from=5.0,until=9.0}]',
        *("target.motion=waypoints", "target.speed=8"),
        "target.waypoints=[[-9,0,0],[0,9,2],[9,0,0],[0,-9,2],[-9,0,0]]",
    )
    (trace,) = simulate([load("tracking", keys).scenario])
    error = np.linalg.norm((trace.estimates - trace.truth)[:, -1, :3], axis=1)
    assert error.max() < 0.5


def test_agents_can_be_told_to_say_who_is_there_and_not_to():
    assert Plan(load("tracking", ["filter.membership=true"]).scenario).settings.cut_off == 10
    assert Plan(load("tracking", [HALVES, "filter.membership=false"]).scenario).settings.cut_off == 0
    with pytest.raises(UserError, match=r"filter\.membership is for filters that take .* leave filter\.membership out"):
        load("tracking", ["filter.membership=true", "filter.kind=ci"])
    with pytest.raises(UserError, match=r"filter\.membership = true needs .* set consensus\.trigger = 0"):
        check(Plan(load("tracking", ["filter.membership=true", "consensus.trigger=0.1"]).scenario))


def test_only_where_agents_may_be_cut_off_messages_tell_who_is_there():
    def size(*overrides):
        return Plan(load("tracking", overrides).scenario).message_size

    for fault in (HALVES, 'fault=[{kind="crash",agents=[1],from=5.0,until=9.0}]'):
        assert size(fault, "filter.defaults=11") == size(fault, "filter.defaults=10") + 6
        assert size(fault) == size(fault, "filter.defaults=11") + 9  # Three agents are in one plane.
    # Agents that isolate a liar may be parted by that.
    liar = 'fault=[{kind="byzantine",agents=[1]}]'
    assert size(liar) == size(liar, "filter.defaults=11") + 15 == size(liar, "consensus.isolate=false") + 15
    assert size() == size("filter.defaults=10")
    for more in ("consensus.trigger=0.1", "agents.count=41", "filter.kind=ci", "filter.kind=local"):
        assert size(HALVES, more) == size(HALVES, more, "filter.defaults=10")
    many = HALVES, "agents.count=13", "consensus.precision=float32"
    assert size(*many) == size(*many, "filter.defaults=10")
    loss = 'fault=[{kind="loss",links="all",probability=0.3}]'
    assert size(loss) == size(loss, "filter.defaults=10")
