"""Messages that are wrong in a known way: each is refused, and told what is wrong; numbers keep their bits."""

from __future__ import annotations

import math
import struct

import msgpack
import numpy as np
import pytest

from tests.protocol.made import RUN, SENDER, read_or_refused, written
from zenoh_cbef.protocol.kinds import MESSAGE_KINDS, ROUND
from zenoh_cbef.protocol.messages import (
    LARGEST,
    VERSION,
    BadMessage,
    decode,
    nan_to_nil,
    nil_to_nan,
    pack_floats,
    unpack_floats,
)

VALID = {"k": 3, "position": [1.0, 2.0, 3.0], "range": 4.0}


@pytest.mark.parametrize(
    ("kind", "change", "said"),
    [
        ("range", {"k": -1}, "field k is not as promised"),
        ("range", {"k": True}, "field k is not as promised"),
        ("range", {"k": 3.0}, "field k is not as promised"),
        ("range", {"k": 2**63}, "field k is not as promised"),
        ("range", {"range": math.nan}, "field range is not as promised"),
        ("range", {"range": math.inf}, "field range is not as promised"),
        ("range", {"range": 4}, "field range is not as promised"),
        ("range", {"position": [1.0, 2.0]}, "field position is not as promised"),
        ("range", {"position": [1.0, 2.0, math.nan]}, "field position is not as promised"),
        ("range", {"position": "abc"}, "field position is not as promised"),
        ("range", {"run": "other"}, "of run 'other'"),
        ("range", {"from": "agent/4"}, "from 'agent/4', not agent/3"),
        ("range", {"v": 2}, "version 2, not 1"),
        ("range", {"seq": -1}, "field seq is not as promised"),
        ("range", {"sent": None}, "field sent is not as promised"),
        ("range", {"bogus": 1}, "unknown field 'bogus'"),
        ("range", {"x" * 5000: 1}, "unknown field 'xxx"),
        ("range", {"run": "x" * 20_000}, "field run is not as promised"),
        ("truth", {}, "unknown field 'position'"),
    ],
)
def test_a_refusal_says_what_is_wrong(kind, change, said):
    fields = {"v": VERSION, "run": RUN, "from": SENDER, "seq": 0, "sent": 0, **VALID, **change}
    with pytest.raises(BadMessage) as caught:
        decode(MESSAGE_KINDS[kind], msgpack.packb(fields), run=RUN, sender=SENDER)
    assert said in str(caught.value)
    assert len(str(caught.value)) < 120


@pytest.mark.parametrize("values", [[math.nan], [1.0, math.inf], [-math.inf, 0.0], [1.0, 2e60]])
def test_numbers_that_are_not_finite_or_immense_do_not_hide_in_binary_fields(values):
    body = {"k": 1, "l": 1, "payload": struct.pack(f"<{len(values)}d", *values)}
    with pytest.raises(BadMessage, match="payload"):
        decode(ROUND, written(body), run=RUN)


def test_a_huge_message_is_refused_before_it_is_read():
    with pytest.raises(BadMessage, match="larger than"):
        decode(ROUND, b"\x81" * (LARGEST + 1), run=RUN)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xdf\xff\xff\xff\xff",
        b"\xdd\xff\xff\xff\xff",
        b"\xc6\xff\xff\xff\xff",
        b"\x91" * 100_000,
        b"\x81\xa1k" * 30_000,
        b"\x81\xc0\xc0",
        b"\x81\x90\xc0",
        b"\xc1",
        b"\x81\xa1\xff\xc0",
    ],
)
def test_hostile_bytes_are_refused(data):
    for kind in MESSAGE_KINDS:
        assert read_or_refused(kind, data) is None


def test_arrays_are_little_endian_and_keep_their_bits():
    values = np.array([[1.0, -0.0], [5e-324, 1e308]])
    data = pack_floats(values)
    assert data == struct.pack("<4d", 1.0, -0.0, 5e-324, 1e308)
    assert unpack_floats(data, 2, 2).tobytes() == values.tobytes()
    assert pack_floats(values.T) == struct.pack("<4d", 1.0, 5e-324, -0.0, 1e308)
    with pytest.raises(BadMessage, match="32 bytes, not 48"):
        unpack_floats(data, 6)


@pytest.mark.parametrize("value", [0.0, -1.5, 1e300])
def test_numbers_pass_nil_unchanged_and_nan_becomes_nil(value):
    assert nil_to_nan(nan_to_nil(value)) == value
    assert nan_to_nil(math.nan) is None
    assert nan_to_nil(math.inf) is None
    assert math.isnan(nil_to_nan(None))
