"""Real processes over real Zenoh sessions; whatever a test starts is gone when it ends, also when it fails."""

import itertools
import json
import os
import random
import signal
import socket
import subprocess
import sys
import threading
import time
import uuid
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import zenoh

from tests.processes.forked import Forked, Process
from tests.waiting import until
from tests.within import within
from zenoh_cbef.outside.registry import known_runs

WITHIN = {"analyze", "cat", "check", "compare", "export", "filter", "info", "merge", "recover", "reestimate", "sim"}
WITHIN |= {"certs", "doctor", "fault", "health", "run", "status", "stop", "timeline", "verify"}
"""Verbs that look at files alone: a test needs no process of theirs, whose start takes longer than their work."""
ON_HOST = ["ip", "netns", "exec"]
COMMAND = [sys.executable, "-m", "zenoh_cbef"]
PLACES = os.environ.get("PYTHONPATH")
CHANCE = random.SystemRandom()
"""Not that of a seed, which tests that run beside this one could have, too."""
SMALL = ["steps=40", "agents.count=4", "network.graph=ring", "consensus.rounds=3"]


def settings(*overrides: str) -> list[str]:
    return [part for one in (*SMALL, *overrides) for part in ("--set", one)]


def outsider(endpoint: str) -> zenoh.Session:
    """A foreign session behind an endpoint: as its client it is heard by all that are linked there, and hears them."""
    return _foreign("client", endpoint, {"timeout_ms": 30_000})


def peer(endpoint: str) -> zenoh.Session:
    """A foreign session that is linked to an endpoint alone, also to one where a process listens only later."""
    return _foreign("peer", endpoint, {})


def _foreign(mode: str, endpoint: str, how: dict[str, int]) -> zenoh.Session:
    config = zenoh.Config()
    retry = {"period_init_ms": 50, "period_max_ms": 100, "period_increase_factor": 1}
    connect = {"endpoints": [endpoint], "retry": retry, **how}
    for key, value in {"mode": mode, "connect": connect, "scouting/multicast/enabled": False}.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def ended(process: Process, status: int = 0, timeout: float = 120) -> tuple[str, str]:
    """What a process printed and said until its end, which must have this exit status."""
    out, err = process.communicate(timeout=timeout)
    assert process.returncode == status, err
    return out, err


def processes_of(run: str) -> dict[int, str]:
    """Pids and command lines of the run's processes that are alive."""
    found = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            try:
                words = (entry / "cmdline").read_bytes().replace(b"\0", b" ").split()
                state = (entry / "stat").read_text().rsplit(")", 1)[1].split()[0]
            except OSError:
                continue
            if run.encode() in words and state != "Z":
                found[int(entry.name)] = b" ".join(words).decode(errors="replace")
    return found


class World:
    """One test's run: its name, its folder, its processes."""

    def __init__(self, folder: Path) -> None:
        self.run = f"test-{uuid.uuid4().hex[:12]}"
        self.folder = folder
        self.log = folder / "run.mcap"
        self._started: list[Process] = []

    def start(self, *arguments: str, prefix: Sequence[str] = ()) -> Process:
        space = Path("/run/netns") / prefix[-1] if [*prefix[:-1]] == ON_HOST else None
        # A fork has imported from other places.
        fresh = (prefix and space is None) or os.environ.get("PYTHONPATH") != PLACES
        process = self._popen(*prefix, *COMMAND, *arguments) if fresh else Forked(arguments, self.folder, space)
        self._started.append(process)
        return process

    def _popen(self, *words: str) -> subprocess.Popen[str]:
        return subprocess.Popen(
            words,
            cwd=self.folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def start_run(self, *overrides: str, options: tuple[str, ...] = ("--no-report",)) -> Process:
        return self.start("run", "tracking", *settings(*overrides), "--run", self.run, "--log", str(self.log), *options)

    def under_way(self, *overrides: str, size: int = 20_000) -> Process:
        """A run that has begun: this host knows of it, and its log has this size in bytes."""
        run = self.start_run(*overrides)
        self.wait_until_known()
        self.wait_for_messages(size)
        return run

    def complete(self, *overrides: str) -> subprocess.CompletedProcess[str]:
        """A run to its end, which must be a good one; its launcher is in this process."""
        return self.done(
            "run", "tracking", *settings(*overrides), "--run", self.run, "--log", str(self.log), "--no-report"
        )

    def done(self, *arguments: str, status: int = 0, prefix: Sequence[str] = ()) -> subprocess.CompletedProcess[str]:
        """A verb called to its end, which must have this exit status."""
        done = self.call(*arguments, prefix=prefix)
        assert done.returncode == status, done.stdout + done.stderr
        return done

    def call(
        self, *arguments: str, timeout: float = 120, prefix: Sequence[str] = ()
    ) -> subprocess.CompletedProcess[str]:
        if arguments[0] in WITHIN and not prefix:
            return within(self.folder, *arguments)
        process = self.start(*arguments, prefix=prefix)
        out, err = process.communicate(timeout=timeout)
        return subprocess.CompletedProcess(arguments, process.returncode, out, err)

    def join(self, endpoint: str) -> list[str]:
        """How a process joins the run behind an endpoint."""
        return ["--run", self.run, "--connect", endpoint, "--patience", "100"]

    def status(self) -> dict[str, Any]:
        """What `status --json` tells of the run; on a busy machine it may not answer at once: nothing then."""
        told: dict[str, Any] = json.loads(self.call("status", "--run", self.run, "--json").stdout or "{}")
        return told

    def metrics(self, log: Path | str | None = None) -> dict[str, Any]:
        """What `analyze --json` finds of a log, by default the run's."""
        told: dict[str, Any] = json.loads(self.call("analyze", str(log or self.log), "--json").stdout)
        return told

    def verdict(self, status: int = 0, log: Path | str | None = None) -> str:
        """What `verify` says of a log, by default the run's, with this exit status."""
        done = self.done("verify", str(log or self.log), status=status)
        assert "Traceback" not in done.stderr
        return done.stdout

    def wait_until_known(self) -> None:
        until(lambda: self.run in known_runs(), "the run did not come")

    def wait_for_messages(self, size: int = 20_000) -> None:
        """Wait until the log has grown, so that the run is surely under way."""
        active = self.log.with_name(self.log.name + ".active")
        # Eight processes begin at once, which takes long on a busy machine.
        until(lambda: active.exists() and active.stat().st_size > size, "the run did not get going", 300.0)

    def pid_of(self, words: str) -> int:
        return next(pid for pid, line in processes_of(self.run).items() if f"zenoh_cbef {words} " in line)

    def wait_until_gone(self) -> dict[int, str]:
        until = time.monotonic() + 100
        while (left := processes_of(self.run)) and time.monotonic() < until:
            time.sleep(0.05)
        return left

    def complete_under(self, attack: Callable[[int], None], target: Process, join: list[str]) -> list[str]:
        """Complete a run whose target waits, while attack(0), attack(1) and so on are called; what all printed."""
        over = threading.Event()

        def go_on() -> None:
            for number in itertools.count():
                if over.is_set():
                    return
                attack(number)

        attacker = threading.Thread(target=go_on)
        attacker.start()
        try:
            others = [self.start("agent", str(agent), *join) for agent in range(4)]
            others.append(self.start("record", *join, "--output", str(self.log)))
            return [ended(process)[0] for process in (target, *others)]
        finally:
            over.set()
            attacker.join()

    def end(self) -> None:
        for process in self._started:
            if process.poll() is None:
                process.kill()
            process.wait()
            for pipe in (process.stdout, process.stderr):
                if pipe is not None:
                    pipe.close()
        for pid in processes_of(self.run):
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                continue


@pytest.fixture
def world(tmp_path: Path):
    one = World(tmp_path)
    yield one
    one.end()


def unused_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    """A port of loopback that no program has, nor takes by chance until the test does.

    The kernel gives outgoing connections, of which there are hundreds at a time, ports from 32768 on.
    """
    while True:
        port = CHANCE.randrange(10_000, 32_768)
        with suppress(OSError), socket.socket(type=kind) as probe:
            probe.bind(("127.0.0.1", port))
            return port


@pytest.fixture
def free_port() -> int:
    return unused_port()


def unused_endpoint() -> str:
    return f"tcp/127.0.0.1:{unused_port()}"


@pytest.fixture
def endpoint() -> str:
    """Where no process listens yet."""
    return unused_endpoint()
