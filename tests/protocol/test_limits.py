"""The last value that a field may have, and the first that it may not, alone and among others."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from zenoh_cbef.protocol import fields
from zenoh_cbef.protocol.fields import field_of
from zenoh_cbef.protocol.messages import BadMessage
from zenoh_cbef.protocol.round_codec import RoundCodec

FAR = 1e100
LIMITS: dict[str, tuple[Any, list[Any], list[Any]]] = {
    "count": (fields.Count, [0, 2**63 - 1], [-1, 2**63, 1.0, True, None]),
    "small count": (fields.SmallCount, [0, 2**40 - 1], [-1, 2**40, "1"]),
    "number": (fields.Number, [0.0, FAR, -FAR], [np.nextafter(FAR, np.inf), -1.1 * FAR, np.nan, np.inf, 1]),
    "number or nil": (fields.NumberOrNil, [None, FAR], [1.1 * FAR, np.nan]),
    "text": (fields.Text, ["", "x" * 10_000, "two\nlines\t"], ["x" * 10_001, "\x1b", "\x7f", "\x00", "\x0b", 1]),
    "counts": (fields.Counts, [[], [0] * 10_000, [2**40 - 1]], [[0] * 10_001, [2**40], [-1], (0,), 0]),
    "doubles": (
        fields.Doubles,
        [b"", np.array([1e60, -1e60]).tobytes()],
        [np.array([1.1e60]).tobytes(), np.array([np.nan]).tobytes(), bytes(7), "x"],
    ),
    "matrix": (
        fields.Matrix,
        [bytes(8 * 36), np.full(36, FAR).tobytes()],
        [bytes(8 * 35), bytes(8 * 37), np.full(36, 1.1 * FAR).tobytes()],
    ),
    "signal": (fields.Signal, ["start", "end"], ["stop", "", 1]),
    "moment": (
        fields.Moment,
        [0.0, np.nextafter(1e10, 0.0).item()],
        [-5e-324, 1e10, np.nan, 1, np.float64(1.0)],
    ),
    "doubles or nil": (
        fields.DoublesOrNil,
        [None, b"", np.array([FAR, -FAR]).tobytes()],
        [np.array([1.1 * FAR]).tobytes(), bytes(9), "x"],
    ),
    "three": (fields.Three, [[0.0, FAR, -FAR]], [[0.0] * 2, [0.0] * 4, [0.0, 0.0, np.nan], [0, 0, 0]]),
    "six": (fields.Six, [[0.0] * 6], [[0.0] * 5, [0.0] * 7]),
    "numbers or nil": (fields.NumbersOrNil, [[], [None], [1.0, None]], [[1.0, np.nan], [1], None]),
    "texts": (fields.Texts, [[], ["x", "y"]], [["x", 1], ["\x07"], "x"]),
    "table": (fields.Table, [{}, {"x": [1, None]}], [{"x": {1: 2}}, {"x": b""}, []]),
}


@pytest.mark.parametrize("name", LIMITS)
def test_the_last_value_is_taken_and_the_first_beyond_it_is_not(name: str) -> None:
    hint, inside, outside = LIMITS[name]
    field = field_of(hint)
    for value in inside:
        assert field.hold([value]), value
    assert field.hold(inside)
    for value in outside:
        assert not field.hold([value]), value
        assert not field.hold([inside[0], value]), value
        assert not field.hold([value, inside[-1]]), value


@pytest.mark.parametrize("place", ["seq", "sent"])
def test_a_number_of_64_bits_is_no_count(place: str) -> None:
    codec = RoundCodec("test", "agent/3", 1)

    def message(value: int) -> bytes:
        numbers = {"seq": 1, "sent": 2} | {place: value}
        return codec.encode(numbers["seq"], numbers["sent"], 3, 4, np.ones(1))

    assert getattr(codec.decode_all([message(1), message(2**63 - 1)]), place).tolist() == [1, 2**63 - 1]
    codec.decode(message(2**63 - 1))
    for read in (lambda data: codec.decode_all([data]), codec.decode):
        with pytest.raises(BadMessage):
            read(message(2**63))
