"""The information filters are their equations, and agree with a centralised filter where theory says so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zenoh_cbef.tracking.consensus import Average
from zenoh_cbef.tracking.diagnostics import Diagnostics
from zenoh_cbef.tracking.filters import KINDS, Belief, FilterSettings, Update, make_filter, sharing_of
from zenoh_cbef.tracking.filters.information_form import belief_of, pack, packed_size
from zenoh_cbef.tracking.filters.weighing import saturation
from zenoh_cbef.tracking.graph import make_edges, neighbours
from zenoh_cbef.tracking.linalg import pack_upper, unpack_upper
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Measurement, Space, no_neighbours
from zenoh_cbef.tracking.tracker import Tracker
from zenoh_cbef.tracking.weights import metropolis_weights

STD, SEEDS, SPACES = 0.3, st.integers(0, 2**32 - 1), st.sampled_from([Space(), Space(0.7)])


def settings_for(space, count, xi=1.5):
    return FilterSettings(NearlyConstantVelocity(0.2, 0.5, space.axes), space, STD, xi, count)


def began(payload):
    """A step that began with these payloads."""
    return Update(payload, Diagnostics.of(len(payload)))


def beliefs(random, space, count):
    size = 2 * space.axes
    root = random.normal(scale=0.3, size=(count, size, size))
    covariance = root @ np.swapaxes(root, 1, 2) + 0.2 * np.eye(size)
    return Belief(random.normal(size=(count, size)), 0.5 * (covariance + np.swapaxes(covariance, 1, 2)))


def scene(seed, space, count=4):
    """Beliefs, and a measurement with a missing range and an aged one."""
    random = np.random.default_rng(seed)
    ranges = random.uniform(3.0, 8.0, count)
    ranges[0] = np.nan
    age = random.uniform(0.0, 0.2, count)
    return beliefs(random, space, count), Measurement(
        random.normal(scale=5, size=(count, 3)), ranges, age, *no_neighbours(count)
    )


def by_the_equations(belief, measurement, space, agent, *, count, xi):
    """V, O, |z| and w of one agent, written as in the paper; H by differences of the range itself."""
    motion = NearlyConstantVelocity(0.2, 0.5, space.axes)
    state = motion.transition @ belief.state[agent]
    covariance = motion.transition @ belief.known_covariance[agent] @ motion.transition.T + motion.process_noise
    prior = np.linalg.inv(covariance)

    def ranged(x):
        at = x[: space.axes] - measurement.age[agent] * x[space.axes :]
        at = at if space.height is None else np.append(at, space.height)
        return np.linalg.norm(at - measurement.position[agent])

    if np.isnan(measurement.range[agent]):
        return prior @ state / count, prior / count, np.nan, np.nan
    steps = 1e-6 * np.eye(len(state))
    row = np.array([(ranged(state + step) - ranged(state - step)) / 2e-6 for step in steps])
    innovation = measurement.range[agent] - ranged(state)
    spread = np.sqrt(row @ covariance @ row + STD**2)
    weight = min(1.0, xi * spread / abs(innovation))
    vector = prior @ state / count + weight * row * (innovation + row @ state) / STD**2
    return vector, prior / count + weight * np.outer(row, row) / STD**2, abs(innovation), weight


@settings(deadline=None, derandomize=True, max_examples=40)
@given(SEEDS, SPACES, st.sampled_from([0.1, 1.0, 3.0, np.inf]))
def test_the_payload_is_the_agents_share_of_the_information(seed, space, xi):
    belief, measurement = scene(seed, space)
    kind = make_filter("icf" if np.isinf(xi) else "sicf", settings_for(space, 4, xi))
    update = kind.update(belief, measurement)
    size = 2 * space.axes
    assert update.payload.shape == (4, packed_size(size))
    for agent in range(4):
        vector, matrix, innovation, weight = by_the_equations(belief, measurement, space, agent, count=4, xi=xi)
        np.testing.assert_allclose(update.payload[agent, :size], vector, rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(unpack_upper(update.payload[[agent], size:], size)[0], matrix, rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(update.diagnostics.innovation[agent], innovation, rtol=1e-9)
        np.testing.assert_allclose(update.diagnostics.weight[agent], weight, rtol=1e-6)
        # Where the innovation is saturated, its weight tells the square of what it was in its own deviations.
        if weight < 1.0:
            np.testing.assert_allclose(update.diagnostics.nis[agent], (xi / weight) ** 2, rtol=1e-6)
        assert update.diagnostics.nis_degrees[agent] == np.isfinite(innovation)


@settings(deadline=None)
@given(SEEDS, SPACES)
def test_concluding_inverts_the_averaged_information(seed, space):
    random = np.random.default_rng(seed)
    belief = beliefs(random, space, 3)
    information = np.linalg.inv(belief.known_covariance) / 5
    information = 0.5 * (information + np.swapaxes(information, 1, 2))
    vector = (information @ belief.state[:, :, None])[:, :, 0]
    payload = np.concatenate([vector, pack_upper(information)], axis=1)
    concluded = make_filter("sicf", settings_for(space, 5)).conclude(payload, began(np.full_like(payload, np.nan)))
    np.testing.assert_allclose(concluded.state, belief.state, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(concluded.known_covariance, belief.known_covariance, rtol=1e-7, atol=1e-7)


@settings(deadline=None)
@given(SEEDS, SPACES)
def test_sicf_that_never_saturates_is_icf_bit_for_bit(seed, space):
    belief, measurement = scene(seed, space)
    results = [
        make_filter(kind, settings_for(space, 4, xi)).update(belief, measurement)
        for kind, xi in (("sicf", np.inf), ("icf", 1.0), ("sicf", 1e300))
    ]
    assert len({one.payload.tobytes() for one in results}) == 1
    assert len({one.diagnostics.weight.tobytes() for one in results}) == 1


@settings(deadline=None)
@given(SEEDS)
def test_saturation_weakens_a_far_range_and_leaves_a_near_one(seed):
    belief, measurement = scene(seed, Space(), 1)
    near, far = (make_filter("sicf", settings_for(Space(), 1, xi=2.0)) for _ in range(2))
    predicted = settings_for(Space(), 1).motion.predict_state(belief.state)
    state = predicted[0, :3] - measurement.age[0] * belief.state[0, 3:]
    distance = np.linalg.norm(state - measurement.position[0])
    measurement.range[0] = distance + STD
    assert near.update(belief, measurement).diagnostics.weight.tolist() == [1.0]
    measurement.range[0] = distance + 1000.0
    update = far.update(belief, measurement)
    assert 0.0 < update.diagnostics.weight[0] < 0.01
    assert update.diagnostics.innovation[0] == pytest.approx(1000.0)


def run_steps(kind, space, count, *, rounds, steps, graph="complete", seed=1, together=False):
    """A tracker of some kind, step by step; together: the agents begin from one belief."""
    random = np.random.default_rng(seed)
    lists = neighbours(count, make_edges(graph, np.zeros((count, 3)), seed=1, probability=0.5, radius=1))
    belief = beliefs(random, space, count)
    if together:
        belief = Belief(np.tile(belief.state[0], (count, 1)), np.tile(belief.known_covariance[0], (count, 1, 1)))
    tracker = Tracker(make_filter(kind, settings_for(space, count)), Average(metropolis_weights(lists)), space, belief)
    for _ in range(steps):
        position = random.normal(scale=6.0, size=(count, 3))
        ranges = np.linalg.norm(position - [1.0, 2.0, 0.7], axis=1) + STD * random.normal(size=count)
        ranges[random.random(count) < 0.2] = np.nan
        before = tracker.belief
        measured = Measurement(position, ranges, np.zeros(count), *no_neighbours(count))
        message = tracker.measure(measured)
        for _ in range(rounds if kind != "local" else 0):
            message = tracker.exchange(message[lists.index], None)
        yield before, measured, tracker.conclude(), tracker.belief


@pytest.mark.parametrize("space", [Space(), Space(0.7)])
def test_many_rounds_of_icf_reach_the_centralised_information_filter(space):
    count = 5
    motion = NearlyConstantVelocity(0.2, 0.5, space.axes)
    for before, measured, _, belief in run_steps("icf", space, count, rounds=60, steps=6, together=True):
        state = motion.transition @ before.state[0]
        covariance = motion.transition @ before.covariance[0] @ motion.transition.T + motion.process_noise
        # A textbook extended Kalman filter on the stacked ranges.
        heard = np.flatnonzero(np.isfinite(measured.range))
        place = state[: space.axes] if space.height is None else np.append(state[:2], space.height)
        offset = place - measured.position[heard]
        distance = np.sqrt((offset**2).sum(axis=1))
        rows = np.zeros((len(heard), 2 * space.axes))
        rows[:, : space.axes] = (offset / distance[:, None])[:, : space.axes]
        gain = covariance @ rows.T @ np.linalg.inv(rows @ covariance @ rows.T + STD**2 * np.eye(len(heard)))
        expected = state + gain @ (measured.range[heard] - distance)
        remaining = (np.eye(2 * space.axes) - gain @ rows) @ covariance
        for agent in range(count):
            np.testing.assert_allclose(belief.state[agent], expected, rtol=0, atol=1e-9)
            np.testing.assert_allclose(belief.known_covariance[agent], remaining, rtol=0, atol=1e-9)


def test_local_keeps_to_itself_and_claims_no_more_than_its_own_information():
    alone, many = (list(run_steps("local", Space(), 4, rounds=rounds, steps=3)) for rounds in (0, 20))
    for (*_, first), (*_, second) in zip(alone, many, strict=True):
        assert first.state.tobytes() == second.state.tobytes()
    kind = make_filter("local", settings_for(Space(), 4))
    assert not sharing_of("local", settings_for(Space(), 4)).cooperates
    belief, measurement = scene(5, Space())
    vector, matrix, *_ = by_the_equations(belief, measurement, Space(), 2, count=1, xi=1.5)
    payload = kind.update(belief, measurement).payload[2]
    np.testing.assert_allclose(payload[:6], vector, rtol=1e-5)
    np.testing.assert_allclose(unpack_upper(payload[None, 6:], 6)[0], matrix, rtol=1e-4, atol=1e-5)


@settings(deadline=None, derandomize=True, max_examples=25)
@given(SEEDS, SPACES, st.sampled_from(["sicf", "icf", "local"]), st.sampled_from([0, 1, 4]))
def test_covariances_stay_symmetric_and_positive_definite(seed, space, kind, rounds):
    for *_, estimate, belief in run_steps(kind, space, 5, rounds=rounds, steps=8, graph="ring", seed=seed):
        np.testing.assert_array_equal(belief.known_covariance, np.swapaxes(belief.known_covariance, 1, 2))
        assert (np.linalg.eigvalsh(belief.known_covariance) > 0.0).all()
        assert estimate.state.shape == (5, 6)
        assert estimate.covariance.shape == (5, 6, 6)
        assert np.isfinite(estimate.state).all()


def test_rows_come_out_the_same_bits_alone_and_in_a_batch():
    for kind in set(KINDS) - {"cbef", "cbef-scaled"}:
        for space in (Space(), Space(0.7)):
            belief, measurement = scene(8, space, 9)
            made = make_filter(kind, settings_for(space, 9))
            batch = made.update(belief, measurement)
            concluded = made.conclude(batch.payload, batch)
            for row in range(9):
                one = [row]
                own = Measurement(
                    measurement.position[one],
                    measurement.range[one],
                    measurement.age[one],
                    measurement.neighbour_position[one],
                    measurement.neighbour_range[one],
                )
                alone = made.update(Belief(belief.state[one], belief.known_covariance[one]), own)
                assert alone.payload.tobytes() == batch.payload[row].tobytes()
                bits = concluded.known_covariance[row].tobytes()
                assert made.conclude(alone.payload, alone).known_covariance.tobytes() == bits


def test_what_is_no_information_matrix_is_replaced_by_the_agents_own():
    belief, measurement = scene(9, Space())
    made = make_filter("sicf", settings_for(Space(), 4))
    own = made.update(belief, measurement).payload
    mixed = np.tile(own.mean(axis=0), (4, 1))
    indefinite = unpack_upper(mixed[[1], 6:], 6)
    indefinite[0] -= 1.001 * np.linalg.eigvalsh(indefinite[0])[0] * np.eye(6)
    mixed[1, 6:] = pack_upper(indefinite)
    mixed[2, 6:] = 0.0
    concluded = made.conclude(mixed, began(own))
    alone = made.conclude(own, began(own))
    together = made.conclude(np.tile(own.mean(axis=0), (4, 1)), began(own))
    for row, expected in enumerate([together, alone, alone, together]):
        assert concluded.state[row].tobytes() == expected.state[row].tobytes()
        assert concluded.known_covariance[row].tobytes() == expected.known_covariance[row].tobytes()


def test_an_information_filter_refuses_a_belief_without_covariance():
    belief, measurement = scene(1, Space())
    with pytest.raises(ValueError, match="covariance"):
        make_filter("sicf", settings_for(Space(), 4)).update(Belief(belief.state, None), measurement)


@pytest.mark.parametrize("kind", ["sicf", "icf", "hcmci"])
def test_an_agent_that_heard_no_neighbour_goes_on_by_prediction(kind):
    belief, measurement = scene(4, Space())
    made = make_filter(kind, settings_for(Space(), 4))
    update = made.update(belief, measurement)
    mixed = update.payload.copy()
    mixed[0] = update.payload.mean(axis=0)  # agent 0 heard the others
    concluded, heard = made.conclude(mixed, update), made.conclude(mixed, began(update.payload))
    motion = settings_for(Space(), 4).motion
    transition, noise = motion.transition, motion.process_noise
    assert concluded.state[0].tobytes() == heard.state[0].tobytes()
    assert concluded.known_covariance[0].tobytes() == heard.known_covariance[0].tobytes()
    for agent in (1, 2, 3):
        np.testing.assert_allclose(concluded.state[agent], transition @ belief.state[agent])
        np.testing.assert_allclose(
            concluded.known_covariance[agent], transition @ belief.known_covariance[agent] @ transition.T + noise
        )


@pytest.mark.parametrize("xi", [0.5, 1.5])
def test_a_redescending_saturation_squares_the_weight_and_its_pull_falls_off(xi):
    belief, measurement = scene(6, Space())
    bounded, redescending = (
        make_filter("sicf", replace(settings_for(Space(), 4, xi), power=power)).update(belief, measurement)
        for power in (1, 2)
    )
    np.testing.assert_allclose(redescending.diagnostics.weight, bounded.diagnostics.weight**2)
    assert (bounded.diagnostics.weight < 1.0).any()
    innovation = np.array([0.1, 1.0, 10.0, 100.0])
    for power, pulls in ((1, [0.1, 1.0, 2.0, 2.0]), (2, [0.1, 1.0, 0.4, 0.04])):
        np.testing.assert_allclose(innovation * saturation(innovation, np.full(4, 2.0), power), pulls)


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.lists(st.floats(-16.0, 3.0), min_size=6, max_size=6), st.booleans())
def test_a_belief_is_the_same_beside_an_unsound_one(seed, exponents, indefinite):
    random = np.random.default_rng(seed)
    basis, _ = np.linalg.qr(random.normal(size=(6, 6)))
    values = 10.0 ** np.array(exponents)
    if indefinite:
        values[0] = -values[0]
    matrix = (basis * values) @ basis.T
    sound, doubtful = (pack(random.normal(size=(1, 6)), one[None]) for one in (np.eye(6), 0.5 * (matrix + matrix.T)))
    own = pack(np.ones((2, 6)), np.stack([2.0 * np.eye(6)] * 2))
    together = belief_of(np.concatenate([sound, doubtful]), own, 6)
    eigenvalues = np.linalg.eigvalsh(unpack_upper(doubtful[:, 6:], 6)[0])
    expected = doubtful if eigenvalues[0] > 1e-12 * eigenvalues[-1] else own[:1]
    for row, payload in enumerate((sound, expected)):
        alone = belief_of(payload, own[:1], 6)
        assert alone.state[0].tobytes() == together.state[row].tobytes()
        assert alone.known_covariance[0].tobytes() == together.known_covariance[row].tobytes()
