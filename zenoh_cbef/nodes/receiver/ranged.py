"""What every format tells: ranges, found in a stream of bytes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol


class Ranged(NamedTuple):
    """A range: time on the receiver's clock (s), None where it tells none; the anchor's name; m."""

    time: float | None
    anchor: str
    distance: float


class Found(NamedTuple):
    """What some bytes held. other: how many lines or messages held no range."""

    ranges: Sequence[Ranged]
    other: int


class Reader(Protocol):
    """Finds ranges in the bytes of one source, which come in pieces of any length."""

    def feed(self, data: bytes) -> Found:
        """What these bytes complete."""

    def finish(self) -> Found:
        """What is complete now that a datagram or file ended."""

    def forget(self) -> None:
        """Bytes were lost: what has begun will not be completed."""


def plausible(ranges: Sequence[Ranged]) -> list[Ranged]:
    """The ranges without lengths below zero or beyond all reason."""
    return [one for one in ranges if 0.0 <= one.distance < 1e7]
