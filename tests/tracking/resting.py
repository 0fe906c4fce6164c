"""Six agents with `sicf`, and what they measure of a target that rests at the origin."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Measurement, no_neighbours

MOTION, STD, AGENTS = NearlyConstantVelocity(0.1, 0.5), 0.1, 6
PLACES = np.random.default_rng(4).uniform(-10.0, 10.0, (AGENTS, 3))


def measured(errors, seed):
    """Ranges that are off by errors (n,), m, beside their noise."""
    ranges = np.linalg.norm(PLACES, axis=1) + np.random.default_rng(seed).normal(0.0, STD, AGENTS) + errors
    return Measurement(PLACES, ranges, np.zeros(AGENTS), *no_neighbours(AGENTS))
