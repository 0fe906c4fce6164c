"""What kill -9 costs with rings: recorders and agents are killed in turn while all cores are busy.

A listener that is linked to the target and to every agent, as a neighbour is, notes each message that it hears. All of
them have to be in the recorders' logs, and none twice in one. The run then goes on for some minutes at full rate, and
it looks how full the rings get.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

from rich.table import Table

from benchmarks.common import Row, below, children, results
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.nodes.common.node import LEASH, RUN
from zenoh_cbef.nodes.launch.ports import free_ports
from zenoh_cbef.protocol.keys import Keys, address
from zenoh_cbef.protocol.mailbox import Mailbox
from zenoh_cbef.protocol.messages import BadMessage, unpack
from zenoh_cbef.protocol.ring import fill_of
from zenoh_cbef.protocol.ring_folder import FOLDER
from zenoh_cbef.protocol.runtimes import ONE_RUNTIME, RUNTIME
from zenoh_cbef.protocol.session import Connection, open_session

_AGENTS = 4
_STEPS = 300_000
"""More than are made in half an hour."""
_SET = ["record.rings=true", "record.ring_bytes=8000000", f"agents.count={_AGENTS}", "network.graph=ring"]
_SETTINGS = [*_SET, f"steps={_STEPS}", "record.required=false"]
_LISTENED = 1 << 17
_PAUSE_SECONDS = 0.5
_START_SECONDS = 60.0

Said = tuple[str, int, int]
"""Key, number and sending time of a message."""


def _in_a_ring(key: str) -> bool:
    """Whether messages of a key are left in rings."""
    at = address(key)
    return at is not None and at.kind in {"truth", "beacon", "range", "round", "estimate", "smoothed"}


@dataclass
class Found:
    """kills by what was killed; heard: messages that the listener heard; lost, twice; fullest: part of a ring."""

    kills: Counter[str] = field(default_factory=Counter)
    heard: int = 0
    lost: int = 0
    twice: int = 0
    fullest: float = 0.0


class Soak:
    """A run by hand at full rate, whose recorder and agents are started again when they were killed."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._run = f"ring-soak-{time.time_ns()}"
        names = ["target", "record", *map(str, range(_AGENTS))]
        self._ends = dict(zip(names, [f"tcp/127.0.0.1:{port}" for port in free_ports(len(names))], strict=True))
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._logs: list[Path] = []
        self._heard: set[Said] = set()
        self._latest: dict[str, Said] = {}
        self._over = threading.Event()
        self.found = Found()

    def __enter__(self) -> Self:
        self._stack = ExitStack()
        self._family = self._stack.enter_context(children())
        settings = [part for one in _SETTINGS for part in ("--set", one)]
        self._start("target", ["target", "tracking", *settings], [])
        self.start_recorder()
        for agent in range(_AGENTS):
            self.start_agent(agent)
        connection = Connection(
            connect=[self._ends[one] for one in ("target", *map(str, range(_AGENTS)))], gossip=False
        )
        session = self._stack.enter_context(open_session(connection))
        self._box = Mailbox(session, Keys(self._run).everything, _LISTENED)
        self._listener = threading.Thread(target=self._listen)
        self._listener.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._box.wake()
        self._listener.join()
        self._stack.close()

    def _start(self, name: str, command: list[str], connect: list[str]) -> None:
        words = [*command, "--run", self._run, "--no-gossip", "--listen", self._ends[name], "--patience", "600"]
        words += [part for one in connect for part in ("--connect", self._ends[one])]
        environment = {LEASH: RUN, RUNTIME: ONE_RUNTIME, FOLDER: str(self._folder / "rings")}
        self._processes[name] = self._family.start("zenoh_cbef", words, environment)

    def start_recorder(self) -> None:
        """Start the next recorder, and wait until it writes."""
        log = self._folder / f"{len(self._logs)}.mcap"
        self._logs.append(log)
        self._start("record", ["record", "--output", str(log)], ["target", *map(str, range(_AGENTS))])

    def await_recorder(self) -> None:
        """Wait until the log of the latest recorder grows."""
        active = self._logs[-1].with_name(self._logs[-1].name + ".active")
        until = time.monotonic() + _START_SECONDS
        while not (active.exists() and active.stat().st_size > 20_000) and time.monotonic() < until:
            time.sleep(0.02)

    def start_agent(self, agent: int) -> None:
        """Start an agent, for the first time or again."""
        others = [str(one) for one in range(_AGENTS) if one != agent]
        self._start(str(agent), ["agent", str(agent)], ["target", "record", *others])

    def kill(self, name: str) -> None:
        """Kill -9."""
        self._processes[name].kill()
        self._processes[name].wait()
        self.found.kills["recorders" if name == "record" else "agents"] += 1

    def await_agent(self, agent: int) -> None:
        """Wait until an agent is heard that was started just now."""
        key, since = Keys(self._run).estimate(agent), time.time_ns()
        until = time.monotonic() + _START_SECONDS
        while not any(one[0] == key and one[2] > since for one in list(self._latest.values())):
            if time.monotonic() > until:
                return
            time.sleep(0.02)

    def look(self) -> None:
        """Note how full the fullest ring is."""
        fill = max(map(fill_of, (self._folder / "rings").rglob("*.ring")), default=0.0)
        self.found.fullest = max(self.found.fullest, fill)

    def _listen(self) -> None:
        while not self._over.is_set():
            received = self._box.receive_from()
            if received is None or not _in_a_ring(received[0]):
                continue
            with suppress(BadMessage):
                message = unpack(received[1])
                seq, sent = message.get("seq"), message.get("sent")
                if isinstance(seq, int) and isinstance(sent, int):
                    self._latest[received[0]] = said = received[0], seq, sent
                    self._heard.add(said)

    def end(self) -> None:
        """End the run, and count."""
        self._processes["target"].send_signal(signal.SIGTERM)
        for process in self._processes.values():
            process.wait(120.0)
        logged: Counter[Said] = Counter()
        for log in self._logs:
            own = Counter(
                (message.channel.topic, message.sequence, message.publish_time)
                for message in open_log(log).messages()
                if _in_a_ring(message.channel.topic)
            )
            self.found.twice += sum(count - 1 for count in own.values())
            logged.update(own.keys())
        heard = set(self._heard)
        self.found.heard, self.found.lost = len(heard), len(heard - logged.keys())


def soak(minutes: float, kills: int, seed: int = 1) -> Found:
    """Kill so many recorders and as many agents, then go on at full rate for so many minutes."""
    noise = random.Random(seed)  # noqa: S311 - the same moments each time
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(os.cpu_count() or 1)]
        for process in busy:
            stack.callback(process.wait)
            stack.callback(process.kill)
        run = stack.enter_context(Soak(folder))
        run.await_recorder()
        for _ in range(kills):
            time.sleep(noise.uniform(0.0, _PAUSE_SECONDS))
            run.kill("record")
            run.start_recorder()
            run.await_recorder()
            time.sleep(noise.uniform(0.0, _PAUSE_SECONDS))
            agent = noise.randrange(_AGENTS)
            run.kill(str(agent))
            run.start_agent(agent)
            run.await_agent(agent)
            run.look()
        began = time.monotonic()
        while time.monotonic() - began < 60.0 * minutes:
            time.sleep(_PAUSE_SECONDS)
            run.look()
        run.end()
    return run.found


def run(repeats: int, minutes: float = 10.0, kills: int = 200) -> Iterator[Table]:
    del repeats  # nothing is timed
    found = soak(minutes, kills)
    killed = ", ".join(f"{count} {what}" for what, count in sorted(found.kills.items()))
    rows = [
        Row("killed with all cores busy", killed or "none"),
        Row(f"messages lost, of {found.heard} that a listener heard", str(found.lost), "0", found.lost == 0),
        Row("messages twice in a log", str(found.twice), "0", found.twice == 0),
        below("fullest ring at full rate", 100.0 * found.fullest, 50.0, " %"),
    ]
    yield results(f"rings, {_AGENTS} agents, {minutes:g} minutes at full rate after the kills", rows)
