"""The differenced rows carry exactly the information that their correlated noise leaves them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zenoh_cbef.tracking.filters.information_form import differenced_information
from zenoh_cbef.tracking.ranging import Measurement, Space, differenced_rows

SEEDS = st.integers(0, 2**32 - 1)


def covariance_of(own, others, std):
    """R of the paper's rows, written out."""
    ones = np.ones((len(others), len(others)))
    return std**2 * (own**2 * ones + np.diag(others**2)) + 0.5 * std**4 * (ones + np.eye(len(others)))


def scene(seed, *, count=4, std=0.3, dropout=0.2):
    random = np.random.default_rng(seed)
    target, places = random.normal(scale=5.0, size=3), random.normal(scale=5.0, size=(count + 1, 3))
    ranges = np.linalg.norm(places - target, axis=1) + std * random.normal(size=count + 1)
    ranges[1:][random.random(count) < dropout] = np.nan
    age = random.uniform(0.0, 0.3, 1)
    return Measurement(places[:1], ranges[:1], age, places[None, 1:], ranges[None, 1:])


def test_the_covariance_of_the_rows_is_that_of_many_draws():
    # The example of the project's notes: ranges 40; 55, 30, 70 m, and a noise large enough for the second order.
    own, others, std = 40.0, np.array([55.0, 30.0, 70.0]), 3.0
    noise = std * np.random.default_rng(1).normal(size=(400_000, 4))
    noisy = np.concatenate([[own], others]) + noise
    drawn = 0.5 * (noisy[:, :1] ** 2 - noisy[:, 1:] ** 2)
    np.testing.assert_allclose(np.cov(drawn.T), covariance_of(own, others, std), rtol=0.02)


@settings(deadline=None, derandomize=True, max_examples=60)
@given(SEEDS, st.sampled_from([Space(), Space(0.7)]), st.sampled_from([0.1, 1.0, np.inf]), st.sampled_from([0.05, 2.0]))
def test_the_information_is_that_of_the_full_covariance_inverted(seed, space, xi, std):
    measured = scene(seed, std=std)
    random = np.random.default_rng(seed)
    size = 2 * space.axes
    state, root = random.normal(size=size), random.normal(size=(size, size))
    prior = root @ root.T + np.eye(size)
    found = differenced_information(space, state[None], prior[None], measured, range_std=std, xi=xi)
    rows, right, present = (part[0] for part in differenced_rows(space, measured))
    if not present.any():
        assert np.isnan(found.diagnostics.innovation[0])
        assert not found.matrix.any()
        return
    rows, right = rows[present], right[present]
    rows = np.hstack([rows, -measured.age[0] * rows])
    noise = covariance_of(measured.range[0], measured.neighbour_range[0][present], std)
    innovation = right - rows @ state
    nis = innovation @ np.linalg.inv(rows @ prior @ rows.T + noise) @ innovation / len(rows)
    weight = min(1.0, xi / np.sqrt(nis))
    scaled = weight * rows.T @ np.linalg.inv(noise)
    tolerance = 1e-7 * np.abs(scaled @ rows).max() * (1.0 + np.abs(state).max() + np.abs(innovation).max())
    np.testing.assert_allclose(found.matrix[0], scaled @ rows, rtol=1e-6, atol=tolerance)
    np.testing.assert_allclose(found.vector[0], scaled @ right, rtol=1e-6, atol=tolerance)
    np.testing.assert_allclose(
        [found.diagnostics.innovation[0], found.diagnostics.weight[0]], [np.sqrt(nis), weight], rtol=1e-5
    )
    np.testing.assert_allclose(found.diagnostics.nis[0], nis * len(rows), rtol=1e-5)
    assert found.diagnostics.nis_degrees[0] == len(rows)


def test_an_agent_without_a_range_of_its_own_has_no_difference():
    measured = scene(3)
    measured.range[0] = np.nan
    found = differenced_information(Space(), np.zeros((1, 6)), np.eye(6)[None], measured, range_std=0.1, xi=1.0)
    assert not found.matrix.any()
    assert not found.vector.any()
    assert np.isnan(found.diagnostics.weight).all()


@pytest.mark.parametrize("scale", [1.0, 100.0])
def test_as_noise_vanishes_differences_of_four_agents_find_the_target(scale):
    random = np.random.default_rng(4)
    target, places = random.normal(scale=scale, size=3), random.normal(scale=scale, size=(5, 3))
    ranges = np.linalg.norm(places - target, axis=1)
    measured = Measurement(places[:1], ranges[:1], np.zeros(1), places[None, 1:], ranges[None, 1:])
    found = differenced_information(
        Space(), np.zeros((1, 6)), scale**2 * np.eye(6)[None], measured, range_std=1e-4 * scale, xi=np.inf
    )
    position = np.linalg.solve(found.matrix[0, :3, :3], found.vector[0, :3])
    np.testing.assert_allclose(position, target, rtol=0, atol=1e-6 * scale)
