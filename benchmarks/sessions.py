"""How many links one process takes, and what they cost it: sessions at a target that waits for its agents."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator

import zenoh
from rich.table import Table

from benchmarks.common import Row, at_least, children, results
from benchmarks.processes import cpu_seconds, resident_megabytes
from zenoh_cbef.machine import require
from zenoh_cbef.nodes.launch.ports import free_ports
from zenoh_cbef.numbers import number
from zenoh_cbef.protocol.session import Connection, open_session

SESSIONS = 1200
_READY_SECONDS = 120.0


def _client(endpoint: str) -> zenoh.Session:
    config = zenoh.Config()
    settings = {"mode": "client", "connect/endpoints": [endpoint], "scouting/multicast/enabled": False}
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def run(repeats: int) -> Iterator[Table]:
    del repeats  # the kernel keeps closed links for a minute
    require(links=2 * SESSIONS)
    endpoint = f"tcp/127.0.0.1:{free_ports(1)[0]}"
    settings = ["--set", "agents.count=1000", "--set", "network.graph=ring"]
    words = ["target", "tracking", *settings, "--run", "sessions", "--listen", endpoint, "--patience", "600"]
    with children() as family:
        target = family.start("zenoh_cbef", words, {})
        with open_session(Connection(mode="client", connect=[endpoint]), _READY_SECONDS):
            before, began = cpu_seconds(target.pid), time.monotonic()
            sessions = [_client(endpoint) for _ in range(SESSIONS)]
            linked = sum(bool(list(one.info.peers_zid())) for one in sessions)
            seconds, used = time.monotonic() - began, cpu_seconds(target.pid) - before
            memory = resident_megabytes(target.pid)
            for one in sessions:
                one.close()
    yield results(
        f"{SESSIONS} sessions at one target",
        [
            at_least("links", linked, SESSIONS),
            Row("until all are made", number(seconds, "s")),
            Row("the target's processor time for one", number(1e3 * used / SESSIONS, "ms")),
            Row("its resident memory then", number(memory, "MB")),
        ],
    )
