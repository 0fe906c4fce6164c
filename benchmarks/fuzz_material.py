"""Made-up and mutated messages, keys, texts and logs, from seeds: input that must not crash a process."""

from __future__ import annotations

import json
import random
from collections.abc import Sequence
from typing import Any

import msgpack
import numpy as np

from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.kinds import MESSAGE_KINDS
from zenoh_cbef.protocol.messages import encode
from zenoh_cbef.protocol.round_codec import RoundCodec

RUN = "fuzz"
KEYS = Keys(RUN)
WIDTH = 4
AGENTS = 3

_TIME = 1_700_000_000_000_000_000
_ODD: tuple[Any, ...] = (
    *(None, True, False, "", "x", "agent/0", "target", "\x00", "é" * 3, "9" * 5000, "a" * 20_000),
    *(0, -1, 1, 255, 1 << 31, (1 << 63) - 1, 1 << 63, (1 << 64) - 1, -(1 << 63)),
    *(0.0, -0.0, 1e-300, 1e200, -1.7e308, float("nan"), float("inf"), -float("inf")),
    *(b"", b"\x00" * 7, b"\x00" * 8, b"\xff" * 16, [], {}, [[]], [None], [{}], {"x": "y"}, [1] * 300),
    *(msgpack.Timestamp(1, 1), msgpack.ExtType(5, b"abc"), {"sent": {"x": "y"}, "step": [], "agent": "a"}),
)

_COUNTS = (0, 1, 2, 8, 9, 50, 51, 300, 1 << 31, 1 << 53, (1 << 63) - 1)
_FLOATS = (0.0, -0.0, 1.0, -1.0, 0.3, 1e-310, 1e10, -1e100, 1e160, 1.7e308, -1.7e308)
_TEXTS = (
    *("", "x", "start", "end", "finished", "silent", "joined", "killed", "here", "rejected", "agent/0", "agent/99"),
    *(
        "target",
        "[]",
        '[{"kind": "loss", "probability": 1.0}]',
        "[" * 9000,
        "<script>",
        "[red]",
        "\x00\x1b[2J",
        "é\n" * 900,
    ),
)


def bodies() -> dict[str, list[tuple[str, str, dict[str, Any]]]]:
    """Key, sender and body of true messages, by kind."""
    counts = {name: [1, 2] for name in ("neighbours", "received", "lost", "late")}
    estimate = {"k": 3, "state": [0.5] * 6, "innovation": 0.1, "weight": None, **counts, "latency": [1e-3, None]}
    sent = {KEYS.round(0): 12, KEYS.event("agent/0"): 2}
    finished = {"step": 3, "sent": sent, "rejected": 0, "word": 5, "total": 1, "reasons": {"a": 1}}
    here = {"host": "h", "pid": 5, "version": "1", "zenoh": "1", "clock": 0.1, "round_trip": 0.2}
    return {
        "truth": [(KEYS.truth, "target", {"k": 3, "state": [0.5] * 6})],
        "beacon": [
            (KEYS.beacon(0), "target", {"k": 3, "emitted": 0.3, "arrived": 0.3 + 1e-8}),
            (KEYS.beacon(1), "receiver", {"k": 3, "emitted": None, "arrived": None}),
        ],
        "signal": [
            (KEYS.signal(1), "target", {"k": 0, "signal": "start", "at": 1.7e9}),
            (KEYS.signal(2), "target", {"k": 9, "signal": "end"}),
        ],
        "range": [(KEYS.range(0), "agent/0", {"k": 3, "position": [1.0, 2.0, 3.0], "range": None})],
        "round": [(KEYS.round(0), "agent/0", {"k": 3, "l": 1, "payload": np.ones(WIDTH).tobytes()})],
        "estimate": [
            (KEYS.estimate(0), "agent/0", {**estimate, "covariance": np.eye(6).tobytes()}),
            (KEYS.estimate(1), "agent/1", {**estimate, "nis": 1.0, "nis_degrees": 1, "covariance": None}),
        ],
        "smoothed": [
            (KEYS.smoothed(0), "agent/0", {"k": 3, "until": 5, "state": [0.5] * 6, "covariance": np.eye(6).tobytes()})
        ],
        "faults": [(KEYS.faults, "target", {"tables": '[{"kind": "loss", "probability": 0.5, "from": 0.1}]'})],
        "event": [
            (KEYS.event("agent/0"), "agent/0", {"kind": "finished", "text": "done", "data": finished}),
            (KEYS.event("target"), "target", {"kind": "finished", "text": "done", "data": finished}),
            (KEYS.event("agent/1"), "agent/1", {"kind": "here", "text": "here", "data": here}),
            (KEYS.event("agent/2"), "agent/2", {"kind": "rejected", "text": "some"}),
            (KEYS.event("target"), "target", {"kind": "joined", "text": "in", "data": {"agent": 1, "planned": True}}),
        ],
    }


class Material:
    """Mutated and made-up things, the same for the same seed."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)  # noqa: S311 - the same faults have to be found again
        self._bodies = bodies()
        self._kinds = [*MESSAGE_KINDS]
        self._codec = RoundCodec(RUN, "agent/0", WIDTH)
        self._texts = ["cbef", RUN, "agent", "beacon", "target", "truth", "event", "faults", "live", "0", "1", "٣", ""]

    def message(self) -> tuple[str, str, bytes]:
        """A kind, the key that a true message of it has, and bytes that may be one."""
        kind = self.random.choice(self._kinds)
        key, sender, body = self.random.choice(self._bodies[kind])
        seq = self.random.choice((0, 1, 2, 3, (1 << 32) + 1, (1 << 63) - 1))
        draw = self.random.random()
        if draw < 0.1 and kind == "round":
            data = self._codec.encode(seq, _TIME, 3, 1, np.full(WIDTH, self.random.choice((1.0, 1e308, np.nan))))
        elif draw < 0.45:
            alike = {name: self.alike(value) if self.random.random() < 0.5 else value for name, value in body.items()}
            data = encode(RUN, sender, seq, _TIME, alike)
        elif draw < 0.7:
            envelope = {"v": 1, "run": RUN, "from": sender, "seq": seq, "sent": _TIME, **body}
            data = _packed(self.changed(envelope))
        elif draw < 0.75:
            data = _packed({**{name: self.odd() for name in body}, self.text(): self.odd()})
        else:
            data = encode(RUN, sender, seq, _TIME, body)
        return kind, key, self.bytes(data) if self.random.random() < 0.3 else data

    def odd(self, depth: int = 0) -> Any:
        """A value that may stand anywhere."""
        draw = self.random.random()
        if draw < 0.02:
            return self._nested()
        if draw < 0.15 and depth < 3:
            return [self.odd(depth + 1) for _ in range(self.random.randrange(4))]
        if draw < 0.3 and depth < 3:
            return {self.text(): self.odd(depth + 1) for _ in range(self.random.randrange(4))}
        return self.random.choice(_ODD)

    def alike(self, value: Any) -> Any:
        """A value of the same type, so that a message with it is well formed."""
        if isinstance(value, bool):
            return not value
        if isinstance(value, list | dict):
            return self._parts_alike(value)
        if isinstance(value, bytes):
            count = len(value) // 8 if self.random.random() < 0.7 else self.random.randrange(40)
            return np.array([self.random.choice(_FLOATS) for _ in range(count)]).tobytes()
        if value is None and self.random.random() < 0.5:
            return None
        choices: dict[type, Sequence[Any]] = {int: _COUNTS, str: _TEXTS}
        return self.random.choice(choices.get(type(value), _FLOATS))

    def _parts_alike(self, value: list[Any] | dict[str, Any]) -> Any:
        draw = self.random.random()
        if isinstance(value, list):
            parts = [self.alike(one) if self.random.random() < 0.5 else one for one in value]
            return parts if draw < 0.8 else parts[:-1] if draw < 0.9 else parts * 2
        table = {name: self.alike(one) for name, one in value.items()}
        return table if draw < 0.4 else {**table, self.text(): self._json_like(0)}

    def _json_like(self, depth: int) -> Any:
        draw = self.random.random()
        if draw < 0.2 and depth < 4:
            return [self._json_like(depth + 1) for _ in range(self.random.randrange(4))]
        if draw < 0.4 and depth < 4:
            return {self.text(): self._json_like(depth + 1) for _ in range(self.random.randrange(4))}
        return self.random.choice((None, True, False, 0, -1, 1 << 63, -(1 << 63), *_FLOATS, *_TEXTS))

    def _nested(self) -> Any:
        value: Any = 1
        for _ in range(self.random.choice((20, 40, 200, 480))):
            value = {"a": value} if self.random.random() < 0.5 else [value]
        return value

    def changed(self, value: Any) -> Any:
        """A value with another one somewhere in it, or without a part."""
        if isinstance(value, dict) and value and self.random.random() < 0.9:
            name, draw = self.random.choice([*value]), self.random.random()
            if draw < 0.05:
                return {other: one for other, one in value.items() if other != name}
            if draw < 0.1:
                return {**value, self.text(): self.odd()}
            return {**value, name: self.changed(value[name])}
        if isinstance(value, list) and value and self.random.random() < 0.8:
            place = self.random.randrange(len(value))
            return [*value[:place], self.changed(value[place]), *value[place + 1 :]]
        return self.odd()

    def text(self) -> str:
        """A word with a meaning in messages, or one without."""
        return self.random.choice(("sent", "step", "word", "k", "kind", "from", "data", "x", "", "9" * 50, "é"))

    def key(self) -> str:
        """A key, true or not."""
        if self.random.random() < 0.3:
            return self.random.choice(self._bodies[self.random.choice(self._kinds)])[0]
        parts = self.random.choice(self._bodies[self.random.choice(self._kinds)])[0].split("/")
        for _ in range(self.random.randrange(1, 3)):
            place = self.random.randrange(len(parts))
            parts[place : place + self.random.randrange(2)] = [self._part()]
        return "/".join(parts)

    def _part(self) -> str:
        draw = self.random.random()
        if draw < 0.3:
            return "9" * self.random.choice((1, 4, 20, 4300, 5000))
        if draw < 0.6:
            return self.random.choice(self._texts)
        return "".join(chr(self.random.choice((10, 32, 48, 97, 0xE9, 0x660, 0x1F600))) for _ in range(3))

    def bytes(self, data: bytes) -> bytes:
        """Bytes with some of them flipped, cut off, doubled, or put in."""
        changed = bytearray(data)
        for _ in range(self.random.choice((1, 1, 2, 8))):
            if not changed:
                break
            place, draw = self.random.randrange(len(changed)), self.random.random()
            if draw < 0.6:
                changed[place] = self.random.randrange(256)
            elif draw < 0.7:
                del changed[place:]
            elif draw < 0.8:
                del changed[place : place + self.random.randrange(1, 9)]
            elif draw < 0.9:
                changed[place:place] = changed[place : place + self.random.randrange(1, 64)]
            else:
                changed[place:place] = self.random.choice((b"\xdd\xff\xff\xff\xff", b"\xdc\xff\xff" * 9, b"\xff" * 8))
        return bytes(changed)

    def json(self, value: Any) -> str:
        """A JSON text of a value, or of something like it."""
        draw = self.random.random()
        if draw < 0.05:
            return self.random.choice(("[", '{"a":')) * self.random.choice((50, 5000, 100_000))
        if draw < 0.1:
            return f"[{'9' * 5000}]"
        if draw < 0.6:
            value = self.changed(value)
        text = json.dumps(value, default=repr)
        return self.bytes(text.encode()).decode(errors="replace") if self.random.random() < 0.4 else text

    def pick(self, values: Sequence[Any]) -> Any:
        """One of some."""
        return self.random.choice(values)


def _packed(value: Any) -> bytes:
    try:
        return bytes(msgpack.packb(value))
    except (ValueError, OverflowError):
        return b"\x80"
