"""recover, filter, merge, check and cat on logs, whole and damaged."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.examples import examples
from tests.log.hand_made import KEYS, START, Maker, written
from tests.log.tools.test_recover import rows
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.common.naming import RESOLVED, SOURCE, part_path
from zenoh_cbef.log.mcap.reader import McapFile
from zenoh_cbef.log.mcap.writer import McapWriter
from zenoh_cbef.log.read.parts import open_log, open_logs
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.log.tools.check import check
from zenoh_cbef.log.tools.filtering import filter_log
from zenoh_cbef.log.tools.merge import merge
from zenoh_cbef.log.tools.selection import select, time_of
from zenoh_cbef.log.tools.show import lines

PLAIN = st.none() | st.floats() | st.binary(max_size=9)


MAPS = st.recursive(PLAIN, lambda inner: st.dictionaries(st.integers(-5, 2**40) | st.text(), inner))


RANGE = {"v": 1, "run": "made", "from": "agent/1", "seq": 0, "sent": 1, "k": 1, "position": [0.0] * 3, "range": 0.5}


def test_topics_are_chosen_by_whole_regular_expressions(log: Path, tmp_path: Path) -> None:
    kept, left = tmp_path / "kept.mcap", tmp_path / "left.mcap"
    count = filter_log(open_log(log), kept, select([".*/estimate", "cbef/made/event/.*"], []))
    filter_log(open_log(log), left, select([], [".*/estimate", "estimate", "made/.*"]))
    assert count == 150
    assert {row[0] for row in rows(kept)} == {KEYS.estimate(agent) for agent in range(3)}
    assert sorted(rows(kept) + rows(left)) == sorted(rows(log))
    assert McapFile(kept).attachments.keys() == {SOURCE, RESOLVED}
    assert McapFile(kept).metadata == McapFile(log).metadata
    bare = tmp_path / "bare.mcap"
    filter_log(open_log(log), bare, select([], []), attachments=False, metadata=False)
    assert (McapFile(bare).attachments, McapFile(bare).metadata) == ({}, {})


def test_times_are_taken_from_start_up_to_but_not_including_end(log: Path, tmp_path: Path) -> None:
    part = tmp_path / "part.mcap"
    times = sorted(row[3] for row in rows(log))
    filter_log(open_log(log), part, select([], [], times[10], times[20]))
    assert sorted(row[3] for row in rows(part)) == times[10:20]


@pytest.mark.parametrize(
    ("text", "nanoseconds"),
    [
        ("17", 17),
        ("1.5s", START + 1_500_000_000),
        ("2023-11-14T22:13:20Z", START),
        ("2023-11-14T23:13:20.000001+01:00", START + 1000),
        ("2023-11-14T22:13:20", START),
    ],
)
def test_times_are_understood_as_nanoseconds_dates_and_seconds_since_the_start(text: str, nanoseconds: int) -> None:
    assert time_of(text, lambda: START, "--start") == nanoseconds


@pytest.mark.parametrize("arguments", [(["a"], ["b"]), (["("], []), ([], [], 5, 5)])
def test_impossible_selections_are_refused(arguments: Any) -> None:
    with pytest.raises(UserError):
        select(*arguments)
    with pytest.raises(UserError, match="is no time"):
        time_of("yesterday", lambda: 0, "--start")


def test_messages_are_shown_as_json_with_their_numbers(log: Path) -> None:
    shown = [json.loads(line) for line in lines(open_log(log), select([".*/2/(estimate|round)"], []))]
    assert len(shown) == 100
    estimate = next(line for line in shown if line["topic"].endswith("estimate"))
    assert estimate["data"]["state"] == [0.5] * 6
    assert estimate["data"]["covariance"][:8] == [1, 0, 0, 0, 0, 0, 0, 1]
    assert estimate["publish_time"] == estimate["data"]["sent"]
    assert [line["log_time"] for line in shown] == sorted(line["log_time"] for line in shown)


@examples(25)
@given(st.binary(max_size=30) | MAPS.map(msgpack.packb))
def test_any_message_is_shown_and_none_is_taken_for_another(data: bytes) -> None:
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "log.mcap"
        with McapWriter(path, library="test") as writer:
            writer.add_message(writer.register_channel("key", "", 0), 1, 2, 3, data)
        (line,) = (json.loads(line) for line in lines(open_log(path), select([], [])))
        assert (line["topic"], line["log_time"], line["publish_time"], line["sequence"]) == ("key", 1, 2, 3)
        assert line["data"] is not None or line["error"]


def two_hosts(folder: Path, ahead: int) -> tuple[Path, Path]:
    """Two recorders of one run: a hears all, but loses some; b, whose clock is ahead, hears another part."""
    first, second = folder / "a.mcap", folder / "b.mcap"
    for path, host in ((first, "a"), (second, "b")):
        maker = Maker(path, ahead=ahead if host == "b" else 0, host=host)
        # The target is on host a, the agents are on b: between the hosts messages take 2 ms.
        far = ["agent/0", "agent/1", "agent/2"] if host == "a" else ["target"]
        maker.way = dict.fromkeys(far, 2_000_000)
        for k in range(1, 41):
            maker.step(k, logged=k % 10 != 5 if host == "a" else k % 3 != 0 or k % 10 == 5)
        maker.close()
    return first, second


@pytest.mark.parametrize("ahead", [0, 5_000_000, -3_600_000_000_000])
def test_merged_logs_hold_every_message_once_in_order_and_tell_the_clocks(tmp_path: Path, ahead: int) -> None:
    first, second = two_hosts(tmp_path, ahead)
    output = tmp_path / "merged.mcap"
    found = merge([open_log(first), open_log(second)], output)
    merged = rows(output)
    datas = [row[-1] for row in merged]
    each = {row[-1] for path in (first, second) for row in rows(path)}
    assert len(datas) == len(set(datas)) == found.messages
    assert set(datas) == each
    assert found.duplicates == len(rows(first)) + len(rows(second)) - len(each)
    assert [row[3] for row in merged] == sorted(row[3] for row in merged)
    (clock,) = found.clocks
    assert clock.offset == pytest.approx(ahead, abs=2_000_000)
    assert clock.doubt == 2_000_000
    assert clock.shared == found.duplicates
    assert check(open_log(output)).exit_status == 0
    assert read_trace(output).traffic.missing == 0
    assert McapFile(output).metadata["cbef.run"]["host"] == "a, b"


def test_a_sender_that_was_started_again_is_no_duplicate(tmp_path: Path) -> None:
    path, output = tmp_path / "a.mcap", tmp_path / "merged.mcap"
    maker = Maker(path)
    for life in range(2):
        maker.seq.clear()
        for k in range(1, 11):
            maker.step(10 * life + k)
    maker.close()
    found = merge([open_log(path), open_log(path)], output)
    assert (found.messages, found.duplicates) == (len(rows(path)), len(rows(path)))
    assert rows(output) == rows(path)
    trace = read_trace(output)
    assert (trace.traffic.sent, trace.traffic.missing, trace.traffic.gaps) == (found.messages, 0, {})
    assert check(open_log(output)).exit_status == 0


def test_logs_of_different_runs_are_not_merged(log: Path, tmp_path: Path) -> None:
    maker = Maker(tmp_path / "other.mcap", run="other")
    maker.close()
    with pytest.raises(UserError, match="another run"):
        merge([open_log(log), open_log(tmp_path / "other.mcap")], tmp_path / "merged.mcap")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["other.mcap"]


def test_a_sound_log_passes_the_check(log: Path) -> None:
    found = check(open_log(log))
    assert (found.exit_status, found.messages, found.damage, found.missing) == (0, 650, [], {})


def test_missing_numbers_are_named_by_key_and_sender(tmp_path: Path) -> None:
    maker = Maker(tmp_path / "run.mcap")
    for k in range(1, 21):
        maker.step(k, logged=k not in (5, 6, 12))
    maker.close()
    found = check(open_log(tmp_path / "run.mcap"))
    assert found.exit_status == 1
    key = KEYS.estimate(1)
    assert found.gaps[f"{key} from agent/1"] == [(4, 5), (11, 11)]
    assert set(found.missing.values()) == {3}
    traffic = read_trace(tmp_path / "run.mcap").traffic
    assert traffic.gaps[key] == [(4, 5), (11, 11)]
    assert traffic.missing == 3 * 13


@pytest.mark.parametrize(
    "data",
    [
        b"\xc1",
        msgpack.packb({"v": 1}),
        msgpack.packb(RANGE | {"run": "other"}),
        msgpack.packb(RANGE | {"position": [0.0] * 2}),
    ],
)
def test_a_message_that_is_not_what_its_key_promises_is_found(tmp_path: Path, data: bytes) -> None:
    maker = Maker(tmp_path / "run.mcap")
    maker.step(1)
    maker.log.add(KEYS.range(1), data, maker.now)
    maker.close()
    found = check(open_log(tmp_path / "run.mcap"))
    assert found.exit_status == 1
    assert sum(found.wrong.values()) == 1
    assert next(iter(found.wrong)).startswith(KEYS.range(1))


def test_a_record_with_another_number_than_its_message_is_found(log: Path, tmp_path: Path) -> None:
    bent = tmp_path / "bent.mcap"
    with McapWriter(bent, library="test") as writer:
        for name, data in McapFile(log).attachments.items():
            writer.add_attachment(name, "", data)
        for name, said in McapFile(log).metadata.items():
            writer.add_metadata(name, said)
        for n, message in enumerate(McapFile(log).messages()):
            schema = writer.register_schema(message.channel.schema_name, "jsonschema", message.channel.schema_data)
            channel = writer.register_channel(message.channel.topic, "msgpack", schema)
            late = message.publish_time + (n == 30)
            writer.add_message(channel, message.log_time, late, message.sequence + (n == 40), message.data)
    found = check(open_log(bent))
    assert sum(count for sentence, count in found.wrong.items() if "another number or time" in sentence) == 2


@pytest.mark.slow
def test_a_rotated_log_is_read_as_one_and_each_part_by_itself(tmp_path: Path) -> None:
    written(tmp_path / "run.mcap", 50, "record.rotate_bytes=6000", "record.chunk_bytes=1024")
    count = len(list(tmp_path.glob("*.mcap")))
    assert count > 4
    parts = [part_path(tmp_path / "run.mcap", number) for number in range(1, count + 1)]
    for path in parts:
        assert McapFile(path).attachments.keys() == {SOURCE, RESOLVED}
        assert McapFile(path).damage == []
    whole = read_trace(tmp_path)
    assert (whole.complete, len(whole.time), whole.traffic.missing) == (True, 50, 0)
    assert whole.traffic.recorded == 650
    assert read_trace(*reversed(parts)).traffic.missing == 0
    assert len(list(open_log(tmp_path / "run.mcap").messages())) == 650
    assert len(list(open_log(parts[2]).messages())) == len(rows(parts[2])) < 650
    assert check(open_logs([tmp_path])).exit_status == 0
    (tmp_path / "run.3.mcap").unlink()
    assert read_trace(tmp_path / "run.mcap").complete is False


def test_another_recording_beside_a_log_is_no_part_of_it(tmp_path: Path) -> None:
    (tmp_path / "made").mkdir()
    for name in ("run.mcap", "run.2.mcap"):
        maker = Maker(tmp_path / "made" / name)
        maker.step(1)
        maker.close()
        (tmp_path / "made" / name).rename(tmp_path / name)
    assert len(open_log(tmp_path).files) == 1
