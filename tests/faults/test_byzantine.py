"""What misbehaving agents send is the same, whichever process computes it."""

from __future__ import annotations

import numpy as np
import pytest

from tests.unaided import ratios_to_centralised
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.analysis.summary import pick
from zenoh_cbef.errors import UserError
from zenoh_cbef.faults import Byzantine, Outgoing
from zenoh_cbef.scenario import build
from zenoh_cbef.scenario.load import load, parse
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.moderation import LARGEST_SENT
from zenoh_cbef.tracking.trimmed import TrimmedComponents

AGENTS = np.array([0, 1, 2, 3])


def byzantine(**keys):
    return Byzantine.model_validate({"kind": "byzantine", "agents": [1, 3], **keys})


def outgoing(*faults, agent=AGENTS, seed=7):
    seeds = np.full(len(agent), seed, dtype=np.uint64)
    return Outgoing(faults, seed=seeds, agent=agent, dt=0.1, displaced=lambda message, offset: message + offset)


def message(step, round_):
    return np.arange(12.0).reshape(4, 3) + 100.0 * step + 10.0 * round_


def run(senders, steps=8, rounds=2, rows=slice(None)):
    return np.array(
        [[senders.message(k, r, message(k, r)[rows]) for r in range(1, rounds + 1)] for k in range(1, steps + 1)]
    )


HONEST = run(outgoing())


@np.errstate(over="ignore")  # as agents and the simulator do
def test_what_is_sent_stays_below_what_receivers_take_for_a_lie_of_no_agent():
    # A payload that grows from round to round, as the lies of several agents echo, never gets farther.
    wild = outgoing(byzantine(mode="scale", magnitude=1e7)).message(1, 1, np.full((4, 3), 1e58))
    assert (np.abs(wild) <= LARGEST_SENT).all()
    assert wild[0, 0] == 1e58
    assert (outgoing().message(1, 1, np.full((4, 3), -1e300)) == -LARGEST_SENT).all()


FAULTS = [
    byzantine(mode="constant", magnitude=2.0),
    byzantine(mode="drift", magnitude=3.0, **{"from": 0.3}),
    byzantine(mode="random", magnitude=4.0),
    byzantine(mode="scale", magnitude=-2.0),
    byzantine(mode="replay", steps=3),
]


def test_only_the_named_agents_lie():
    for fault in FAULTS:
        wrong = run(outgoing(fault))
        np.testing.assert_array_equal(wrong[:, :, [0, 2]], HONEST[:, :, [0, 2]])
        assert (wrong[-1][:, [1, 3]] != HONEST[-1][:, [1, 3]]).all()


def test_constant_drift_and_scale_are_what_they_say():
    constant, drift, _, scale, _ = (run(outgoing(fault))[:, :, [1, 3]] - HONEST[:, :, [1, 3]] for fault in FAULTS)
    np.testing.assert_allclose(constant, 2.0)
    for step in range(1, 9):
        np.testing.assert_allclose(drift[step - 1], 3.0 * max(0.0, 0.1 * step - 0.3), atol=1e-12)
    np.testing.assert_allclose(scale, -3.0 * HONEST[:, :, [1, 3]])


def test_random_lies_are_normal_and_differ_from_message_to_message():
    many = np.arange(5000)
    fault = Byzantine.model_validate({"kind": "byzantine", "agents": many.tolist(), "mode": "random", "magnitude": 4.0})
    senders, honest = outgoing(fault, agent=many), np.zeros((5000, 3))
    first, again, other = (senders.message(*at, honest) for at in ((1, 1), (1, 1), (1, 2)))
    np.testing.assert_array_equal(first, again)
    assert abs(first.mean()) < 5 * 4.0 / np.sqrt(first.size)
    assert first.std() == pytest.approx(4.0, rel=0.05)
    for one, two in ((first, other), (first[:, :1], first[:, 1:2])):
        assert abs(np.corrcoef(one.ravel(), two.ravel())[0, 1]) < 0.07


@pytest.mark.parametrize("ago", [1, 3])
def test_a_replay_sends_the_honest_message_of_the_same_round_some_steps_ago(ago):
    wrong = run(outgoing(byzantine(mode="replay", steps=ago)))
    for step in range(1, 9):
        np.testing.assert_array_equal(wrong[step - 1][:, [1, 3]], HONEST[max(1, step - ago) - 1][:, [1, 3]])


def test_lies_begin_and_end_in_time():
    fault = byzantine(**{"from": 0.3, "until": 0.6})
    wrong = (run(outgoing(fault)) != HONEST).any(axis=(1, 2, 3))
    assert np.flatnonzero(wrong).tolist() == [2, 3, 4]  # steps 3 to 5


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.mode)
def test_an_agent_alone_sends_what_it_sends_in_a_batch(fault):
    together = run(outgoing(fault, byzantine(mode="random")))
    for agent in range(4):
        alone = run(outgoing(fault, byzantine(mode="random"), agent=AGENTS[[agent]]), rows=slice(agent, agent + 1))
        np.testing.assert_array_equal(alone[:, :, 0], together[:, :, agent])


def test_a_false_range_is_longer_by_the_displacement_and_what_was_not_measured_stays_so():
    told = outgoing(byzantine(magnitude=2.0)).ranges(1, np.array([5.0, 5.0, np.nan, np.nan]))
    np.testing.assert_allclose(told, [5.0, 5.0 + 2.0 * np.sqrt(3.0), np.nan, np.nan])


def test_averages_leave_liars_out():
    fault = {"kind": "byzantine", "agents": [2]}
    [analysis] = analyze(simulate([parse({"steps": 20, "fault": [fault]}, "test")]))
    honest = [0, 1, 3, 4, 5]
    assert analysis.metrics.left_out == [2]
    window = analysis.position_error[honest][:, analysis.first :]
    assert analysis.metrics.position_rmse == pytest.approx(np.sqrt((window**2).mean()))
    assert pick(analysis.metrics, "nees.average") == pytest.approx(analysis.nees[honest][:, analysis.first :].mean())
    positions = analysis.trace.estimates[honest][:, :, :3]
    apart = ((positions - positions.mean(axis=0)) ** 2).sum(axis=2).mean(axis=0)
    np.testing.assert_allclose(analysis.disagreement, np.sqrt(apart))


@pytest.mark.slow
def test_trimming_holds_off_one_liar_of_ten_where_plain_averaging_is_lost():
    keys = ["agents.count=10", "network.probability=0.8", "steps=150", 'fault=[{kind="byzantine", agents=[3]}]']
    plain, trimmed = (
        ratios_to_centralised(
            simulate([load("tracking", [*keys, "consensus.isolate=false", f"consensus.trim={trim}"]).scenario])
        )[0]
        for trim in (0, 1)
    )
    assert plain > 20
    assert trimmed < 1.3


def test_components_of_information_must_not_be_trimmed_apart(monkeypatch):
    keys = ["agents.count=10", "network.probability=0.8", "consensus.trim=1", "steps=150"]
    monkeypatch.setattr(build, "TrimmedMessages", lambda weights, trim, *_, **__: TrimmedComponents(weights, trim))
    [ratio] = ratios_to_centralised(simulate([load("tracking", keys).scenario]))
    assert ratio > 10


def test_trimming_is_not_combined_with_what_weighs_agents_negatively():
    for other in ({"acceleration": "chebyshev"}, {"scheme": "running-sums"}):
        with pytest.raises(UserError, match=r"consensus\.trim = 1 needs plain averaging"):
            parse({"consensus": {"trim": 1, **other}}, "test")
