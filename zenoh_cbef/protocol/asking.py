"""Questions to all processes that answer them, each of which may answer with several messages."""

from __future__ import annotations

from collections.abc import Iterator

import zenoh


def ask_all(session: zenoh.Session, selector: str, seconds: float) -> Iterator[zenoh.Sample]:
    """Every answer of every process, in the order in which they come, until all have answered or the time is up."""
    replies = session.get(
        selector, timeout=seconds, target=zenoh.QueryTarget.ALL, consolidation=zenoh.ConsolidationMode.NONE
    )
    return (reply.ok for reply in replies if reply.ok is not None)


def all_answers(session: zenoh.Session, selector: str, seconds: float = 1.0) -> list[bytes]:
    """What they answer, without who does."""
    return [sample.payload.to_bytes() for sample in ask_all(session, selector, seconds)]
