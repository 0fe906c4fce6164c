"""Consensus messages at speed: the same msgpack maps as in messages.py, with every field at a fixed place.

An agent reads one message per neighbour and round, so this is the network's innermost loop. Integers are written
in their widest form, which makes the layout constant; what does not have it is read by the general decoder, so
both accept the same messages.
"""

from __future__ import annotations

import struct
import sys
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.protocol.messages import VERSION, decode, unpack_floats

Floats = NDArray[np.float64]

_KEYS = (b"\xa3seq\xcf", b"\xa4sent\xcf", b"\xa1k\xce", b"\xa1l\xcd")
_LITTLE = sys.byteorder == "little"
_MOST = 1 << 63
_TAIL = b"\xa7payload\xc5"


class RoundCodec:
    """Reads and writes one sender's round messages. width: number d of float64 in a payload."""

    def __init__(self, run: str, sender: str, width: int) -> None:
        self._run, self._sender, self._width = run, sender, width
        envelope = {"v": VERSION, "run": run, "from": sender}
        packed = b"".join(msgpack.packb(key) + msgpack.packb(value) for key, value in envelope.items())
        # A map of 8 fields: v, run, from, seq, sent, k, l, payload.
        self._head = b"\x88" + packed + _KEYS[0]
        self._tail = _TAIL + struct.pack(">H", 8 * width)
        self._numbers = struct.Struct(f">Q{len(_KEYS[1])}sQ{len(_KEYS[2])}sI{len(_KEYS[3])}sH{len(self._tail)}s")
        self._begin = len(self._head)
        self._values = self._begin + self._numbers.size
        self._size = self._values + 8 * width

    def encode(self, seq: int, sent: int, step: int, round_: int, payload: Floats) -> bytes:
        """One message; payload: (d,)."""
        numbers = self._numbers.pack(seq, _KEYS[1], sent, _KEYS[2], step, _KEYS[3], round_, self._tail)
        return self._head + numbers + (payload if _LITTLE else payload.astype("<f8")).tobytes()

    def decode(self, data: bytes) -> tuple[int, int, int, bytes]:
        """Step, round, sending time (ns) and payload, d native float64 that the caller still has to find finite.

        Raises BadMessage for anything else than a round message of this run and sender.
        """
        if len(data) == self._size and data.startswith(self._head):
            seq, key1, sent, key2, step, key3, round_, tail = self._numbers.unpack_from(data, self._begin)
            fixed = key1 == _KEYS[1] and key2 == _KEYS[2] and key3 == _KEYS[3] and tail == self._tail
            if fixed and seq < _MOST and sent < _MOST:
                return step, round_, sent, _native(data[self._values :])
        message: dict[str, Any] = decode("round", data, run=self._run, sender=self._sender)
        payload = unpack_floats(message["payload"], self._width)
        return message["k"], message["l"], message["sent"], payload.tobytes()


def _native(payload: bytes) -> bytes:
    return payload if _LITTLE else np.frombuffer(payload, "<f8").astype("=f8").tobytes()
