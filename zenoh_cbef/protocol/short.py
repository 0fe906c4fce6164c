"""Consensus messages of few bytes, where `consensus.precision` has payloads travel in few bits.

    code (1 byte), seq (4), sent (8), k (4), l (2), all little-endian; the payload as tracking/compact.py has it

Of an agent that keeps silent in a round (tracking/triggered.py) the message has code 1 and no payload: lockstep waits
for every message. Run and sender are those of the key, which names both. The code says how the payload is laid out;
none begins a msgpack map, so no reader takes such a message for one of another kind.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.arrays import Floats
from zenoh_cbef.protocol.keys import Address
from zenoh_cbef.protocol.messages import BadMessage
from zenoh_cbef.protocol.round_codec import RoundCodec, Rounds
from zenoh_cbef.tracking.compact import Compact, is_code

ENCODING, SCHEMA = "cbef.short", "cbef.Short"
"""The message encoding of their channels in logs, and the name of its schema, which is empty."""

_HEAD = struct.Struct("<BIQIH")
HEAD_BYTES = _HEAD.size - 1
"""Bytes before a payload and its code."""
_ROW = np.dtype([("code", "u1"), ("seq", "<u4"), ("sent", "<u8"), ("step", "<u4"), ("round", "<u2")])
_MOST = 1 << 63
_SILENT = 1
SILENCE = bytes((_SILENT,))
"""What a message says that stands for silence."""
SILENT_BYTES = _HEAD.size
"""Bytes of a message that stands for silence."""


def is_short(data: bytes, at: Address | None) -> bool:
    """Whether a message on a key is one of these, as far as its beginning tells."""
    if at is None or at.kind != "round":
        return False
    return data[0] == _SILENT if len(data) == _HEAD.size else len(data) > _HEAD.size and is_code(data[0])


def numbered(data: bytes) -> tuple[int, int]:
    """Number of a message, and when it was sent, ns."""
    _, seq, sent, _, _ = _HEAD.unpack_from(data)
    return seq, sent


def step_of(data: bytes) -> int:
    """The step of a message."""
    return int(_HEAD.unpack_from(data)[3])


def codec_of(run: str, sender: str, width: int, compact: Compact | None) -> Codec:
    """The codec of a sender; width: numbers in a message. compact: None where they travel in all their bits."""
    return RoundCodec(run, sender, width) if compact is None else ShortCodec(compact)


def packed(compact: Compact, payloads: Floats) -> list[bytes]:
    """What a round's messages (n, d) say, rounded before, or NaN: silence; all at once, as one takes as long."""
    spoken = payloads[:, 0] == payloads[:, 0]
    told = iter(compact.pack_all(payloads[spoken]) if spoken.any() else ())
    return [next(told) if one else SILENCE for one in spoken.tolist()]


def framed(seq: int, sent: int, step: int, round_: int, said: bytes) -> bytes:
    """One message; said: its code and payload."""
    return _HEAD.pack(said[0], seq & 0xFFFFFFFF, sent, step, round_) + said[1:]


class ShortCodec:
    """Reads and writes round messages of few bytes."""

    def __init__(self, compact: Compact) -> None:
        self._compact = compact

    def encode(self, seq: int, sent: int, step: int, round_: int, payload: Floats) -> bytes:
        """One message; payload: d numbers, rounded before, or NaN: silence."""
        silent = payload.flat[0] != payload.flat[0]
        return framed(seq, sent, step, round_, SILENCE if silent else self._compact.pack(payload))

    def decode(self, data: bytes) -> tuple[int, int, int, bytes]:
        """Step, round, sending time (ns) and payload: d float64, NaN for silence. Raises BadMessage."""
        rounds = self.decode_all([data])
        return int(rounds.step[0]), int(rounds.round[0]), int(rounds.sent[0]), rounds.payload.tobytes()

    def decode_table(self, table: NDArray[np.uint8]) -> Rounds | None:  # noqa: ARG002 - as other codecs have it
        """Leave messages to `decode_all`: those of one size can have different codes."""
        return None

    def decode_all(self, messages: Sequence[bytes]) -> Rounds:
        """Many messages at once. Raises BadMessage where any is not as promised."""
        if min(map(len, messages)) < _HEAD.size:
            raise BadMessage("too short")
        heads = np.frombuffer(b"".join(data[: _HEAD.size] for data in messages), _ROW)
        if (heads["sent"] >= _MOST).any():
            raise BadMessage("field sent is not as promised")
        silent = np.array([len(data) == _HEAD.size and data[0] == _SILENT for data in messages])
        if silent.any() and not self._compact.silences:
            raise BadMessage("silence, which the run does not have")
        payload = np.full((len(messages), self._compact.width), np.nan)
        told = [messages[row] for row in np.flatnonzero(~silent).tolist()]
        try:
            payload[~silent] = self._compact.unpack([data[:1] + data[_HEAD.size :] for data in told])
        except ValueError as error:
            raise BadMessage(str(error)) from None
        seq, sent = heads["seq"].astype(np.uint32), heads["sent"].astype(np.uint64)
        return Rounds(seq, sent, heads["step"].astype(np.uint32), heads["round"].astype(np.uint32), payload)


Codec = RoundCodec | ShortCodec
"""Reads and writes one sender's round messages."""
