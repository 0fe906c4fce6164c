"""Agents that come, leave, die and move at random in a run by hand: the links that sockets show, and tokens left."""

from __future__ import annotations

import random
import re
import signal
import statistics
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.table import Table

from benchmarks.common import Children, Row, children, results
from zenoh_cbef.nodes.launch.ports import free_ports
from zenoh_cbef.protocol.keys import Keys, agent_named
from zenoh_cbef.protocol.presence import live_now
from zenoh_cbef.protocol.session import Connection, open_session
from zenoh_cbef.scenario.load import load

CHANGES, AGENTS = 100, 12
_SETTINGS = ["timing.mode=realtime", "dt=0.5", "steps=100000", "consensus.rounds=2", f"agents.count={AGENTS}"]
_SETTLE_SECONDS = 40.0
_LOOK_SECONDS = 0.1
_SOCKET = re.compile(r"(?m)^\d+ +\d+ +(\S+) +(\S+) +users:\(\(\"[^\"]*\",pid=(\d+),")

Pair = frozenset[str]


class Hall:
    """A run whose agents come and go. Every process has an address of its own, which no earlier one had."""

    def __init__(self, family: Children, folder: Path) -> None:
        self.run = f"joins-{time.time_ns()}"
        self._family = family
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._moves = 0
        plan = load("tracking", _SETTINGS).plan
        self._edges = [frozenset(f"agent/{one}" for one in edge) for edge in plan.edges.tolist()]
        [port] = free_ports(1)
        self.target = f"tcp/127.0.0.1:{port}"
        settings = [part for one in _SETTINGS for part in ("--set", one)]
        self._start("target/target", ["target", "tracking", *settings, "--listen", self.target])
        self._start("record/record", ["record", "--output", str(folder / "run.mcap"), "--connect", self.target])

    def _start(self, name: str, words: list[str]) -> None:
        whole = [*words, "--run", self.run, "--patience", "60"]
        self._processes[name] = self._family.start("zenoh_cbef", whole, {})

    def come(self, agent: int) -> None:
        """Start an agent at an address of its own."""
        self._moves += 1
        place = f"tcp/127.0.{self._moves // 200}.{self._moves % 200 + 2}:0"
        self._start(f"agent/{agent}", ["agent", str(agent), "--connect", self.target, "--listen", place])

    def leave(self, agent: int, how: signal.Signals) -> None:
        """End an agent."""
        process = self._processes.pop(f"agent/{agent}")
        process.send_signal(how)
        process.wait(30.0)

    def here(self) -> list[int]:
        """The agents that were started and not ended."""
        return [agent for agent in map(agent_named, self._processes) if agent is not None]

    def ended(self) -> list[str]:
        """The processes that have ended by themselves."""
        return [name for name, process in self._processes.items() if process.poll() is not None]

    def wanted(self) -> Counter[Pair]:
        """One link for each edge between agents that are here, and of each process to the target and the recorder."""
        here = self._processes.keys()
        hubs = [frozenset({name, hub}) for hub in ("target/target", "record/record") for name in here if name != hub]
        return Counter({*hubs, *(edge for edge in self._edges if edge <= here)})

    def linked(self) -> Counter[Pair]:
        """Which processes are linked, and how often, by their sockets."""
        words = ["ss", "-tnpH", "state", "established"]
        shown = subprocess.run(words, capture_output=True, text=True, check=True).stdout
        owners = {str(process.pid): name for name, process in self._processes.items()}
        ends = {(one[1], one[2]): owners[one[3]] for one in _SOCKET.finditer(shown) if one[3] in owners}
        return Counter(
            frozenset({name, ends[other, own]})
            for (own, other), name in ends.items()
            if own < other and (other, own) in ends
        )


def change(hall: Hall, chance: random.Random) -> None:
    """One agent comes, leaves, dies, or moves: it ends, and starts elsewhere."""
    here = hall.here()
    away = [agent for agent in range(AGENTS) if agent not in here]
    what = chance.choice(["come", "leave", "die", "move"])
    if (what == "come" and away) or len(here) < AGENTS // 2:
        hall.come(chance.choice(away))
        return
    agent = chance.choice(here)
    hall.leave(agent, signal.SIGKILL if what == "die" else signal.SIGTERM)
    if what in {"move", "come"}:
        hall.come(agent)


def settle(hall: Hall) -> tuple[float, Counter[Pair], Counter[Pair]]:
    """Wait for the links that there should be. Returns seconds, and which are too many and too few."""
    began, wanted = time.monotonic(), hall.wanted()
    while (found := hall.linked()) != wanted and time.monotonic() - began < _SETTLE_SECONDS:
        time.sleep(_LOOK_SECONDS)
    return time.monotonic() - began, found - wanted, wanted - found


def tokens_left(hall: Hall) -> list[str]:
    """Liveliness tokens of agents that are not here, and second ones of agents that are."""
    with open_session(Connection(connect=[hall.target], mode="client"), 10.0) as session:
        until = time.monotonic() + _SETTLE_SECONDS
        while time.monotonic() < until:
            live = live_now(session, Keys(hall.run).all_live)
            left = _beyond(live, hall.here())
            if not left:
                break
            time.sleep(_LOOK_SECONDS)
        return left


def _beyond(live: set[str], here: list[int]) -> list[str]:
    patterns = [re.compile(rf"(agent|ready|life/agent|claim/agent)/{agent}(/[0-9a-f]+)?") for agent in here]
    # The others' tokens stay, also those by which the recorder says which last words it has heard.
    mine = [one for one in live if re.match("(agent|ready|over/agent|life/agent|claim/agent)/", one)]
    known = {one: next((found[0] for pattern in patterns if (found := pattern.fullmatch(one))), None) for one in mine}
    kinds = Counter(re.sub(r"(?<=\d)/[0-9a-f]+$", "", one) for one, found in known.items() if found)
    return [one for one, found in known.items() if found is None] + [one for one, count in kinds.items() if count > 1]


@contextmanager
def hall() -> Iterator[Hall]:
    """A run of all agents; all processes end with the block."""
    with tempfile.TemporaryDirectory() as folder, children() as family:
        made = Hall(family, Path(folder))
        for agent in range(AGENTS):
            made.come(agent)
        yield made


def run(repeats: int) -> Iterable[Table]:
    """Measure: after each change, and after bursts of several at once."""
    del repeats
    chance = random.Random(1)  # noqa: S311 - the same changes each time
    waits, many, few = [], 0, 0
    with hall() as made:
        first, *_ = settle(made)
        done = 0
        while done < CHANGES:
            burst = min(chance.choice([1, 1, 2, 5]), CHANGES - done)
            for _ in range(burst):
                change(made, chance)
            done += burst
            seconds, surplus, lack = settle(made)
            waits.append(seconds)
            many, few = many + surplus.total(), few + lack.total()
        left, ended = tokens_left(made), made.ended()
    median = f"{statistics.median(waits):.2g} s; {max(waits):.2g} s"
    yield results(
        f"{AGENTS} agents by hand, {CHANGES} random joins, leaves, deaths and moves, one to five at once",
        [
            Row("from the start of the processes until all links are there", f"{first:.2g} s"),
            Row("from a change until the links are those of the graph, median; longest", median),
            Row("links too many, of all looks", str(many), "0", many == 0),
            Row("links too few", str(few), "0", few == 0),
            Row("tokens left behind", str(len(left)), "0", not left),
            Row("processes that ended by themselves", str(len(ended)), "0", not ended),
        ],
    )
