"""The cost of the recorder for the agents: the pace of one run with it and without it, seen from outside."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from rich.table import Table

from benchmarks.by_hand import by_hand
from benchmarks.common import Row, results
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.kinds import ESTIMATE
from zenoh_cbef.protocol.mailbox import Mailbox
from zenoh_cbef.protocol.messages import decode
from zenoh_cbef.protocol.session import Connection, open_session
from zenoh_cbef.scenario.load import load

_STEPS = 1000


def rate(*, recorder: bool) -> float:
    """Measure rounds per second of `tracking` between a tenth and the end, by the estimates of agent 0."""
    overrides = [f"steps={_STEPS}", f"record.required={str(recorder).lower()}"]
    plan = load("tracking", overrides).plan
    times: dict[int, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "run.mcap" if recorder else None
        with by_hand("tracking", overrides, agents=range(plan.scenario.count), log=log) as hand:
            connection = Connection(connect=[hand.endpoints["agent 0"]], gossip=False)
            with open_session(connection) as session:
                mailbox = Mailbox(session, Keys(hand.run).estimate(0), 2 * _STEPS)
                while _STEPS not in times:
                    data = mailbox.receive()
                    if data is not None:
                        step = decode(ESTIMATE, data, run=hand.run, sender="agent/0")["k"]
                        times[step] = time.monotonic()
    first = min(step for step in times if step >= _STEPS // 10)
    return plan.rounds * (_STEPS - first) / (times[_STEPS] - times[first])


def run(repeats: int) -> Iterator[Table]:
    rates: dict[bool, list[float]] = {True: [], False: []}
    for _ in range(repeats):
        for recorder, values in rates.items():
            values.append(rate(recorder=recorder))
    medians = {recorder: statistics.median(values) for recorder, values in rates.items()}
    rows = [
        Row(
            "with recorder" if recorder else "without recorder",
            f"{medians[recorder]:.0f} rounds/s ({min(values):.0f} to {max(values):.0f})",
        )
        for recorder, values in rates.items()
    ]
    rows.append(Row("with / without", f"{medians[True] / medians[False]:.3f}"))
    yield results(f"tracking, {_STEPS} steps, medians of {repeats}", rows)
