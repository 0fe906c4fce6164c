"""Payloads in few bits: what a sender says, and what all its neighbours and itself take it to have said.

A message is a code, one byte that tells the layout, and the numbers. Information (V, O) of s states travels as the
state x = O^-1 V and the matrix O, both in integers that are scaled by the diagonal of O:

    e_i  the least integer with O_ii < 4^e_i                                    one byte each
    c_ij = round(2^(b-1) O_ij / 2^(e_i + e_j))                                  b bits each, the upper triangle
    k_i  = round(2^5 2^e_i x_i)                                                 2 bytes each, or 4 where one is far off
    then O' = 2^(1-b) c_ij 2^(e_i + e_j),  x' = 2^-5 k_i 2^-e_i,  V' = O' x'

A rounded matrix thus moves no estimate, wherever the origin is: it weighs a state that was rounded to a 32nd of the
deviation 2^-e_i. Sent as V and O, an error E of O would move it by O^-1 E x, which grows with the coordinates. All
these products are exact in float64, so V' and O', rounded once more, stay as they are.

Where O' would not be safely positive definite in b bits (the least eigenvalue of its scaled form is at least 3 + s/2
units more than what rounding can take from it, s/2 + 1), the message takes the next more bits, and at last float32.
Other numbers of a payload are float32, rounded to 16 bits of mantissa, three bytes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import accumulate
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.linalg import inverse, matvec, pack_upper, unpack_upper

Precision = Literal["float64", "float32", "int16", "int12", "int8"]
PRECISIONS: tuple[Precision, ...] = get_args(Precision)

_Bytes = NDArray[np.uint8]
_Whole = NDArray[np.int64]

FLOAT32, FLOAT64 = 32, 64
"""The codes of messages in floats. That of one in integers is their bits, plus one where states take four bytes."""

_BITS = {"int8": 8, "int12": 12, "int16": 16}
_FINEST = 32.0
"""Into how many parts the deviation 2^-e_i is divided."""

_SHORT, _LONG = (1 << 15) - 1, (1 << 27) - 1
"""The largest k_i of two bytes, and of four: beyond it, a state that is found from V' and O' may be another one."""

_FARTHEST_POWER = 100
_LARGEST = 3e38


def is_code(code: int) -> bool:
    """Whether a message of some precision begins with this byte."""
    return code in (FLOAT32, FLOAT64) or code & ~1 in _BITS.values()


class Compact:
    """Payloads of `width` numbers, of which the first are information on states: `blocks` has how many each time.

    silences: whether agents keep silent in some rounds.
    """

    def __init__(self, width: int, blocks: tuple[int, ...], precision: Precision, *, silences: bool = False) -> None:
        self.width, self.precision, self.silences = width, precision, silences
        self._bits = [bits for bits in _BITS.values() if blocks and bits >= _BITS.get(precision, FLOAT32)]
        sizes = [size + size * (size + 1) // 2 for size in blocks]
        self._blocks = [*zip(blocks, accumulate(sizes, initial=0), strict=False)]
        self._states, self._entries, self._first_other = sum(blocks), sum(sizes) - sum(blocks), sum(sizes)

    @property
    def size(self) -> int:
        """Bytes of a message, with its code; seldom more: a filter that has just begun may need more bits."""
        return self._size(self._bits[0] if self._bits else FLOAT64 if self.precision == "float64" else FLOAT32)

    def rounded(self, payload: Floats) -> Floats:
        """What receivers of payloads (n, d) take them to be. Rounded ones stay as they are, to the bit."""
        found = np.empty_like(payload)
        for code, rows, data in self._packed(payload):
            found[rows] = self._unpacked(code, data)
        return found

    def pack(self, payload: Floats) -> bytes:
        """The message of one payload (d,) or (1, d)."""
        return self.pack_all(payload.reshape(1, -1))[0]

    def pack_all(self, payloads: Floats) -> list[bytes]:
        """The messages of payloads (n, d)."""
        messages = [b""] * len(payloads)
        for code, rows, data in self._packed(payloads):
            for row, one in zip(np.flatnonzero(rows).tolist(), data, strict=True):
                messages[row] = bytes((code,)) + one.tobytes()
        return messages

    def unpack(self, messages: Sequence[bytes]) -> Floats:
        """The payloads (m, d) of messages. Raises ValueError where one is none, or holds what is no number."""
        found = np.empty((len(messages), self.width))
        codes = np.array([message[0] if message else 0 for message in messages])
        for code in np.unique(codes).tolist():
            rows = np.flatnonzero(codes == code)
            size = self._size(code)
            if any(len(messages[row]) != size for row in rows.tolist()):
                raise ValueError("a payload of another size")
            data = np.frombuffer(b"".join(messages[row][1:] for row in rows.tolist()), np.uint8)
            found[rows] = self._unpacked(code, data.reshape(len(rows), size - 1))
        if not np.isfinite(found).all():
            raise ValueError("a payload that is not finite")
        return found

    def _size(self, code: int) -> int:
        bits, long = code & ~1, code & 1
        if code == (FLOAT64 if self.precision == "float64" else FLOAT32):
            return 1 + code // 8 * self.width
        if bits not in self._bits:
            raise ValueError(f"a payload in a layout {code} that the run does not have")
        entries = -(-self._entries // 2) * 3 if bits == _BITS["int12"] else self._entries * bits // 8
        return 1 + self._states * (5 if long else 3) + entries + 3 * (self.width - self._first_other)

    def _packed(self, payload: Floats) -> list[tuple[int, Bools, _Bytes]]:
        """By code: which payloads (n,) have it, and their bytes without it."""
        if self.precision == "float64":
            data = np.ascontiguousarray(payload, "<f8").view(np.uint8)
            return [(FLOAT64, np.ones(len(payload), dtype=bool), data)]
        payload = np.clip(payload, -_LARGEST, _LARGEST)
        tried = self._tried(payload)
        chosen = np.where((payload == payload.astype(np.float32)).all(axis=1), FLOAT32, 0)
        # A payload that has been rounded stays in a layout that leaves it as it is: another may just be sound now.
        for one in reversed(tried):
            chosen[one.same] = one.bits
        for one in tried:
            chosen[(chosen == 0) & one.sound] = one.bits
        chosen[chosen == 0] = FLOAT32
        found = []
        for one in tried:
            far = np.maximum.reduce(np.abs(one.state), axis=1) > _SHORT
            for long in (False, True):
                rows = (chosen == one.bits) & (far == long)
                if rows.any():
                    found.append((one.bits + long, rows, one.data(rows, payload[:, self._first_other :], long=long)))
        left = chosen == FLOAT32
        if left.any():
            found.append((FLOAT32, left, np.ascontiguousarray(payload[left], "<f4").view(np.uint8)))
        return found

    def _tried(self, payload: Floats) -> list[_Integers]:
        """Payloads in as many layouts as are needed to choose one for each."""
        tried: list[_Integers] = []
        settled = np.zeros(len(payload), dtype=bool)
        for bits in self._bits:
            one = self._integers(payload, bits)
            if one.whole.any():
                others = _from_three(_in_three(payload[:, self._first_other :]))
                one.same = one.sound & (self._payload(one, others) == payload).all(axis=1)
            tried.append(one)
            settled |= one.same | (one.sound & ~one.whole)
            if settled.all():
                break
        return tried

    def _integers(self, payload: Floats, bits: int) -> _Integers:
        blocks = []
        for size, start in self._blocks:
            end = start + size + size * (size + 1) // 2
            matrix = unpack_upper(payload[:, start + size : end], size)
            blocks.append(_block(payload[:, start : start + size], matrix, bits))
        return _Integers.joined(bits, blocks)

    def _payload(self, one: _Integers, others: Floats) -> Floats:
        """The payloads (n, d) that integers stand for."""
        found, seen, held = [], 0, 0
        for size, _ in self._blocks:
            mine, upper = slice(seen, seen + size), slice(held, held + size * (size + 1) // 2)
            scale = np.ldexp(1.0, one.power[:, mine])
            scaled = np.ldexp(unpack_upper(one.entries[:, upper].astype(np.float64), size), 1 - one.bits)
            matrix = scaled * (scale[:, :, None] * scale[:, None, :])
            found += [matvec(matrix, one.state[:, mine] / (_FINEST * scale)), pack_upper(matrix)]
            seen, held = mine.stop, upper.stop
        return np.concatenate([*found, others], axis=1)

    def _unpacked(self, code: int, data: _Bytes) -> Floats:
        """The payloads of messages of one code, without it."""
        if code in (FLOAT32, FLOAT64):
            return np.ascontiguousarray(data).view(f"<f{code // 8}").astype(np.float64)
        bits, long = code & ~1, code & 1
        end = data.shape[1] - 3 * (self.width - self._first_other)
        middle = end - self._states * (4 if long else 2)
        one = _Integers(
            bits,
            np.ascontiguousarray(data[:, : self._states]).view(np.int8).astype(np.int64),
            _from_bytes(data[:, self._states : middle], bits),
            _from_bytes(data[:, middle:end], 32 if long else 16),
        )
        return self._payload(one, _from_three(data[:, end:]))


@dataclass
class _Integers:
    """Payloads (n, d) in integers of some bits: powers and states (n, s), upper triangles (n, t) of all blocks.

    sound: (n,), which payloads these integers stand for. whole: (n,), whose matrices may have been rounded before.
    same: (n,), which payloads they leave as they are.
    """

    bits: int
    power: _Whole
    entries: _Whole
    state: _Whole
    sound: Bools = field(default_factory=lambda: np.zeros(0, dtype=bool))
    whole: Bools = field(default_factory=lambda: np.zeros(0, dtype=bool))
    same: Bools = field(init=False)

    def __post_init__(self) -> None:
        self.same = np.zeros(len(self.power), dtype=bool)

    @classmethod
    def joined(cls, bits: int, blocks: Sequence[_Integers]) -> _Integers:
        """All blocks of payloads, one after the other."""
        power, entries, state = (
            np.concatenate(each, axis=1)
            for each in zip(*((one.power, one.entries, one.state) for one in blocks), strict=True)
        )
        sound, whole = (
            np.logical_and.reduce(each) for each in zip(*((one.sound, one.whole) for one in blocks), strict=True)
        )
        return cls(bits, power, entries, state, sound, whole)

    def data(self, rows: Bools, others: Floats, *, long: bool) -> _Bytes:
        """The bytes of some payloads, without their code; others: (n, r), the numbers after the blocks."""
        parts = (
            self.power[rows].astype(np.int8).view(np.uint8),
            _in_bytes(self.entries[rows], self.bits),
            _in_bytes(self.state[rows], 32 if long else 16),
            _in_three(others[rows]),
        )
        return np.concatenate(parts, axis=1)


def _block(vector: Floats, matrix: Floats, bits: int) -> _Integers:
    """Information vectors (n, s) and matrices (n, s, s) in integers."""
    size, unit, diagonal = matrix.shape[1], 2.0 ** (1 - bits), np.arange(matrix.shape[1])
    own = matrix[:, diagonal, diagonal]
    sound = np.logical_and.reduce(own > 0.0, axis=1)
    power = (np.frexp(np.where(own > 0.0, own, 1.0))[1].astype(np.int64) + 1) // 2
    sound &= (np.abs(power) <= _FARTHEST_POWER).all(axis=1)
    scale = np.ldexp(1.0, np.clip(power, -_FARTHEST_POWER, _FARTHEST_POWER))
    scaled = matrix / (scale[:, :, None] * scale[:, None, :])
    most = (1 << (bits - 1)) - 1
    entries = np.clip(np.rint(scaled / unit), -most, most)
    # Strictly between a quarter and one, so that the rounded diagonal has the same power.
    entries[:, diagonal, diagonal] = np.maximum(entries[:, diagonal, diagonal], (1 << (bits - 3)) + 1)
    entries = np.where(sound[:, None, None], entries, most * np.eye(size))
    sound &= np.linalg.eigvalsh(unit * entries)[:, 0] >= (4.0 + 0.5 * size) * unit
    chosen = np.where(sound[:, None, None], matrix, np.eye(size))
    state = np.rint(_FINEST * scale * matvec(inverse(chosen), np.where(sound[:, None], vector, 0.0)))
    sound &= (np.abs(state) <= _LONG).all(axis=1)
    finest = np.ldexp(scaled, _BITS["int16"] - 1).reshape(len(matrix), -1)
    whole = np.logical_and.reduce(np.rint(finest) == finest, axis=1)
    state = np.where(sound[:, None], state, 0.0)
    return _Integers(bits, power, pack_upper(entries).astype(np.int64), state.astype(np.int64), sound, whole)


def _in_bytes(numbers: _Whole, bits: int) -> _Bytes:
    """Integers (m, t) of some bits as bytes, little-endian; two of 12 bits share three bytes."""
    if bits != _BITS["int12"]:
        return np.ascontiguousarray(numbers, f"<i{bits // 8}").view(np.uint8)
    even = np.pad(numbers, ((0, 0), (0, numbers.shape[1] % 2))) & 0xFFF
    low, high = even[:, ::2], even[:, 1::2]
    parts = np.stack([low & 0xFF, low >> 8 | (high & 0xF) << 4, high >> 4], axis=2)
    return parts.reshape(len(numbers), -1).astype(np.uint8)


def _from_bytes(data: _Bytes, bits: int) -> _Whole:
    """The reverse; where there is an odd number of 12 bits, a zero follows."""
    if bits != _BITS["int12"]:
        return np.ascontiguousarray(data).view(f"<i{bits // 8}").astype(np.int64)
    first, second, third = (data[:, place::3].astype(np.int64) for place in range(3))
    both = np.stack([first | (second & 0xF) << 8, second >> 4 | third << 4], axis=2).reshape(len(data), -1)
    return (both ^ 0x800) - 0x800


def _in_three(numbers: Floats) -> _Bytes:
    """Numbers (m, t) as float32 whose last eight bits are rounded away."""
    whole = numbers.astype("<f4").view("<u4").astype(np.int64) + 0x80
    return (
        np.ascontiguousarray(whole.astype("<u4"))
        .view(np.uint8)
        .reshape(*numbers.shape, 4)[:, :, 1:]
        .reshape(len(numbers), -1)
    )


def _from_three(data: _Bytes) -> Floats:
    """The reverse."""
    whole = np.zeros((len(data), data.shape[1] // 3, 4), dtype=np.uint8)
    whole[:, :, 1:] = data.reshape(len(data), -1, 3)
    return np.ascontiguousarray(whole).view("<f4").astype(np.float64)[:, :, 0]
