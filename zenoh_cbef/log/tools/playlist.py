"""Which messages of a log a replay publishes, under which keys, and in what order."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import takewhile
from typing import NamedTuple

from zenoh_cbef.errors import UserError
from zenoh_cbef.log.read.parts import Log
from zenoh_cbef.plain import count_in
from zenoh_cbef.protocol.keys import address, matches
from zenoh_cbef.protocol.messages import BadMessage, unpack
from zenoh_cbef.protocol.short import is_short, step_of

_BEGIN_STEPS = ("truth", "beacon")


class Item(NamedTuple):
    """A message to be published. log_time: ns since the epoch. step: of the messages that can begin one, else 0."""

    key: str
    log_time: int
    data: bytes
    step: int


@dataclass(frozen=True)
class Selection:
    """Which keys are played, and under which names.

    topics, exclude: key expressions. include, leave_out: they match the key as a whole. regex, exclude_regex: searched
    for in the key. remap: OLD:=NEW, where OLD is a key or what keys begin with, up to a slash; the first that fits
    counts. Raises UserError for what is none of these.
    """

    topics: Sequence[str] = ()
    exclude: Sequence[str] = ()
    include: Sequence[re.Pattern[str]] = ()
    leave_out: Sequence[re.Pattern[str]] = ()
    regex: Sequence[str] = ()
    exclude_regex: Sequence[str] = ()
    remap: Sequence[str] = ()

    def __post_init__(self) -> None:
        for pattern in (*self.regex, *self.exclude_regex):
            try:
                re.compile(pattern)
            except re.error as error:
                raise UserError(f"{pattern!r} is no regular expression ({error}); correct it") from None
        for rule in self.remap:
            old, found, new = rule.partition(":=")
            if not (old and found and new):
                raise UserError(f"--remap {rule!r} is not of the form OLD:=NEW, as in --remap cbef/one:=cbef/two")

    def takes(self, topic: str) -> bool:
        """Whether a key is played."""
        wanted = not (self.topics or self.include or self.regex)
        wanted = wanted or _any(topic, self.topics, self.include, self.regex)
        return wanted and not _any(topic, self.exclude, self.leave_out, self.exclude_regex)

    def renamed(self, topic: str) -> str:
        """What a key is called when it is played."""
        for rule in self.remap:
            old, _, new = rule.partition(":=")
            if topic == old or topic.startswith(old.rstrip("/") + "/"):
                return new.rstrip("/") + topic[len(old.rstrip("/")) :]
        return topic


class Playlist:
    """The messages of a log that a selection takes, read as they are played: in file order, which is that of arrival.

    start, end: log times of the whole log (ns). keys: all that will be published on. Raises UserError for none.
    """

    def __init__(self, file: Log, selection: Selection) -> None:
        self._file = file
        summary = file.summary()
        self.start, self.end = summary.start_time, summary.end_time
        self._keys = {topic: selection.renamed(topic) for topic in summary.channel_counts if selection.takes(topic)}
        if not self._keys:
            raise UserError("nothing is left to replay; see the log's keys with 'info', and correct --topics")
        kinds = {topic: found.kind for topic in self._keys if (found := address(topic)) is not None}
        # Without truth and beacons a step begins with whatever is first to tell its number.
        self._begin = {topic for topic, kind in kinds.items() if kind in _BEGIN_STEPS} or set(self._keys)

    @property
    def keys(self) -> set[str]:
        """The keys that are published on."""
        return set(self._keys.values())

    def items(self, since: int, until: int) -> Iterator[Item]:
        """The messages from one log time on (ns) up to another; what arrived before is read over."""
        for message in takewhile(lambda one: one.log_time <= until, self._file.messages()):
            if message.log_time < since:
                continue
            topic = message.channel.topic
            key = self._keys.get(topic)
            if key is not None:
                step = step_in(topic, message.data) if topic in self._begin else 0
                yield Item(key, message.log_time, message.data, step)


def _any(topic: str, expressions: Sequence[str], whole: Sequence[re.Pattern[str]], within: Sequence[str]) -> bool:
    """Whether a key expression stands for a key, or a regular expression matches it, as a whole or within."""
    return (
        any(matches(one, topic) for one in expressions)
        or any(one.fullmatch(topic) for one in whole)
        or any(re.search(one, topic) for one in within)
    )


def step_in(topic: str, data: bytes) -> int:
    """The step of a message, 0 where it has none."""
    if is_short(data, address(topic)):
        return step_of(data)
    try:
        return count_in(unpack(data), "k") or 0
    except BadMessage:
        return 0
