"""The last few messages of a key, for those who come later and ask for them."""

from __future__ import annotations

from collections import deque

import zenoh

_KEPT = 16


class Latest:
    """Answers queries on a key with what was published on it last, or with the message of the step asked for."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self._key = key
        self._kept: deque[tuple[int, bytes]] = deque(maxlen=_KEPT)
        self._queryable = session.declare_queryable(key, self._answer)

    def keep(self, step: int, data: bytes) -> None:
        """Remember the message of a step."""
        self._kept.append((step, data))

    def _answer(self, query: zenoh.Query) -> None:
        with query:
            kept, wanted = list(self._kept), query.parameters.get("k")
            found = kept[-1:] if wanted is None else [one for one in kept if str(one[0]) == wanted]
            if found:
                query.reply(self._key, found[0][1])


def ask_latest(session: zenoh.Session, key: str, step: int | None = None, *, timeout: float = 1.0) -> list[bytes]:
    """What was published last on the keys of an expression, or in a step; empty where nobody answers in time (s)."""
    selector = key if step is None else f"{key}?k={step}"
    replies = session.get(selector, timeout=timeout, target=zenoh.QueryTarget.ALL)
    return [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]
