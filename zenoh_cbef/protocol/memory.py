"""The last messages of each key, which their sender keeps for receivers that missed them and ask."""

from __future__ import annotations

import time
from collections import deque

import zenoh

from zenoh_cbef.protocol.asking import all_answers

KEPT_SECONDS = 60.0
KEPT_BYTES = 1 << 16
"""How long messages of a key are kept, and how many bytes of them, where nothing else is said."""


_Kept = tuple[int, int | None, float, bytes]
"""Number, step, when it is forgotten (monotonic s), and the message. Plain, as one is made for each message sent."""


class Memory:
    """The last messages of one key. most: bytes."""

    def __init__(self, most: int = KEPT_BYTES) -> None:
        self._kept: deque[_Kept] = deque()
        self._room = most

    def keep(self, seq: int, step: int | None, data: bytes) -> None:
        """Remember a message by its number and its step, if it is of one; forget what is too old or too much."""
        now, kept = time.monotonic(), self._kept
        kept.append((seq, step, now + KEPT_SECONDS, data))
        self._room -= len(data)
        while kept and (self._room < 0 or kept[0][2] < now):
            self._room += len(kept.popleft()[3])

    def answer(self, wanted: zenoh.Parameters) -> list[bytes]:
        """What is kept of the step `k`, since the step `since`, or from number `first` to `last`; or the last one.

        Numbers that are none give nothing.
        """
        kept = list(self._kept)
        try:
            if (step := wanted.get("k")) is not None:
                return [data for _, of, _, data in kept if of == int(step)]
            if (since := wanted.get("since")) is not None:
                return [data for _, of, _, data in kept if of is not None and of >= int(since)]
            if (first := wanted.get("first")) is not None:
                last = int(wanted.get("last") or first)
                return [data for seq, _, _, data in kept if int(first) <= seq <= last]
        except ValueError:
            return []
        return [data for _, _, _, data in kept[-1:]]


class Archive:
    """The memories of one process, and its answers to queries."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._memories: dict[str, Memory] = {}
        self._queryables: list[zenoh.Queryable[None]] = []

    def open(self, key: str, most: int = KEPT_BYTES) -> Memory:
        """The memory of a key, of `most` bytes."""
        return self._memories.setdefault(key, Memory(most))

    def serve(self, *expressions: str) -> None:
        """Answer queries on these key expressions."""
        self._queryables += [self._session.declare_queryable(one, self._answer) for one in expressions]

    def _answer(self, query: zenoh.Query) -> None:
        with query:
            key = str(query.key_expr)
            memory = self._memories.get(key)
            for data in memory.answer(query.parameters) if memory else ():
                query.reply(key, data)


def ask_latest(session: zenoh.Session, key: str, step: int | None = None) -> list[bytes]:
    """The messages published last on a key, or in a step; empty where no process answers in time."""
    return all_answers(session, key if step is None else f"{key}?k={step}")


def ask_since(session: zenoh.Session, key: str, step: int) -> list[bytes]:
    """The messages published on a key since a step, as far as their sender has kept them."""
    return all_answers(session, f"{key}?since={step}")


def ask_numbers(session: zenoh.Session, key: str, first: int, last: int) -> list[bytes]:
    """The messages published on a key with these numbers, as far as their sender has kept them."""
    return all_answers(session, f"{key}?first={first};last={last}")
