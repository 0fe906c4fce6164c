"""Whether a log is sound: its file, its sequence numbers, and every message."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from zenoh_cbef.log.common.naming import END
from zenoh_cbef.log.mcap.contents import RawMessage
from zenoh_cbef.log.mcap.heads import Batch
from zenoh_cbef.log.read.decoding import Decoder
from zenoh_cbef.log.read.header import read_header
from zenoh_cbef.log.read.parts import Log
from zenoh_cbef.log.tools.collection import goes_on
from zenoh_cbef.protocol.keys import address
from zenoh_cbef.protocol.messages import BadMessage
from zenoh_cbef.protocol.short import ENCODING, SCHEMA
from zenoh_cbef.scenario.plugged import PackageAbsentError

_NAMED = 100


@dataclass
class Findings:
    """The faults of a log, and notes.

    damage: one sentence for each fault of the file. missing: numbers that are not there, by key and sender, with their
    stretches in gaps. unheard: missing numbers that were sent while the recorder was cut off; these and restarts are
    notes, no faults of the log. wrong: messages that are not valid on their key, by topic and reason. out_of_order:
    messages with an earlier log time than the one before them in the file. goes_on: the log is still being written, so
    that it has no end is no fault. unread: why messages and their numbers were not checked; "" where they were.
    """

    messages: int = 0
    damage: list[str] = field(default_factory=list)
    missing: dict[str, int] = field(default_factory=dict)
    gaps: dict[str, list[tuple[int, int]]] = field(default_factory=dict)
    unheard: dict[str, int] = field(default_factory=dict)
    wrong: Counter[str] = field(default_factory=Counter)
    out_of_order: int = 0
    goes_on: bool = False
    unread: str = ""

    @property
    def exit_status(self) -> int:
        """0 for a log without fault, 1 for one with any, 2 where that cannot be judged.

        Log times that go back are reported, but are no fault.
        """
        return 1 if self.damage or self.missing or self.wrong else 2 if self.unread else 0


class _Checker:
    def __init__(self, findings: Findings) -> None:
        self.findings = findings
        self._last = np.uint64(0)
        self._seen: set[int] = set()

    def refused(self, raw: RawMessage, reason: BadMessage) -> None:
        self.note(f"{raw.channel.topic}: {reason}")

    def see(self, batch: Batch) -> None:
        """Check the records and the channels of messages."""
        if not len(batch):
            return
        times = np.append(self._last, batch.log)
        self.findings.out_of_order += int((times[1:] < times[:-1]).sum())
        self._last = times[-1]
        new = [one for one in dict.fromkeys(batch.channel.tolist()) if id(batch.channels[one]) not in self._seen]
        for channel in map(batch.channels.__getitem__, new):
            self._seen.add(id(channel))
            found = address(channel.topic)
            promised = (f"cbef.{found.kind.capitalize()}", "jsonschema", "msgpack") if found else None
            if found and found.kind == "round" and channel.message_encoding == ENCODING:
                promised = SCHEMA, "", ENCODING
            if channel.schema_name == "cbef.Unknown":
                continue  # its messages are refused one by one
            if promised != (channel.schema_name, channel.schema_encoding, channel.message_encoding):
                self.note(f"{channel.topic}: its channel is declared as {channel.schema_name or 'without a schema'}")

    def note(self, sentence: str) -> None:
        """Count one thing that is wrong."""
        wrong = self.findings.wrong
        wrong[sentence if sentence in wrong or len(wrong) < _NAMED else "others"] += 1


def check(log: Log) -> Findings:
    """Read all of a log and say what is wrong with it. Raises UserError where it is no log of a run."""
    findings = Findings()
    checker, decoder = _Checker(findings), None
    try:
        decoder = Decoder(read_header(log), refused=checker.refused)
    except PackageAbsentError as error:
        findings.unread = str(error)
    for batch in log.batches():
        checker.see(batch)
        if decoder is not None:
            decoder.take(batch)
        findings.messages += len(batch)
    # Attachments and metadata were read with the header: only now all damage is known.
    findings.goes_on = goes_on(log)
    findings.damage = log.lost if findings.goes_on else log.damage
    if not findings.goes_on and END not in log.metadata:
        findings.damage.append("there is no end record: the recorder was killed, or could not write any more")
    for (key, sender), sequence in decoder.tally.sequences if decoder is not None else ():
        if sequence.absurd:
            number, expected = sequence.example
            checker.note(
                f"{key} from {sender}: {sequence.absurd} numbers are out of all proportion, the first {number} "
                f"in place of {expected}; nothing is taken to be missing for them"
            )
        if sequence.unheard:
            findings.unheard[f"{key} from {sender}"] = sequence.unheard
        if sequence.missing > sequence.unheard:
            findings.missing[f"{key} from {sender}"] = sequence.missing - sequence.unheard
            findings.gaps[f"{key} from {sender}"] = sequence.gaps[:_NAMED]
    return findings
