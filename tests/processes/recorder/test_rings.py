"""Processes leave what they say in rings: it is recorded once, without a second trip, also of killed ones."""

from __future__ import annotations

import os
import re
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from tests.processes.conftest import World, ended, peer, settings
from tests.waiting import until
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.mcap.reader import McapFile
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.nodes.launch.ports import free_ports
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.ring_folder import FOLDER

RINGS = "record.rings=true"
PATIENT = ["--patience", "200"]
_ELSEWHERE = re.compile("/event/|/signal$|/faults$")


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(FOLDER, str(tmp_path / "rings"))
    return tmp_path / "rings"


def proved(world: World) -> list[tuple[str, int]]:
    """Key and number of what is left in rings, of a log that is sound, and is computed again with the same bits."""
    for verb in ("check", "verify"):
        world.done(verb, str(world.log))
    return numbers_in(world.log)


def numbers_in(log: Path) -> list[tuple[str, int]]:
    all_ = ((message.channel.topic, message.sequence) for message in open_log(log).messages())
    return sorted(one for one in all_ if not _ELSEWHERE.search(one[0]))


def once_each(numbers: list[tuple[str, int]]) -> bool:
    counts: dict[str, int] = {}
    for key, number in numbers:
        if number != counts.setdefault(key, 0):
            return False
        counts[key] += 1
    return bool(numbers)


def events_of(log: Path, kind: str) -> int:
    return sum(
        kind.encode() in message.data for message in open_log(log).messages() if "/event/" in message.channel.topic
    )


def test_a_run_is_recorded_from_rings_and_leaves_none(world, place):
    world.complete(RINGS, "filter.lag_seconds=0.5")
    numbers = proved(world)
    assert once_each(numbers)
    found = {key.rpartition("/")[2] for key, _ in numbers}
    assert found == {"range", "round", "estimate", "smoothed", "truth", *"0123"}
    assert list(place.iterdir()) == []


def test_processes_without_rings_are_heard_over_zenoh_and_say_so(world, place):
    place.touch()  # a file, where the folder would be
    world.complete(RINGS)
    assert once_each(proved(world))
    assert events_of(world.log, "has no ring") == 5


def test_a_ring_too_small_for_a_recorder_that_stands_still_loses_nothing(world):
    run = world.under_way(RINGS, "record.ring_bytes=65536", "steps=150", size=5000)
    recorder = world.pid_of("record")
    os.kill(recorder, signal.SIGSTOP)
    time.sleep(2.5)
    os.kill(recorder, signal.SIGCONT)
    ended(run, timeout=300)
    assert once_each(proved(world))


class Hosts:
    """A run that is started by hand, in realtime and slow, so that all its processes have the time they need."""

    def __init__(self, world: World, *, agents: int, recorders: int = 1) -> None:
        self.world, self.agents = world, agents
        names = ["target", "recorder", *map(str, range(agents))]
        self.endpoints = dict(zip(names, [f"tcp/127.0.0.1:{port}" for port in free_ports(len(names))], strict=True))
        slow = ["timing.mode=realtime", "dt=0.2", "steps=100000", f"agents.count={agents}", "network.graph=path"]
        scenario = settings(*slow, RINGS, f"record.recorders={recorders}", "record.ring_bytes=4000000")
        listen = ["--run", world.run, "--listen", self.endpoints["target"]]
        self.target = world.start("target", "tracking", *scenario, *listen, *PATIENT)

    def join(self, *words: str, at: str | None = None, prefix: tuple[str, ...] = ()):
        listen = ["--listen", self.endpoints[at]] if at else []
        connect = ["--run", self.world.run, "--connect", self.endpoints["target"], *listen, *PATIENT]
        return self.world.start(*words, *connect, prefix=prefix)

    def start_agents(self) -> None:
        self.started = [self.join("agent", str(agent), at=str(agent)) for agent in range(self.agents)]

    def wait_for(self, log: str) -> None:
        """Wait until a log has messages of agents: the run has begun, and is recorded."""

        def has_some() -> bool:
            with suppress(UserError):
                return len(numbers_in(self.world.folder / log)) > 20
            return False

        until(has_some, f"{log} does not grow")

    def end(self, *others) -> None:
        self.target.send_signal(signal.SIGTERM)
        for process in (self.target, *others):
            _, err = process.communicate(timeout=200)
            assert process.returncode in (0, 130), err

    def is_subscribed(self) -> Callable[[], bool]:
        """Whether the recorder has Zenoh bring it what agent 0 publishes, or a beacon, as a peer linked to it sees."""
        self.session = peer(self.endpoints["recorder"])
        keys = Keys(self.world.run)
        publishers = [self.session.declare_publisher(key) for key in (keys.round(0), keys.beacon(0))]
        # What Zenoh returns has a field that its types do not tell of.
        return lambda: any(bool(getattr(one.matching_status, "matching", one.matching_status)) for one in publishers)


def test_a_recorder_that_is_killed_and_an_agent_lose_nothing_that_they_had_said(world):
    hosts = Hosts(world, agents=3)
    first = hosts.join("record", "-o", "a.mcap", at="recorder")
    hosts.start_agents()
    hosts.wait_for("a.mcap")
    subscribed = hosts.is_subscribed()
    until(lambda: not subscribed(), "the recorder has what agents say brought twice")
    hosts.session.close()
    first.send_signal(signal.SIGKILL)
    first.wait()
    last = hosts.join("record", "-o", "a.mcap")  # as what starts it again would
    hosts.wait_for("a-2.mcap")
    os.kill(world.pid_of("agent 2"), signal.SIGKILL)
    hosts.end(*hosts.started[:2], last)
    world.done("merge", "a.mcap", "a-2.mcap", "-o", "run.mcap", status=3)  # a file that has no end
    numbers = numbers_in(world.log)
    assert once_each(numbers)
    assert len({key for key, _ in numbers}) == 13


def test_two_recorders_of_a_host_record_all_each(world):
    hosts = Hosts(world, agents=2, recorders=2)
    recorders = [hosts.join("record", "-o", f"{name}.mcap", "--name", name) for name in "ab"]
    hosts.start_agents()
    for name in "ab":
        hosts.wait_for(f"{name}.mcap")
    hosts.end(*hosts.started, *recorders)
    both = [numbers_in(world.folder / f"{name}.mcap") for name in "ab"]
    assert once_each(both[0])
    assert both[0] == both[1]
    assert McapFile(world.folder / "a.mcap").metadata["cbef.end"]["missing"] == "0"


def test_one_agent_without_a_ring_is_heard_beside_others_with_rings(world):
    hosts = Hosts(world, agents=3)
    recorder = hosts.join("record", "-o", "run.mcap", at="recorder")
    others = [hosts.join("agent", str(agent)) for agent in (0, 1)]
    others.append(hosts.join("agent", "2", prefix=("prlimit", "--fsize=100000")))
    hosts.wait_for("run.mcap")
    subscribed = hosts.is_subscribed()
    until(subscribed, "the recorder does not hear the agent without a ring")
    hosts.session.close()
    hosts.end(*others, recorder)
    assert once_each(numbers_in(world.log))
    assert events_of(world.log, "agent 2 has no ring (File too large)") == 1
