"""The scaled filter is its equations, contracts at any scale, and corrects the velocity."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zenoh_cbef.tracking.filters import Belief, FilterSettings, make_filter
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Measurement, Space

DT = 0.2
SEEDS = st.integers(0, 2**32 - 1)


def make(space, xi=1.5):
    return make_filter("cbef-scaled", FilterSettings(NearlyConstantVelocity(DT, 0.1, space.axes), space, 0.1, xi, 4))


def scene(seed, scale, *, noise=0.0, dropout=0.0):
    """One agent with four neighbours, and where the target is."""
    random = np.random.default_rng(seed)
    target, places = random.normal(scale=scale, size=3), random.normal(scale=scale, size=(5, 3))
    ranges = np.linalg.norm(places - target, axis=1) + noise * random.normal(size=5)
    ranges[1:][random.random(4) < dropout] = np.nan
    return target, Measurement(places[:1], ranges[:1], np.zeros(1), places[None, 1:], ranges[None, 1:])


@settings(deadline=None, derandomize=True)
@given(SEEDS, st.sampled_from([Space(), Space(0.4)]), st.sampled_from([0.1, 2.0, 1e9]))
def test_an_update_is_the_equations_computed_by_loops(seed, space, xi):
    _, measured = scene(seed, 3.0, noise=0.1, dropout=0.3)
    axes = space.axes
    state = np.random.default_rng(seed).normal(size=2 * axes)
    place, velocity = state[:axes] + DT * state[axes:], state[axes:]
    directions, innovations = [], []
    own, distance = measured.position[0], measured.range[0]
    for other, heard in zip(measured.neighbour_position[0], measured.neighbour_range[0], strict=True):
        if np.isnan(heard):
            continue
        right = (distance**2 - heard**2 + other @ other - own @ own) / 2.0
        right -= 0.0 if space.height is None else space.height * (other - own)[2]
        baseline = np.linalg.norm((other - own)[:axes])
        directions.append((other - own)[:axes] / baseline)
        innovations.append(right / baseline - directions[-1] @ place)
    update = make(space, xi).update(Belief(state[None], None), measured)
    if not innovations:
        assert np.isnan(update.diagnostics.innovation[0])
        np.testing.assert_allclose(update.payload[0], [*place, *velocity], rtol=1e-12)
        return
    size = np.linalg.norm(innovations)
    gain = min(1.0, xi / size)
    correction = gain / len(innovations) * sum(h * z for h, z in zip(directions, innovations, strict=True))
    expected = np.concatenate([place + 0.5 * correction, velocity + 0.1 / DT * correction])
    np.testing.assert_allclose(update.payload[0], expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(
        [update.diagnostics.innovation[0], update.diagnostics.weight[0]], [size, gain], rtol=1e-9
    )


@pytest.mark.parametrize("scale", [0.01, 1.0, 1e4])
def test_an_update_brings_the_estimate_nearer_at_any_scale(scale):
    for seed in range(20):
        target, measured = scene(seed, scale)
        start = target + np.random.default_rng(seed).normal(scale=scale, size=3)
        state = np.concatenate([start, np.zeros(3)])[None]
        update = make(Space(), xi=1e12).update(Belief(state, None), measured)
        assert np.linalg.norm(update.payload[0, :3] - target) < np.linalg.norm(start - target)


def test_an_agent_at_the_place_of_its_neighbour_learns_nothing_from_it():
    places = np.array([[1.0, 2.0, 3.0], [1.0, 2.0, 5.0]])
    measured = Measurement(places[:1], np.array([2.0]), np.zeros(1), places[None, 1:], np.array([[3.0]]))
    state = np.array([[0.5, 0.5, 0.25, 0.25]])
    update = make(Space(0.0)).update(Belief(state, None), measured)
    np.testing.assert_allclose(update.payload, [[0.55, 0.55, 0.25, 0.25]])
    assert np.isnan(update.diagnostics.innovation).all()


def test_it_has_no_covariance():
    made = make(Space())
    _, measured = scene(1, 1.0)
    update = made.update(Belief(np.zeros((1, 6)), None), measured)
    concluded = made.conclude(update.payload, update)
    assert concluded.covariance is None
    assert concluded.state.tobytes() == update.payload.tobytes()
