"""A network that has coasted so far that ranges bend over its claimed error looks for its target again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.filters.finding.drifted import bent, drifted
from zenoh_cbef.tracking.filters.finding.squared_ranges import Seen
from zenoh_cbef.tracking.ranging import Space
from zenoh_cbef.tracking.status import Status

NEAR, FAR = [0.0, 0.0, 0.0], [1e5, 0.0, 0.0]


def seen(*places, heard=(False, False, False, False)):
    """What agents at these places have seen of four steps."""
    ranges = np.tile(np.where(heard, 10.0, np.nan), (len(places), 1))
    return Seen(np.repeat(np.array(places)[:, None], 4, axis=1), np.zeros_like(ranges), ranges)


def test_a_range_bends_by_the_spread_across_it():
    state, position = np.array([[10.0, 0.0, 0.0, 0.0]]), np.array([NEAR])
    across, along = (np.diag([*each, 1.0, 1.0])[None] for each in ((0.0, 9.0), (9.0, 0.0)))
    # 9/(2 * 10) m.
    assert bent(Space(0.0), state, across, position, 0.44).all()
    assert not bent(Space(0.0), state, across, position, 0.46).any()
    assert not bent(Space(0.0), state, along, position, 0.01).any()


def test_agents_that_coast_drift_where_ranges_bend():
    settings = Plan(load("tracking", ["filter.planar_height=0"]).scenario).settings
    belief = Belief(np.tile([10.0, 0.0, 0.0, 0.0], (2, 1)), np.tile(np.diag([9.0, 9.0, 1.0, 1.0]), (2, 1, 1)))
    spread = np.full(2, np.sqrt(18.0))
    coasts = replace(Status.first(2), spread=spread, reference=spread / 5.0)
    assert drifted(settings, belief, coasts, seen(NEAR, FAR)).tolist() == [True, False]
    tracks = replace(coasts, reference=spread)
    assert not drifted(settings, belief, tracks, seen(NEAR, FAR)).any()
    # By the rules of before only what has grown twentyfold drifts.
    before = replace(settings, bends=False)
    assert not drifted(before, belief, coasts, seen(NEAR, FAR)).any()
    assert drifted(before, belief, replace(coasts, reference=spread / 21.0), seen(NEAR, FAR)).all()
    # Agents that split their hypotheses would forget them.
    splits = replace(settings, drifts=False)
    assert not drifted(splits, belief, replace(coasts, reference=spread / 21.0), seen(NEAR, FAR)).any()


def test_agents_that_have_ranges_do_not_drift_where_most_innovations_widen_what_they_claim():
    settings = replace(Plan(load("tracking", ["filter.planar_height=0"]).scenario).settings, sudden=1)
    belief = Belief(np.tile([10.0, 0.0, 0.0, 0.0], (2, 1)), np.tile(np.diag([9.0, 9.0, 1.0, 1.0]), (2, 1, 1)))
    adrift = replace(Status.first(2), spread=np.full(2, 21.0), reference=np.ones(2))
    assert drifted(settings, belief, adrift, seen(NEAR, FAR)).all()
    assert drifted(settings, belief, adrift, seen(NEAR, FAR, heard=(True, False, False, False))).all()
    assert not drifted(settings, belief, adrift, seen(NEAR, FAR, heard=(True, True, False, False))).any()
    # By the rules of before the covariance alone counts.
    assert drifted(replace(settings, sudden=0), belief, adrift, seen(NEAR, FAR, heard=(True,) * 4)).all()
