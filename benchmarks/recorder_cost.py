"""The cost of the recorder for the agents: the pace of one run with it and without it, seen from outside.

The recorder hears agents over Zenoh, or reads their rings. CPU is that of the recorder's process between its first step
and its end, for each consensus round of the network.
"""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rich.table import Table

from benchmarks.by_hand import by_hand
from benchmarks.common import Row, at_least, results
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.kinds import ESTIMATE
from zenoh_cbef.protocol.mailbox import Mailbox
from zenoh_cbef.protocol.messages import decode
from zenoh_cbef.protocol.session import Connection, open_session
from zenoh_cbef.scenario.load import load

_STEPS = 1000
WITHOUT, ZENOH, RINGS = "without recorder", "recorder over Zenoh", "recorder with rings"
_ARMS = {
    ZENOH: ["record.rings=false"],
    RINGS: ["record.rings=true"],
    WITHOUT: ["record.required=false"],
}


@dataclass(frozen=True)
class Pace:
    """rate: rounds/s of an agent; cpu: of the recorder, us a round of the network, NaN without one."""

    rate: float
    cpu: float


def _cpu_seconds(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def pace(arm: str) -> Pace:
    """Measure `tracking` between a tenth and the end, by the estimates of agent 0."""
    overrides = [f"steps={_STEPS}", *_ARMS[arm]]
    plan = load("tracking", overrides).plan
    times: dict[int, tuple[float, float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        log = None if arm == WITHOUT else Path(folder) / "run.mcap"
        with by_hand("tracking", overrides, agents=range(plan.scenario.count), log=log) as hand:
            connection = Connection(connect=[hand.endpoints["agent 0"]], gossip=False)
            with open_session(connection) as session:
                mailbox = Mailbox(session, Keys(hand.run).estimate(0), 2 * _STEPS)
                while _STEPS not in times:
                    data = mailbox.receive()
                    if data is not None:
                        step = decode(ESTIMATE, data, run=hand.run, sender="agent/0")["k"]
                        used = _cpu_seconds(hand.pids["recorder"]) if log and step in _ends(times) else 0.0
                        times[step] = time.monotonic(), used
    first = min(step for step in times if step >= _STEPS // 10)
    rounds = plan.rounds * (_STEPS - first)
    (began, before), (ended, after) = times[first], times[_STEPS]
    return Pace(rounds / (ended - began), 1e6 * (after - before) / rounds if log else float("nan"))


def _ends(times: dict[int, tuple[float, float]]) -> set[int]:
    """The steps at which CPU is looked at: the first one that counts, and the last."""
    return {_STEPS} | (set() if any(step >= _STEPS // 10 for step in times) else {*range(_STEPS // 10, _STEPS)})


def run(repeats: int) -> Iterator[Table]:
    busy = os.getloadavg()[0]
    found: dict[str, list[Pace]] = {arm: [] for arm in _ARMS}
    for _ in range(repeats):
        for arm, values in found.items():
            values.append(pace(arm))
    rows = []
    for arm, values in found.items():
        rates = [one.rate for one in values]
        text = f"{statistics.median(rates):.0f} rounds/s ({min(rates):.0f} to {max(rates):.0f})"
        rows.append(Row(arm, text))
    for arm, goal in ((ZENOH, None), (RINGS, 0.98)):
        shares = [one.rate / bare.rate for one, bare in zip(found[arm], found[WITHOUT], strict=True)]
        what, value = f"{arm} / without", statistics.median(shares)
        note = f" ({min(shares):.3f} to {max(shares):.3f})"
        rows.append(Row(what, f"{value:.3f}{note}") if goal is None else at_least(what, value, goal, note=note))
        cpu = statistics.median(one.cpu for one in found[arm])
        rows.append(Row(f"{arm}: its CPU a round", f"{cpu:.0f} us"))
    rows.append(Row("load average before", f"{busy:.1f}"))
    yield results(f"tracking, {_STEPS} steps, medians of {repeats}, pair by pair", rows)
