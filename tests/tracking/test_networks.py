"""What holds of networks of any size and filter: an agent alone predicts, and a liar displaces what it is told to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tracking.centralised import switching
from zenoh_cbef.tracking.filters import Belief, FilterSettings, make_filter, payloads_of
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Measurement, Space, no_neighbours

MOTION = NearlyConstantVelocity(0.5, 0.5)
PLACES = np.array([[-8.0, 3, 1], [7, -6, 4], [2, 9, -5], [-3, -7, -8]])
STATE = np.array([[1.0, -2, 0.5, 0.4, 0.3, -0.2]])
COVARIANCE = np.diag([0.5, 0.4, 0.3, 0.2, 0.3, 0.4])[None]


def of(count, **more):
    return FilterSettings(MOTION, Space(), 0.1, np.inf, count, **more)


def begun(count):
    """Beliefs of agents, and their ranges of a target that is elsewhere."""
    ranges = np.linalg.norm(PLACES[:count] - STATE[0, :3], axis=1) + 0.3
    belief = Belief(STATE.repeat(count, axis=0), COVARIANCE.repeat(count, axis=0))
    return belief, Measurement(PLACES[:count], ranges, np.zeros(count), *no_neighbours(count), agent=np.arange(count))


CASES: dict[str, tuple[str, dict[str, object]]] = {
    **{kind: (kind, {}) for kind in ("sicf", "icf", "hcmci")},
    "squares": ("icf", {"squares": True}),
    "told": ("icf", {"tells_ranges": True}),
    "biased": ("icf", {"bias": "estimate", "common_bias_std": 0.3, "own_bias_std": 0.2}),
    "models": ("icf", switching(MOTION, replace(MOTION, acceleration_std=3.0))),
}


@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize(("kind", "more"), CASES.values(), ids=CASES)
def test_an_agent_of_a_network_that_hears_no_neighbour_goes_on_by_prediction(kind, more, count):
    filter_ = make_filter(kind, of(count, **more))
    belief, measurement = begun(count)
    update = filter_.update(belief, measurement)
    alone, together = (
        filter_.conclude(payload, update)
        for payload in (update.payload, np.tile(update.payload.mean(axis=0), (count, 1)))
    )
    np.testing.assert_allclose(alone.state, MOTION.predict_state(belief.state), atol=1e-9)
    assert np.abs(together.state - alone.state).max() > 0.01


@pytest.mark.parametrize(("kind", "more"), [CASES["sicf"], CASES["hcmci"], CASES["biased"]])
def test_a_liar_moves_the_network_as_far_as_it_lies(kind, more):
    settings = of(4, **more)
    filter_, offset = make_filter(kind, settings), np.array([5.0, -3.0, 2.0])
    update = filter_.update(*begun(4))
    mean = np.tile(update.payload.mean(axis=0), (4, 1))
    lied = payloads_of(kind, settings).displaced(mean, np.tile(offset, (4, 1)))
    found = [filter_.conclude(payload, update).state for payload in (mean, lied)]
    np.testing.assert_allclose(found[1] - found[0], np.tile([*offset, 0.0, 0.0, 0.0], (4, 1)), atol=1e-6)
