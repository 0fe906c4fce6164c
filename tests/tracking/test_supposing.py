"""What all agents told is of some steps ago when it is compared with the estimate."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.world import make_world
from zenoh_cbef.simulator import Heard, heard_in, simulate
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters import FilterSettings
from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.filters.finding.doubts import SLOT, Doubts
from zenoh_cbef.tracking.filters.finding.supposing import Supposing
from zenoh_cbef.tracking.filters.kinds.icf import InformationWeighted
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Space

PLACES = np.array([[-8.0, 3, 1], [7, -6, 4], [2, 9, -5], [-3, -7, -8], [9, 5, 7], [-6, 1, 9]])
TARGET = np.array([1.0, -2.0, 0.5, 0.8, 0.6, -0.4])
STD = 0.05


def told():
    """What six agents tell of a target, exactly: (1, 6, 9)."""
    offset = TARGET[:3] - PLACES
    distance = np.linalg.norm(offset, axis=1)
    spread = np.tile([STD**2, 0.0, STD**2], (6, 1))
    return np.column_stack([np.ones(6), PLACES, distance, offset @ TARGET[3:] / distance, spread])[None]


@pytest.mark.parametrize(("off", "moves"), [(0.0, False), (2.0, True)])
def test_an_estimate_stays_that_fits_what_was_told_a_step_ago_and_another_moves_there(off, moves):
    motion, space = NearlyConstantVelocity(0.5, 0.1), Space()
    anywhere = np.zeros((1, 6)), np.diag([170.0, 170, 170, 3, 3, 3])[None] ** 2
    settings = FilterSettings(motion, space, STD, 2.0, 6, anywhere=anywhere, reacquires=10)
    # Three agents tell in a step, the other three in the next one.
    supposing = Supposing.of(settings, InformationWeighted(motion, space, STD, 6), 3 * SLOT)
    doubts = replace(Doubts.first(1, 6, 20), table=told(), agent=np.array([2.0]))
    now = motion.predict_state(TARGET[None])
    belief = Belief(now + off, np.eye(6)[None])
    after, found = supposing._judged(doubts, belief, np.array([0]))  # noqa: SLF001 - what follows from what all told
    assert (found is not belief) == moves
    np.testing.assert_allclose(found.state, now, atol=0.1)
    assert after.left.tolist() == after.open.tolist() == [0.0]


@pytest.mark.parametrize(("rules", "later"), [(13, 30), (14, 2)])
def test_a_receiver_that_was_wrong_for_a_while_takes_part_again_after_two_ranges_that_fit(rules, later):
    plan = load("tracking", [f"filter.defaults={rules}", "steps=95"]).plan
    heard, ends = heard_in(plan, make_world(plan.scenario)), 60
    ranges = heard.ranges.copy()
    ranges[5, :ends] += 10.0
    (trace,) = simulate([plan.scenario], heard=[Heard(heard.positions, ranges, heard.age)])
    left = trace.diagnostics.distrust[5] == 1.0
    assert left[ends - 20 : ends].all()
    assert np.argmin(left[ends:]) == later
