"""What a process left in its ring is written at once as message by message, and is read where its frames lie."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from zenoh_cbef.log.mcap.reader import McapFile
from zenoh_cbef.log.mcap.writer import McapWriter
from zenoh_cbef.log.write.run_log import RunLog
from zenoh_cbef.protocol.messages import encode
from zenoh_cbef.protocol.ring import Said
from zenoh_cbef.protocol.short import ShortCodec
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.model import Record

KEYS = ["cbef/test/agent/3/range", "cbef/test/agent/3/round", "cbef/test/agent/3/estimate"]
SETTINGS = Record()
Logged = tuple[str, str, int, tuple[int, int, bytes]]
"""Key, encoding and number of a message, its times and its bytes."""
NOW = 1_700_000_000_000_000_000
COMPACT = load("tracking", ["consensus.precision='int16'"]).plan.compact
assert COMPACT is not None
CODEC = ShortCodec(COMPACT)
ONES = np.ones(COMPACT.width)


def said(kind: int, number: int, sender: str = "agent/3", *, short: bool = False) -> Said:
    sent = NOW + 1000 * number
    if short:
        return kind, number, sent, CODEC.encode(number, sent, 1, 1, ONES)
    return kind, number, sent, encode("test", sender, number, sent, {"k": number})


def logged(
    path: Path, *batches: list[Said], whole: bool = True, settings: Record = SETTINGS
) -> tuple[RunLog, list[Logged]]:
    """The log of some batches, each written whole or message by message, and what is in its files."""
    log = RunLog(path, settings)
    log.describe(source="", resolved="", run={})
    for time, batch in enumerate(batches, NOW):
        if whole:
            log.add_all(KEYS, batch, time)
        else:
            for kind, _, _, data in batch:
                log.add(KEYS[kind], data, time)
    log.close({})
    return log, [
        (message.channel.topic, message.channel.message_encoding, message.sequence, (*message[1:3], message.data))
        for file in sorted(path.parent.glob(f"{path.stem}*.mcap"))
        for message in McapFile(file).messages()
    ]


TURNS = [said(0, 0), said(1, 0), said(1, 1), said(2, 0), said(0, 1), said(1, 2)]
LYING = [
    ("another number", (1, 9, said(1, 3)[2], said(1, 3)[3])),
    ("another time", (1, 3, 5, said(1, 3)[3])),
    ("another sender", said(1, 3, "agent/4")),
    ("no message", (1, 3, 5, b"\xc1")),
]


@pytest.mark.parametrize("short", [False, True], ids=["whole", "short"])
def test_a_batch_is_written_as_its_messages_one_by_one(tmp_path: Path, *, short: bool) -> None:
    later = [said(1, number, short=short) for number in (3, 4, 7)]
    ours = [one for one in TURNS if one[0] != 1 or not short]
    whole, found = logged(tmp_path / "a.mcap", ours, later)
    single, expected = logged(tmp_path / "b.mcap", ours, later, whole=False)
    assert found == expected
    assert len(found) == len(ours) + 3
    assert (whole.missing, whole.gaps()) == (single.missing, single.gaps())
    assert whole.missing == (5 if short else 2)


@pytest.mark.parametrize(("what", "one"), LYING, ids=[what for what, _ in LYING])
def test_a_batch_whose_frames_are_not_what_its_messages_say_is_read(tmp_path: Path, what: str, one: Said) -> None:
    whole, found = logged(tmp_path / "a.mcap", [said(0, 0), one, said(1, 4)])
    single, expected = logged(tmp_path / "b.mcap", [said(0, 0), one, said(1, 4)], whole=False)
    assert found == expected, what
    assert len(found) == 3
    assert (whole.missing, whole.foreign) == (single.missing, single.foreign)


def test_a_batch_goes_on_in_the_next_file_and_the_next_chunk(tmp_path: Path) -> None:
    batches = [[said(1, number) for number in range(begin, begin + 50)] for begin in range(0, 500, 50)]
    log, found = logged(tmp_path / "a.mcap", *batches, settings=Record(rotate_bytes=2000, chunk_bytes=1024))
    assert len([*tmp_path.glob("*.mcap")]) > 3
    assert sorted(one[2] for one in found) == [*range(500)]
    assert (log.count, log.missing) == (500, 0)


def test_what_a_full_disk_does_not_take_of_a_batch_is_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = RunLog(tmp_path / "a.mcap", Record(chunk_bytes=1024))
    log.describe(source="", resolved="", run={})

    def refuse(_: McapWriter, data: bytes) -> None:
        raise OSError(28, "No space left on device", data[:0])

    with monkeypatch.context() as context:
        context.setattr(McapWriter, "_write", refuse)
        log.add_all(KEYS, [said(1, number) for number in range(100)], NOW)
    assert "No space" in log.failure
    assert 0 < log.dropped < 100
    log.add_all(KEYS, [said(1, number) for number in range(100, 200)], NOW)
    log.close({})
    assert log.count + log.dropped == 200
    assert log.count == len([*McapFile(tmp_path / "a.mcap").messages()])
