"""Consensus messages at speed: the same msgpack maps as in messages.py, with every field at a fixed place.

An agent reads one message per neighbour and round, so this is the network's innermost loop. Integers are written
in their widest form, which makes the layout constant; the general decoder reads a message with another layout, so
both accept the same messages. Where payloads travel in few bits, messages are short.py's in place of these.
"""

from __future__ import annotations

import struct
import sys
from collections.abc import Sequence
from typing import NamedTuple

import msgpack
import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.arrays import Floats
from zenoh_cbef.protocol.kinds import ROUND
from zenoh_cbef.protocol.messages import VERSION, decode, unpack_floats
from zenoh_cbef.tracking.moderation import LARGEST_SENT

Counts = NDArray[np.uint16] | NDArray[np.uint32] | NDArray[np.uint64]

_KEYS = (b"\xa3seq\xcf", b"\xa4sent\xcf", b"\xa1k\xce", b"\xa1l\xcd")
_LITTLE = sys.byteorder == "little"
_TAIL = b"\xa7payload\xc5"


class Rounds(NamedTuple):
    """Many round messages of one sender: seq, sent (ns), step and round (m,), payloads (m, d)."""

    seq: Counts
    sent: Counts
    step: Counts
    round: Counts
    payload: Floats


class RoundCodec:
    """Reads and writes one sender's round messages. width: number d of float64 in a payload."""

    def __init__(self, run: str, sender: str, width: int) -> None:
        self._run, self._sender, self._width = run, sender, width
        envelope = {"v": VERSION, "run": run, "from": sender}
        packed = b"".join(msgpack.packb(key) + msgpack.packb(value) for key, value in envelope.items())
        # A map of 8 fields: v, run, from, seq, sent, k, l, payload.
        self._head = b"\x88" + packed + _KEYS[0]
        self._tail = _TAIL + struct.pack(">H", 8 * width)
        # The numbers, and between them the keys: they are written, and passed over when a header is read.
        begin, gaps = len(self._head), [*map(len, _KEYS[1:]), len(self._tail)]
        numbers = "".join(f"{kind}{gap}s" for kind, gap in zip("QQIH", gaps, strict=True))
        self._written = struct.Struct(f">{numbers}")
        self._read = struct.Struct(f">{begin}x{numbers.replace('s', 'x')}")
        self._values = self._read.size
        self._size = self._values + 8 * width
        places = [begin, 8, 8, 4, self._values]
        for n in (1, 2, 3):
            places[n] += places[n - 1] + len(_KEYS[n])
        formats = [">u8", ">u8", ">u4", ">u2", ("<f8", (width,))]
        self._row = np.dtype(
            {"names": list(Rounds._fields), "formats": formats, "offsets": places, "itemsize": self._size}
        )
        # Which bits of a header are always the same: all but its numbers, of which seq and sent are below 2^63.
        same = np.full(self._values, 0xFF, np.uint8)
        for place, size, first in zip(places, (8, 8, 4, 2), (0x80, 0x80, 0, 0), strict=False):
            same[place : place + size] = first, *(0,) * (size - 1)
        self._same, self._header = same, np.frombuffer(self.encode(0, 0, 0, 0, np.zeros(width)), np.uint8, self._values)
        self._same_bits, self._header_bits = (int.from_bytes(one.tobytes()) for one in (same, self._header))

    def encode(self, seq: int, sent: int, step: int, round_: int, payload: Floats) -> bytes:
        """One message; payload: d numbers."""
        numbers = self._written.pack(seq, _KEYS[1], sent, _KEYS[2], step, _KEYS[3], round_, self._tail)
        return self._head + numbers + (payload if _LITTLE else payload.astype("<f8")).tobytes()

    def decode_all(self, messages: Sequence[bytes]) -> Rounds:
        """Many messages at once. Raises BadMessage where any is not as promised, or its payload immense."""
        if set(map(len, messages)) == {self._size}:
            found = self.decode_table(np.frombuffer(b"".join(messages), np.uint8).reshape(-1, self._size))
            if found is not None:
                return found
        maps = [decode(ROUND, data, run=self._run, sender=self._sender) for data in messages]
        numbers = [(message["seq"], message["sent"], message["k"], message["l"]) for message in maps]
        seq, sent, step, round_ = np.array(numbers, np.uint64).T
        return Rounds(
            seq, sent, step, round_, np.stack([unpack_floats(message["payload"], self._width) for message in maps])
        )

    def decode_table(self, table: NDArray[np.uint8]) -> Rounds | None:
        """Messages of one size, (m, size); None where any of them is written otherwise, or not as promised."""
        if table.shape[1] != self._size or ((table[:, : self._values] & self._same) != self._header).any():
            return None
        read = table.view(self._row)[:, 0]
        found = Rounds(*(read[name].astype(read[name].dtype.newbyteorder("=")) for name in Rounds._fields))
        return found if (np.abs(found.payload) <= LARGEST_SENT).all() else None

    def decode(self, data: bytes) -> tuple[int, int, int, bytes]:
        """Step, round, sending time (ns) and payload: d float64; the caller compares it with LARGEST_SENT.

        Raises BadMessage for anything else than a round message of this run and sender.
        """
        header = data[: self._values]
        if len(data) == self._size and int.from_bytes(header) & self._same_bits == self._header_bits:
            _, sent, step, round_ = self._read.unpack(header)
            values = data[self._values :]
            return step, round_, sent, values if _LITTLE else _swapped(values)
        message = decode(ROUND, data, run=self._run, sender=self._sender)
        payload = unpack_floats(message["payload"], self._width)
        return message["k"], message["l"], message["sent"], payload.tobytes()


def _swapped(payload: bytes) -> bytes:
    return np.frombuffer(payload, "<f8").astype("=f8").tobytes()
