"""How badly the ranges of an agent fit that leaves them out."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters import FilterSettings
from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.filters.finding.supposing import _FADES, _MEMORY, Supposing
from zenoh_cbef.tracking.filters.kinds.icf import InformationWeighted
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Measurement, Space, no_neighbours
from zenoh_cbef.tracking.status import CUT


@pytest.mark.parametrize(
    ("rejoins", "then"),
    [
        (False, [CUT + (1.5**2 - CUT) / _MEMORY, 4.0 + (CUT - 4.0) / _MEMORY, 4.0]),  # a step towards each
        (True, [CUT / _FADES, CUT, 4.0]),  # the larger one of the latest and a third of those before
    ],
)
def test_how_badly_ranges_fit_follows_each_new_one_and_stays_where_there_is_none(rejoins, then):
    motion, space, std = NearlyConstantVelocity(0.5, 1.0), Space(), 0.3
    settings = FilterSettings(motion, space, std, 2.0, 4, anywhere=(np.zeros((1, 6)), np.eye(6)[None]), reacquires=10)
    settings = replace(settings, rejoins=rejoins)
    supposing = Supposing.of(settings, InformationWeighted(motion, space, std, 4), 65)
    state = np.array([[5.0, 1.0, 2.0, -1.0, 0.5, 0.2]]).repeat(3, axis=0)
    covariance = np.diag([0.4, 0.3, 0.2, 0.1, 0.1, 0.1])[None].repeat(3, axis=0)
    ahead = motion.predict_state(state)[:, :3]
    spread = motion.predict_covariance(covariance, state)[0, :3, :3]
    distance = float(np.linalg.norm(ahead[0]))
    towards = ahead[0] / distance
    variance = float(towards @ spread @ towards) + std**2
    off = 1.5 * np.sqrt(variance)
    ranges = np.array([distance + off, distance + 100.0, np.nan])
    new = Measurement(np.zeros((3, 3)), ranges, np.zeros(3), *no_neighbours(3))
    before = np.array([CUT, 4.0, 4.0])
    found = supposing._own(before, Belief(state, covariance), new)  # noqa: SLF001 - the one number of it
    np.testing.assert_allclose(found, then)
