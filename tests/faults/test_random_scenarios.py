"""Whatever faults a scenario has, it runs, stays finite, and gives the same bits alone and in a batch."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given

from tests.examples import examples
from tests.faults.strategies import scenarios
from tests.simulator.made import assert_same
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.errors import UserError
from zenoh_cbef.scenario.checks import check
from zenoh_cbef.scenario.load import parse
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate


@pytest.mark.slow
@examples(15, suppress_health_check=[HealthCheck.too_slow])
@given(scenarios())
def test_a_faulty_run_is_finite_and_the_same_alone_and_in_a_batch(given):
    one = parse(given, "test")
    try:
        check(Plan(one))
    except UserError as error:
        assume(not re.search("is there to track|remembers nothing", str(error)))
        raise
    absences = Plan(one).absences
    there = ~np.stack([absences.at(step) for step in range(1, one.length + 1)], axis=1)
    other = one.changed(seed=one.seed + 1)
    together = simulate([one, other], keep_payloads=True)
    for expected in together:
        [alone] = simulate([expected.scenario], keep_payloads=True)
        assert_same(alone, expected)
        assert (np.isfinite(alone.estimates).all(axis=2) == there).all()
        assert np.isfinite(alone.covariances[there]).all() or np.isnan(alone.covariances).all()
        if alone.payloads is not None:
            assert expected.payloads is not None
            told = alone.payloads[there]
            silent = np.isnan(told).all(axis=2) & (one.consensus.trigger > 0.0)
            assert np.isfinite(told[~silent]).all()
            assert alone.payloads.tobytes() == expected.payloads.tobytes()
        links = alone.links
        assert (links.sent == links.delivered + links.lost + links.late).all()
        assert not links.real_lost.any()
        assert not links.deadline_missed.any()
        assert (links.duplicated <= links.delivered).all()
    # Where all honest agents are away in the scored window there is no error to tell.
    errors = [one.metrics.position_rmse for one in analyze(together)]
    assert all(error is None or np.isfinite(error) for error in errors)
