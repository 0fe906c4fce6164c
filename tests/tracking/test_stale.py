"""Messages that are steps late: predicted forward and fused by covariance intersection, never as they are."""

from __future__ import annotations

import numpy as np
import pytest

from tests import unaided
from zenoh_cbef.errors import UserError
from zenoh_cbef.scenario.load import load, parse
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.filters.information_form import pack
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.stale import StaleAverage

LAGGED = ["filter.kind=ci", "consensus.rounds=1"]


def delayed(milliseconds):
    return f'fault=[{{kind="delay", milliseconds={milliseconds}}}]'


def runs(keys, seeds=8):
    scenario = load("tracking", [*LAGGED, *keys]).scenario
    return simulate([scenario.changed(seed=seed) for seed in range(1, seeds + 1)])


@pytest.mark.parametrize("lag", [1, 3])
def test_it_is_the_intersection_of_the_own_estimate_and_predicted_old_ones(lag):
    rng, motion, weights = np.random.default_rng(lag), NearlyConstantVelocity(0.1, 0.5), np.array([[0.3, 0.2, 0.1]])
    states = rng.normal(0.0, 5.0, (4, 6))
    roots = rng.normal(0.0, 1.0, (4, 6, 6))
    covariances = roots @ np.swapaxes(roots, 1, 2) + np.eye(6)
    information = np.linalg.inv(covariances).astype(np.float64)
    payload = np.append(pack((information @ states[..., None])[..., 0], information), [[7.0], [1.0], [2.0], [3.0]], 1)
    stage = StaleAverage(weights, motion, lag)
    stage.start(payload[:1])
    stage.mix(payload[None, 1:], np.array([[True, False, True]]))
    vector, matrix = np.zeros(6), np.zeros((6, 6))
    for place, weight in ((0, 0.6), (1, 0.3), (3, 0.1)):
        state, covariance = states[place], covariances[place]
        for _ in range(lag if place else 0):
            state = motion.transition @ state
            covariance = motion.transition @ covariance @ motion.transition.T + motion.process_noise
        vector += weight * np.linalg.solve(covariance, state)
        matrix += weight * np.linalg.inv(covariance)
    expected = np.append(pack(vector[None], matrix[None])[0], 0.6 * 7.0 + 0.3 * 1.0 + 0.1 * 3.0)
    np.testing.assert_allclose(stage.result()[0], expected, rtol=1e-9, atol=1e-9)


def test_messages_that_all_came_are_averaged_also_where_nothing_says_so():
    rng, motion = np.random.default_rng(2), NearlyConstantVelocity(0.1, 0.5)
    roots = rng.normal(size=(3, 6, 6))
    payload = pack(rng.normal(size=(3, 6)), roots @ np.swapaxes(roots, 1, 2) + np.eye(6))
    averages = []
    for delivered in (None, np.array([[True, True]])):
        stage = StaleAverage(np.array([[0.3, 0.2]]), motion, 1)
        stage.start(payload[:1])
        stage.mix(payload[None, 1:], delivered)
        averages.append(stage.result())
    np.testing.assert_array_equal(averages[0], averages[1])


def test_a_delay_up_to_the_lag_costs_nothing_more_and_one_beyond_cuts_all_agents_off():
    short = ["steps=40", "consensus.lag=2"]
    clean, inside, beyond = (runs([*short, *extra], 2) for extra in ([], [delayed(200.0)], [delayed(200.1)]))
    alone = runs(["steps=40", "filter.kind=local"], 2)
    for one, other, cut, local in zip(clean, inside, beyond, alone, strict=True):
        np.testing.assert_array_equal(one.estimates, other.estimates)
        np.testing.assert_array_equal(cut.estimates, local.estimates)
        assert other.links.late.sum() == 0
        assert (cut.links.late == cut.links.sent).all()
        # What was sent in the last two steps was never wanted.
        assert (one.links.sent == 38).all()


@pytest.mark.slow
def test_a_network_whose_messages_are_a_step_late_tracks_and_does_not_claim_too_much():
    late, cut = (unaided.errors(runs([delayed(90.0), f"consensus.lag={lag}"])) for lag in (1, 0))
    error = [np.median([unaided.position_rmse(run) for run in each]) for each in (late, cut)]
    assert error[0] < 0.05 * error[1]
    # Never overconfident: a chi-squared mean of 6 is the most that an intersection may have.
    assert np.mean([unaided.nees(run) for run in late]) < 6.0


def test_a_late_network_is_the_same_alone_and_in_a_batch():
    fault = 'fault=[{kind="delay", milliseconds=80.0, distribution="exponential"}, {kind="loss", probability=0.2}]'
    keys = [fault, "steps=12", "consensus.lag=1", "consensus.rounds=2", "filter.distrust=true"]
    together = runs(keys, 3)
    scenario = load("tracking", [*LAGGED, *keys, "seed=2"]).scenario
    [alone] = simulate([scenario])
    np.testing.assert_array_equal(alone.estimates, together[1].estimates)
    np.testing.assert_array_equal(alone.covariances, together[1].covariances)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({}, "only covariance intersection may"),
        ({"filter": {"kind": "ci", "measurement": "difference"}}, "only covariance intersection may"),
        ({"consensus": {"scheme": "running-sums"}}, "needs plain averaging"),
        ({"consensus": {"acceleration": "chebyshev"}}, "needs plain averaging"),
        ({"consensus": {"trim": 1}}, "needs plain averaging"),
    ],
)
def test_what_would_count_information_twice_is_refused(keys, message):
    with pytest.raises(UserError, match=message):
        parse({"filter": {"kind": "sicf"}, **keys, "consensus": {"lag": 1, **keys.get("consensus", {})}}, "test")
