"""Messages of one kind by field: as arrays where they are alike byte for byte, else read one by one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from zenoh_cbef.arrays import Bools, Floats, Ints
from zenoh_cbef.log.mcap.heads import Batch, Bytes
from zenoh_cbef.log.read.layouts import Layout, layout_of
from zenoh_cbef.log.read.tables import floats
from zenoh_cbef.protocol.kinds import Envelope, Kind
from zenoh_cbef.protocol.messages import decode, decode_all, unpack

_FEW = 16
"""Up to so many messages are read one by one, which then is faster."""
_ATTEMPTS = 4
"""So many layouts are learnt from messages of one size at once; where more are there, the rest is read one by one."""
_LAYOUTS = 16
"""So many layouts are kept for a key. Whole numbers are written in as few bytes as they need, so a run has several."""


class Columns:
    """Checked messages (m,) of one kind, in order."""

    def __init__(self, parts: Sequence[tuple[Ints, _Rows | _Maps]]) -> None:
        self._parts = parts
        self._count = sum(len(rows) for rows, _ in parts)

    @classmethod
    def of(cls, messages: Sequence[Mapping[str, object]]) -> Columns:
        """Messages that were read one by one, and checked."""
        return cls([(np.arange(len(messages)), _Maps(messages))])

    def __len__(self) -> int:
        """How many messages there are."""
        return self._count

    @cached_property
    def names(self) -> frozenset[str]:
        """Of all fields that any message has."""
        return frozenset[str]().union(*(part.names for _, part in self._parts))

    @cached_property
    def seq(self) -> Ints:
        """Their numbers, (m,)."""
        return self.integers("seq")

    @cached_property
    def sent(self) -> Ints:
        """When they were sent, ns, (m,)."""
        return self.integers("sent")

    @cached_property
    def step(self) -> Ints:
        """Their steps, (m,)."""
        return self.integers("k")

    def senders(self) -> list[str]:
        """The sender of each."""
        return [str(one) for one in self.values("from")]

    def by_sender(self) -> list[tuple[str, Ints]]:
        """The senders of messages, in the order of their first, each with its rows, ascending."""
        found: dict[str, list[Ints]] = {}
        for rows, part in self._parts:
            for name, own in part.by_sender(rows):
                found.setdefault(name, []).append(own)
        joined = [(name, np.sort(np.concatenate(own))) for name, own in found.items()]
        return sorted(joined, key=lambda one: int(one[1][0]))

    def texts(self, name: str) -> list[list[str] | None]:
        """The list of texts of a field, message by message; None where a message lacks it."""
        return [[*map(str, one)] if isinstance(one, list) else None for one in self.values(name)]

    def integers(self, name: str) -> Ints:
        """The whole number of a field that all messages have, (m,)."""
        found = np.empty(len(self), dtype=np.int64)
        for rows, part in self._parts:
            found[rows] = part.integers(name)
        return found

    def sizes(self, name: str) -> Ints:
        """How many items the list of a field has, (m,); -1 where a message lacks it."""
        found = np.full(len(self), -1)
        for rows, part in self._parts:
            found[rows] = part.sizes(name)
        return found

    def has(self, name: str) -> Bools:
        """Which messages have a field, (m,)."""
        return np.asarray(self.sizes(name) >= 0)

    def numbers(self, name: str, width: int = 1) -> Floats:
        """The numbers of a field, (m, width).

        NaN for nil, and where a message lacks the field or has another number of them.
        """
        found = np.full((len(self), width), np.nan)
        for rows, part in self._parts:
            if name in part.names:
                found[rows] = part.numbers(name, width)
        return found

    def values(self, name: str) -> list[object]:
        """What a field is, message by message; None where a message lacks it."""
        found: list[object] = [None] * len(self)
        for rows, part in self._parts:
            if name in part.names:
                for row, value in zip(rows.tolist(), part.values(name), strict=True):
                    found[row] = value
        return found


class Reader:
    """Reads the messages of one key. sender: the process that owns the key, "" for any."""

    def __init__(self, kind: Kind[Envelope], run: str, sender: str) -> None:
        self._kind, self._run, self._sender = kind, run, sender
        self._layouts: list[Layout] = []

    def read(self, batch: Batch, rows: Ints) -> Columns:
        """Some messages of a batch. Raises BadMessage where any is not as promised."""
        parts: list[tuple[Ints, _Rows | _Maps]] = []
        single: list[Ints] = []
        sizes = batch.end[rows] - batch.start[rows]
        for size in sorted(set(sizes.tolist())):
            places = np.flatnonzero(sizes == size)
            if len(places) > _FEW:
                found, places = self._alike(batch.table(rows[places], size), places)
                parts += found
            single.append(places)
        left = np.concatenate(single)
        if len(left):
            maps = decode_all(self._kind, batch.contents(rows[left]), run=self._run, sender=self._sender)
            parts.append((left, _Maps(maps)))
        return Columns(parts)

    def _alike(self, table: Bytes, places: Ints) -> tuple[list[tuple[Ints, _Rows | _Maps]], Ints]:
        """Those of some messages of one size (m, size) that have a layout in common with others, and the other ones."""
        parts: list[tuple[Ints, _Rows | _Maps]] = []
        single = [places[:0]]
        known = [one for one in self._layouts if one.size == table.shape[1]]
        attempts = _ATTEMPTS
        while len(places) > _FEW and (known or attempts):
            is_new = not known
            attempts -= is_new
            layout = known.pop() if known else layout_of(table[0].tobytes())
            if layout is None:
                break
            fits = layout.fits(table)
            if fits.sum() > _FEW:
                rows = table[fits]
                for one in layout.extremes(rows):
                    decode(self._kind, one, run=self._run, sender=self._sender)
                parts.append((places[fits], _Rows(layout, rows)))
                if is_new:
                    self._layouts = [*self._layouts[1 - _LAYOUTS :], layout]
            elif is_new:
                single.append(places[fits])
            else:
                continue
            places, table = places[~fits], table[~fits]
        return parts, np.concatenate([*single, places])


@dataclass(frozen=True)
class _Rows:
    """Messages (m, size) of one layout."""

    layout: Layout
    rows: Bytes

    @property
    def names(self) -> frozenset[str]:
        return self.layout.names

    def integers(self, name: str) -> Ints:
        return self.layout.integers(self.rows, name)

    def sizes(self, name: str) -> Ints:
        return np.full(len(self.rows), self.layout.width(name) if name in self.names else -1)

    def numbers(self, name: str, width: int) -> Floats:
        if self.layout.width(name) != width:
            return np.full((len(self.rows), width), np.nan)
        return self.layout.numbers(self.rows, name)

    def values(self, name: str) -> list[object]:
        if self.layout.varies(name):
            return [unpack(row.tobytes())[name] for row in self.rows]
        return [unpack(self.rows[0].tobytes())[name]] * len(self.rows)

    def by_sender(self, rows: Ints) -> list[tuple[str, Ints]]:
        return [(str(unpack(self.rows[0].tobytes())["from"]), rows)]  # Only numbers differ.


@dataclass(frozen=True)
class _Maps:
    """Messages (m,) that were read one by one."""

    maps: Sequence[Mapping[str, object]]

    @cached_property
    def names(self) -> frozenset[str]:
        return frozenset[str]().union(*self.maps)

    def integers(self, name: str) -> Ints:
        return np.array([one[name] for one in self.maps], dtype=np.int64)

    def sizes(self, name: str) -> Ints:
        return np.array([_size(one[name]) if name in one else -1 for one in self.maps])

    def numbers(self, name: str, width: int) -> Floats:
        nothing = [None] * width
        rows = [_row(one.get(name)) for one in self.maps]
        return floats([one if len(one) == width else nothing for one in rows]).reshape(-1, width)

    def values(self, name: str) -> list[object]:
        return [one.get(name) for one in self.maps]

    def by_sender(self, rows: Ints) -> list[tuple[str, Ints]]:
        names = np.array([str(one["from"]) for one in self.maps], dtype=object)
        return [(name, rows[names == name]) for name in dict.fromkeys(names.tolist())]


def _row(value: object) -> Sequence[object]:
    """The items of a field."""
    if isinstance(value, bytes):
        return [*np.frombuffer(value, "<f8")]
    return value if isinstance(value, list) else [value]


def _size(value: object) -> int:
    return len(_row(value))
