"""What the tests of replays listen with: a session of another process."""

import time

import msgpack
import pytest
import zenoh

from tests.processes.conftest import World, ended, peer
from tests.processes.forked import Process
from tests.waiting import until
from zenoh_cbef.log.mcap.reader import McapFile


class Listener:
    """A session of another process than the replay's: what it hears, and how it tells the replay what to do."""

    def __init__(self, port: int, run: str) -> None:
        self.port = port
        self.heard: list[tuple[str, bytes]] = []
        self._key = f"cbef/{run}/replay"
        self._session = peer(f"tcp/127.0.0.1:{port}")
        self._subscriber = self._session.declare_subscriber("**", self._hear)

    def _hear(self, sample: zenoh.Sample) -> None:
        self.heard.append((str(sample.key_expr), sample.payload.to_bytes()))

    def ask(self, orders: str = "") -> dict:
        """The replay's state after it did what it was told."""
        answer = self.answer(orders)
        assert isinstance(answer, dict), answer
        return answer

    def answer(self, orders: str) -> dict | str:
        """The replay's state, or the words of its refusal."""
        until = time.monotonic() + 100
        while time.monotonic() < until:
            for reply in self._session.get(f"{self._key}?{orders}", timeout=5.0):
                if reply.ok is not None:
                    return msgpack.unpackb(reply.ok.payload.to_bytes())
                assert reply.err is not None
                return reply.err.payload.to_string()
            time.sleep(0.05)
        pytest.fail("the replay does not answer")

    def wait(self, count: int) -> None:
        """Wait until that many messages were heard, and a moment in which there must be no more."""
        until(lambda: len(self.heard) >= count)
        time.sleep(0.1)
        assert len(self.heard) == count

    def leave(self) -> None:
        """Subscribe no longer: the replay does not stay for us."""
        self._subscriber.undeclare()

    def close(self) -> None:
        self._session.close()


def start(recorded: World, listener: Listener, *options: str) -> Process:
    endpoint = f"tcp/127.0.0.1:{listener.port}"
    return recorded.start("replay", str(recorded.log), "--listen", endpoint, "--wait", "--linger", "60", *options)


def play(recorded: World, listener: Listener, *options: str) -> list[tuple[str, bytes]]:
    """All that is heard of a replay to its end."""
    replay = start(recorded, listener, *options)
    finish(replay, listener)
    return listener.heard


def finish(replay: Process, listener: Listener) -> int:
    """Wait for the end of a replay and for all that it sent; returns how much that was."""
    while (state := listener.ask())["state"] != "done":
        time.sleep(0.02)
    listener.wait(state["published"])
    listener.leave()
    out, _ = ended(replay)
    assert int(out.split()[0]) == state["published"]
    return state["published"]


def logged(recorded: World) -> list[tuple[str, bytes]]:
    return [(message.channel.topic, message.data) for message in McapFile(recorded.log).messages()]
