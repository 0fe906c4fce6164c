"""An agent that comes back begins with what its neighbours know."""

import numpy as np

from zenoh_cbef.scenario.load import load, parse
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.consensus import Average
from zenoh_cbef.tracking.filters import Belief
from zenoh_cbef.tracking.newcomer import belief_from
from zenoh_cbef.tracking.ranging import Measurement, Space, no_neighbours
from zenoh_cbef.tracking.tracker import Tracker

RNG = np.random.default_rng(3)
INITIAL = Belief(np.full((2, 6), 7.0), np.tile(9.0 * np.eye(6), (2, 1, 1)))


def random_estimates(count: int) -> tuple[np.ndarray, np.ndarray]:
    roots = RNG.normal(size=(2, count, 6, 6))
    return RNG.normal(size=(2, count, 6)), roots @ np.swapaxes(roots, 2, 3) + 0.1 * np.eye(6)


def test_neighbours_estimates_are_intersected_with_equal_weights():
    states, covariances = random_estimates(3)
    told = np.array([[True, False, True], [False, False, False]])
    belief = belief_from(Space(), states, covariances, told, INITIAL)
    information = [np.linalg.inv(covariances[0, place]) for place in (0, 2)]
    expected = np.linalg.inv(sum(information) / 2.0)
    np.testing.assert_allclose(belief.known_covariance[0], expected, rtol=1e-9)
    mean = expected @ (information[0] @ states[0, 0] + information[1] @ states[0, 2]) / 2.0
    np.testing.assert_allclose(belief.state[0], mean, rtol=1e-9)
    # An agent that gets no answer begins as at the start.
    np.testing.assert_array_equal(belief.state[1], INITIAL.state[1])
    np.testing.assert_array_equal(belief.known_covariance[1], INITIAL.known_covariance[1])


def test_without_covariances_it_is_the_mean_and_in_a_plane_the_height_is_left_out():
    states, _ = random_estimates(2)
    told = np.ones((2, 2), dtype=bool)
    plane = Belief(INITIAL.state[:, :4], INITIAL.known_covariance[:, :4, :4])
    belief = belief_from(Space(1.5), states, None, told, plane)
    np.testing.assert_allclose(belief.state, states.mean(axis=1)[:, [0, 1, 3, 4]])


def test_what_follows_position_and_velocity_is_as_at_the_start():
    states, covariances = random_estimates(3)
    told = np.array([[True, True, True], [False, False, False]])
    longer = Belief(np.full((2, 7), 7.0), np.tile(9.0 * np.eye(7), (2, 1, 1)))
    belief, six = (belief_from(Space(), states, covariances, told, one) for one in (longer, INITIAL))
    np.testing.assert_array_equal(belief.state, np.pad(six.state, ((0, 0), (0, 1)), constant_values=7.0))
    expected = np.pad(six.known_covariance, ((0, 0), (0, 1), (0, 1)))
    expected[:, 6, 6] = 9.0
    np.testing.assert_array_equal(belief.known_covariance, expected)


def test_a_row_does_not_depend_on_padding():
    states, covariances = random_estimates(2)
    told = np.ones((2, 2), dtype=bool)
    narrow = belief_from(Space(), states, covariances, told, INITIAL)
    wide = belief_from(
        Space(),
        np.pad(states, ((0, 0), (0, 3), (0, 0)), constant_values=5.0),
        np.pad(covariances, ((0, 0), (0, 3), (0, 0), (0, 0)), constant_values=2.0),
        np.pad(told, ((0, 0), (0, 3))),
        INITIAL,
    )
    assert narrow.state.tobytes() == wide.state.tobytes()
    assert narrow.known_covariance.tobytes() == wide.known_covariance.tobytes()


def test_some_rows_begin_anew_and_the_others_go_on():
    scenario = parse({"agents": {"count": 3}, "filter": {"kind": "sicf", "start": "given"}}, "test")
    given = np.arange(3.0)[:, None] * np.ones((3, 6))
    elsewhere = Belief(np.full((3, 6), 5.0), np.tile(0.01 * np.eye(6), (3, 1, 1)))
    measurement = Measurement(np.zeros((3, 3)), np.full(3, 6.0), np.zeros(3), *no_neighbours(3))

    def payload(belief: Belief, adopted: np.ndarray | None = None) -> np.ndarray:
        tracker = Tracker(Plan(scenario).filter, Average(np.zeros((3, 0))), Space(), belief)
        if adopted is not None:
            tracker.adopt(elsewhere, adopted)
        return tracker.measure(measurement)

    former = Belief(given, np.tile(np.eye(6), (3, 1, 1)))
    rows = np.array([False, True, False])
    mixed = payload(former, rows)
    assert mixed[~rows].tobytes() == payload(former)[~rows].tobytes()
    assert mixed[rows].tobytes() == payload(elsewhere)[rows].tobytes()
    assert (payload(former)[rows] != payload(elsewhere)[rows]).any()


def test_a_guess_is_worth_what_motion_leaves_of_it():
    plan = Plan(parse({"target": {"motion": "circle"}, "timing": {"mode": "realtime"}}, "a scenario"))
    guess, later = plan.initial_belief, plan.guessed_at(plan.initial_belief, 30)
    step = plan.motion.jacobian(guess.state)
    powers = [np.linalg.matrix_power(step, number) for number in range(31)]
    expected = powers[30] @ guess.known_covariance @ powers[30].T
    expected = expected + sum(one @ plan.motion.process_noise @ one.T for one in powers[:30])
    np.testing.assert_allclose(later.state, guess.state @ powers[30].T, rtol=1e-9)
    np.testing.assert_allclose(later.known_covariance, expected, rtol=1e-9)
    np.testing.assert_array_equal(plan.guessed_at(guess, 0).state, guess.state)
    before = Plan(parse({"filter": {"defaults": 17}}, "a scenario"))
    np.testing.assert_array_equal(before.guessed_at(guess, 30).known_covariance, guess.known_covariance)


def test_agents_that_come_back_together_do_not_take_their_guess_for_a_place():
    away = 'fault=[{kind="crash",agents=[0,1,2],from=2.0,until=4.0}]'
    circle = "target.motion=circle", "target.radius=5", "target.period=8", away, "steps=55", "seed=1001"
    # The only neighbour of agent 1 comes back with it.
    for rules in (17, 18):
        (trace,) = simulate([load("tracking", [*circle, f"filter.defaults={rules}"]).scenario])
        off = np.linalg.norm((trace.estimates - trace.truth)[1, 41:, :3], axis=1)
        assert (rules == 18) == (off.max() < 1.0)
