"""Messages that are alike byte for byte are read as arrays, and come out as each does when it is read alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest

from tests.log.made import made_log
from zenoh_cbef.log.mcap.contents import Channel, RawMessage
from zenoh_cbef.log.mcap.heads import Batch, gathered
from zenoh_cbef.log.mcap.reader import McapFile
from zenoh_cbef.log.read.columns import Columns, Reader
from zenoh_cbef.log.read.decoding import Decoder, Sink
from zenoh_cbef.log.read.header import Header
from zenoh_cbef.protocol.kinds import BEACON, ESTIMATE
from zenoh_cbef.protocol.messages import BadMessage, decode
from zenoh_cbef.scenario.load import load

RUN = "made"
KEY = f"cbef/{RUN}/agent/3/estimate"
CHANNEL = Channel(7, KEY, "msgpack", "", "", b"", {})


def estimates(count: int = 300) -> list[dict[str, Any]]:
    """Estimates of one agent. Whole numbers grow past one byte and past two; some have no range, some have marks."""
    draw = np.random.default_rng(4)
    found = []
    for k in range(1, count + 1):
        counts = {"neighbours": [1, 2], "received": [k, 130 * k], "lost": [0, k // 7], "late": [0, 1]}
        body: dict[str, Any] = {
            "k": k,
            "state": draw.normal(size=6).tolist(),
            "innovation": None if k % 5 == 0 else float(k),
            "weight": 1.0,
            "nis_degrees": k,
            **counts,
            "latency": [1e-3 * k, None],
            "covariance": draw.normal(size=36).tobytes() if k % 11 else None,
        }
        body |= {"fates": ["..", "x."], "injected_lost": [k, 1]} if k % 50 == 0 else {}
        found.append({"v": 1, "run": RUN, "from": "agent/3", "seq": k - 1, "sent": 10**18 + k} | body)
    return found


def batch_of(messages: list[bytes]) -> Batch:
    told = [msgpack.unpackb(one) for one in messages]
    raws = [
        RawMessage(CHANNEL, 5 + row, one["sent"], one["seq"] & 0xFFFFFFFF, data)
        for row, (one, data) in enumerate(zip(told, messages, strict=True))
    ]
    return Batch.of(raws, {CHANNEL.id: CHANNEL})


def read(messages: list[bytes]) -> Columns:
    return Reader(ESTIMATE, RUN, "agent/3").read(batch_of(messages), np.arange(len(messages)))


@pytest.mark.parametrize("count", [3, 300])
def test_columns_are_the_fields_of_the_messages_in_their_order(count: int) -> None:
    told = estimates(count)
    columns, single = read([msgpack.packb(one) for one in told]), Columns.of(told)
    assert columns.names == single.names
    assert columns.senders() == ["agent/3"] * count
    for name in ("seq", "sent", "k", "nis_degrees"):
        assert columns.integers(name).tolist() == [one[name] for one in told]
    for name, width in (("state", 6), ("innovation", 1), ("received", 2), ("latency", 2), ("bias", 1), ("lost", 3)):
        np.testing.assert_array_equal(columns.numbers(name, width), single.numbers(name, width))
    packed = [one["covariance"] or np.full(36, np.nan).tobytes() for one in told]
    assert columns.numbers("covariance", 36).tobytes() == b"".join(packed)
    for name in ("fates", "covariance", "neighbours", "bias"):
        assert columns.sizes(name).tolist() == single.sizes(name).tolist()
    assert columns.texts("fates") == [one.get("fates") for one in told]
    assert columns.values("received") == [one["received"] for one in told]


@pytest.mark.parametrize(
    "change",
    [
        {"state": [0.0, 0.0, float("nan"), 0.0, 0.0, 0.0]},
        {"state": [0.0, 0.0, 0.0, 0.0, 0.0, -1e101]},
        {"weight": float("inf")},
        {"sent": 1 << 63},
        {"covariance": np.full(36, np.nan).tobytes()},
        {"from": "agent/4"},
        {"run": "mode"},
        {"state": [0, 0.0, 0.0, 0.0, 0.0, 0.0]},
    ],
)
def test_one_that_is_not_as_promised_is_refused_and_the_others_are_taken(change: dict[str, Any]) -> None:
    told = estimates()
    told[120] |= change
    packed = [msgpack.packb(one) for one in told]
    with pytest.raises(BadMessage):
        decode(ESTIMATE, packed[120], run=RUN, sender="agent/3")
    refused: list[RawMessage] = []
    taken: list[int] = []

    class Taking(Sink):
        def take_estimates(self, at: object, logged: object, messages: Columns) -> None:  # noqa: ARG002
            taken.extend(messages.step.tolist())

    plan = load("tracking", ["steps=300", "agents.count=6"]).plan
    decoder = Decoder(Header(RUN, plan, None), Taking(), refused=lambda raw, _: refused.append(raw))
    decoder.take(batch_of(packed))
    assert [one.data for one in refused] == [packed[120]]
    assert taken == [one["k"] for one in told if one is not told[120]]
    assert (decoder.tally.recorded, decoder.tally.undecodable) == (299, 1)


@pytest.mark.parametrize(
    "data", [b"", b"\x85", b"\xde\xff\xff", b"\x81\xa1k", b"\x81\x01\x02", b"\x82\xa1k\x01\xa1k\x02"]
)
def test_bytes_of_any_kind_are_refused(data: bytes) -> None:
    packed = [msgpack.packb(one) for one in estimates(20)]
    batch = Batch.of([RawMessage(CHANNEL, 1, 1, 1, one) for one in [*packed, *[data] * 20]], {CHANNEL.id: CHANNEL})
    with pytest.raises(BadMessage):
        Reader(ESTIMATE, RUN, "agent/3").read(batch, np.arange(40))


def test_beacons_with_and_without_a_time_are_one_column() -> None:
    times = [None if k % 2 else float(k) for k in range(100)]
    told = [
        {"v": 1, "run": RUN, "from": "target", "seq": k, "sent": k, "k": k, "emitted": time, "arrived": time}
        for k, time in enumerate(times)
    ]
    columns = Reader(BEACON, RUN, "").read(batch_of([msgpack.packb(one) for one in told]), np.arange(100))
    np.testing.assert_array_equal(columns.numbers("emitted")[:, 0], np.array(times, dtype=float))


@pytest.mark.slow
def test_a_file_by_columns_is_the_file_by_messages(tmp_path: Path) -> None:
    path = made_log(tmp_path / "run.mcap", "steps=30", "record.chunk_bytes=5000")
    single, batches = [*McapFile(path).messages()], [*McapFile(path).batches()]
    (joined,) = gathered(batches)
    assert len(batches) > 10
    assert joined.messages() == [joined.message(row) for row in range(len(joined))] == single
    assert Batch.of(single, joined.channels).messages() == single
    assert (np.diff(joined.chunk) >= 0).all()
    assert joined.chunk[-1] == len(batches) - 1
