"""Recorders of some agents: their ids are in the recorder's name, so each process knows to which recorders it links."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache

from zenoh_cbef.protocol.keys import Keys

_OF_SOME = re.compile(r"record/agents-((?:\d{1,3}(?:-\d{1,3})?)(?:_\d{1,3}(?:-\d{1,3})?)*)")


def share_name(ids: str) -> str:
    """The name of the recorder of these agents, a list as in "0,3,5-9"."""
    return "agents-" + ids.replace(",", "_")


def share_keys(agents: Sequence[int]) -> list[str]:
    """What the recorder of some agents records, beside all events and signals that reach it, below the run's key."""
    keys = Keys("*")
    common = [one.removeprefix(f"{keys.root}/") for one in (keys.truth, keys.faults)]
    return [*common, *(f"*/{agent}/**" for agent in agents)]


def records(recorder: str, agent: int) -> bool:
    """Whether a recorder, as in "record/agents-0-9", records an agent: one whose name tells no agents records all."""
    share = _share(recorder)
    return share is None or agent in share


def is_share(recorder: str) -> bool:
    """Whether a recorder's name says that it records some agents alone."""
    return _share(recorder) is not None


@lru_cache(maxsize=256)
def _share(recorder: str) -> frozenset[int] | None:
    found = _OF_SOME.fullmatch(recorder)
    if found is None:
        return None
    ranges = (part.partition("-") for part in found[1].split("_"))
    return frozenset(agent for first, _, last in ranges for agent in range(int(first), int(last or first) + 1))
