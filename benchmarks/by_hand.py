"""A run whose processes are started one by one, so that some of them can be left out."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.common import children
from benchmarks.watched import WATCHED
from zenoh_cbef.machine import keep_to_core
from zenoh_cbef.nodes.common.node import LEASH, RUN
from zenoh_cbef.nodes.launch.ports import free_ports
from zenoh_cbef.protocol.runtimes import ONE_RUNTIME, RUNTIME
from zenoh_cbef.scenario.load import load

_SECONDS = 300.0


@dataclass(frozen=True)
class ByHand:
    """A run's processes. pids and endpoints by name: "target", "recorder", "agent 0", ..."""

    run: str
    pids: dict[str, int]
    endpoints: dict[str, str]


@contextmanager
def by_hand(
    name: str,
    overrides: Sequence[str],
    *,
    agents: Sequence[int],
    log: Path | None = None,
    watched: Mapping[str, str] | None = None,
    watching: str = "benchmarks.watched",
) -> Iterator[ByHand]:
    """Start target, some agents, and a recorder where a log is given; all end with the block.

    watched: the environment of agent 0, where it is to tell what its steps cost, and watching: the
    module that it then is.
    """
    plan = load(name, overrides).plan
    run = f"by-hand-{name}-{time.time_ns()}"
    names = ["target", *(["recorder"] if log else []), *(f"agent {agent}" for agent in agents)]
    ports = free_ports(len(names))
    endpoints = {name: f"tcp/127.0.0.1:{port}" for name, port in zip(names, ports, strict=True)}
    common = ["--run", run, "--no-gossip"]
    settings = [part for override in overrides for part in ("--set", override)]
    commands: dict[str, tuple[list[str], list[str]]] = {
        "target": (["target", name, *settings, "--patience", "600"], [])
    }
    hubs = [endpoints["target"]]
    if log:
        commands["recorder"] = (["record", "--output", str(log)], hubs.copy())
        hubs.append(endpoints["recorder"])
    edges = plan.edges.tolist()
    for agent in agents:
        lower = [endpoints[f"agent {a}"] for a, b in edges if b == agent and a in agents]
        commands[f"agent {agent}"] = (["agent", str(agent)], [*hubs, *lower])
    environment = {LEASH: RUN, RUNTIME: ONE_RUNTIME}
    with children() as family:
        pids = {}
        for process, (command, connect) in commands.items():
            links = [part for endpoint in connect for part in ("--connect", endpoint)]
            watches = watched is not None and process == "agent 0"
            child = family.start(
                watching if watches else "zenoh_cbef",
                [*command, *common, "--listen", endpoints[process], *links],
                environment | dict(watched or {}),
            )
            pids[process] = child.pid
            if command[0] == "agent":
                keep_to_core(child.pid, int(command[1]), len(agents))
        yield ByHand(run, pids, endpoints)


def told_by(
    name: str,
    overrides: Sequence[str],
    *,
    agents: Sequence[int],
    recorded: bool = False,
    watched: Mapping[str, str] | None = None,
    watching: str = "benchmarks.watched",
) -> dict[str, Any]:
    """What agent 0 of such a run tells, with the module `watching` in its place. watched: its further environment."""
    with tempfile.TemporaryDirectory() as folder:
        told, log = Path(folder) / "told.json", Path(folder) / "run.mcap"
        environment = {WATCHED: str(told), **(watched or {})}
        recorder = log if recorded else None
        with by_hand(name, overrides, agents=agents, log=recorder, watched=environment, watching=watching):
            until = time.monotonic() + _SECONDS
            while not (told.exists() and told.read_text(encoding="utf-8")):
                if time.monotonic() > until:
                    raise RuntimeError("the watched agent has not come to its end")
                time.sleep(0.1)
        found: dict[str, Any] = json.loads(told.read_text(encoding="utf-8"))
        return found
