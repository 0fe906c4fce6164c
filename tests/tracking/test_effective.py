"""Of how many agents an average is, and a network that is larger than its rounds reach."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.analysis.summary import pick
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking import effective
from zenoh_cbef.tracking.effective import effective_sizes
from zenoh_cbef.tracking.graph import make_edges, neighbours
from zenoh_cbef.tracking.weights import metropolis_weights

GRID = ["agents.count=100", "network.graph=grid", "steps=60"]


def sizes(kind, count, rounds):
    lists = neighbours(count, make_edges(kind, np.zeros((count, 3)), seed=1, probability=0.5, radius=1.0))
    return effective_sizes(lists, metropolis_weights(lists), rounds)


def test_on_a_path_one_round_is_of_as_many_agents_as_its_weights_say():
    # Weights 1/3 to each neighbour; an end keeps 2/3 for itself: 1/(4/9 + 1/9) and 1/(3/9).
    np.testing.assert_allclose(sizes("path", 5, 1), [1.8, 3.0, 3.0, 3.0, 1.8])


@given(kind=st.sampled_from(["path", "ring", "grid", "star", "erdos-renyi"]), count=st.integers(2, 12))
def test_more_rounds_are_of_more_agents_until_they_are_of_all(kind, count):
    found = [sizes(kind, count, rounds) for rounds in (0, 1, 2, 4, 4000)]
    np.testing.assert_allclose(found[0], 1.0)
    # The sum for agent i is (W^2L)_ii, of terms lambda^2L v_i^2, and no eigenvalue lambda is beyond 1.
    assert all((more >= less - 1e-9).all() for less, more in pairwise(found))
    np.testing.assert_allclose(found[-1], count, rtol=1e-6)


def test_the_averages_of_random_signs_tell_it_for_large_networks(monkeypatch):
    exact = sizes("grid", 400, 5)
    monkeypatch.setattr(effective, "_EXACT", 0)
    drawn = sizes("grid", 400, 5)
    # Each is a mean of 32 squares of about normal averages: sqrt(2/32) = 25 % off, and all of them 3 % too large.
    ratio = drawn / exact
    assert np.median(ratio) == pytest.approx(1.0, abs=0.1)
    assert np.std(ratio) == pytest.approx(0.25, abs=0.1)


def test_a_network_beyond_the_reach_of_its_rounds_claims_no_more_than_it_knows():
    today, before = (
        [analyze(simulate([load("tracking", [*GRID, f"seed={seed}", *more]).scenario]))[0].metrics for seed in (1, 2)]
        for more in ([], ["filter.defaults=12"])
    )
    for now, then in zip(today, before, strict=True):
        assert 0.6 * 6.0 < pick(now, "nees.average") < 1.3 * 6.0 < pick(then, "nees.average")
        assert pick(now, "position_rmse") < pick(then, "position_rmse")


@pytest.mark.parametrize(
    ("keys", "counted"),
    [
        (["filter.defaults=12"], "once"),
        (["filter.kind=ci"], "once"),
        (["consensus.acceleration=chebyshev"], "once"),
        (["consensus.rounds=0"], "once"),
        (["network.graph=complete"], "once"),
        (["agents.count=12", "network.graph=path", "consensus.rounds=1"], "once"),
        ([], "often"),
        (["filter.kind=icf"], "often"),
        (["filter.motion=imm"], "often"),
    ],
)
def test_ranges_are_counted_less_where_n_times_an_average_would_count_them_often(keys, counted):
    often = Plan(load("tracking", [*GRID, *keys]).scenario).overcounted
    assert (often > 1.0).all() if counted == "often" else (often == 1.0).all()
