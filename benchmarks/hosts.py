"""A run by hand on ten virtual hosts, as docs/hosts.md starts it: how soon it begins, what it takes, what it carries.

Target and recorder have a host each; each other host has one fleet. All are on this machine, and share its cores.
"""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Protocol

import numpy as np
from rich.table import Table

from benchmarks.common import ROOT, Row, below, results
from benchmarks.processes import agents_of, bytes_on, cpu_seconds, own_megabytes, resident_megabytes
from zenoh_cbef.cli.console import number
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.prove.verify import verify
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.machine import require
from zenoh_cbef.scenario.load import load

HOSTS, AGENTS = 10, 100
_DEGREE = 6.0
_STEPS, _AGENT_STEPS = 30, 12_000
"""Steps of a run, at least, and steps of all its agents together."""
_LEASE_MS = 30_000
"""Long, as all hosts share the cores of one machine: a process that gets none for seconds is not dead."""
_RATE = 10.0
_LIMIT_SECONDS = 280.0
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


def _netlab() -> ModuleType:
    path = ROOT / "deploy" / "netlab" / "netlab.py"
    spec = importlib.util.spec_from_file_location("netlab", path)
    if spec is None or spec.loader is None:
        raise UserError(f"{path} is missing; run benchmarks in the repository")
    module = importlib.util.module_from_spec(spec)
    sys.modules["netlab"] = module
    spec.loader.exec_module(module)
    return module


def settings_of(agents: int, *more: str) -> list[str]:
    """A sparse graph: a denser one has more links with more agents."""
    return [f"agents.count={agents}", f"network.probability={min(0.9, _DEGREE / (agents - 1))}", *more]


class Lab(Protocol):
    """The parts of deploy/netlab's laboratory that are used here."""

    def address(self, host: str) -> str:
        """A host's address."""
        ...

    def command(self, host: str, words: Sequence[str]) -> list[str]:
        """The command that runs a command on a host."""
        ...


def _established(lab: Lab, host: str) -> Counter[int]:
    """The links on a host by the processes that have them."""
    words = lab.command(host, ["ss", "-tnHp", "state", "established"])
    told = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    return Counter(int(pid) for pid in re.findall(r"pid=(\d+)", told))


class _Site:
    """The run's processes on their hosts."""

    def __init__(self, lab: Lab, folder: Path, agents: int, hosts: int) -> None:
        self._lab, self._folder, self._agents = lab, folder, agents
        self._hosts = [f"a{number}" for number in range(hosts)]
        self._running: dict[str, subprocess.Popen[bytes]] = {}
        self._pids: list[int] = []
        self.seen = Seen(time.time_ns(), folder / "run.mcap")

    def _start(self, host: str, *words: str) -> None:
        with (self._folder / f"{host}.err").open("wb") as err:
            self._running[host] = subprocess.Popen(
                self._lab.command(host, [sys.executable, "-m", "zenoh_cbef", *words]),
                cwd=self._folder,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=err,
            )

    def start(self, overrides: Sequence[str]) -> None:
        """Start target and recorder, and a fleet on each other host, all at once."""
        target = f"tcp/{self._lab.address('target')}:7447"
        settings = [part for one in overrides for part in ("--set", one)]
        run = ["--run", "hosts", "--patience", str(_LIMIT_SECONDS), "--lease-ms", str(_LEASE_MS)]
        self._start("target", "target", "tracking", *settings, *run, "--listen", target)
        there = [*run, "--connect", target, "--listen"]
        self._start("record", "record", *there, f"tcp/{self._lab.address('record')}:7448", "--output", "run.mcap")
        for place, host in enumerate(self._hosts):
            first, last = (self._agents * one // len(self._hosts) for one in (place, place + 1))
            self._start(host, "fleet", f"{first}-{last - 1}", *there, "tcp/0.0.0.0:0")

    def watch(self) -> None:
        """Look at the run until it has ended. Raises RuntimeError where a process fails, or it takes too long."""
        until = time.monotonic() + _LIMIT_SECONDS
        target = self._running["target"].pid
        while any(one.poll() is None for one in self._running.values()):
            with suppress(OSError):  # one of them has just ended
                agents = sum(map(cpu_seconds, self._pids))
                received, sent = bytes_on(target, _DEVICE)
                self.seen.samples.append(Sample(time.time_ns(), received, sent, cpu_seconds(target), agents))
            if not self.seen.links and self._under_way() == self._agents:
                self._count()
            failed = [host for host, one in self._running.items() if one.poll()]
            if failed or time.monotonic() > until:
                words = (self._folder / f"{failed[0]}.err").read_text() if failed else "it takes too long"
                raise RuntimeError(f"the run did not end well: {failed} {words}")
            time.sleep(0.1)

    def _under_way(self) -> int:
        """How many agents the fleets say to be under way."""
        said = [(self._folder / f"{host}.err").read_text() for host in self._hosts]
        return sum(int(([0, *re.findall(r"(\d+) under way", one)])[-1]) for one in said)

    def _count(self) -> None:
        links: Counter[int] = sum((_established(self._lab, host) for host in self._hosts), Counter())
        found = agents_of("hosts")
        self._pids = list(found.values())
        self.seen.samples.clear()
        for agent, pid in found.items():
            self.seen.links[agent] = links[pid]
            self.seen.resident.append(resident_megabytes(pid))
            self.seen.own.append(own_megabytes(pid))


def observe(agents: int, overrides: Sequence[str], folder: Path, hosts: int = HOSTS) -> Seen:
    """Run a scenario on so many virtual hosts; none is left. Raises UserError where there can be none."""
    netlab = _netlab()
    if (why := netlab.why_not()) is not None:
        raise UserError(f"no virtual hosts here: {why}")
    require(links=agents + 1, processes=agents, forked=True)
    with netlab.Lab(
        ["target", "record", *(f"a{number}" for number in range(hosts))], f"b{time.time_ns() % 10**6}"
    ) as lab:
        site = _Site(lab, folder, agents, hosts)
        site.start(overrides)
        site.watch()
    return site.seen


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
