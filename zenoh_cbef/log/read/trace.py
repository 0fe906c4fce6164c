"""From a log to a trace."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.errors import UserError
from zenoh_cbef.log.read.columns import Columns
from zenoh_cbef.log.read.contents import Contents, Header, read_header
from zenoh_cbef.log.read.decoding import Decoder, Tally
from zenoh_cbef.log.read.parts import open_logs
from zenoh_cbef.plain import count_in
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.messages import nil_to_nan
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.injected import read_tables, with_faults
from zenoh_cbef.scenario.paths import agent_positions, step_times
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import measured
from zenoh_cbef.trace import Links, Trace, Traffic
from zenoh_cbef.tracking.diagnostics import Diagnostics

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]

_COUNTS = {"received": "delivered"} | {
    name: name for name in ("lost", "late", "injected_lost", "injected_late", "corrupted", "duplicated")
}


def read_trace(*paths: Path) -> Trace:
    """Read a log, complete or cut off, of one file or several.

    Raises UserError where it is no log of a run, or holds no step.
    """
    log = open_logs(paths)
    header = read_header(log, log.path)
    columns = Columns(header.scenario.count, header.scenario.length)
    decoder = Decoder(header.run, header.plan, columns)
    decoder.take_all(log)
    return _trace_of(header, columns, decoder.tally, complete=log.complete and not log.damage)


def _trace_of(header: Header, columns: Columns, tally: Tally, *, complete: bool) -> Trace:
    """The arrays of a log's messages, as far as any agent got."""
    plan, steps = header.plan, columns.estimates.last
    if columns.faults:
        plan = with_faults(plan, read_tables(columns.faults))
    if steps == 0:
        raise UserError(
            f"the log of run {header.run!r} holds no estimate: the run ended before its first step, or this is a part "
            "of its log without them"
        )
    ranges, age = _measured(plan, *np.moveaxis(columns.beacons.upto(steps), 2, 0))
    estimates = columns.estimates.upto(steps)
    diagnostics = Diagnostics.read(estimates[:, :, 6:])
    unlogged, traffic = _unlogged(header.run, columns, tally, diagnostics.innovation), _traffic(columns, tally)
    positions = columns.positions.upto(steps)
    expected = agent_positions(plan.scenario.model_copy(update={"steps": steps}))
    return Trace(
        name=header.run,
        plan=plan,
        time=step_times(plan.scenario, steps),
        truth=columns.truth.upto(steps)[0],
        positions=np.where(np.isfinite(positions), positions, expected),
        ranges=ranges,
        age=age,
        initial=plan.initial_states,
        estimates=estimates[:, :, :6],
        covariances=columns.covariances.upto(steps).reshape(plan.scenario.count, steps, 6, 6),
        diagnostics=diagnostics,
        edges=plan.edges,
        links=_links(plan, columns),
        traffic=traffic,
        events=[_event(message) for message in columns.events],
        unlogged=unlogged if unlogged.any() else None,
        complete=complete and (header.end or {}).get("status") == "finished" and traffic.missing == 0,
    )


def _unlogged(run: str, columns: Columns, tally: Tally, innovation: Floats) -> Bools:
    """Which measurements are not in the log, (n, K), although an agent says that it measured, or may have.

    A receiver that hears nothing may say nothing. So a beacon is missing where the agent's own estimate tells of an
    innovation; and without that estimate, where numbers of its key are missing, or nothing is in the log of either.
    """
    count, steps = innovation.shape
    missing: Counter[str] = Counter()
    for (key, _), sequence in tally.sequences:
        missing[key] += sequence.missing
    heard, told = columns.beacons.seen(steps), columns.estimates.seen(steps)
    keys = Keys(run)
    gone = np.array([missing[keys.beacon(agent)] > 0 for agent in range(count)])
    gone |= ~heard.any(axis=1) & ~told.any(axis=1)
    return np.asarray(~heard & (np.isfinite(innovation) | (~told & gone[:, None])))


def heard_ranges(plan: Plan, contents: Contents, steps: int) -> tuple[Floats, Floats]:
    """Ranges and ages (n, K) from the logged beacons, NaN and 0 where none was heard."""
    emitted = np.full((plan.scenario.count, steps), np.nan)
    arrived = np.full((plan.scenario.count, steps), np.nan)
    for (agent, step), message in contents.beacons.items():
        if 1 <= step <= steps:
            emitted[agent, step - 1] = nil_to_nan(message["emitted"])
            arrived[agent, step - 1] = nil_to_nan(message["arrived"])
    return _measured(plan, emitted, arrived)


def _measured(plan: Plan, emitted: Floats, arrived: Floats) -> tuple[Floats, Floats]:
    steps = np.arange(1, emitted.shape[1] + 1, dtype=np.float64)
    ranges, age = measured(plan, emitted, arrived, steps)
    return ranges, np.where(np.isfinite(age), age, 0.0)


def logged_positions(scenario: Scenario, contents: Contents, steps: int) -> Floats:
    """Where the agents said they were, (n, K, 3); where they said nothing, where the scenario has them."""
    positions = agent_positions(scenario.model_copy(update={"steps": steps}))
    for (agent, step), message in contents.ranges.items():
        if 1 <= step <= steps:
            positions[agent, step - 1] = message["position"]
    return positions


def _links(plan: Plan, columns: Columns) -> Links:
    """What the receivers counted: the last counts of each of their lives, and the mean of their latencies."""
    rows = []
    for first, second in plan.edges.tolist():
        for source, destination in ((first, second), (second, first)):
            each = [_counts(message, source) for message in columns.lives.get(destination, [])]
            counts = np.sum(each, axis=0).tolist() if each else [0] * len(_COUNTS)
            total, number = columns.latency.get((source, destination), (np.nan, 1))
            rows.append((destination, source, *counts, total / number))
    table = np.array(sorted(rows), dtype=np.float64).reshape(-1, 3 + len(_COUNTS))
    destination, source = table[:, :2].astype(np.int64).T
    counted = dict(zip(_COUNTS.values(), table[:, 2:-1].astype(np.int64).T, strict=True))
    sent = counted["delivered"] + counted["lost"] + counted["late"]
    return Links(source=source, destination=destination, sent=sent, **counted, latency=table[:, -1])


def _counts(message: dict[str, Any], source: int) -> list[int]:
    if source not in message["neighbours"]:
        return [0] * len(_COUNTS)
    place = message["neighbours"].index(source)
    return [message[name][place] if name in message else 0 for name in _COUNTS]


def _traffic(columns: Columns, tally: Tally) -> Traffic:
    rejected: dict[str, int] = {}
    for message in columns.events:
        data = message.get("data", {})
        for name in ("rejected", "total"):
            rejected[message["from"]] = max(rejected.get(message["from"], 0), count_in(data, name) or 0)
    total = tally.sequences.sent
    return Traffic(
        sent=total,
        recorded=tally.recorded,
        missing=max(0, total - tally.recorded),
        rejected=max(tally.undecodable, sum(rejected.values())),
        agent_bytes=tally.agent_bytes,
        agents_missing=sum(each.missing for (_, sender), each in tally.sequences if sender.startswith("agent/")),
        gaps=_gaps(tally),
    )


def _gaps(tally: Tally) -> dict[str, list[tuple[int, int]]]:
    gaps: dict[str, list[tuple[int, int]]] = {}
    for (key, _), sequence in tally.sequences:
        if sequence.gaps:
            gaps.setdefault(key, []).extend(sequence.gaps)
    return gaps


def _event(message: dict[str, Any]) -> dict[str, object]:
    return {name: message[name] for name in ("kind", "text", "from", "sent", "data") if name in message}
