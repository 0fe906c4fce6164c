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
                states[begins, 6] = np.sqrt(motion.extra_covariance[0, 0]) * random.normal(size=begins.sum())
            roots = np.linalg.svd(motion.process_noise)
            noise = random.normal(size=(rows.sum(), size)) * np.sqrt(roots[1]) @ roots[0].T
            states[rows, :size] = motion.predict_state(states[rows, :size]) + noise
        paths.append(states[:, :6].copy())
    return np.stack(paths, axis=1)


def tracked(truth, plan=PLAN, since=20):
    """Root mean square error of the position, m, and NEES over its ideal, of a filter that sees all ranges."""
    random = np.random.default_rng(1)
    # Agents so far off that ranges are straight lines: the filter's linearisation is no part of this.
    places = FAR * random.normal(size=(RUNS, AGENTS, 1, 3)).repeat(STEPS, axis=2)
    ranges = np.linalg.norm(truth[:, None, :, :3] - places, axis=3) + STD * random.normal(size=(RUNS, AGENTS, STEPS))
    known = np.diag([0.01] * 3 + [1.0] * 3)
    initial = Belief(np.zeros((RUNS, 6)), known[None].repeat(RUNS, axis=0))
    models = CentralModels(Switching(plan.models, LEAVING), plan.space, np.inf)
    steps = each_step(positions=places, ranges=ranges, age=np.zeros_like(ranges), range_std=STD)
    states, covariances = stacked(plan.space, centralized_models(initial, models, steps))
    error = (states - truth)[:, since:]
    nees = np.mean(error[..., None, :] @ np.linalg.solve(covariances[:, since:], error[..., None])) / 6.0
    return np.sqrt(np.mean(np.sum(error[..., :3] ** 2, axis=2))), nees


def test_a_target_that_moves_as_assumed_is_tracked_with_the_right_covariance():
    assert 0.8 < tracked(drawn(np.random.default_rng(1)))[1] < 1.3


def always(velocity):
    """The path (K, 6) of such velocities (K, 3) in all runs: each step ends with its own, and went on with it."""
    path = np.concatenate([np.cumsum(PLAN.scenario.dt * velocity, axis=0), velocity], axis=1)
    return np.repeat(path[None], RUNS, axis=0)


def test_calmer_motions_follow_a_circle_more_closely_than_those_of_before():
    before = load("tracking", ("target.motion=circle", "filter.defaults=13")).plan
    angle = 0.8 * PLAN.scenario.dt * np.arange(STEPS)
    circle = always(np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1))
    assert tracked(circle, since=50)[0] < 0.95 * tracked(circle, before, since=50)[0]


def test_calmer_motions_are_not_falsely_sure_at_a_corner_after_a_straight_line():
    straight = np.arange(STEPS)[:, None] < STEPS // 2
    assert 0.8 < tracked(always(np.where(straight, [0.0, 1.0, 0.0], [0.0, 0.0, -1.0])), since=50)[1] < 1.3
