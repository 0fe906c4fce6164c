"""Rounds per second against a bare exchange, without recorder, with one over Zenoh and with rings, and a round's cost.

What a round costs is told in two ways: CPU of all processes, as the scheduler counts it, and agent 0's time by place.
"""

from __future__ import annotations

import os
import statistics
from collections.abc import Iterator
from dataclasses import dataclass

from rich.table import Table

from benchmarks.bare_exchange import RUNTIMES, bare_rate
from benchmarks.by_hand import told_by
from benchmarks.common import at_least, plain_table, results
from benchmarks.watched_round import PLACES
from zenoh_cbef.scenario.load import load

_SIZES = {"tracking": (600, 0.6), "scale24": (150, 0.7)}
"""Steps of a run, and the share of the bare exchange that is to be reached, recorder on."""
WITHOUT, _ZENOH, RINGS = "no recorder", "recorder", "recorder, rings"
_ARMS = {
    WITHOUT: ["record.required=false"],
    _ZENOH: ["record.rings=false"],
    RINGS: ["record.rings=true"],
}


@dataclass(frozen=True)
class Measured:
    """One run. rate: rounds/s. cost: CPU of a round of the network, µs, and waits, by role and thread.

    places: a round of agent 0 by place, µs; empty where none were asked for.
    """

    rate: float
    cost: dict[str, float]
    places: dict[str, float]


def agents(name: str, steps: int, arm: str, *, places: bool = False) -> Measured:
    """Measure one run of agents between a tenth of its steps and the end."""
    overrides = [f"steps={steps}", *_ARMS[arm]]
    plan = load(name, overrides).plan
    found = told_by(
        name,
        overrides,
        agents=range(plan.scenario.count),
        recorded=arm != WITHOUT,
        watched={PLACES: "1"} if places else {},
        watching="benchmarks.watched_round",
    )
    rounds = plan.rounds * found["steps"]
    cost = {}
    for role, (main, others, waits) in found["used"].items():
        number = plan.scenario.count if role == "agent" else 1
        cost[f"{role}: main thread"] = 1e-3 * main / rounds / number
        cost[f"{role}: other threads"] = 1e-3 * others / rounds / number
        cost[f"{role}: waits"] = waits / rounds / number
    return Measured(rounds / found["seconds"], cost, {place: 1e-3 * spent for place, spent in found["places"].items()})


def run(repeats: int) -> Iterator[Table]:
    """All arms in turn, so that other work of the machine slows all of them; medians."""
    for name, (steps, goal) in _SIZES.items():
        busy = os.getloadavg()[0]
        plan = load(name).plan
        edges = [(first, second) for first, second in plan.edges.tolist()]
        bare: list[float] = []
        runs: dict[str, list[Measured]] = {arm: [] for arm in _ARMS}
        for _ in range(repeats):
            size, rounds = 8 * plan.message_size, plan.rounds * steps
            bare.append(
                bare_rate(edges, plan.scenario.count, rounds=rounds, size=size, environment=RUNTIMES["merged runtime"])
            )
            for arm, found in runs.items():
                found.append(agents(name, steps, arm))
        rows = [["bare exchange", *_spread(bare), "", ""]]
        for arm, found in runs.items():
            shares = [one.rate / other for one, other in zip(found, bare, strict=True)]
            rows.append([arm, *_spread([one.rate for one in found]), *_spread(shares, 2)])
        title = f"{name}: rounds/s, and share of bare pair by pair, medians of {repeats}, load before {busy:.1f}"
        yield plain_table(title, ["", "median", "from, to", "of bare", "from, to"], rows)
        best = max(
            _median([one.rate / other for one, other in zip(runs[arm], bare, strict=True)]) for arm in (_ZENOH, RINGS)
        )
        yield results("", [at_least("of bare, recorder on, the better of both", best, goal)])
        yield _costs(name, runs)
        yield _places(name, steps, repeats)


def _median(values: list[float]) -> float:
    return float(statistics.median(values))


def _spread(values: list[float], digits: int = 0) -> tuple[str, str]:
    return f"{_median(values):.{digits}f}", f"{min(values):.{digits}f}, {max(values):.{digits}f}"


def _costs(name: str, runs: dict[str, list[Measured]]) -> Table:
    parts = list(dict.fromkeys(part for found in runs.values() for part in found[0].cost))
    rows = [
        [
            part,
            *(_median([one.cost[part] for one in found]) if part in found[0].cost else "" for found in runs.values()),
        ]
        for part in parts
    ]
    return plain_table(f"{name}: CPU of one process in a round, µs, and how often it waits", ["", *runs], rows)


def _places(name: str, steps: int, repeats: int) -> Table:
    found = [agents(name, steps, RINGS, places=True).places for _ in range(repeats)]
    rows = [[place, _median([one[place] for one in found])] for place in found[0]]
    return plain_table(f"{name}: a round of agent 0 with rings, by place, µs, medians of all rounds", ["", "µs"], rows)
