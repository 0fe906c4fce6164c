"""A told noise that is wrong: agents weigh several, as a centralised filter does that has a filter for each of them."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.analysis.summary import pick
from zenoh_cbef.scenario.build import backwards_of
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.backwards import SeveralMotions
from zenoh_cbef.tracking.central_models import CentralModels
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters import FilterSettings, make_filter, sharing_of
from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Measurement, Space, no_neighbours
from zenoh_cbef.tracking.reference import Ranges
from zenoh_cbef.tracking.switching import Switching, to_noises

DT, STD, AGENTS, STEPS, LEAVING, FAR = 0.2, 0.1, 6, 30, 0.02, 1e5
NOISES = tuple(NearlyConstantVelocity(DT, std) for std in (0.1, 1.0, 10.0))
RANDOM = np.random.default_rng(3)
PLACES = FAR * RANDOM.normal(size=(AGENTS, 3))
TRUTH = np.cumsum(DT * np.cumsum(DT * 2.0 * RANDOM.normal(size=(STEPS, 3)), axis=0), axis=0)
RANGES = np.linalg.norm(TRUTH[None] - PLACES[:, None], axis=2) + STD * RANDOM.normal(size=(AGENTS, STEPS))
RANGES[2, 7:12] = np.nan
BEGIN = np.zeros((1, 6)), np.diag([0.25] * 3 + [0.04] * 3)[None]
SETTINGS = FilterSettings(NOISES[1], Space(), STD, np.inf, AGENTS, noises=NOISES, leaving=(LEAVING,))


def everyone(part):
    return np.repeat(part, AGENTS, axis=0)


def beliefs(alone=(), settings=SETTINGS):
    """Of a network that averages exactly, but in steps in which the first agent hears no neighbour."""
    filter_, belief = make_filter("icf", settings), Belief(*map(everyone, BEGIN))
    for k in range(STEPS):
        update = filter_.update(belief, Measurement(PLACES, RANGES[:, k], np.zeros(AGENTS), *no_neighbours(AGENTS)))
        mean = everyone(update.payload.mean(axis=0)[None])
        if k in alone:
            mean[0] = update.payload[0]
        belief = filter_.conclude(mean, update)
        yield belief


@pytest.mark.parametrize("nearer", [False, True])
def test_agents_that_average_exactly_are_filters_of_each_noise_where_ranges_are_straight(nearer):
    settings = replace(SETTINGS, nearer=nearer)
    assert settings.switching == Switching(NOISES, (LEAVING,), nearer)
    models, belief = CentralModels(settings.switching, Space(), np.inf), Belief(*BEGIN)
    for k, mine in enumerate(beliefs(settings=settings)):
        seen = Ranges(PLACES[None], RANGES[None, :, k], np.zeros((1, AGENTS)), np.full((1, AGENTS), STD))
        belief, _ = models.step(belief, seen)
        np.testing.assert_allclose(mine.state, everyone(belief.state), atol=1e-4)
        np.testing.assert_allclose(mine.known_covariance, everyone(belief.known_covariance), rtol=1e-4, atol=1e-6)
        np.testing.assert_allclose(mine.known_chance, everyone(belief.known_chance), atol=1e-3)
    assert belief.known_chance[0].argmax() == 1


def test_a_noise_rather_changes_a_little():
    chances = to_noises([NearlyConstantVelocity(DT, std) for std in (1.0, 2.0, 8.0)], 0.1)
    np.testing.assert_allclose(chances, [[0.9, 0.08, 0.02], [0.2 / 3, 0.9, 0.1 / 3], [0.1 / 3, 0.2 / 3, 0.9]])


@pytest.mark.parametrize(
    ("keys", "nearer"),
    [
        ((), True),
        (("filter.defaults=15",), False),
        (("target.motion=circle",), False),  # It may go straight on, and then turn at once.
    ],
)
def test_of_a_target_of_one_noise_it_does(keys, nearer):
    plan = load("tracking", ["filter.acceleration_std=0.3", *keys]).plan
    assert plan.settings.nearer is nearer
    assert len(plan.noises) == 11


def test_an_agent_that_hears_no_neighbour_predicts():
    before, after = list(beliefs(alone=(STEPS - 1,)))[-2:]
    chance = before.known_chance[0]
    other = LEAVING / 2
    np.testing.assert_allclose(after.known_chance[0], other + (1.0 - LEAVING - other) * chance, atol=1e-9)
    np.testing.assert_allclose(after.state[0], NOISES[0].predict_state(before.state)[0], atol=1e-6)
    assert np.trace(after.known_covariance[0]) > np.trace(after.known_covariance[1])


def test_a_message_holds_a_state_more():
    one = sharing_of("sicf", load("tracking", ["filter.defaults=12"]).plan.settings).payload_size
    told = load("tracking", ["filter.acceleration_std=0.3"]).plan
    assert told.sharing.payload_size == one + 6
    assert told.sharing.blocks == ()


@pytest.mark.parametrize(
    ("keys", "doubted"),
    [
        ([], False),
        (["filter.acceleration_std=0.3"], True),
        (["filter.acceleration_std=0.1", "dt=1"], True),
        (["filter.acceleration_std=0.3", "filter.defaults=12"], False),
        (["filter.acceleration_std=0.3", "consensus.precision=int16"], False),
        (["filter.acceleration_std=0.3", "consensus.rounds=0"], False),
        (["filter.acceleration_std=0.3", "filter.recovery=true"], False),
        (["filter.acceleration_std=0.3", "filter.motion=turn"], False),
        (["filter.acceleration_std=0.3", "sensor.bias_std=0.5"], False),
        (["filter.acceleration_std=0.3", "sensor.real=true", "timing.mode=realtime"], False),
        (["filter.acceleration_std=0.3", "filter.kind=ci"], False),
        (["filter.motion=ncv", "target.motion=circle", "agents.count=4"], True),
        (["target.motion=circle"], False),
    ],
)
def test_the_noise_of_a_target_that_is_not_known_to_have_it_is_doubted(keys, doubted):
    plan = load("tracking", keys).plan
    assert bool(plan.noises) == doubted
    if doubted:
        assert plan.motion in plan.noises
        assert isinstance(backwards_of(plan), SeveralMotions)


@pytest.mark.slow
@pytest.mark.parametrize(("std", "dt", "steps"), [(0.04, 0.1, 300), (0.3, 0.1, 300), (3.0, 0.1, 300), (0.1, 1.0, 120)])
def test_a_told_noise_that_is_wrong_costs_little_and_no_honesty(std, dt, steps):
    def found(*keys):
        runs = load("tracking", [*keys, f"dt={dt}", f"steps={steps}"]).scenario
        return analyze(simulate([runs.changed(seed=3001 + seed) for seed in range(3)]))

    known, told = found(), found(f"filter.acceleration_std={std}")
    errors = [np.array([pick(run.metrics, "position_rmse") for run in runs]) for runs in (known, told)]
    assert np.median(errors[1] / errors[0]) < 1.08
    assert 0.7 < np.median([pick(run.metrics, "nees.average") for run in told]) / 6.0 < 1.5
