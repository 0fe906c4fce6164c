"""From a log to a trace."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.errors import UserError
from zenoh_cbef.log.contents import Contents, Header, open_log, read_contents, read_header
from zenoh_cbef.protocol.messages import BIAS, DISTRUST, BadMessage, nil_to_nan, unpack_floats
from zenoh_cbef.scenario import Scenario, network
from zenoh_cbef.scenario.injected import read_tables, with_faults
from zenoh_cbef.scenario.paths import agent_positions, step_times
from zenoh_cbef.scenario.start import initial_states
from zenoh_cbef.simulator import measured
from zenoh_cbef.trace import Links, Trace, Traffic

Floats = NDArray[np.float64]


_COUNTS = {"received": "delivered"} | {
    name: name for name in ("lost", "late", "injected_lost", "injected_late", "corrupted", "duplicated")
}


def read_trace(path: Path) -> Trace:
    """Read a log, complete or cut off. Raises UserError where it is no log of a run, or holds no step."""
    file = open_log(path)
    header = read_header(file, path)
    contents = read_contents(file, header, rounds=False)
    return trace_of(header, contents, complete=file.complete and not file.damage)


def trace_of(header: Header, contents: Contents, *, complete: bool) -> Trace:
    """The arrays of a log's messages, as far as any agent got."""
    scenario, count = header.scenario, header.scenario.count
    if contents.faults:
        scenario = with_faults(scenario, read_tables(contents.faults))
    steps = max((step for _, step in contents.estimates if step <= scenario.length), default=0)
    if steps == 0:
        raise UserError(f"the log of run {header.run!r} holds no estimate; the run ended before its first step")
    ranges, age = heard_ranges(scenario, contents, steps)
    estimates = _Estimates(count, steps)
    for (agent, step), message in contents.estimates.items():
        if 1 <= step <= steps:
            estimates.put(agent, step, message)
    return Trace(
        name=header.run,
        scenario=scenario,
        time=step_times(scenario, steps),
        truth=_truth(contents, steps),
        positions=logged_positions(scenario, contents, steps),
        ranges=ranges,
        age=age,
        initial=initial_states(scenario),
        estimates=estimates.state,
        covariances=estimates.covariance,
        innovation=estimates.innovation,
        weight=estimates.weight,
        nis=estimates.nis,
        nis_degrees=estimates.nis_degrees,
        distrust=estimates.distrust,
        bias=estimates.bias,
        edges=network.edges(scenario),
        links=_links(scenario, contents),
        traffic=_traffic(contents),
        events=[_event(message) for message in contents.events],
        complete=complete and (header.end or {}).get("status") == "finished",
    )


def heard_ranges(scenario: Scenario, contents: Contents, steps: int) -> tuple[Floats, Floats]:
    """Ranges and ages (n, K) from the logged beacons, NaN and 0 where none was heard."""
    emitted = np.full((scenario.count, steps), np.nan)
    arrived = np.full((scenario.count, steps), np.nan)
    for (agent, step), message in contents.beacons.items():
        if 1 <= step <= steps:
            emitted[agent, step - 1] = nil_to_nan(message["emitted"])
            arrived[agent, step - 1] = nil_to_nan(message["arrived"])
    ranges, age = measured(scenario, emitted, arrived, np.arange(1, steps + 1, dtype=np.float64))
    return ranges, np.where(np.isfinite(age), age, 0.0)


def logged_positions(scenario: Scenario, contents: Contents, steps: int) -> Floats:
    """Where the agents said they were, (n, K, 3); where they said nothing, where the scenario has them."""
    positions = agent_positions(scenario.model_copy(update={"steps": steps}))
    for (agent, step), message in contents.ranges.items():
        if 1 <= step <= steps:
            positions[agent, step - 1] = message["position"]
    return positions


def _truth(contents: Contents, steps: int) -> Floats:
    truth = np.full((steps, 6), np.nan)
    for step, message in contents.truth.items():
        if 1 <= step <= steps:
            truth[step - 1] = message["state"]
    return truth


class _Estimates:
    def __init__(self, count: int, steps: int) -> None:
        self.state = np.full((count, steps, 6), np.nan)
        self.covariance = np.full((count, steps, 6, 6), np.nan)
        self.innovation = np.full((count, steps), np.nan)
        self.weight = np.full((count, steps), np.nan)
        self.nis = np.full((count, steps), np.nan)
        self.nis_degrees = np.zeros((count, steps), dtype=np.int64)
        self.distrust = np.full((count, steps), np.nan)
        self.bias = np.full((count, steps, 3), np.nan)

    def put(self, agent: int, step: int, message: dict[str, Any]) -> None:
        at = (agent, step - 1)
        self.state[at] = message["state"]
        self.innovation[at] = nil_to_nan(message["innovation"])
        self.weight[at] = nil_to_nan(message["weight"])
        self.nis[at], self.nis_degrees[at] = nil_to_nan(message.get("nis")), message.get("nis_degrees", 0)
        self.distrust[at] = nil_to_nan(message.get(DISTRUST))
        self.bias[at] = [nil_to_nan(message.get(name)) for name in BIAS]
        if message["covariance"] is not None:
            try:
                self.covariance[at] = unpack_floats(message["covariance"], 6, 6)
            except BadMessage:
                return


def _links(scenario: Scenario, contents: Contents) -> Links:
    """What the receivers counted: the last counts of each of their lives, and the mean of their latencies."""
    last: dict[int, list[dict[str, Any]]] = {}
    latency: dict[tuple[int, int], list[float]] = {}
    for (agent, _), message in sorted(contents.estimates.items(), key=lambda item: item[0]):
        lives = last.setdefault(agent, [message])
        if message["seq"] < lives[-1]["seq"]:
            lives.append(message)  # It was started again, and counts anew.
        lives[-1] = message
        for source, delay in zip(message["neighbours"], message["latency"], strict=False):
            if delay is not None:
                latency.setdefault((source, agent), []).append(delay)
    rows = []
    for first, second in network.edges(scenario).tolist():
        for source, destination in ((first, second), (second, first)):
            each = [_counts(message, source) for message in last.get(destination, [])]
            counts = np.sum(each, axis=0).tolist() if each else [0] * len(_COUNTS)
            delays = latency.get((source, destination))
            rows.append((destination, source, *counts, np.mean(delays) if delays else np.nan))
    table = np.array(sorted(rows), dtype=np.float64).reshape(-1, 3 + len(_COUNTS))
    destination, source = table[:, :2].astype(np.int64).T
    columns = dict(zip(_COUNTS.values(), table[:, 2:-1].astype(np.int64).T, strict=True))
    sent = columns["delivered"] + columns["lost"] + columns["late"]
    return Links(source=source, destination=destination, sent=sent, **columns, latency=table[:, -1])


def _counts(message: dict[str, Any], source: int) -> list[int]:
    if source not in message["neighbours"]:
        return [0] * len(_COUNTS)
    place = message["neighbours"].index(source)
    return [message[name][place] if name in message else 0 for name in _COUNTS]


def _traffic(contents: Contents) -> Traffic:
    sent = dict(contents.next_seq)
    rejected: dict[str, int] = {}
    for message in contents.events:
        data = message.get("data", {})
        if message["kind"] == "finished" and isinstance(data.get("sent"), dict):
            # What a process says it sent on its own keys is the truth: forged numbers do not count against it.
            sent.update({(key, message["from"]): n for key, n in data["sent"].items() if isinstance(n, int)})
        for name in ("rejected", "total"):
            if isinstance(data.get(name), int):
                rejected[message["from"]] = max(rejected.get(message["from"], 0), data[name])
    total = sum(sent.values())
    return Traffic(
        sent=total,
        recorded=contents.recorded,
        missing=max(0, total - contents.recorded),
        rejected=max(contents.undecodable, sum(rejected.values())),
        agent_bytes=contents.agent_bytes,
    )


def _event(message: dict[str, Any]) -> dict[str, object]:
    return {name: message[name] for name in ("kind", "text", "from", "sent", "data") if name in message}
