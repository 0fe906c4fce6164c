"""Where the numbers of a message stand: messages that differ in nothing else are read as arrays, many at once."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.arrays import Bools, Floats, Ints
from zenoh_cbef.log.mcap.heads import Bytes

Numbers = NDArray[np.float64] | NDArray[np.uint8] | NDArray[np.uint16] | NDArray[np.uint32] | NDArray[np.uint64]

_NIL = "nil"
_SIZES = {"fix": 1, ">u1": 1, ">u2": 2, ">u4": 4, ">u8": 8, ">f8": 8, "<f8": 8}
_HEADED = {0xCB: ">f8", 0xCC: ">u1", 0xCD: ">u2", 0xCE: ">u4", 0xCF: ">u8"}
_LENGTHS = {
    **dict.fromkeys((0xC4, 0xD9), ">xB"),
    **dict.fromkeys((0xC5, 0xDA, 0xDC, 0xDE), ">xH"),
    **dict.fromkeys((0xC6, 0xDB, 0xDD, 0xDF), ">xI"),
}
_BINS, _TEXTS, _LISTS, _MAPS = {0xC4, 0xC5, 0xC6}, {0xD9, 0xDA, 0xDB}, {0xDC, 0xDD}, {0xDE, 0xDF}


class _Strange(Exception):
    """A message in which something else stands than numbers, texts, nil, flags, lists of these, and doubles."""


@dataclass(frozen=True)
class _Run:
    """Numbers of one field that stand in equal distances: from which of the field, how many, where, how far apart."""

    field: str
    first: int
    count: int
    kind: str
    offset: int
    stride: int

    def within(self, rows: Bytes) -> Numbers:
        """These numbers of messages (m, size), (m, count)."""
        kind = "u1" if self.kind == "fix" else self.kind
        shape, strides = (len(rows), self.count), (rows.shape[1], self.stride)
        return np.ndarray(shape, kind, rows, self.offset, strides)


class Layout:
    """What a message has in common with others of its sender: all but its numbers, which stand at the same places.

    size: bytes. Raises ValueError for a message that is no map of plain fields.
    """

    def __init__(self, example: bytes) -> None:
        self.size = len(example)
        self.example = np.frombuffer(example, np.uint8)
        self._widths: dict[str, int] = {}
        self._runs: dict[str, list[_Run]] = {}
        self._same = np.full(self.size, 0xFF, np.uint8)
        try:
            self._walk(example)
        except (_Strange, IndexError, struct.error, UnicodeDecodeError):
            raise ValueError("not a map of plain fields") from None
        for run in self.runs():
            for at in range(run.offset, run.offset + run.count * run.stride, run.stride):
                self._same[at : at + _SIZES[run.kind]] = 0x80 if run.kind == "fix" else 0
        self._common = self.example & self._same

    @cached_property
    def names(self) -> frozenset[str]:
        """Of its fields."""
        return frozenset(self._widths)

    def varies(self, name: str) -> bool:
        """Whether a field has numbers."""
        return bool(self._runs[name])

    def runs(self) -> Iterator[_Run]:
        """All stretches of numbers."""
        for runs in self._runs.values():
            yield from runs

    def fits(self, rows: Bytes) -> Bools:
        """Which messages (m, size) are like it, (m,)."""
        alike = (rows & self._same) == self._common
        return np.ones(len(rows), dtype=bool) if alike.all() else np.asarray(alike.all(axis=1))

    def extremes(self, rows: Bytes) -> tuple[bytes, bytes]:
        """Of messages that are like it: a message with the least number at each place, and one with the greatest.

        Where a number of any is NaN, it is NaN there.
        """
        found = self.example.copy()[None], self.example.copy()[None]
        with np.errstate(invalid="ignore"):
            for run in self.runs():
                numbers = run.within(rows)
                run.within(found[0])[:] = numbers.min(axis=0)
                run.within(found[1])[:] = numbers.max(axis=0)
        return found[0].tobytes(), found[1].tobytes()

    def width(self, name: str) -> int:
        """How many numbers a field has, nil included."""
        return self._widths[name]

    def integers(self, rows: Bytes, name: str) -> Ints:
        """The one whole number of a field, (m,)."""
        (run,) = self._runs[name]
        return run.within(rows)[:, 0].astype(np.int64)

    def numbers(self, rows: Bytes, name: str) -> Floats:
        """The numbers of a field, (m, width), NaN for nil."""
        runs = self._runs.get(name, [])
        if len(runs) == 1 and runs[0].count == self._widths[name]:
            return runs[0].within(rows).astype(np.float64)
        found = np.full((len(rows), self._widths[name]), np.nan)
        for run in runs:
            found[:, run.first : run.first + run.count] = run.within(rows)
        return found

    def _walk(self, data: bytes) -> None:
        """Find the places of all numbers."""
        count, at = _opened(data, 0, 0x80, _MAPS)
        for _ in range(count):
            size, start = _opened(data, at, 0xA0, _TEXTS)
            name = data[start : start + size].decode()
            if name in self._widths:
                raise _Strange
            places, at = _places(data, start + size)
            self._widths[name] = len(places)
            self._runs[name] = _runs(name, places)
        if at != len(data):
            raise _Strange


def layout_of(example: bytes) -> Layout | None:
    """The layout of a message; None where it is no map of plain fields."""
    try:
        return Layout(example)
    except ValueError:
        return None


def _opened(data: bytes, at: int, short: int, long: set[int]) -> tuple[int, int]:
    """Size of a text, list or map, and where what is in it begins."""
    first = data[at]
    if short <= first < short + (32 if short == 0xA0 else 16):
        return first - short, at + 1
    if first not in long:
        raise _Strange
    head = struct.Struct(_LENGTHS[first])
    return int(head.unpack_from(data, at)[0]), at + head.size


def _places(data: bytes, at: int) -> tuple[list[tuple[str, int]], int]:
    """Kinds and places of the numbers in the value at a place, and where the value ends."""
    first = data[at]
    if 0x90 <= first < 0xA0 or first in _LISTS:
        count, at = _opened(data, at, 0x90, _LISTS)
        found = []
        for _ in range(count):
            one, at = _single(data, at)
            found.append(one)
        return found, at
    if first in _BINS:
        size, at = _opened(data, at, 0x100, _BINS)
        return [("<f8", at + place) for place in range(0, size - size % 8, 8)], at + size
    one, at = _single(data, at)
    return [one], at


def _single(data: bytes, at: int) -> tuple[tuple[str, int], int]:
    first = data[at]
    if first < 0x80:
        return ("fix", at), at + 1
    if first in _HEADED:
        kind = _HEADED[first]
        return (kind, at + 1), at + 1 + _SIZES[kind]
    if first in (0xC0, 0xC2, 0xC3):
        return (_NIL, at), at + 1
    size, start = _opened(data, at, 0xA0, _TEXTS)
    return (_NIL, at), start + size


def _runs(field: str, places: Sequence[tuple[str, int]]) -> list[_Run]:
    """The numbers of a field as stretches in equal distances."""
    found: list[_Run] = []
    for number, (kind, offset) in enumerate(places):
        if kind == _NIL:
            continue
        last = found[-1] if found else None
        if last is not None and last.kind == kind and last.first + last.count == number:
            stride = offset - last.offset - (last.count - 1) * last.stride
            if last.count == 1 or stride == last.stride:
                found[-1] = replace(last, count=last.count + 1, stride=stride)
                continue
        found.append(_Run(field, number, 1, kind, offset, _SIZES[kind]))
    return found
