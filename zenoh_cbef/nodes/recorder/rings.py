"""The rings that processes of this host leave their messages in, as one recorder reads them."""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress

from zenoh_cbef.log.write.run_log import RunLog
from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.nodes.common.ring_place import ring_folder
from zenoh_cbef.nodes.common.succession import TARGET
from zenoh_cbef.protocol.keys import address
from zenoh_cbef.protocol.ring import RingError, RingReader, Said
from zenoh_cbef.protocol.ring_folder import OF_TARGET, RingFolder, RingName, tag_of

_LOOK_SECONDS = 0.2
_PORTION = 2000
_STUCK_SECONDS = 5.0


def _sender(agent: int) -> str:
    """The name of a process in its messages."""
    return "target" if agent == OF_TARGET else f"agent/{agent}"


def _name(agent: int) -> str:
    """The name of a process among those that are there."""
    return TARGET if agent == OF_TARGET else _sender(agent)


def _speaker(key: str) -> int | None:
    """The agent that publishes on a key, OF_TARGET for the target; None where what is said there is in no ring."""
    at = address(key)
    if at is not None and at.kind in {"truth", "beacon"}:
        return OF_TARGET
    return at.agent if at is not None and at.owner == f"agent/{at.agent}" else None


class _Open:
    """A ring that is being read. takes: tells of a key whether it is recorded."""

    def __init__(self, name: RingName, reader: RingReader, takes: Callable[[str], bool]) -> None:
        self.name, self.reader = name, reader
        self.left = False
        self._stuck_since: float | None = None
        self._others = {kind for kind, key in enumerate(reader.names) if not takes(key)}

    def read(self) -> list[Said]:
        """The next messages. What cannot be read for seconds, as no process writes it any more, is passed over."""
        found = self.reader.read(_PORTION)
        if found or not self.reader.waiting:
            self._stuck_since = None
        elif self._stuck_since is None:
            self._stuck_since = time.monotonic()
        elif time.monotonic() - self._stuck_since > _STUCK_SECONDS:
            self.reader.pass_over()
        return [one for one in found if one[0] not in self._others] if self._others else found


class Rings:
    """Reads the rings of a run's agents and target, and knows which of them have one. Used under the log's lock.

    covers: tells of a key whether it is recorded. agents: those whose messages are, OF_TARGET for the target.
    """

    def __init__(self, node: Node, log: RunLog, covers: Callable[[str], bool], agents: Collection[int]) -> None:
        self._node, self._log, self._covers, self._agents = node, log, covers, agents
        self._tag = tag_of(node.identity.sender)
        self._open: dict[RingName, _Open] = {}
        self._done: set[RingName] = set()
        self._refused: set[RingName] = set()
        self._lives: dict[int, str] = {}
        self._looked = -1.0
        self._folder: RingFolder | None = None
        self._held: int | None = None
        with suppress(OSError):  # without a folder it has no rings
            self._folder = ring_folder(node)
            self._held = self._folder.enter(self._tag)

    def look(self, *, now: bool = False) -> None:
        """Open rings that have come since."""
        if self._folder is None or self._held is None:
            return
        if not now and time.monotonic() - self._looked < _LOOK_SECONDS:
            return
        self._looked = time.monotonic()
        for name, path in self._folder.rings():
            if name in self._open or name in self._done or name in self._refused:
                continue
            self._refused.add(name)
            if name.agent in self._agents:
                with suppress(RingError, OSError), self._folder.alone():
                    reader = RingReader(path, self._tag, self._folder.is_read)
                    self._open[name] = _Open(name, reader, self._takes)
                    self._refused.discard(name)

    def read(self) -> Iterator[tuple[Sequence[str], list[Said]]]:
        """What processes have left since, with the keys that it is on; of an agent's rings the oldest first.

        The target's last: an estimate does not come before the truth of its step.
        """
        busy = set()
        # Whether a ring is still written takes two calls of the system: only another ring of its agent waits for it.
        rings = Counter(name.agent for name in self._open)
        for ring in sorted(self._open.values(), key=lambda one: one.name.agent == OF_TARGET):
            if ring.name.agent in busy:
                continue
            ring.left = ring.reader.left  # before it is read: what is there now is all
            if found := ring.read():
                yield ring.reader.names, found
            if rings[ring.name.agent] > 1 and (ring.reader.waiting or (not ring.left and ring.reader.written)):
                busy.add(ring.name.agent)

    def _takes(self, key: str) -> bool:
        return _speaker(key) in self._agents and self._covers(key)

    def save(self) -> None:
        """What was read is safe in the file. Rings that end are removed."""
        for name, ring in list(self._open.items()):
            ring.reader.save()
            if not ring.reader.waiting and not ring.reader.written:
                with suppress(OSError):
                    ring.reader.path.unlink()
                ring.reader.close()
                del self._open[name]
                self._done.add(name)

    @property
    def waiting(self) -> bool:
        """Whether anything is left to read."""
        return any(ring.reader.waiting for ring in self._open.values())

    def has(self, agent: int) -> bool:
        """Whether all that an agent's process, or the target, says comes by a ring, as far as is known of it."""
        life = self._node.presence.life(_name(agent))
        if not life or self._lives.get(agent) != life:
            self.look(now=True)
            if life:
                self._lives[agent] = life
        return any(name not in self._open or not self._open[name].left for name in self._of(agent, life))

    def _of(self, agent: int, life: str) -> list[RingName]:
        """The rings of an agent's process, of any where its life is not known."""
        known = (*self._open, *self._done)
        return [name for name in known if name.agent == agent and life in ("", name.life)]

    def is_the_same(self, sender: str) -> bool:
        """Whether a sender is the only process of its name, as far as rings tell.

        Where it is not, missing numbers may be those of the process before, whose messages are in its ring.
        """
        self.look(now=True)
        return sum(_sender(name.agent) == sender for name in (*self._open, *self._done)) < 2

    def lacks(self, agents: Collection[int]) -> bool:
        """Whether any of these agents, or the target, has to be heard over Zenoh."""
        return not all(map(self.has, agents))

    def lets_in(self, key: str, data: bytes) -> bool:
        """Whether a message that came over Zenoh is to be recorded: it does not come by a ring."""
        agent = _speaker(key)
        if agent is None or agent not in self._agents:
            return True
        if self.has(agent):
            return False
        if not self._of(agent, self._node.presence.life(_name(agent))):
            return True
        # It left its ring when that was full: what is in the ring came over Zenoh, too.
        sender = _sender(agent)
        return self._log.wants(key, sender, data) or self._log.lacks(key, sender, 1)

    def close(self) -> None:
        """Let go of all rings; another recorder goes on from what was saved."""
        for ring in self._open.values():
            ring.reader.close()
        if self._folder is not None and self._held is not None:
            os.close(self._held)
            self._folder.tidy()
