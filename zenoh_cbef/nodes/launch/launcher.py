"""Starts target, agents and recorder as processes of their own on this host, and leaves none behind."""

from __future__ import annotations

import json
import math
import os
import selectors
import signal
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from zenoh_cbef.machine import keep_to_core
from zenoh_cbef.nodes.common.ending import PLACE, Ending, ending_at
from zenoh_cbef.nodes.common.node import LEASH, RUN
from zenoh_cbef.nodes.common.recording import Status
from zenoh_cbef.nodes.launch.children import Child, Nursery, how_ended, last_words
from zenoh_cbef.nodes.launch.ports import free_ports
from zenoh_cbef.protocol.ring_folder import clear_rings
from zenoh_cbef.protocol.runtimes import ONE_RUNTIME, RUNTIME
from zenoh_cbef.scenario.load import Loaded

_POLITE_SECONDS = 6.0
_UNBEGUN_SECONDS = 1.0
"""How long agents may take to end that perhaps never met the target, and would wait for one."""
_LAST_SECONDS = 3.0
_ENDING_SECONDS = 20.0
"""How long the other processes may take to end after the target: their last words take ten at most."""
_PATIENCE_SECONDS = 30.0
"""The others are started together with the target, which may have a large world to make before it answers."""


@dataclass(frozen=True)
class Death:
    """A process that failed, was killed, or hung.

    status: its exit status; negative for a signal, 0 for one that hung. words: its last words on standard error.
    ending: the reason, where it left one.
    """

    name: str
    status: int
    words: str
    ending: Ending | None = None

    def __str__(self) -> str:
        how = how_ended(self.status) if self.status else "had to be ended"
        return f"{self.name} {how}" + (f": {self.words}" if self.words else "")


class Launcher:
    """All processes of one run. Use as a context manager: leaving it ends every process.

    arguments: the scenario as the command line gave it (a name or file, and --set options), which the target
    reads for itself. loaded: the same, read here for the graph.
    """

    def __init__(self, arguments: Sequence[str], loaded: Loaded, run: str, log: Path, *, sync: bool = False) -> None:
        self._arguments, self._loaded, self._run = list(arguments), loaded, run
        self._log, self._sync = log, sync
        self._processes: dict[str, Child] = {}
        self.endpoint = ""
        self._commands: dict[str, list[str]] = {}
        self._restarts: dict[str, float] = {}
        self._ended: set[str] = set()
        self._told: set[str] = set()
        self._status: Status | None = None
        self._asked_at: float | None = None
        self._finished_at = math.inf
        self.deaths: list[Death] = []

    def __enter__(self) -> Self:
        self._folder = tempfile.TemporaryDirectory(prefix="zenoh-cbef-")
        self._nursery = Nursery().__enter__()
        self._reports = os.pipe()
        try:
            self._start_all()
        except BaseException:
            self._clear()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._clear()

    def _clear(self) -> None:
        self.kill()
        self._nursery.__exit__()
        if self._loaded.scenario.record.rings:
            clear_rings(self._run)
        for end in self._reports:
            os.close(end)
        self._folder.cleanup()

    def _start_all(self) -> None:
        count = self._loaded.scenario.count
        scheme = "tls" if self._loaded.scenario.zenoh.tls else "tcp"
        endpoints = [f"{scheme}/127.0.0.1:{port}" for port in free_ports(count + 2)]
        self.endpoint, recorder, agents = endpoints[0], endpoints[1], endpoints[2:]
        extra = list(self._loaded.scenario.zenoh.listen)
        self._start("target", ["target", *self._arguments], listen=[self.endpoint, *extra], connect=[])
        log = ["--output", str(self._log), "--status-json", *(["--sync"] if self._sync else [])]
        self._start("recorder", ["record", *log], listen=[recorder], connect=[self.endpoint])
        lower: list[list[str]] = [[] for _ in range(count)]
        for first, second in self._loaded.plan.edges.tolist():
            lower[second].append(agents[first])
        for agent in range(count):
            connect = [self.endpoint, recorder, *lower[agent]]
            self._start(f"agent {agent}", ["agent", str(agent)], listen=[agents[agent]], connect=connect)

    def _start(self, name: str, command: list[str], *, listen: Sequence[str], connect: Sequence[str]) -> None:
        settings = self._loaded.scenario.zenoh
        command += ["--run", self._run, "--no-gossip", "--lease-ms", str(settings.lease_ms)]
        command += ["--tls", settings.tls] if settings.tls else []
        command += [] if name == "target" else ["--patience", str(_PATIENCE_SECONDS)]
        for option, endpoints in (("--listen", listen), ("--connect", connect)):
            for endpoint in endpoints:
                command += [option, endpoint]
        self._spawn(name, command)

    def _spawn(self, name: str, command: list[str]) -> None:
        self._commands[name] = command
        place = self._ending(name)
        place.unlink(missing_ok=True)
        environment = {LEASH: RUN, PLACE: str(place), RUNTIME: ONE_RUNTIME}
        output = self._reports[1] if name == "recorder" else None
        child = self._nursery.start(command, environment, self._words(name), output)
        if name.startswith("agent"):
            keep_to_core(child.pid, int(name.removeprefix("agent ")), self._loaded.scenario.count)
        self._processes[name] = child

    def _words(self, name: str) -> Path:
        return Path(self._folder.name) / name.replace(" ", "-")

    def _ending(self, name: str) -> Path:
        return self._words(name).with_suffix(".json")

    def pids(self) -> dict[str, int]:
        """The processes by name."""
        return {name: process.pid for name, process in self._processes.items()}

    def watch(
        self,
        on_status: Callable[[Status], None],
        asked_to_stop: Callable[[], int],
        on_death: Callable[[Death], None] = lambda _: None,
    ) -> None:
        """Watch until every process has ended.

        on_status gets the recorder's reports, on_death at once the deaths of a run that has begun. asked_to_stop: how
        often the user asked; once stops the run cleanly, twice at once. A process that dies before the first step ends
        the run.
        """
        with selectors.DefaultSelector() as selector:
            selector.register(self._reports[0], selectors.EVENT_READ)
            while len(self._ended) < len(self._processes) or self._restarts:
                for _ in selector.select(0.05):
                    self._read_status(on_status)
                known = len(self.deaths)
                self._note_ends()
                for death in self.deaths[known if self.started else len(self.deaths) :]:
                    on_death(death)
                self._restart()
                self._obey(asked_to_stop())

    def _read_status(self, on_status: Callable[[Status], None]) -> None:
        for line in os.read(self._reports[0], 1 << 16).splitlines():
            try:
                self._status = Status(**json.loads(line))
            except ValueError:  # half a line: the next report is due in a moment
                continue
            on_status(self._status)

    def _note_ends(self) -> None:
        for name, process in self._processes.items():
            status = process.poll()
            if status is None or name in self._ended:
                continue
            self._ended.add(name)
            if name == "target" and status == 0:
                self._finished_at = time.monotonic()
            ending = ending_at(self._ending(name))
            if status == -signal.SIGKILL and ending is not None and ending.cause == "crash":
                self._plan_restart(name, ending.steps_away)
            elif status != 0 and not (status < 0 and name in self._told):
                self.deaths.append(Death(name, status, last_words(self._words(name)), ending))

    def _plan_restart(self, name: str, steps: int | None) -> None:
        """Where the scenario has an agent come back: at once in lockstep, as the others wait for it."""
        if steps is not None:
            scenario = self._loaded.scenario
            away = steps * scenario.dt if scenario.timing.mode == "realtime" else 0.0
            self._restarts[name] = time.monotonic() + away

    def _restart(self) -> None:
        if "target" in self._ended or self._asked_at is not None:
            self._restarts.clear()
        for name in [name for name, due in self._restarts.items() if time.monotonic() >= due]:
            del self._restarts[name]
            self._ended.discard(name)
            self._spawn(name, self._commands[name])

    @property
    def lost_a_port(self) -> bool:
        """Whether the run did not start because another program took one of its ports first."""
        causes = [death.ending.cause for death in self.deaths if death.ending is not None]
        return not self.started and "port" in causes

    @property
    def started(self) -> bool:
        """Whether a first step was seen."""
        return self._status is not None and self._status.began

    def _obey(self, asked: int) -> None:
        now = time.monotonic()
        if self._loaded.scenario.record.on_full == "stop" and any(death.name == "recorder" for death in self.deaths):
            asked = max(asked, 1)
        if asked > 1:
            self.kill()
        elif self._asked_at is not None:
            waited = now - self._asked_at
            if waited > _POLITE_SECONDS + _LAST_SECONDS:
                hung = [name for name in self._processes if name not in self._ended]
                self.kill()
                self.deaths += [Death(name, 0, "it did not answer any more") for name in hung]
            elif waited > (_POLITE_SECONDS if self.started or "target" not in self._ended else _UNBEGUN_SECONDS):
                self._terminate(set(self._processes))
        elif asked and "target" not in self._ended:
            # The target ends the run for all at the same step.
            self._asked_at = now
            self._terminate({"target"})
        elif asked or (self.deaths and not self.started):
            self._asked_at = now
            self._terminate(set(self._processes))
        elif self._over():
            # The processes that are left are about to end, or hang.
            self._asked_at = now

    def _over(self) -> bool:
        """Whether all that the run needs has ended: what is left hangs, or ends in a moment."""
        agents = self._processes.keys() - {"target", "recorder"}
        if self._restarts or time.monotonic() > self._finished_at + _ENDING_SECONDS:
            return not self._restarts
        heard_all = self._processes["recorder"].poll() == 0
        return agents <= self._ended or heard_all or {"target", "recorder"} <= self._ended

    def _terminate(self, names: set[str]) -> None:
        for name in names - self._ended:
            self._told.add(name)
            self._processes[name].send(signal.SIGTERM)

    def kill(self) -> None:
        """End every process now; the recorder gets a moment to close its file."""
        for name, process in self._processes.items():
            if process.poll() is None:
                self._told.add(name)
                process.send(signal.SIGTERM if name == "recorder" else signal.SIGKILL)
        for process in self._processes.values():
            if process.wait(_LAST_SECONDS) is None:
                process.send(signal.SIGKILL)
                process.wait(_LAST_SECONDS)
