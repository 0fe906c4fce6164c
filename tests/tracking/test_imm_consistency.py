"""A target that switches its motion as the filter assumes: then the filter knows how unsure it is."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.scenario.load import load
from zenoh_cbef.tracking.central_models import CentralModels, centralized_models
from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.reference import each_step, stacked
from zenoh_cbef.tracking.switching import Switching

RUNS, STEPS, AGENTS, FAR = 40, 150, 6, 1e5
PLAN = load("tracking", ("target.motion=circle",)).plan
LEAVING, STD = PLAN.settings.leaving, PLAN.range_std


def drawn(random):
    """Paths (r, K, 6) of targets that leave their first motion, and others, as often as one of the assumptions says."""
    models, count = PLAN.models, len(PLAN.models)
    states, which, paths = np.zeros((RUNS, 7)), np.zeros(RUNS, dtype=int), []
    states[:, 3:6] = random.normal(size=(RUNS, 3))
    for _ in range(STEPS):
        left = random.random(RUNS) < np.resize(LEAVING, RUNS)
        which = (which + left * random.integers(1, count, RUNS)) % count
        for j, motion in enumerate(models):
            rows, size = which == j, motion.size
            if size > 6:
                begins = rows & left
                states[begins, 6] = motion.extra_std[0] * random.normal(size=begins.sum())
            roots = np.linalg.svd(motion.process_noise)
            noise = random.normal(size=(rows.sum(), size)) * np.sqrt(roots[1]) @ roots[0].T
            states[rows, :size] = motion.predict_state(states[rows, :size]) + noise
        paths.append(states[:, :6].copy())
    return np.stack(paths, axis=1)


def test_a_target_that_moves_as_assumed_is_tracked_with_the_right_covariance():
    random = np.random.default_rng(1)
    truth = drawn(random)
    # Agents so far off that ranges are straight lines: the filter's linearisation is no part of this.
    places = FAR * random.normal(size=(RUNS, AGENTS, 1, 3)).repeat(STEPS, axis=2)
    ranges = np.linalg.norm(truth[:, None, :, :3] - places, axis=3) + STD * random.normal(size=(RUNS, AGENTS, STEPS))
    known = np.diag([0.01] * 3 + [1.0] * 3)
    initial = Belief(np.zeros((RUNS, 6)), known[None].repeat(RUNS, axis=0))
    models = CentralModels(Switching(PLAN.models, LEAVING), PLAN.space, np.inf)
    steps = each_step(positions=places, ranges=ranges, age=np.zeros_like(ranges), range_std=STD)
    states, covariances = stacked(PLAN.space, centralized_models(initial, models, steps))
    error = (states - truth)[:, 20:]
    nees = np.mean(error[..., None, :] @ np.linalg.solve(covariances[:, 20:], error[..., None])) / 6.0
    assert 0.8 < nees < 1.3
