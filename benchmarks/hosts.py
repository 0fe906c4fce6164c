"""A run by hand on ten virtual hosts, as docs/hosts.md starts it: how soon it begins, what it takes, what it carries.

Target and recorder have a host each; each other host has one fleet. All are on this machine, and share its cores.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from rich.table import Table

from benchmarks.common import Row, below, results
from benchmarks.processes import agents_of, bytes_on, cpu_seconds, own_megabytes, resident_megabytes
from benchmarks.virtual import Lab, Processes, laboratory, links_on
from zenoh_cbef.log.prove.verify import verify
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.machine import require
from zenoh_cbef.numbers import number
from zenoh_cbef.scenario.load import load

HOSTS, AGENTS = 10, 100
_DEGREE = 6.0
_STEPS, _AGENT_STEPS = 30, 12_000
"""Steps of a run, at least, and steps of all its agents together."""
_LEASE_MS = 30_000
"""Long, as all hosts share the cores of one machine: a process that gets none for seconds is not dead."""
_RATE = 10.0
_LIMIT_SECONDS, _AGENT_SECONDS = 280.0, 2.0
"""How long a run may take: at least, and for each agent."""
_DEVICE = "eth0"


@dataclass(frozen=True)
class Sample:
    """What the target's host had received and sent, bytes, and what had been used, s, at a time, ns.

    cpu: the target's processor time; agents: that of all agents.
    """

    at: int
    received: int
    sent: int
    cpu: float
    agents: float


@dataclass
class Seen:
    """What was seen of a run from outside, and its log. links, memories: of each agent, in MB resident and its own."""

    began: int
    log: Path
    links: dict[int, int] = field(default_factory=dict)
    resident: list[float] = field(default_factory=list)
    own: list[float] = field(default_factory=list)
    samples: list[Sample] = field(default_factory=list)


def settings_of(agents: int, *more: str) -> list[str]:
    """A sparse graph: a denser one has more links with more agents."""
    return [f"agents.count={agents}", f"network.probability={min(0.9, _DEGREE / (agents - 1))}", *more]


class _Watched:
    """The run's processes on their hosts, and what is seen of them."""

    def __init__(self, lab: Lab, folder: Path, agents: int, hosts: int) -> None:
        self._agents, self._limit = agents, max(_LIMIT_SECONDS, _AGENT_SECONDS * agents)
        self._hosts = [f"a{number}" for number in range(hosts)]
        self._processes = Processes(lab, folder)
        self._pids: list[int] = []
        self.seen = Seen(time.time_ns(), folder / "run.mcap")

    def start(self, overrides: Sequence[str]) -> None:
        """Start target and recorder, and a fleet on each other host, all at once."""
        start, address = self._processes.start, self._processes.lab.address
        target = f"tcp/{address('target')}:7447"
        settings = [part for one in overrides for part in ("--set", one)]
        run = ["--run", "hosts", "--patience", str(self._limit), "--lease-ms", str(_LEASE_MS)]
        start("target", "target", "tracking", *settings, *run, "--listen", target)
        there = [*run, "--connect", target, "--listen"]
        start("record", "record", *there, f"tcp/{address('record')}:7448", "--output", "run.mcap")
        for place, host in enumerate(self._hosts):
            first, last = (self._agents * one // len(self._hosts) for one in (place, place + 1))
            start(host, "fleet", f"{first}-{last - 1}", *there, "tcp/0.0.0.0:0")

    def watch(self) -> None:
        """Look at the run until it has ended. Raises RuntimeError where a process fails, or it takes too long."""
        self._processes.watch(self._limit, self._look)

    def _look(self) -> None:
        target = self._processes.pid("target")
        with suppress(OSError):  # one of them has just ended
            agents = sum(map(cpu_seconds, self._pids))
            received, sent = bytes_on(target, _DEVICE)
            self.seen.samples.append(Sample(time.time_ns(), received, sent, cpu_seconds(target), agents))
        if not self.seen.links and self._processes.under_way() == self._agents:
            self._count()

    def _count(self) -> None:
        links: Counter[int] = sum((links_on(self._processes.lab, host) for host in self._hosts), Counter())
        found = agents_of("hosts")
        self._pids = list(found.values())
        self.seen.samples.clear()
        for agent, pid in found.items():
            self.seen.links[agent] = links[pid]
            self.seen.resident.append(resident_megabytes(pid))
            self.seen.own.append(own_megabytes(pid))


def observe(agents: int, overrides: Sequence[str], folder: Path, hosts: int = HOSTS) -> Seen:
    """Run a scenario on so many virtual hosts; none is left. Raises UserError where there can be none."""
    require(links=agents + 1, processes=agents, forked=True)
    with laboratory(["target", "record", *(f"a{number}" for number in range(hosts))]) as lab:
        run = _Watched(lab, folder, agents, hosts)
        run.start(overrides)
        run.watch()
    return run.seen


def _times(seen: Seen) -> tuple[dict[int, int], int]:
    """When the target sent each step, and when the last agent had done the first one, ns."""
    steps: dict[int, int] = {}
    first: dict[str, int] = {}
    for message in open_log(seen.log).messages():
        topic = message.channel.topic
        if topic.endswith("/truth"):
            steps[len(steps) + 1] = message.log_time
        elif topic.endswith("/estimate"):
            first.setdefault(topic, message.log_time)
    return steps, max(first.values())


def _per_step(seen: Seen, steps: dict[int, int]) -> tuple[float, float, float, float]:
    """For a step of the middle of the run: bytes that the target received and sent, its processor time, the agents', s.

    All nan where the run was over before it was looked at.
    """
    times = np.array(list(steps.values()))
    inside = [one for one in seen.samples if times[2] <= one.at <= times[-1]]
    if len(inside) < 2:
        return np.nan, np.nan, np.nan, np.nan
    first, last = inside[0], inside[-1]
    done = float(np.diff(np.interp([first.at, last.at], times, np.arange(len(times))))[0])
    names = ("received", "sent", "cpu", "agents")
    received, sent, cpu, agents = (float(getattr(last, one) - getattr(first, one)) / done for one in names)
    return received, sent, cpu, agents


def measured(agents: int, hosts: int = HOSTS) -> list[Row]:
    """The rows of one run in lockstep."""
    overrides = settings_of(agents, f"steps={max(_STEPS, _AGENT_STEPS // agents)}")
    with tempfile.TemporaryDirectory() as folder:
        seen = observe(agents, overrides, Path(folder), hosts)
        verdict, (steps, begun) = verify(seen.log), _times(seen)
    degrees = np.bincount(load("tracking", overrides).plan.edges.ravel(), minlength=agents)
    over = max((count - int(degrees[agent]) for agent, count in seen.links.items()), default=0)
    received, sent, cpu, all_agents = _per_step(seen, steps)
    times, cores = list(steps.values()), os.cpu_count() or 1
    return [
        below("from the first process to the last agent's first step", 1e-9 * (begun - seen.began), 20.0, "s"),
        Row("links of an agent beyond its degree", f"at most {over}", "at most 2", 0 < over <= 2),
        below("resident memory of an agent", float(np.mean(seen.resident)), 60.0, "MB"),
        Row("of it shared with no other process", number(float(np.mean(seen.own)), "MB")),
        Row("the target receives in a step", number(1e-3 * received, "kB")),
        Row("the target sends in a step", number(1e-3 * sent, "kB")),
        Row("the target's processor time for a step", number(1e3 * cpu, "ms")),
        Row("an agent's processor time for a step", number(1e3 * all_agents / agents, "ms")),
        Row(
            f"agents that these {cores} cores carry at {_RATE:g} Hz",
            number(agents * cores / _RATE / (all_agents or np.nan)),
        ),
        Row("steps per second", number((len(times) - 1) / (1e-9 * (times[-1] - times[0])))),
        Row("verify", verdict.text, "equal", verdict.result == "equal"),
    ]


def run(repeats: int, agents: str | None = None) -> Iterator[Table]:
    del repeats
    for one in map(int, (agents or str(AGENTS)).split(",")):
        yield results(f"{one} agents on {HOSTS} virtual hosts, lockstep", measured(one))
