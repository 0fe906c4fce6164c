"""What each kind of message fault does to the messages of its links, and to no other."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import TypeAdapter

from zenoh_cbef.faults import AnyFault, Fates
from zenoh_cbef.streams import stream, uniform

ANY = TypeAdapter(AnyFault)
PAIRS = np.array([(source, destination) for source in range(6) for destination in range(6) if source != destination])


def fates(*faults, source=PAIRS[:, 0], destination=PAIRS[:, 1], rounds=4, **keys):
    return Fates(
        [ANY.validate_json(ANY.dump_json(ANY.validate_python(fault), by_alias=True)) for fault in faults],
        seed=np.full(len(source), 11, dtype=np.uint64),
        source=source,
        destination=destination,
        dt=0.1,
        rounds=rounds,
        **keys,
    )


def many(count=20_000):
    return {"source": np.arange(count), "destination": np.arange(count) + 1}


FLAGS = {"duplicate": "duplicated", "reorder": "late", "corrupt": "corrupted", "loss": "lost"}


@pytest.mark.parametrize("kind", FLAGS)
def test_a_kind_strikes_its_share_of_messages_and_does_nothing_else(kind):
    fate = fates({"kind": kind, "probability": 0.3}, **many()).of(4, 2)
    share = getattr(fate, FLAGS[kind])
    assert abs(share.mean() - 0.3) < 6 * np.sqrt(0.21 / 20_000)
    for other in {*FLAGS.values()} - {FLAGS[kind]}:
        assert not getattr(fate, other).any()
    assert fate.due.tolist() == (~share | (kind == "duplicate")).tolist()
    assert not fate.delay.any()


def test_kinds_strike_independently_and_the_worst_of_them_counts():
    faults = [{"kind": kind, "probability": 0.5} for kind in FLAGS]
    alone = {
        kind: getattr(fates(fault, **many()).of(1, 1), FLAGS[kind]) for kind, fault in zip(FLAGS, faults, strict=True)
    }
    # Each is the same draw at any place in the list only if the list is the same: streams hold the place.
    together = fates(*faults, **many()).of(1, 1)
    shares = [getattr(together, FLAGS[kind]).mean() for kind in ("loss", "reorder", "corrupt", "duplicate")]
    np.testing.assert_allclose(shares, [0.5, 0.25, 0.125, 0.0625], atol=0.02)
    assert not (together.lost & together.late).any()
    assert not (together.corrupted & (together.lost | together.late)).any()
    assert not (together.duplicated & ~together.due).any()
    assert (alone["duplicate"] == fates(faults[0], **many()).of(1, 1).duplicated).all()


@pytest.mark.parametrize("rate", [0.0, 1.0, 7.3, 25.0, 49.9, 50.0, 80.0])
@pytest.mark.parametrize("ranges", [False, True])
def test_a_limited_link_carries_its_rate_evenly(rate, ranges):
    first = 0 if ranges else 1
    faulty = fates({"kind": "rate-limit", "messages_per_second": rate}, ranges=ranges)
    passed = np.array([faulty.of(step, round_).due for step in range(1, 81) for round_ in range(first, 5)])
    per_second = 10 * passed.shape[0] / 80
    expected = min(rate, per_second) * 8.0
    assert (np.abs(passed.sum(axis=0) - expected) <= 1.0).all()
    # In any part of the run, too: never more than one message from the even share.
    for begin, end in ((3, 17), (40, 200), (100, 101)):
        share = min(rate / per_second, 1.0) * (end - begin)
        assert (np.abs(passed[begin:end].sum(axis=0) - share) <= 1.0 + 1e-9).all()


def test_where_in_its_interval_the_first_token_comes_is_the_first_draw_of_the_links_stream():
    phase = uniform(stream(11, "rate-limit/0", PAIRS[:, 0], PAIRS[:, 1]), 0)
    faulty = fates({"kind": "rate-limit", "messages_per_second": 20.0}, ranges=False)
    # Four messages in 0.1 s: with each comes half a token.
    passed = np.array([faulty.of(1, round_).due for round_ in range(1, 5)])
    tokens = np.floor(phase + 0.5 * np.arange(5)[:, None])
    np.testing.assert_array_equal(passed, np.diff(tokens, axis=0) > 0)


def test_a_partition_cuts_groups_apart_both_ways_and_heals():
    groups = [{0, 1, 2}, {3, 4}]
    fault = {"kind": "partition", "links": {"between": [[0, 1, 2], [3, 4]]}, "from": 1.0, "until": 2.0}
    cut = fates(fault)
    for step in (5, 10, 19, 20):
        lost = cut.of(step, 1).lost
        for place, (source, destination) in enumerate(PAIRS.tolist()):
            sides = [[agent in group for group in groups] for agent in (source, destination)]
            apart = any(sides[0]) and any(sides[1]) and sides[0] != sides[1]
            assert lost[place] == (apart and 10 <= step < 20), (step, source, destination)


def test_three_groups_are_all_cut_from_each_other():
    lost = fates({"kind": "partition", "links": {"between": [[0, 1], [2, 3], [4, 5]]}}).of(1, 1).lost
    assert lost.tolist() == (PAIRS[:, 0] // 2 != PAIRS[:, 1] // 2).tolist()


def test_between_serves_any_kind():
    slow = fates({"kind": "delay", "milliseconds": 5.0, "links": {"between": [[0], [1, 2]]}}).of(1, 1)
    assert [tuple(pair) for pair in PAIRS[slow.late].tolist()] == [(0, 1), (0, 2), (1, 0), (2, 0)]


def test_an_agent_that_is_out_is_silent_and_deaf():
    lost = fates({"kind": "outage", "agents": [2, 5], "from": 0.3}).of(3, 1).lost
    assert lost.tolist() == (np.isin(PAIRS, [2, 5]).any(axis=1)).tolist()
    assert not fates({"kind": "outage", "agents": [2], "from": 0.31}).of(3, 1).lost.any()


def test_faults_of_sensors_do_not_touch_messages():
    assert fates({"kind": "sensor-stuck"}, {"kind": "clock", "offset": 1.0}).quiet


def test_in_realtime_a_delay_is_left_to_the_clock_but_an_overtaken_message_is_late():
    faults = {"kind": "delay", "milliseconds": 5.0}, {"kind": "reorder", "probability": 0.5}
    exact, real = fates(*faults).of(1, 1), fates(*faults, realtime=True).of(1, 1)
    assert exact.late.all()
    assert 0 < real.late.sum() < len(PAIRS)
    np.testing.assert_array_equal(real.delay, np.full(len(PAIRS), 0.005))
