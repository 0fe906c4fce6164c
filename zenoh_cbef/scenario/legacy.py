"""What a scenario in an older log means where it lacks a key that was added later."""

from __future__ import annotations

from collections.abc import Mapping

MEANT: dict[tuple[str, str], object] = {
    ("filter", "defaults"): 1,
    ("filter", "start"): "given",
    ("filter", "status"): False,
    ("filter", "status_rules"): 1,
    ("filter", "agile"): "ncv",
    ("filter", "turn_rate_change"): None,
    ("filter", "linearise"): "before",
    ("filter", "reacquire"): False,
    ("consensus", "isolate"): False,
}
"""What an absent key of a table stood for when it did not exist yet: so an older log is computed as it was."""


def as_meant(data: Mapping[str, object]) -> dict[str, object]:
    """The tables of a logged scenario, with the keys that it lacks."""
    filled = {name: dict(table) if isinstance(table, Mapping) else table for name, table in data.items()}
    for (table, key), value in MEANT.items():
        given = filled.setdefault(table, {})
        if isinstance(given, dict):
            given.setdefault(key, value)
    return filled
