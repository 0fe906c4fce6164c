"""What the lab has open: one source, and the orders that were given to it."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path

from zenoh_cbef.errors import UserError
from zenoh_cbef.lab.sources import LogSource, RunSource, Source
from zenoh_cbef.outside.registry import find_run, known_runs
from zenoh_cbef.protocol.session import Connection
from zenoh_cbef.scenario.load import to_toml

_START_SECONDS = 300.0
_PATIENCE_SECONDS = 5.0
_TOLD_LINES = 5
_MOST_LOGS = 20

Connect = Callable[[str], tuple[str, Connection]]
"""From the name of a run to how it is reached. Raises UserError."""


def reach(run: str) -> tuple[str, Connection]:
    """A run of this host, as a client of its target: a peer would hear the target alone."""
    found = find_run(run)
    return found.name, Connection(connect=found.endpoints, mode="client", gossip=False)


class Bench:
    """One lab. number: grows with every source that is opened, so that a page sees that another one is open.

    scenarios: the built-in ones, each with its purpose. connect: how a run is reached by name. measured: whether ranges
    and beacons are read, too, which only viewers show.
    """

    def __init__(self, scenarios: Mapping[str, str], connect: Connect = reach, *, measured: bool = False) -> None:
        self.source: Source | None = None
        self.beside: Source | None = None
        self.number = 0
        self._scenarios, self._connect, self._measured = dict(scenarios), connect, measured
        self._given: list[int] = []
        self._started: subprocess.Popen[str] | None = None
        self._lock = threading.Lock()

    def offered(self) -> dict[str, object]:
        """What can be opened: scenarios with their purposes, runs on this host, logs in logs/, the latest first."""
        logs = sorted(Path("logs").glob("*/run.mcap"), key=lambda path: path.stat().st_mtime, reverse=True)
        named = [path.parent.name for path in logs if not path.parent.is_symlink()]
        return {"scenarios": self._scenarios, "runs": sorted(known_runs()), "logs": named[:_MOST_LOGS]}

    def open_log(self, log: str) -> dict[str, object]:
        """Open a log. Raises UserError."""
        return self._take(LogSource(Path(log), measured=self._measured))

    def put_beside(self, log: str) -> None:
        """Show a log beside what is open, over the same time. Raises UserError."""
        self.beside = LogSource(Path(log))

    def join(self, run: str) -> dict[str, object]:
        """Look at a run that goes on. Raises UserError."""
        name, connection = self._connect(run)
        return self._take(RunSource(name, connection, _PATIENCE_SECONDS, measured=self._measured))

    def start(self, scenario: str, settings: list[str]) -> dict[str, object]:
        """Start a run of its own, as `run` does, and look at it. Raises UserError with what `run` said."""
        if self._started is not None and self._started.poll() is None:
            raise UserError("the run that this lab started goes on; stop it first")
        name = f"lab-{time.strftime('%Y%m%d-%H%M%S')}"
        words = [part for one in settings for part in ("--set", one)]
        command = [sys.executable, "-m", "zenoh_cbef", "run", scenario, *words, "--run", name, "--leashed"]
        self._started = begun = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        until = time.monotonic() + _START_SECONDS
        while name not in known_runs():
            if begun.poll() is not None or time.monotonic() > until:
                begun.terminate()
                said = (begun.communicate()[1] or "").strip().splitlines()
                raise UserError(" ".join(said[-_TOLD_LINES:]).removeprefix("zenoh-cbef: ") or "the run did not start")
            time.sleep(0.05)
        # Its words are read, so that it never waits for a reader; its input stays open until this process ends.
        if begun.stderr is not None:
            threading.Thread(target=begun.stderr.read, daemon=True).start()
        return self.join(name)

    def inject(self, fault: Mapping[str, object], seconds: float | None) -> dict[str, object]:
        """Inject a fault into the run. Raises UserError."""
        added = self._opened().orders.inject(fault, seconds)
        self._given.append(added["number"])
        return {"fault": added["number"], "from": added["from"], "warnings": added.get("warnings", [])}

    def undo(self) -> dict[str, object]:
        """End the fault that was injected last. Raises UserError."""
        if not self._given:
            raise UserError("there is nothing to undo")
        return self.clear(self._given[-1])

    def clear(self, number: int) -> dict[str, object]:
        """End an injected fault. Raises UserError."""
        ended = self._opened().orders.clear([number])
        self._given = [one for one in self._given if one != number]
        return {"ended": ended}

    def stop(self) -> dict[str, object]:
        """End the run. Raises UserError."""
        self._opened().orders.stop()
        return {}

    def hold(self, *, on: bool, steps: int, rounds: int) -> dict[str, object]:
        """Let the run stand still after so many more steps, or rounds of one, or go on. Raises UserError."""
        return {**self._opened().orders.hold(on=on, steps=steps, rounds=rounds)}

    def scenario_text(self) -> str:
        """The scenario that repeats what is open, injected faults included. Raises UserError."""
        source = self._opened()
        with source.lock:
            scene = source.scene
            return to_toml(scene.plan.scenario.changed(steps=scene.newest or scene.plan.scenario.length))

    def close(self) -> None:
        """Let go of what is open, and end a run that this lab started."""
        for source in (self.source, self.beside):
            if source is not None:
                source.close()
        if self._started is not None and self._started.poll() is None:
            self._started.terminate()
            self._started.wait()

    def _opened(self) -> Source:
        if self.source is None:
            raise UserError("nothing is open; choose a scenario, a run or a log")
        return self.source

    def _take(self, source: Source) -> dict[str, object]:
        with self._lock:
            former, self.source, self._given = self.source, source, []
            self.number += 1
        if former is not None:
            former.close()
        return {"number": self.number}
