"""Hypotheses over which ranges bend are split, and later ranges choose between the parts."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.filters.models.branching import Branches, Heard, conditioned
from zenoh_cbef.tracking.filters.models.mixtures import alike, mixture
from zenoh_cbef.tracking.filters.models.splitting import MANY, STAY, begun_with, split, staying
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.switching import Switching

STD = 0.1
WIDE = np.diag([3.0, 2.0, 2.5, 1.0, 1.0, 1.0]) ** 2
PLACES = np.array([[-9.0, -7, 3], [8, -6, -5], [7, 8, 2], [-6, 9, -7]])


def heard_of(places, errors=0.0):
    """Ranges of targets (n, 3) to all agents."""
    shape = len(places), len(PLACES)
    ranges = np.linalg.norm(places[:, None] - PLACES, axis=2) + errors
    anchors = np.broadcast_to(PLACES, (*shape, 3))
    return Heard(anchors, np.zeros(shape), ranges, np.zeros(shape), np.full(shape, STD**2))


def only(heard, agent):
    """What was heard by one agent."""
    others = np.arange(len(PLACES)) != agent
    return Heard(heard.place, heard.height, np.where(others, np.nan, heard.range), heard.age, heard.variance)


def test_a_split_hypothesis_has_the_same_moments():
    priors = alike(np.arange(6.0)[None], WIDE[None], 2)
    state, covariance, likelihood = split(priors, heard_of(np.zeros((1, 3))))
    assert state.shape == (1, 6, 6)
    mean, spread, total = mixture(state, covariance, likelihood)
    np.testing.assert_allclose(mean[0], np.arange(6.0), atol=1e-12)
    np.testing.assert_allclose(spread[0], WIDE, atol=1e-12)
    np.testing.assert_allclose(total, 0.0, atol=1e-12)


def test_of_directions_in_which_as_little_is_known_the_first_axis_is_split():
    """And not one that last digits choose: these differ between processors."""
    alike_on_all = np.diag([3.0, 3, 3, 1, 1, 1]) ** 2
    turned = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    rounded = np.array(alike_on_all)
    rounded[:3, :3] = turned @ alike_on_all[:3, :3] @ turned.T
    rounded = 0.5 * (rounded + rounded.T)
    assert not np.array_equal(rounded, alike_on_all)
    heard = heard_of(np.zeros((1, 3)))
    for covariance in (alike_on_all, rounded):
        states, _, _ = split(alike(np.zeros((1, 6)), covariance[None], 1), heard)
        np.testing.assert_allclose(states[0, 1], [3.0, 0, 0, 0, 0, 0], atol=1e-5)
        np.testing.assert_allclose(states[0, 2], [-3.0, 0, 0, 0, 0, 0], atol=1e-5)
    by_digits = [
        split(alike(np.zeros((1, 6)), one[None], 1), heard, settled=False)[0] for one in (alike_on_all, rounded)
    ]
    assert np.abs(by_digits[0] - by_digits[1]).max() > 0.1


def test_what_is_narrow_or_has_no_range_stays_one():
    heard = heard_of(np.zeros((1, 3)))
    narrow = alike(np.zeros((1, 6)), 0.01 * WIDE[None], 1)
    assert split(narrow, heard) is narrow
    silent = Heard(heard.place, heard.height, np.full_like(heard.range, np.nan), heard.age, heard.variance)
    wide = alike(np.zeros((1, 6)), WIDE[None], 1)
    assert split(wide, silent) is wide


def test_of_a_batch_each_row_is_as_it_is_alone():
    states, covariances = np.zeros((2, 6)), np.stack([WIDE, 0.01 * WIDE])
    heard = heard_of(np.ones((2, 3)))
    both = conditioned(Branches.of(split(alike(states, covariances, STAY), heard), 3), heard, None, MANY)
    one = heard_of(np.ones((1, 3)))
    for row in (0, 1):
        prior = split(alike(states[row : row + 1], covariances[row : row + 1], STAY), one)
        alone = conditioned(Branches.of(prior, 3), one, None, MANY)
        for ours, theirs in zip(both.merged(), alone.merged(), strict=True):
            np.testing.assert_array_equal(ours[row], theirs[0])


def test_ranges_one_after_the_other_find_a_target_of_which_little_is_known():
    random = np.random.default_rng(1)
    count = 50
    truth = random.normal(size=(count, 3)) * np.sqrt(np.diag(WIDE))[:3]
    heard = heard_of(truth, STD * random.normal(size=(count, len(PLACES))))
    off = []
    for splits in (False, True):
        priors = alike(np.zeros((count, 6)), np.repeat(WIDE[None], count, axis=0), STAY)
        for agent in (0, 1, 2, 3):
            new = only(heard, agent)
            branches = conditioned(Branches.of(split(priors, new) if splits else priors, 3), new, None, MANY)
            priors = staying(branches)
        state, covariance, _ = branches.merged()
        error = (state - np.pad(truth, ((0, 0), (0, 3))))[:, :3]
        off.append(np.sqrt(np.mean(np.sum(error**2, axis=1))))
        nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance[:, :3, :3]), error)
        assert np.median(nees) < 4.0
    assert off[1] < 0.5 * off[0]


def test_a_motion_begins_with_the_hypotheses_of_all_motions():
    calm, wild = NearlyConstantVelocity(0.1, 0.1), NearlyConstantVelocity(0.1, 10.0)
    switching = Switching((calm, wild), (0.1,))
    places = np.zeros((2, 1, STAY, 6))
    places[1, :, :, 0] = 100.0
    weights = alike(np.zeros((1, 6)), np.eye(6)[None], STAY)[2]
    parts = tuple(
        Belief(place[:, 0], np.eye(6)[None], memory=(place, np.tile(np.eye(6), (1, STAY, 1, 1)), weights))
        for place in places
    )
    belief = Belief(np.zeros((1, 6)), np.eye(6)[None], chance=np.array([[0.75, 0.25]]), parts=parts)
    ahead, priors = begun_with(switching, belief)
    np.testing.assert_allclose(ahead, [[0.7, 0.3]])
    for motion, shares in enumerate([(0.675, 0.025), (0.075, 0.225)]):
        state, _, likelihood = priors[motion]
        found = {float(one[0]): weight for one, weight in zip(state[0], np.exp(likelihood[0]), strict=True) if weight}
        for place, share in zip((0.0, 100.0), shares, strict=True):
            np.testing.assert_allclose(found[place], share / sum(shares))
