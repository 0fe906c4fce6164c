"""Agents that keep silent: the sum stays, all come as near as the trigger says, no word is made up."""

from __future__ import annotations

import numpy as np
import pytest

from tests import unaided
from zenoh_cbef.errors import UserError
from zenoh_cbef.scenario.checks import check
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.graph import make_edges, neighbours
from zenoh_cbef.tracking.triggered import Triggered
from zenoh_cbef.tracking.weights import metropolis_weights

LISTS = neighbours(7, make_edges("erdos-renyi", np.zeros((7, 3)), seed=2, probability=0.4, radius=1.0))
NEVER = np.zeros(LISTS.present.shape, dtype=bool)


def information(count):
    """Payloads of two states, near one another, and a number more."""
    rng = np.random.default_rng(5)
    matrix = np.array([[4.0, 1.0], [1.0, 2.0]]) * rng.uniform(0.8, 1.2, (count, 1, 1))
    vector = (matrix @ rng.normal(1.0, 0.3, (count, 2, 1)))[:, :, 0]
    upper = np.stack([matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 1]], axis=1)
    return np.concatenate([vector, upper, rng.uniform(0.0, 1.0, (count, 1))], axis=1)


def mixed(trigger, rounds=200):
    stage = Triggered(metropolis_weights(LISTS), trigger, (2,))
    payload = information(7)
    message = stage.start(payload)
    assert not np.isnan(message).any()
    for _ in range(rounds):
        message = stage.mix(message[LISTS.index], None)
    return stage, payload


@pytest.mark.parametrize("trigger", [1e-3, 0.02, 0.2, 1.0])
def test_silence_keeps_the_sum_and_leaves_agents_as_far_apart_as_the_trigger_says(trigger):
    stage, payload = mixed(trigger)
    np.testing.assert_allclose(stage.result().sum(axis=0), payload.sum(axis=0), rtol=0, atol=1e-12)
    state = np.linalg.solve(stage.result()[:, [[2, 3], [3, 4]]], stage.result()[:, :2, None])[:, :, 0]
    # A deviation of what an agent shares is at most 1; seven agents may each keep that much to themselves.
    assert (state.max(axis=0) - state.min(axis=0)).max() < 7.0 * trigger
    assert (stage.silent > 0.0).all()


def test_the_wider_the_trigger_the_more_agents_keep_silent():
    silent = [mixed(trigger)[0].silent.sum() for trigger in (1e-9, 0.01, 0.1, 1.0)]
    assert silent == sorted(silent)
    assert silent[-1] > silent[0] + 7


def test_of_a_neighbour_that_was_never_heard_silence_says_nothing():
    stage, payload = mixed(10.0, rounds=0)
    quiet = np.full_like(payload, np.nan)[LISTS.index]
    stage.mix(payload[LISTS.index], NEVER)
    stage.mix(quiet, None)
    np.testing.assert_array_equal(stage.result(), payload)
    stage.mix(payload[LISTS.index], None)
    once = stage.result().copy()
    stage.mix(quiet, None)
    assert not np.array_equal(stage.result(), once)


@pytest.mark.slow
def test_on_a_clean_network_silence_costs_less_than_a_hundredth_of_the_error():
    def found(*overrides):
        scenario = load("tracking", ["steps=60", *overrides]).scenario
        traces = simulate([scenario.changed(seed=seed) for seed in range(1, 7)])
        runs = [(unaided.position_rmse(one), unaided.nees(one)) for one in unaided.errors(traces)]
        return np.array(runs), np.mean([trace.diagnostics.silent[:, 20:].mean() for trace in traces])

    plain, _ = found()
    quiet, silent = found("consensus.trigger=0.1", "consensus.precision='int12'")
    assert silent > 3.0
    assert np.median(quiet[:, 0] / plain[:, 0]) < 1.01
    assert np.mean(quiet[:, 1] / plain[:, 1]) < 1.02


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        (["filter.kind='kcf'"], "set consensus.trigger = 0"),
        (["filter.kind='hcmci'"], "set consensus.trigger = 0"),
        (["fault=[{kind='byzantine', agents=[1], mode='constant', magnitude=1.0}]"], "consensus.isolate = false"),
        (["consensus.acceleration='chebyshev'"], "needs plain averaging"),
        (["consensus.scheme='running-sums'"], "needs plain averaging"),
        (["consensus.trim=1", "agents.count=12"], "needs plain averaging"),
        (["consensus.isolate=true"], "needs plain averaging"),
    ],
)
def test_where_silence_would_mislead_a_sentence_names_the_remedy(keys, told):
    with pytest.raises(UserError, match=told):
        check(load("tracking", ["consensus.trigger=0.1", *keys]).plan)
    check(load("tracking", ["consensus.trigger=0.1", "fault=[{kind='loss', probability=0.3}]"]).plan)


@pytest.mark.parametrize(("off", "near"), [(0.5, True), (0.5000001, False), (-0.5, True), (-0.6, False)])
def test_a_number_is_near_up_to_the_trigger_or_that_share_of_a_larger_one(off, near):
    stage = Triggered(metropolis_weights(LISTS), 0.5, (2,))
    said = information(2)
    for told, scale in ((0.0, 1.0), (-1.0, 1.0), (8.0, 8.0), (-8.0, 8.0)):
        said[:, -1] = told
        value = said.copy()
        value[1, -1] += off * scale
        assert stage._near(value, said).tolist() == [True, near]  # noqa: SLF001


def error(*more):
    keys = ["steps=60", "seed=4001", "sensor.bias_std=0.1", *more]
    (trace,) = simulate([load("tracking", keys).scenario])
    return float(np.linalg.norm(trace.estimates[:, 5:, :3] - trace.truth[5:, :3], axis=2).mean())


def test_numbers_of_a_first_fix_are_no_information_on_biases_that_come_later():
    """Where the filter's information on biases is to stand, the fix has numbers of its own, and zeros."""
    all_told = error()
    assert error("consensus.trigger=0.02") < 1.02 * all_told
    assert error("consensus.trigger=0.02", "filter.defaults=13") > 2.0 * all_told
