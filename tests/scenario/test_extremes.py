"""Whatever numbers a scenario has within their ranges: a result in finite numbers, or one sentence."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.examples import examples
from tests.scenario.extremes import scenario_of
from zenoh_cbef.analysis.divergence import refuse_divergence
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.errors import UserError
from zenoh_cbef.scenario import size
from zenoh_cbef.scenario.checks import check
from zenoh_cbef.scenario.load import load, parse
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate


def numbers(value):
    if isinstance(value, dict | list):
        for part in value.values() if isinstance(value, dict) else value:
            yield from numbers(part)
    elif isinstance(value, float):
        yield value


def told_by_sim(data):
    """The metrics that `sim` tells, and the sentence that it ends with."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            scenario = parse(data, "extreme")
            check(Plan(scenario))
            with np.errstate(all="ignore"):
                [trace] = simulate([scenario])
            refuse_divergence(trace)
            with np.errstate(over="raise", divide="raise", invalid="raise"):
                return analyze([trace])[0].metrics.as_json(), ""
        except (UserError, ArithmeticError, np.linalg.LinAlgError) as error:
            return {}, str(error)


@pytest.mark.slow
@examples(60)
@given(st.randoms(use_true_random=False))
def test_numbers_at_the_ends_of_their_ranges_give_a_result_or_a_sentence(random):
    told, failure = told_by_sim(scenario_of(random))
    assert "\n" not in failure
    assert all(math.isfinite(one) for one in numbers(told))


@pytest.mark.parametrize(
    "override",
    [
        "agents.low=1e300",
        "filter.planar_height=1e300",
        "target.planar_height=1e300",
        "filter.range_std=1e-200",
        "network.edges=[[0, 18446744073709551616]]",
        'fault=[{kind="outage", agents=[99999999999999999999]}]',
        'fault=[{kind="loss", probability=1.0, links="agent:99999999999999999999"}]',
        "timing.patience=1e300",
        "filter.acceleration_std=1e5",
    ],
)
def test_numbers_out_of_all_proportion_are_refused_by_the_check(override):
    key = override.partition("=")[0]
    with pytest.raises(UserError, match=f"{key}|standard deviations are out of proportion"):
        check(load("tracking", [override, "dt=1000", "steps=20", "sensor.range_std=0.05"]).plan)


def test_what_does_not_fit_the_memory_is_refused_with_an_estimate():
    with pytest.raises(UserError, match=r"1000 agents in 10000000 steps take about 1\.3 TB of memory.* lower steps"):
        check(load("tracking", ["steps=10000000", "agents.count=1000"]).plan)


def test_more_than_the_memory_that_is_left_is_not_simulated(monkeypatch):
    monkeypatch.setattr(size, "available_bytes", lambda: 10**6)
    few, many = (load("tracking", [f"steps={steps}"]).scenario for steps in (10, 300))
    simulate([few])
    for runs in ([many], [few] * 30):
        with pytest.raises(UserError, match="of memory, and 1 MB are left"):
            simulate(runs)


def test_the_last_seed_is_a_seed():
    last = load("tracking", ["seed=18446744073709551615", "steps=3"]).scenario
    assert np.isfinite(simulate([last])[0].estimates).all()


def test_as_many_agents_as_fit_are_simulated_and_no_more_as_processes():
    many = ["agents.count=1500", "network.graph=grid", "steps=2", "consensus.rounds=1"]
    loaded = load("tracking", many)
    assert check(loaded.plan) == check(load("tracking", [*many, "agents.count=900"]).plan)
    assert np.isfinite(simulate([loaded.scenario])[0].estimates).all()
    with pytest.raises(UserError, match=r"1500 agents are too many for processes.*'sim'"):
        size.refuse_too_many_processes(loaded.scenario)


@pytest.mark.parametrize("graph", ["erdos-renyi", "complete", "geometric"])
def test_a_network_far_beyond_memory_is_refused_at_once(graph):
    over = ["agents.count=900000000", f"network.graph={graph}", "steps=1000"]
    with pytest.raises(UserError, match=r"900000000 agents in 1000 steps take about .* TB of memory"):
        check(load("tracking", over).plan)


def test_of_many_agents_a_few_may_be_out_of_reach_and_of_few_none():
    apart = [[place, 0.0, 0.1 * place**2] for place in range(1200)] + [[1e6, 0.0, 0.0]]
    keys = ["agents.count=1201", f"agents.positions={apart}", "steps=3"]
    chain = [[place, place + 1] for place in range(1199)]
    scenario = load("tracking", [*keys, f"network.edges={chain}"])
    assert any("1 agent of 1201 cannot reach the others" in each for each in check(scenario.plan))
    with pytest.raises(UserError, match=r"falls apart: agents 1101 cannot reach agents 0, 1, .*, 7 and 1093 more"):
        check(load("tracking", [*keys, f"network.edges={chain[:1100]}"]).plan)
