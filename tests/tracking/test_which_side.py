"""When agents in one plane lose the side on which their target is, of estimates and places that are given."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.diagnostics import Diagnostics
from zenoh_cbef.tracking.filters import Belief, FilterSettings, Update
from zenoh_cbef.tracking.filters.finding.one_side import OneSide
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Measurement, Space, no_neighbours
from zenoh_cbef.tracking.status import ACQUIRING, LOST, TRACKING, Status

MIDDLE, FIX = np.array([1.0, 2.0, -3.0]), 4
# Agents in a tilted plane: along two axes, and the third one off it.
AXES = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
FLAT = np.array([[-8.0, -5, 0], [8, -4, 0], [0, 9, 0]])
ROOT = np.random.default_rng(2).normal(size=(6, 6))
COVARIANCE = 0.01 * (ROOT @ ROOT.T + np.eye(6))


@dataclass
class Fixed:
    """A filter that estimates what it is told."""

    state: Floats
    which: float = TRACKING
    steps: float = FIX + 1.0

    def update(self, belief: Belief, measurement: Measurement) -> Update:  # noqa: ARG002 - it knows already
        return Update(np.zeros((len(belief.state), 1)), Diagnostics.of(len(belief.state)))

    def conclude(self, payload: Floats, update: Update) -> Belief:  # noqa: ARG002
        count = len(payload)
        status = replace(Status.first(count), which=np.full(count, self.which), steps=np.full(count, self.steps))
        return Belief(np.tile(self.state, (count, 1)), np.tile(COVARIANCE, (count, 1, 1)), status=status)


def state_of(height, speed):
    """A target above the agents' plane, m and m/s, and anywhere along it."""
    return np.concatenate([MIDDLE + AXES @ [2.0, -1.0, height], AXES @ [0.5, 3.0, speed]])


def said(places, filter_, before=None, weights=None):
    """What agents at places along and off the plane say then: beliefs after one step."""
    count = len(places)
    side = OneSide(filter_, FilterSettings(NearlyConstantVelocity(0.5, 0.5), Space(), 0.1, 2.0, count, says_status=True,
                                           sides=True, first_fix=FIX, middle=tuple(MIDDLE)))  # fmt: skip
    heard = Measurement(
        MIDDLE + np.array([0.3, 0.2, 0.1]) + places @ AXES.T, np.ones(count), np.zeros(count), *no_neighbours(count)
    )
    belief = before or Belief(np.zeros((count, 6)), np.tile(np.eye(6), (count, 1, 1)))
    update = side.update(belief, heard)
    mixed = (np.full((count, count), 1.0 / count) if weights is None else weights) @ update.payload
    return side.conclude(mixed, update)


def is_lost(places, filter_, **how):
    """Whether they say that they do not know the side; all say the same."""
    status = said(places, filter_, **how).status.which
    assert (status == status[0]).all()
    return bool(status[0] == ACQUIRING)


@pytest.mark.parametrize("speed", [0.0, 0.5, -2.0])
def test_it_is_lost_within_five_deviations_of_the_mirror_image(speed):
    """Of height and speed across the plane together, whatever the weights with which agents hear of places."""
    random, lost = np.random.default_rng(3), set()
    across = np.zeros((2, 6))
    across[0, :3] = across[1, 3:] = AXES[:, 2]
    above = MIDDLE + np.array([0.3, 0.2, 0.1])
    for height in np.linspace(-1.5, 1.5, 31):
        state = state_of(height, speed)
        apart = 2.0 * across @ (state - [*above, 0, 0, 0])
        expected = apart @ np.linalg.solve(across @ COVARIANCE @ across.T, apart) < 25.0
        assert is_lost(FLAT, Fixed(state), weights=random.dirichlet(np.ones(3), size=3)) == expected
        lost.add(bool(expected))
    assert lost == ({True, False} if abs(speed) < 1.0 else {False})


ON = state_of(0.0, 0.0) + np.array([0.3, 0.2, 0.1, 0, 0, 0])
"""A target in the plane of the agents."""


@pytest.mark.parametrize(
    ("off", "flat"), [([0, 0, 0, 0], True), ([0, 0, 0, 1e-4], True), ([0, 0, 0, 1e-2], False), ([1, 1, 1, 1], True)]
)
def test_agents_are_in_one_plane_that_are_hardly_off_it(off, flat):
    places = np.vstack([FLAT, [3.0, 1.0, 0.0]])
    places[:, 2] += off
    assert is_lost(places, Fixed(ON + np.pad(AXES[:, 2] * np.mean(off), (0, 3)))) == flat


@pytest.mark.parametrize(("beside", "flat"), [(0.0, False), (1e-4, False), (1e-2, True)])
def test_agents_on_one_line_are_in_no_plane(beside, flat):
    places = np.array([[-8.0, 0, 0], [8, 0, 0], [2, beside, 0]])
    assert is_lost(places, amid(places)) == flat


def amid(places):
    """A target amid the agents, which moves along their longest axis."""
    return Fixed(np.concatenate([MIDDLE + np.array([0.3, 0.2, 0.1]) + AXES @ places.mean(axis=0), AXES[:, 0]]))


def test_the_share_of_their_reach_counts_and_not_the_distance():
    places = np.vstack([FLAT, [3.0, 1.0, 1e-2]])
    assert not is_lost(places, Fixed(ON))
    thin = np.array([[-1000.0, 0, 0], [1000, 0, 0], [0, 1, 0], [0, -1, 1e-2]])
    assert is_lost(thin, amid(thin))
    assert is_lost(1e3 * FLAT + np.vstack([np.zeros((2, 3)), [[0, 0, 1e-2]]]), Fixed(ON))


def test_it_stays_lost_while_they_are_in_one_plane():
    belief = said(FLAT, Fixed(ON))
    far = Fixed(state_of(50.0, 0.0))
    assert not is_lost(FLAT, far)
    assert is_lost(FLAT, far, before=belief)
    later = said(FLAT, far, before=belief)
    np.testing.assert_allclose(later.status.seconds, belief.status.seconds + 0.5)
    assert not is_lost(FLAT + np.diag([0.0, 0.0, 5.0]) @ AXES, far, before=None)
    four = np.vstack([FLAT, [1.0, 1.0, 4.0]])
    away = said(four, Fixed(ON))
    assert (away.status.which == TRACKING).all()


@pytest.mark.parametrize(("filter_", "which"), [(Fixed(ON, LOST), LOST), (Fixed(ON, steps=FIX), TRACKING)])
def test_a_lost_target_stays_lost_and_before_the_first_fix_is_over_there_is_no_side(filter_, which):
    assert (said(FLAT, filter_).status.which == which).all()


def test_what_is_no_number_is_no_plane():
    weights = np.full((3, 3), 1.0 / 3.0)
    weights[1, 2] = np.nan
    assert said(FLAT, Fixed(ON), weights=weights).status.which.tolist() == [ACQUIRING, TRACKING, ACQUIRING]
