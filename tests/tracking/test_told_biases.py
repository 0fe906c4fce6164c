"""Biases of which the scenario tells are estimated as told, from the first fix on."""

from __future__ import annotations

import numpy as np

from tests import unaided
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.filters.finding.remembered_ranges import Remembered, Wandering

DRIFT = Wandering(0.0, 1.0)


def ranges_of(random):
    """Ranges of five steps, one of them missing, and their noise."""
    measured = np.ones((1, 5), dtype=bool)
    measured[0, 2] = False
    rows = np.where(measured[:, :, None], random.normal(size=(1, 5, 6)), 0.0)
    ranges = Remembered(
        random.normal(size=(1, 6)),
        random.uniform(5.0, 9.0, (1, 5)),
        rows,
        random.normal(size=(1, 5)) * measured,
        np.ones((1, 5)),
        measured,
    )
    return ranges, random.uniform(0.5, 1.0, (1, 5)), np.full((1, 5), 0.04)


def by_least_squares(ranges, weight, variance, constant):
    """Information on state and constant together, (7, 7), and its vector, of the ranges and the constant's prior."""
    there = ranges.measured[0]
    rows = np.hstack([ranges.rows[0][there], np.ones((there.sum(), 1))])
    value = ranges.innovation[0][there] + ranges.rows[0][there] @ ranges.state[0]
    precision = (weight / variance)[0][there]
    matrix = rows.T @ (precision[:, None] * rows) + np.diag([0.0] * 6 + [1.0 / constant])
    return matrix, rows.T @ (precision * value)


def test_what_a_fix_says_of_the_state_and_of_a_constant_given_the_state_is_what_both_together_say():
    ranges, weight, variance = ranges_of(np.random.default_rng(7))
    matrix, vector = by_least_squares(ranges, weight, variance, 0.25)
    found, information = ranges.joint_information(weight, variance, DRIFT, 3, 0.25)
    # The constant is eliminated by its Schur complement.
    np.testing.assert_allclose(information[0], matrix[:6, :6] - np.outer(matrix[:6, 6], matrix[6, :6]) / matrix[6, 6])
    np.testing.assert_allclose(found[0], vector[:6] - matrix[:6, 6] * vector[6] / matrix[6, 6])
    offset, slope, left = vars(ranges.constant_given(weight, variance, DRIFT, 3, 0.25)).values()
    np.testing.assert_allclose(left[0], 1.0 / matrix[6, 6])
    np.testing.assert_allclose(slope[0], -matrix[6, :6] / matrix[6, 6])
    np.testing.assert_allclose(offset[0], vector[6] / matrix[6, 6])


def consistency(rules):
    scenario = load("tracking", ["sensor.bias_std=0.5", f"filter.defaults={rules}", "steps=120"]).scenario
    runs = unaided.errors(simulate([scenario.changed(seed=2001 + seed) for seed in range(4)]))
    nees = np.array([np.nanmean(run.nees[:, run.first :]) / 6.0 for run in runs])
    return nees, np.array([unaided.position_rmse(run) for run in runs])


def test_biases_as_large_as_told_leave_the_network_honest():
    nees, errors = consistency(7)
    before, larger = consistency(6)
    assert nees.max() < 3.0
    assert np.median(before) > 10.0
    assert np.median(errors) < 0.8 * np.median(larger)
