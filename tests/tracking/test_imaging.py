"""Hypotheses of agents that tell each other their ranges go on on both sides of a plane near which these are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.stress import cases, scenario_of
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.filters.models.imaging import with_images
from zenoh_cbef.tracking.filters.models.mixtures import NEVER
from zenoh_cbef.tracking.mirroring import Sides, seen_from
from zenoh_cbef.tracking.status import TRACKING

PLANE = (0.0, 0.0, 1.0), (0.0, 0.0, 1.0)


def hypotheses(heights, rise=0.0, std=0.5):
    """One for each height above the plane, with unit velocity spread."""
    state = np.zeros((1, len(heights), 6))
    state[0, :, 2], state[0, :, 5] = np.array(heights) + 1.0, rise
    covariance = np.broadcast_to(np.diag([1.0, 1.0, std**2, 1.0, 1.0, 1.0]), (1, len(heights), 6, 6))
    return state, covariance, np.log(np.full((1, len(heights)), 1.0 / len(heights)))


@given(st.lists(st.floats(-4.0, 4.0), min_size=1, max_size=4), st.floats(-8.0, 8.0))
def test_images_are_as_likely_as_what_they_are_beside_has_it_and_all_as_before(heights, rise):
    known = hypotheses(heights, rise)
    state, covariance, likelihood = with_images(known, PLANE)
    assert np.exp(likelihood).sum() == pytest.approx(1.0)
    near = Sides.of(known[0][0], PLANE).unsure(known[1][0])
    if not near.any():
        assert state is known[0]
        return
    count = len(heights)
    there = likelihood[0, count:] > 0.5 * NEVER
    np.testing.assert_array_equal(there, near)
    beside = np.stack([np.array(heights), np.full(count, rise)], axis=1)
    apart = np.sum((2.0 * beside) ** 2 / np.array([0.25, 1.0]), axis=1)
    np.testing.assert_allclose((likelihood[0, :count] - likelihood[0, count:])[near], 0.5 * apart[near], atol=1e-9)
    np.testing.assert_allclose(state[0, count:, 2] - 1.0, -np.array(heights), atol=1e-12)
    np.testing.assert_allclose(state[0, count:, 5], -rise)
    np.testing.assert_allclose(covariance[0, count:], covariance[0, :count])


def test_what_is_far_off_the_plane_or_crosses_it_fast_has_none():
    for far in (hypotheses([2.0]), hypotheses([0.0], rise=3.0)):
        assert with_images(far, PLANE) is far
    near = hypotheses([0.3])
    assert with_images(near, None) is near
    dead = near[0], near[1], np.full((1, 1), NEVER)
    assert with_images(dead, PLANE) is dead


def test_a_plane_is_counted_from_the_middle_as_states_are():
    assert seen_from(((1.0, 2.0), (0.0, 1.0)), (0.5, 4.0)) == ((0.5, -2.0), (0.0, 1.0))
    assert seen_from(None, (0.0, 0.0)) is None


@pytest.mark.parametrize(
    ("case", "seed"),
    [
        ("flat-box-and-crossing", 1005),
        ("many-agents-flat-box-and-crossing", 1019),
        ("many-agents-circle-near-a-plane-and-mirror-guess", 1001),
        ("circle-near-a-plane-and-mirror-guess", 1001),
    ],
)
def test_agents_near_a_plane_are_not_sure_of_a_mirror_image(case, seed):
    shares = []
    for rules in (25, 26):
        (trace,) = simulate([scenario_of(cases()[case], [f"filter.defaults={rules}", f"seed={seed}", "steps=200"])])
        error = np.linalg.norm((trace.estimates - trace.truth)[:, :, :3], axis=2)
        claimed = np.sqrt(trace.covariances[:, :, range(3), range(3)].sum(axis=2))
        shares.append(((trace.diagnostics.status == TRACKING) & (error > 5.0 * claimed)).mean())
    before, today = shares
    assert before > 0.4
    assert today < 0.02
