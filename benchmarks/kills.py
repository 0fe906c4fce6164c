"""What kill -9 costs: a recorder is killed at random moments, and its log must hold all that is older than a second."""

from __future__ import annotations

import random
import signal
import statistics
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from rich.table import Table

from benchmarks.by_hand import by_hand
from benchmarks.common import Children, Row, children, results
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.nodes.launch.ports import free_ports
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.memory import Memory
from zenoh_cbef.protocol.outbox import Outbox
from zenoh_cbef.protocol.session import Connection, open_session

KILLS = 200
_SENDER = "receiver/probe"
_AGE = 1.0
_PAUSE = 0.0005
_START_SECONDS, _LOOK_SECONDS = 60.0, 0.05


@dataclass(frozen=True)
class Kill:
    """One kill. older: messages sent more than a second before it; lost: those of them that are not in the log.

    cut: age of the oldest message that the log lacks, s. signal: how the recorder ended.
    """

    older: int
    lost: int
    cut: float
    signal: int


class Kills:
    """A run that does not begin, with a peer that sends events all the time, and recorders that are killed.

    pause: s, after each message; by default a recorder has as many as it can take.
    """

    def __init__(self, folder: Path, pause: float = _PAUSE) -> None:
        self._folder, self._pause = folder, pause
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        hand = self._stack.enter_context(by_hand("tracking", [], agents=[]))
        self._run = hand.run
        (port,) = free_ports(1)
        here = f"tcp/127.0.0.1:{port}"
        self._hubs = [hand.endpoints["target"], here]
        connection = Connection(listen=[here], connect=self._hubs[:1], gossip=False)
        session = self._stack.enter_context(open_session(connection))
        self._key = key = Keys(self._run).event(_SENDER)
        who = {"run": self._run, "sender": _SENDER}
        # It waits where the recorder does not keep up: what a sender drops, and cannot be asked for, no log has.
        self._events = Outbox(session, key, **who, may_drop=False, clock=time.time_ns, memory=Memory())
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def kill(self, number: int, after: float) -> Kill:
        """Start a recorder, and kill it a second and some time after the first of our messages is in its log.

        Only what is sent from then on is due. While a session joins, Zenoh may hand it one message and not the next; a
        recorder asks processes of the run for those, and this sender, which is none, would not answer.
        """
        log = self._folder / f"{number}.mcap"
        sent: list[tuple[int, float]] = []
        with children() as family:
            recorder = self._start(family, log)
            until = time.monotonic() + _START_SECONDS
            while not self._found(log) and time.monotonic() < until:
                self._send(sent, _LOOK_SECONDS)
            first = self._events.sent
            self._send(sent, _AGE + after)
            killed = time.monotonic()
            recorder.kill()
            recorder.wait()
        found = self._found(log)
        due = [(seq, killed - at) for seq, at in sent if seq >= first]
        old = [seq for seq, age in due if age > _AGE]
        missing = [age for seq, age in due if seq not in found]
        return Kill(len(old), len({*old} - found), max(missing, default=0.0), recorder.returncode)

    def _send(self, sent: list[tuple[int, float]], seconds: float) -> None:
        """Send for so long, and note number and time of each message."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            sent.append((self._events.sent, time.monotonic()))
            self._events.send(kind="note", text="x" * 100)
            time.sleep(self._pause)

    def _found(self, log: Path) -> set[int]:
        """The numbers of our messages that are in a log; none where there is no log yet."""
        with suppress(UserError):
            return {one.sequence for one in open_log(log).messages() if one.channel.topic == self._key}
        return set()

    def _start(self, family: Children, log: Path) -> subprocess.Popen[bytes]:
        links = [part for endpoint in self._hubs for part in ("--connect", endpoint)]
        arguments = ["record", "--run", self._run, "--no-gossip", "--patience", "30", "--output", str(log), *links]
        return family.start("zenoh_cbef", arguments, {})


def run(repeats: int) -> Iterator[Table]:
    """Kill recorders, and count lost messages; nothing is timed, so `repeats` changes nothing."""
    del repeats
    noise = random.Random(1)  # noqa: S311 - the same kills each time
    with tempfile.TemporaryDirectory() as folder, Kills(Path(folder)) as kills:
        done = [kills.kill(number, noise.uniform(0.0, 1.0)) for number in range(KILLS)]
    assert all(one.signal == -signal.SIGKILL and one.older > 0 for one in done)
    lost, older, cut = sum(one.lost for one in done), sum(one.older for one in done), [one.cut for one in done]
    rows = [
        Row(f"messages older than {_AGE:g} s that were lost, of {older}", str(lost), "0", lost == 0),
        Row("oldest message that was lost: age, median", f"{statistics.median(cut):.3f} s"),
        Row("the same, largest", f"{max(cut):.3f} s"),
    ]
    yield results(f"{KILLS} recorders killed at random moments", rows)
