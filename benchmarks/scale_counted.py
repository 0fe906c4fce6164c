"""A run of n agents as processes of this host, counted: links and bytes from sockets, messages from the log.

Linux only: /proc, and `ss` of iproute2.
"""

from __future__ import annotations

import os
import re
import subprocess
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.common import children
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.nodes.launch.ports import free_ports
from zenoh_cbef.protocol.keys import address
from zenoh_cbef.scenario.load import load, to_toml
from zenoh_cbef.scenario.plan import Plan

_STEPS = 10
_STEP_OF_AN_AGENT = 0.02
"""s: few cores have time for so many agents, and the recorder keeps up."""
_PATIENCE = 240.0
_BEGUN = 5_000
"""Bytes of the log for each agent: more than a step."""
_OF_STEPS = {"truth", "beacon", "range", "round", "estimate"}


@dataclass(frozen=True)
class Counted:
    """A run while it went on, by role, of agents the mean.

    links: sockets. out, into: bytes of a step. memory: bytes that no other process shares. cpu: s of a step. heard:
    messages of a step that the recorder has.
    """

    plan: Plan
    links: Mapping[str, float]
    out: Mapping[str, float]
    into: Mapping[str, float]
    memory: Mapping[str, float]
    cpu: Mapping[str, float]
    heard: float

    @property
    def agents(self) -> int:
        """How many there are."""
        return self.plan.scenario.count

    @property
    def cores(self) -> float:
        """How many cores all processes need for a dt of 0.1 s."""
        return 10.0 * (self.agents * self.cpu["agent"] + self.cpu["target"] + self.cpu["recorder"])


@dataclass(frozen=True)
class _Sample:
    """One look at all processes: wall-clock time (ns), and by process id CPU (s), memory, links, bytes out and in."""

    at: int
    cpu: Mapping[int, float]
    memory: Mapping[int, float]
    sockets: Mapping[int, tuple[int, int, int]]


def counted(agents: int, *overrides: str) -> Counted:
    """Run `tracking` with so many agents in realtime, as a fleet, look at it twice, and end it."""
    dt = _STEP_OF_AN_AGENT * agents
    plan = load(
        "tracking", [f"agents.count={agents}", *overrides, "timing.mode=realtime", f"dt={dt}", "steps=5000"]
    ).plan
    run = plan.scenario.name
    with tempfile.TemporaryDirectory() as folder, children() as family:
        source, log = Path(folder) / "scale.toml", Path(folder) / "run.mcap"
        source.write_text(to_toml(plan.scenario), encoding="utf-8")
        [port] = free_ports(1)
        # With so many processes on few cores a link is silent for long, and not broken.
        every = ["--run", run, "--patience", str(_PATIENCE), "--lease-ms", "60000"]
        joins = [*every, "--connect", f"tcp/127.0.0.1:{port}"]
        words = ["target", str(source), *every, "--listen", f"tcp/127.0.0.1:{port}"]
        target = family.start("zenoh_cbef", words, {})
        recorder = family.start("zenoh_cbef", ["record", *joins, "--output", str(log)], {})
        fleet = family.start("zenoh_cbef", ["fleet", f"0-{agents - 1}", *joins], {})
        _wait_until_begun(log, agents)
        roles = {target.pid: "target", recorder.pid: "recorder"} | dict.fromkeys(_last_descendants(fleet.pid), "agent")
        first = _look(roles)
        time.sleep(_STEPS * dt)
        second = _look(roles)
        target.terminate()
        recorder.wait(_PATIENCE)
        messages = _messages(log, first.at, second.at)
    return _told(plan, roles, (first, second), messages)


def _wait_until_begun(log: Path, agents: int) -> None:
    """Until the recorder has heard some steps. Raises RuntimeError where that takes too long."""
    active, until = log.with_name(log.name + ".active"), time.monotonic() + _PATIENCE
    while not (active.exists() and active.stat().st_size > _BEGUN * agents):
        if time.monotonic() > until:
            raise RuntimeError(f"{agents} agents did not begin within {_PATIENCE:.0f} s")
        time.sleep(0.2)


def _last_descendants(pid: int) -> list[int]:
    """The processes below one that have none below themselves: a fleet's agents."""
    children = [int(one) for task in Path(f"/proc/{pid}/task").glob("*/children") for one in task.read_text().split()]
    return [last for child in children for last in _last_descendants(child)] if children else [pid]


def _look(roles: Mapping[int, str]) -> _Sample:
    tick = os.sysconf("SC_CLK_TCK")
    cpu, memory = {}, {}
    at = time.time_ns()
    sockets = _sockets(set(roles))
    for pid in roles:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        cpu[pid] = (int(fields[11]) + int(fields[12])) / tick
        rollup = Path(f"/proc/{pid}/smaps_rollup").read_text()
        private = re.findall(r"^Private_(?:Clean|Dirty): +([0-9]+) kB", rollup, re.MULTILINE)
        memory[pid] = 1024.0 * sum(map(int, private))
    return _Sample(at, cpu, memory, sockets)


def _sockets(pids: set[int]) -> dict[int, tuple[int, int, int]]:
    """Links, bytes sent and bytes received of each process."""
    words = ["ss", "-tinpHO", "state", "established"]
    lines = subprocess.run(words, capture_output=True, text=True, check=True).stdout.splitlines()
    found: dict[int, tuple[int, int, int]] = defaultdict(lambda: (0, 0, 0))
    for line in lines:
        owner = re.search(r"pid=(\d+)", line)
        if owner and int(owner[1]) in pids:
            sent, received = (
                int(one[1]) if (one := re.search(rf"{name}:(\d+)", line)) else 0
                for name in ("bytes_acked", "bytes_received")
            )
            links, out, into = found[int(owner[1])]
            found[int(owner[1])] = links + 1, out + sent, into + received
    return found


def _messages(log: Path, first: int, second: int) -> Counter[str]:
    """How many messages of a step were sent in between, and how many of them are estimates."""
    found: Counter[str] = Counter()
    for message in open_log(log).messages():
        where = address(message.channel.topic)
        if where is not None and where.kind in _OF_STEPS and first < message.publish_time <= second:
            found["all"] += 1
            found["estimates"] += where.kind == "estimate"
    return found


def _told(plan: Plan, roles: Mapping[int, str], looks: tuple[_Sample, _Sample], messages: Counter[str]) -> Counted:
    first, second = looks
    steps = messages["estimates"] / plan.scenario.count
    if not steps:
        raise RuntimeError("not a single step was done while the run was looked at")

    def mean(value: Callable[[int], float]) -> dict[str, float]:
        by_role: dict[str, list[float]] = defaultdict(list)
        for pid, role in roles.items():
            by_role[role].append(value(pid))
        return {role: float(np.mean(values)) for role, values in by_role.items()}

    return Counted(
        plan,
        links=mean(lambda pid: second.sockets[pid][0]),
        out=mean(lambda pid: (second.sockets[pid][1] - first.sockets[pid][1]) / steps),
        into=mean(lambda pid: (second.sockets[pid][2] - first.sockets[pid][2]) / steps),
        memory=mean(lambda pid: second.memory[pid]),
        cpu=mean(lambda pid: (second.cpu[pid] - first.cpu[pid]) / steps),
        heard=messages["all"] / steps,
    )
