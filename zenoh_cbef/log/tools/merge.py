"""Several logs of one run, as recorders on different hosts wrote them, joined into one."""

from __future__ import annotations

import heapq
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from zenoh_cbef.errors import UserError
from zenoh_cbef.log.common.naming import END, RESOLVED, RUN
from zenoh_cbef.log.mcap.contents import RawMessage
from zenoh_cbef.log.mcap.writer import Compression
from zenoh_cbef.log.read.parts import Log
from zenoh_cbef.log.tools.output import OutputLog
from zenoh_cbef.protocol.keys import address
from zenoh_cbef.protocol.messages import BadMessage, unpack
from zenoh_cbef.protocol.short import ENCODING

_SAMPLES = 10_000
_MOST_AHEAD = 1 << 20


@dataclass(frozen=True)
class Clock:
    """How far the recorder's clock of a log is ahead of the first log's, as messages show that both recorded.

    offset, doubt: ns. A message takes longer to the other host than to its own. With messages from both sides, the
    offset is the middle of two bounds, and uncertain by half their distance; with one side it contains the time that
    messages travel. None where the logs share no message.
    """

    log: Path
    host: str
    shared: int
    offset: int | None
    doubt: int | None


@dataclass(frozen=True)
class Merged:
    """What was written, what was left out because it was there already, and the clocks of the other logs."""

    messages: int
    duplicates: int
    clocks: list[Clock]


class _Seen:
    """The messages met so far, by key, sender, number and sending time, in 24 bytes each.

    The number alone would take the messages of a sender that was started again for those before.
    """

    def __init__(self) -> None:
        self._tables: dict[tuple[str, str], list[tuple[array[int], array[int], array[int]]]] = {}
        self._beyond: dict[tuple[str, str, int, int], tuple[int, int]] = {}

    def first(self, name: tuple[str, str], message: RawMessage, log: int) -> tuple[int, int] | None:
        """The log and the log time in which a message was met before; None for a new one, which is remembered."""
        tables = self._tables.setdefault(name, [])
        number, sent = message.sequence, message.publish_time
        for times, logs, log_times in tables:
            if number < len(times):
                if times[number] == sent + 1:
                    return logs[number], log_times[number]
                if times[number]:
                    continue
            elif number > len(times) + _MOST_AHEAD:
                break
            else:
                missing = number + 1 - len(times)
                for column in (times, logs, log_times):
                    column.frombytes(bytes(missing * 8))
            times[number], logs[number], log_times[number] = sent + 1, log, message.log_time
            return None
        if number > _MOST_AHEAD:
            # A number that far ahead is hardly true: a table for it would be mostly empty.
            place = (*name, number, sent)
            known = self._beyond.get(place)
            self._beyond.setdefault(place, (log, message.log_time))
            return known
        tables.append((array("Q"), array("Q"), array("Q")))
        return self.first(name, message, log)


class _Clocks:
    """Differences of log times of shared messages, by log and sender."""

    def __init__(self) -> None:
        self._shared: dict[int, int] = {}
        self._samples: dict[int, dict[str, list[int]]] = {}

    def add(self, sender: str, first: tuple[int, int], log: int, log_time: int) -> None:
        """Take one message that two logs hold."""
        pair = (first[0], log)
        if pair[0] == pair[1] or 0 not in pair:
            return
        ahead = log_time - first[1] if first[0] == 0 else first[1] - log_time
        other = max(pair)
        self._shared[other] = self._shared.get(other, 0) + 1
        samples = self._samples.setdefault(other, {}).setdefault(sender, [])
        if len(samples) < _SAMPLES:
            samples.append(ahead)

    def of(self, number: int, log: Log) -> Clock:
        """What is known of a log's clock."""
        host = log.metadata.get(RUN, {}).get("host", "")
        middles = [round(median(samples)) for samples in self._samples.get(number, {}).values()]
        if not middles:
            return Clock(log.path, host, 0, None, None)
        low, high = min(middles), max(middles)
        return Clock(log.path, host, self._shared[number], (low + high) // 2, (high - low) // 2)


def merge(logs: Sequence[Log], output: Path, compression: Compression = "zstd") -> Merged:
    """Join logs of one run by log time; of messages with one key, sender and number, the first is kept.

    Messages without an envelope cannot be told apart: all are kept. Raises UserError where the logs are of different
    runs, or the output cannot be written.
    """
    run = _common_run(logs)
    seen, clocks, duplicates = _Seen(), _Clocks(), 0
    owners: dict[str, str | None] = {}
    with OutputLog(output, compression) as new:
        for attachment in logs[0].attached():
            new.attach(attachment)
        if run:
            new.describe(RUN, run)
        streams = [_numbered(number, log) for number, log in enumerate(logs)]
        for _, number, message in heapq.merge(*streams, key=lambda item: item[:2]):
            sender = _sender(message, owners)
            if sender is not None:
                first = seen.first((message.channel.topic, sender), message, number)
                if first is not None:
                    duplicates += 1
                    clocks.add(sender, first, number, message.log_time)
                    continue
            new.add(message)
        found = [clocks.of(number, log) for number, log in enumerate(logs) if number]
        new.describe("cbef.merge", _described(logs, found))
        ends = [log.metadata.get(END, {}).get("status") for log in logs]
        if all(ends):
            # The absence of an end marks a recorder that was killed; it stays absent.
            new.describe(END, {"status": "finished" if set(ends) == {"finished"} else "stopped"})
        return Merged(new.count, duplicates, found)


def _common_run(logs: Sequence[Log]) -> dict[str, str]:
    """What the logs say of their run. Raises UserError where that differs."""
    told = [log.metadata.get(RUN, {}) for log in logs]
    first = logs[0]
    for log, said in zip(logs, told, strict=True):
        for what, same in (
            ("run", said.get("run") == told[0].get("run")),
            ("scenario", log.attachments.get(RESOLVED) == first.attachments.get(RESOLVED)),
        ):
            if not same:
                raise UserError(
                    f"{log.path} is of another {what} than {first.path}; only logs of one run are merged, "
                    "'compare' sets runs side by side"
                )
    hosts = dict.fromkeys(said["host"] for said in told if "host" in said)
    merged = {name: value for name, value in told[0].items() if name != "part"}
    return merged | ({"host": ", ".join(hosts)} if hosts else {})


def _described(logs: Sequence[Log], clocks: Sequence[Clock]) -> dict[str, str]:
    described = {f"log.{number}": log.path.name for number, log in enumerate(logs)}
    for number, clock in enumerate(clocks, 1):
        if clock.offset is not None:
            described |= {f"clock_offset_ns.{number}": str(clock.offset), f"clock_doubt_ns.{number}": str(clock.doubt)}
    return described


def _numbered(number: int, log: Log) -> Iterator[tuple[int, int, RawMessage]]:
    for message in log.messages_in_order():
        yield message.log_time, number, message


def _sender(message: RawMessage, owners: dict[str, str | None]) -> str | None:
    """The sender of a message; None where it has no envelope."""
    topic = message.channel.topic
    if topic not in owners:
        found = address(topic) if message.channel.message_encoding in {"msgpack", ENCODING} else None
        owners[topic] = found.owner if found else None
    owner = owners[topic]
    if owner == "":
        try:
            return str(unpack(message.data)["from"])
        except (BadMessage, KeyError):
            return None
    return owner
