"""Logs of before events and signals had keys of their own are read, checked, verified and analysed as ever."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgpack
import pytest

from tests.log.made import made_log
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.log.common.naming import RESOLVED, SOURCE
from zenoh_cbef.log.prove.verify import verify
from zenoh_cbef.log.read.exchange import read_exchange
from zenoh_cbef.log.read.measurements import read_measurements
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.log.tools.check import check
from zenoh_cbef.log.write.run_log import RunLog
from zenoh_cbef.protocol.keys import Keys, address
from zenoh_cbef.scenario.model import Record
from zenoh_cbef.viewers.scene import read_scene


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The log of a run in which an agent is killed and comes back, as it is written now and as it was."""
    folder = tmp_path_factory.mktemp("layout")
    crash = 'fault=[{kind="crash", agents=[2], from=1.0, until=2.0}]'
    new = made_log(folder / "new.mcap", "steps=40", "agents.count=4", "network.graph=ring", crash)
    return new, as_it_was(new, folder / "old.mcap")


def as_it_was(new: Path, path: Path) -> Path:
    """A log with one key for all events, and signals among the beacons."""
    log, old, keys = open_log(new), RunLog(path, Record()), Keys("made")
    texts = {name: log.attachments[name].decode() for name in (SOURCE, RESOLVED)}
    old.describe(source=texts[SOURCE], resolved=texts[RESOLVED], run=log.metadata["cbef.run"])
    sent: dict[tuple[str, str], int] = {}
    for raw in log.messages():
        at, key, message = address(raw.channel.topic), raw.channel.topic, msgpack.unpackb(raw.data)
        assert at is not None
        if at.kind == "event":
            key = f"{keys.root}/event"
            told: dict[str, Any] = message.get("data", {}).get("sent", {})
            for signals in [one for one in told if one.endswith("/signal")]:
                told[signals.removesuffix("/signal")] += told.pop(signals)
        elif at.kind == "signal":
            key = keys.beacon(at.agent)
            message |= {"emitted": None, "arrived": None}
        if at.kind in {"event", "signal", "beacon"}:
            message["seq"] = sent.get((key, message["from"]), 0)
            sent[key, message["from"]] = message["seq"] + 1
        old.add(key, msgpack.packb(message) if at.kind != "round" else raw.data, raw.log_time)
    old.close({"status": "finished"})
    return path


def test_both_layouts_are_sound_and_proved(logs: tuple[Path, Path]) -> None:
    topics = [{message.channel.topic for message in open_log(log).messages()} for log in logs]
    assert "cbef/made/event" in topics[1]
    assert not {"cbef/made/event"} & topics[0]
    for log in logs:
        found = check(open_log(log))
        assert (found.exit_status, found.wrong, found.missing) == (0, {}, {})
        assert verify(log).result == "equal"


def test_both_layouts_say_the_same(logs: tuple[Path, Path]) -> None:
    new, old = (analyze([read_trace(log)])[0].metrics for log in logs)
    assert new == old
    scenes, pictures = [read_scene(log) for log in logs], [read_exchange(log, steps=(9, 22)) for log in logs]
    assert scenes[0].events == scenes[1].events
    assert (scenes[0].time == scenes[1].time).all()
    assert pictures[0] == pictures[1]
    measured = [read_measurements(log) for log in logs]
    assert measured[0].start == measured[1].start is not None
    assert (measured[0].logged, measured[0].steps) == (measured[1].logged, measured[1].steps)


def test_what_a_log_says_of_anothers_messages_does_not_count(logs: tuple[Path, Path], tmp_path: Path) -> None:
    log, copy = open_log(logs[0]), RunLog(tmp_path / "forged.mcap", Record())
    texts = {name: log.attachments[name].decode() for name in (SOURCE, RESOLVED)}
    copy.describe(source=texts[SOURCE], resolved=texts[RESOLVED], run=log.metadata["cbef.run"])
    for raw in log.messages():
        copy.add(raw.channel.topic, raw.data, raw.log_time)
    keys = Keys("made")
    sent = {keys.round(1): 10**15, keys.beacon(1): 10**15, keys.round(3): 10**15}
    for number, sender in ((5_000_000, "agent/3"), (5_000_000, "agent/1")):
        body = {"kind": "finished", "text": "forged", "data": {"sent": sent}}
        envelope = {"v": 1, "run": "made", "from": sender, "seq": number, "sent": raw.log_time}
        copy.add(keys.event("agent/3"), msgpack.packb(envelope | body), raw.log_time)
    assert copy.missing == 0
    copy.close({"status": "finished"})
    found = check(open_log(copy.path))
    assert found.missing == {}
    assert any("5000000" in sentence and "out of all proportion" in sentence for sentence in found.wrong)
    assert any("not agent/3" in sentence for sentence in found.wrong)
    assert analyze([read_trace(copy.path)])[0].metrics.messages.missing == 0
