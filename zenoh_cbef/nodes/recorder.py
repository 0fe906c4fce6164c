"""The recorder process: writes everything that crosses the network into one log, and survives being killed."""

from __future__ import annotations

import threading
import time
import tomllib
from collections.abc import Callable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from platform import node as host_name
from typing import Any

import numpy as np

from zenoh_cbef import __version__
from zenoh_cbef.log.run_log import RunLog
from zenoh_cbef.nodes.attendance import Attendance
from zenoh_cbef.nodes.node import Identity, Node, heard_token
from zenoh_cbef.protocol.keys import agent_of
from zenoh_cbef.protocol.mailbox import Mailbox
from zenoh_cbef.protocol.messages import BadMessage, decode
from zenoh_cbef.protocol.scenario_service import fetch_scenario
from zenoh_cbef.scenario.load import parse
from zenoh_cbef.scenario.model import Record

_CAPACITY = 1 << 18
_REPORT_SECONDS = 0.2
_GATHER_SECONDS = 0.005
_PORTION = 10_000


@dataclass
class Status:
    """What the recorder sees of a run.

    step: what all estimates have reached; error: the network's position error (m) there. messages: recorded.
    lost, late: on links, as their receivers counted. missing: gaps in the sequence numbers of what was recorded.
    """

    run: str
    log: str
    steps: int
    step: int = 0
    error: float | None = None
    messages: int = 0
    lost: int = 0
    late: int = 0
    missing: int = 0
    state: str = "recording"


class _Overview:
    """Keeps a Status up to date from the messages that go by."""

    def __init__(self, status: Status, present: Callable[[], int]) -> None:
        self.status = status
        self._present = present
        self._expected = 1
        self._truth: dict[int, list[float]] = {}
        self._errors: dict[int, list[float]] = {}
        self._links: dict[int, tuple[int, int]] = {}

    def see(self, kind: str, key: str, data: bytes) -> None:
        """Take one truth or estimate message into account."""
        try:
            message = decode(kind, data, run=self.status.run)
        except BadMessage:
            return
        step = message["k"]
        if kind == "truth":
            self._truth[step] = message["state"]
            return
        self._links[agent_of(key)] = (sum(message["lost"]), sum(message["late"]))
        truth = self._truth.get(step)
        if truth is None:
            return
        errors = self._errors.setdefault(step, [])
        errors.append(sum((a - b) ** 2 for a, b in zip(message["state"][:3], truth[:3], strict=True)))
        # At the end everybody has left before their last words are read.
        self._expected = self._present() or self._expected
        if len(errors) >= self._expected:
            self.status.step = step
            self.status.error = float(np.sqrt(np.mean(errors)))
            self.status.lost = sum(lost for lost, _ in self._links.values())
            self.status.late = sum(late for _, late in self._links.values())
            for old in [known for known in self._truth if known <= step]:
                self._truth.pop(old)
                self._errors.pop(old, None)


class Recorder:
    """Takes messages off the network and puts them into the log."""

    def __init__(self, node: Node, log: RunLog, overview: _Overview, mailbox: Mailbox) -> None:
        self.node, self.log, self.overview = node, log, overview
        self._mailbox = mailbox
        self._lock = threading.Lock()
        self._done = threading.Event()
        self._promised: dict[tuple[str, str], int] = {}
        self._acknowledged: set[str] = set()
        self.target_ended: int | None = None
        self._attendance = Attendance(node, self._tell)
        node.on_stop(self._mailbox.wake)

    def run(self, *, flush_seconds: float, sync: bool, report: Callable[[Status], None]) -> None:
        """Record until everybody has left, or until told to stop."""
        ticker = threading.Thread(target=self._tick, args=(flush_seconds, sync, report), daemon=True)
        ticker.start()
        try:
            while not self._finished():
                self._write_waiting(self._mailbox.receive_from())
                # Being woken for every single message costs more than writing it: let a few gather.
                time.sleep(_GATHER_SECONDS)
            self._write_waiting(self._mailbox.poll_from())
        finally:
            self._done.set()
            ticker.join()

    def _write_waiting(self, received: tuple[str, bytes] | None) -> None:
        """Write a message and those behind it.

        No more than a portion: in a flood, too, the log is flushed and the end of the run is seen.
        """
        left = _PORTION
        with self._lock:
            while received is not None:
                self._write(*received)
                left -= 1
                received = self._mailbox.poll_from() if left else None

    def _tick(self, flush_seconds: float, sync: bool, report: Callable[[Status], None]) -> None:
        flushed = time.monotonic()
        while not self._done.wait(min(flush_seconds, _REPORT_SECONDS)):
            if time.monotonic() - flushed >= flush_seconds:
                with self._lock:
                    self.log.flush(sync=sync)
                flushed = time.monotonic()
            self._mailbox.wake()
            report(self.status())

    def status(self) -> Status:
        """The present state of affairs."""
        status = self.overview.status
        status.messages, status.missing = self.log.count, self.log.missing
        return status

    def _write(self, key: str, data: bytes) -> None:
        kind = self.log.add(key, data, time.time_ns())
        if kind in ("truth", "estimate"):
            self.overview.see(kind, key, data)
        elif kind == "event":
            self._note_promises(data)

    def _note_promises(self, data: bytes) -> None:
        try:
            message = decode("event", data, run=self.node.identity.run)
        except BadMessage:
            return
        told: dict[Any, Any] = message.get("data", {})
        self._acknowledge(message["from"], told.get("word"))
        sent = told.get("sent")
        if message["kind"] in {"finished", "killed"}:
            self._attendance.farewell(message["from"])
        if message["kind"] == "finished" and message["from"] == "target" and isinstance(told.get("step"), int):
            self.target_ended = told["step"]
        if message["kind"] == "finished" and isinstance(sent, dict):
            for key, count in sent.items():
                if isinstance(key, str) and isinstance(count, int):
                    self._promised[key, message["from"]] = count

    def _acknowledge(self, sender: str, word: object) -> None:
        """Tell a process that is about to leave that all it sent has come."""
        known = sender == "target" or sender in self.node.presence
        if known and isinstance(word, int) and (token := heard_token(sender, word)) not in self._acknowledged:
            self._acknowledged.add(token)
            self.node.presence.announce(token)

    def _tell(self, kind: str, text: str, name: str) -> None:
        data = self.node.events.send(kind=kind, text=text, data={"name": name})
        with self._lock:
            self._write(self.node.keys.event, data)

    def _finished(self) -> bool:
        """Whether all who were here have left and what they say they sent has come, or we are told to stop."""
        lacking = any(self.log.lacks(*name, count) for name, count in self._promised.items())
        return self.node.stopping or self._attendance.over(lacking=lacking)


def run_recorder(
    identity: Identity,
    path: Path,
    *,
    sync: bool,
    report: Callable[[Status], None],
) -> Status:
    """Run the recorder process until the run ends or it is told to stop; returns the last status."""
    with Node(identity) as node:
        # Subscribed before anybody can see us: nothing is sent before we listen.
        mailbox = Mailbox(node.session, node.keys.everything, _CAPACITY)
        text = fetch_scenario(node.session, identity.run, patience=identity.patience, stopped=lambda: node.stopping)
        scenario = parse(tomllib.loads(text.resolved), f"the scenario of run {identity.run!r}")
        settings: Record = scenario.record
        log = RunLog(path, settings)
        log.describe(
            source=text.source,
            resolved=text.resolved,
            run={
                "run": identity.run,
                "name": scenario.name,
                "seed": str(scenario.seed),
                "version": __version__,
                "host": host_name(),
                "started": datetime.now(UTC).isoformat(),
            },
        )
        overview = _Overview(
            Status(identity.run, str(path), scenario.length),
            lambda: sum(name.startswith("agent/") for name in node.presence.names()),
        )
        recorder = Recorder(node, log, overview, mailbox)
        node.presence.announce(f"record/{identity.name}")
        try:
            recorder.run(flush_seconds=settings.flush_seconds, sync=sync, report=report)
        finally:
            status = recorder.status()
            finished = recorder.target_ended == scenario.length
            log.close({"status": "finished" if finished else "stopped", **_text(status)})
        status.state = "done"
        report(status)
        node.presence.withdraw()
    return status


def _text(status: Status) -> dict[str, str]:
    return {name: str(value) for name, value in asdict(status).items() if name != "state"}
