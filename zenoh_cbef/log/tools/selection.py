"""Selects messages of a log by topic and by time, as the mcap command line does."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from zenoh_cbef.errors import UserError
from zenoh_cbef.log.mcap.contents import RawMessage
from zenoh_cbef.plain import whole

_LAST = 1 << 64
_SINCE_START = re.compile(r"(\d+(?:\.\d*)?|\.\d+)s")


def time_of(text: str, start: Callable[[], int], option: str) -> int:
    """A time in ns since the epoch, from whole ns, an RFC 3339 date, or seconds since the log's start, as in 12.5s."""
    if (since_epoch := whole(text)) is not None:
        return since_epoch
    if since := _SINCE_START.fullmatch(text):
        return start() + round(float(since[1]) * 1e9)
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise UserError(
            f"{option} {text!r} is no time; give whole ns since the epoch, a date as 2026-01-31T12:00:00Z, "
            "or seconds since the log's start as 12.5s"
        ) from None
    moment = moment.replace(tzinfo=moment.tzinfo or UTC)
    passed = moment - datetime(1970, 1, 1, tzinfo=UTC)
    return (passed.days * 86_400 + passed.seconds) * 10**9 + passed.microseconds * 1000


@dataclass(frozen=True)
class Selection:
    """Messages whose whole topic matches any pattern of include, or none of exclude, logged in [start, end), in ns."""

    include: tuple[re.Pattern[str], ...] = ()
    exclude: tuple[re.Pattern[str], ...] = ()
    start: int = 0
    end: int = _LAST

    def topics(self) -> Callable[[str], bool]:
        """A test of topics that looks at each only once."""
        known: dict[str, bool] = {}

        def chosen(topic: str) -> bool:
            found = known.get(topic)
            if found is None:
                wanted = not self.include or any(pattern.fullmatch(topic) for pattern in self.include)
                found = known[topic] = wanted and not any(pattern.fullmatch(topic) for pattern in self.exclude)
            return found

        return chosen

    def test(self) -> Callable[[RawMessage], bool]:
        """A test of messages."""
        chosen, start, end = self.topics(), self.start, self.end
        return lambda message: start <= message.log_time < end and chosen(message.channel.topic)


def select(include: Sequence[str], exclude: Sequence[str], start: int = 0, end: int = _LAST) -> Selection:
    """A selection by regular expressions. Raises UserError."""
    if include and exclude:
        raise UserError("topics are either included (-y) or excluded (-n); give one of the two")
    if end <= start:
        raise UserError("--end is not after --start; messages are taken from start up to, not including, end")
    return Selection(_patterns(include), _patterns(exclude), start, end)


def _patterns(texts: Sequence[str]) -> tuple[re.Pattern[str], ...]:
    try:
        return tuple(re.compile(text) for text in texts)
    except re.error as error:
        raise UserError(f"{error.pattern!r} is no regular expression ({error}); correct it") from None
