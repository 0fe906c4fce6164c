"""A receiver that stays wrong is weighed down by its own agent, and trusted again; a wrong estimate is not."""

from __future__ import annotations

import re
from dataclasses import replace
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from tests.tracking.resting import AGENTS, MOTION, PLACES, STD, measured
from tests.unaided import errors
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.analysis.report import write_report
from zenoh_cbef.cli.terminal.results import metrics_table
from zenoh_cbef.errors import UserError
from zenoh_cbef.scenario.load import load, parse
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.filters import Belief
from zenoh_cbef.tracking.filters.around.distrusting import REPEATS, Distrusting
from zenoh_cbef.tracking.filters.kinds.sicf import SaturatedInformation
from zenoh_cbef.tracking.ranging import Measurement, Space

PLAIN = SaturatedInformation(MOTION, Space(), STD, AGENTS, 1.5)
BEGIN = Belief(np.zeros((AGENTS, 6)), np.tile(0.25 * np.eye(6), (AGENTS, 1, 1)))


def updates(errors, *, hear=True, silence=0):
    """Updates of a network whose ranges are off by errors (K, n), and the belief that each begins with."""
    filter_, belief = Distrusting(PLAIN, STD, silence=silence), BEGIN
    for seed, row in enumerate(errors):
        update = filter_.update(belief, measured(row, seed))
        yield belief, measured(row, seed), update
        mixed = np.tile(update.payload.mean(axis=0), (AGENTS, 1)) if hear else update.payload
        belief = filter_.conclude(mixed, update)


def errors_of(agent, size, steps=40, until=20):
    errors = np.zeros((steps, AGENTS))
    errors[5:until, agent] = size
    return errors


@pytest.mark.parametrize("silence", [0, 1])
def test_every_step_is_what_the_equations_say_of_each_agent(silence):
    errors = errors_of(2, 3.0)
    errors[12:14, 2] = np.nan
    means, average, seen, missing = [1.0] * AGENTS, 1.0, set(), [0] * AGENTS
    for belief, measurement, update in updates(errors, silence=silence):
        for agent in range(AGENTS):
            way = min(max((means[agent] - max(average, 1.0) - 3.0) / 2.0, 0.0), 1.0)
            distrust = 3.0 * way**2 - 2.0 * way**3
            assert update.diagnostics.distrust[agent] == pytest.approx(distrust, abs=1e-9)
            seen.add(round(distrust))
            # The filter itself, told of this noise, sends the same information.
            each = ("position", "range", "age", "neighbour_position", "neighbour_range")
            own = {name: getattr(measurement, name)[[agent]] for name in each}
            told = Measurement(
                **own,
                range_std=np.array(
                    [(1.0 + 29.0 * update.diagnostics.distrust[agent] * update.diagnostics.distrust[agent]) * STD]
                ),
            )
            alone = PLAIN.update(Belief(belief.state[[agent]], belief.covariance[[agent]]), told)
            np.testing.assert_array_equal(update.payload[agent, :-1], alone.payload[0])
            state = MOTION.transition @ belief.state[agent]
            covariance = MOTION.transition @ belief.covariance[agent] @ MOTION.transition.T + MOTION.process_noise
            offset = state[:3] - PLACES[agent]
            distance = np.sqrt(offset @ offset)
            row = np.append(offset / distance, np.zeros(3))
            nis = (measurement.range[agent] - distance) ** 2 / (row @ covariance @ row + STD**2)
            before = means[agent]
            missing[agent] = 0 if np.isfinite(nis) else missing[agent] + 1
            if np.isfinite(nis):
                means[agent] += (min(nis, 9.0) - means[agent]) / 5.0
            elif silence and missing[agent] > silence:
                means[agent] += (average - means[agent]) / 5.0
            assert update.payload[agent, -1] == pytest.approx(means[agent] + 0.9 * (average - before), rel=1e-6)
        # All hear all, so the network's average is exact, and stays so.
        average = sum(means) / AGENTS
    assert seen == {0, 1}


@pytest.mark.parametrize("silence", [0, 1])
def test_few_agents_that_hear_a_target_which_turns_stand_out_among_those_that_do_not(silence):
    errors = np.zeros((20, AGENTS))
    errors[:, 2:] = np.nan
    errors[5:, :2] = 3.0
    distrust = np.array([update.diagnostics.distrust for _, _, update in updates(errors, silence=silence)])
    assert (distrust[:, 2:] == 0.0).all()
    assert (distrust[:, :2] < 0.1).all() if silence else (distrust[-1, :2] > 0.9).all()


def test_a_wrong_receiver_is_distrusted_within_ten_steps_alone_and_trusted_again_within_ten():
    distrust = np.array([update.diagnostics.distrust for _, _, update in updates(errors_of(2, 3.0))])
    assert (distrust[15:20, 2] == 1.0).all()
    assert (distrust[30:, 2] == 0.0).all()
    assert (np.delete(distrust, 2, axis=1) == 0.0).all()


@pytest.mark.parametrize("hear", [True, False])
def test_no_agent_distrusts_where_all_are_surprised_or_no_neighbour_is_heard(hear):
    errors = np.tile(np.where(np.arange(AGENTS) % 2, 8.0, -8.0), (10, 1)) if hear else errors_of(2, 3.0, 10)
    for _, _, update in updates(errors, hear=hear):
        np.testing.assert_array_equal(update.diagnostics.distrust, 0.0)


@pytest.mark.slow
def test_one_round_a_step_is_enough_to_stand_out():
    keys = ["steps=75", "consensus.rounds=1", 'fault=[{kind="sensor-bias", bias=2.0, agents=[3], from=3.0}]']
    scenario = load("tracking", keys).scenario
    distrust = np.array(
        [one.diagnostics.distrust for one in simulate([scenario.changed(seed=seed) for seed in range(1, 9)])]
    )
    flagged = np.median(distrust[:, :, 50:].mean(axis=2), axis=0)
    assert flagged[3] > 0.9
    assert np.delete(flagged, 3).max() == 0.0


@pytest.mark.slow
def test_the_network_is_better_off_and_says_who_was_wrong(tmp_path):
    fault = 'fault=[{kind="sensor-bias", bias=2.0, agents=[3], from=3.0, until=6.0}]'
    # A redescending weight leaves little of the error to distrust.
    scenario = load("tracking", [fault, "steps=62", "filter.saturation=bounded"]).scenario
    assert Plan(scenario).distrusts_own
    trusting = scenario.changed(filter={"distrust": False})
    traces, trusted = (simulate([one.changed(seed=seed) for seed in range(1, 9)]) for one in (scenario, trusting))
    runs, others = analyze(traces), errors(trusted)
    off, trusting_off = (np.median([run.position_error[:, 40:60].mean() for run in each]) for each in (runs, others))
    assert off < 0.5 * trusting_off
    write_report(runs[0], tmp_path / "report.html")
    text = StringIO()
    page = Console(width=200, file=text)
    page.print(metrics_table(runs[0].metrics))
    assert re.search(r"agents that distrust their ranges +│ +3: \d+%", text.getvalue())
    found = runs[0].metrics.distrust
    assert found is not None
    many = replace(found, agents=[0.0, *np.linspace(0.01, 0.2, 20)])
    page.print(metrics_table(replace(runs[0].metrics, distrust=many)))
    assert re.search(r"20: 20% of the steps, 19: 19%, .* and 12 more", text.getvalue())
    assert "steps of distrust (%)" in (tmp_path / "report.html").read_text()
    for run in runs:
        told = run.metrics.distrust
        assert told is not None
        agents, first, last = (np.array(each, dtype=float) for each in (told.agents, told.first, told.last))
        assert run is not runs[0] or f"<td>{100.0 * agents[3]:.4g}</td>" in (tmp_path / "report.html").read_text()
        assert agents[3] > 0.25
        assert max(np.delete(agents, 3)) == 0.0
        assert np.isnan(first[0])
        assert 3.0 < first[3] < 4.5
        assert 5.9 <= last[3] < 7.5
    assert analyze(trusted[:1])[0].metrics.distrust is None


def test_auto_is_for_receivers_with_faults_and_neighbours_that_are_trusted():
    stuck = {"kind": "sensor-stuck", "agents": [1]}
    liar = {"kind": "byzantine", "agents": [1], "mode": "random"}
    for keys, wanted in (
        ({"fault": [stuck]}, True),
        ({}, False),
        ({"fault": [{"kind": "loss", "probability": 0.1}]}, False),
        ({"fault": [stuck, liar]}, False),
        ({"fault": [stuck], "filter": {"kind": "kcf"}}, False),
        ({"fault": [stuck], "filter": {"kind": "ci", "measurement": "difference"}}, False),
        ({"filter": {"distrust": True}}, True),
        ({"fault": [stuck], "filter": {"distrust": False}}, False),
    ):
        assert Plan(parse(keys, "test")).distrusts_own is wanted


def test_without_a_fault_the_estimates_are_those_of_a_filter_that_always_trusts():
    [first], [second] = (
        simulate([load("tracking", ["steps=60", "filter.start=given", f"filter.distrust={value}"]).scenario])
        for value in ("true", "false")
    )
    assert np.isnan(second.diagnostics.distrust).all()
    np.testing.assert_array_equal(first.diagnostics.distrust, 0.0)
    np.testing.assert_allclose(first.estimates, second.estimates, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("keys", [{"kind": "kcf"}, {"kind": "ci", "measurement": "difference"}])
def test_distrust_is_for_filters_that_average_information_of_own_ranges(keys):
    with pytest.raises(UserError, match=r"filter\.distrust compares"):
        parse({"filter": {**keys, "distrust": True}}, "test")


def test_a_filter_that_predicts_no_variance_is_always_trusted():
    class Blind(SaturatedInformation):
        def update(self, belief, measurement):
            update = super().update(belief, measurement)
            return replace(update, diagnostics=replace(update.diagnostics, nis=np.full(len(update.payload), np.nan)))

    blind = Distrusting(Blind(MOTION, Space(), STD, AGENTS), STD)
    belief = BEGIN
    for step in range(1, 20):
        update = blind.update(belief, measured(np.where(np.arange(AGENTS) == 1, 9.0, 0.0), step))
        belief = blind.conclude(np.tile(update.payload.mean(axis=0), (AGENTS, 1)), update)
        np.testing.assert_array_equal(update.diagnostics.distrust, 0.0)


@pytest.mark.parametrize(("repeats", "steps"), [(True, REPEATS + 1), (False, 0)])
def test_a_range_that_is_repeated_to_the_last_bit_is_distrusted_until_it_changes(repeats, steps):
    filter_, belief, stuck = Distrusting(PLAIN, STD, repeats=repeats), BEGIN, measured(np.zeros(AGENTS), 0).range[1]
    for step in range(1, 12):
        now = measured(np.zeros(AGENTS), step)
        heard = now.range.copy()
        if step < 11:
            heard[1] = np.nan if step == 3 else stuck
        update = filter_.update(belief, replace(now, range=heard))
        # What is not heard is no repetition, and no end of it.
        again = repeats and steps < step < 11 and (step > REPEATS + 1)
        np.testing.assert_array_equal(update.diagnostics.distrust, np.where(np.arange(AGENTS) == 1, again, 0.0))
        belief = filter_.conclude(np.tile(update.payload.mean(axis=0), (AGENTS, 1)), update)


@pytest.mark.parametrize(("rules", "seconds"), [(11, 1.0), (12, 0.0)])
def test_a_stuck_receiver_does_not_lead_the_network_away(rules, seconds):
    fault = 'fault=[{kind="sensor-stuck",agents=[2],from=5.0}]'
    (trace,) = simulate([load("tracking", [fault, "steps=90", "seed=1019", f"filter.defaults={rules}"]).scenario])
    far = np.linalg.norm((trace.estimates - trace.truth)[:, :, :3], axis=2).max(axis=0) > 0.3
    assert far[20:].sum() * trace.scenario.dt >= seconds
    assert not (rules == 12 and far[20:].any())
