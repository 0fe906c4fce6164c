"""Starts the processes of an exchange of rounds along a graph's edges, and collects what they tell."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence

from benchmarks.common import children
from benchmarks.exchange_part import Outcome, Part, as_text

_PATIENCE_SECONDS = 120.0


def parts_of(edges: Sequence[tuple[int, int]], endpoints: Sequence[str]) -> list[Part]:
    """The parts of all processes of a graph."""
    return [
        Part(me, sorted(b if a == me else a for a, b in edges if me in (a, b)), list(endpoints))
        for me in range(len(endpoints))
    ]


def exchanged(
    module: str,
    parts: Sequence[Part],
    arguments: Sequence[str] = (),
    *,
    environment: Mapping[str, str],
    launcher: Sequence[str] = (),
) -> list[Outcome]:
    """Start `python -m module PART arguments` for each part; returns what they tell, in the order of the parts.

    launcher: a command that starts all of them with the same arguments; they get all parts then. Raises RuntimeError
    where a process fails, or hangs.
    """
    told = [as_text(parts)] if launcher else [as_text(part) for part in parts]
    with children() as family:
        started = [
            family.start(module, [one, *arguments], environment, listen_to=True, launcher=launcher) for one in told
        ]
        until = time.monotonic() + _PATIENCE_SECONDS
        lines = [line for child in started for line in family.wait(child, until - time.monotonic()).splitlines()]
    return sorted((Outcome(**json.loads(line)) for line in lines), key=lambda one: one.me)


def slowest(outcomes: Sequence[Outcome]) -> float:
    """The rounds per second of the slowest process."""
    return min(one.rate for one in outcomes)
