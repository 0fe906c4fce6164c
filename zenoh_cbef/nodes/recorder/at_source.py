"""Recording at the source: a host's processes are read from their rings, and heard over Zenoh where one has none."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from zenoh_cbef.log.write.run_log import RunLog
from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.nodes.common.succession import TARGET
from zenoh_cbef.nodes.recorder.rings import Rings
from zenoh_cbef.protocol.fair_mailbox import FairMailbox
from zenoh_cbef.protocol.recorded import apart, covering
from zenoh_cbef.protocol.ring import Said
from zenoh_cbef.protocol.ring_folder import OF_TARGET
from zenoh_cbef.scenario import Scenario

_LOOK_SECONDS = 0.2
_LAST_SECONDS = 10.0

WriteAll = Callable[[Sequence[str], Sequence[Said]], None]
"""Writes what a process has left in its ring, each message on one of its keys."""


@dataclass
class Group:
    """Processes that are heard over Zenoh while any of them has no ring: what they publish, and which they are.

    agents: ids, or OF_TARGET. boxes: what is subscribed to.
    """

    expressions: list[str]
    agents: list[int]
    boxes: list[FairMailbox] = field(default_factory=list)


class AtSource:
    """Writes what processes leave in their rings, and subscribes to what they publish while any of them has no ring.

    As long as the recorder subscribes to a key, Zenoh brings it each message of the key a second time.
    groups: of agents, and of the target. It begins with the subscription, so that none is missed.
    """

    def __init__(self, node: Node, rings: Rings, groups: Sequence[Group], capacity: int) -> None:
        self.rings = rings
        self.expressions = [one for group in groups for one in group.expressions]
        self._node, self._capacity, self._groups = node, capacity, groups
        self._looked = -_LOOK_SECONDS
        self._early: list[tuple[str, bytes]] = []
        self._repeated: Counter[tuple[str, bytes]] = Counter()
        for group in groups:
            self._subscribe(group)

    def _subscribe(self, group: Group) -> None:
        group.boxes = [FairMailbox(self._node.session, one, self._capacity) for one in group.expressions]

    def take_over(self, mailboxes: Sequence[FairMailbox]) -> None:
        """End mailboxes whose keys are subscribed to a second time by now; what came to them is written first."""
        for mailbox in mailboxes:
            while (one := mailbox.poll_from()) is not None:
                self._early.append(one)
            mailbox.close()
        self._repeated.update(self._early)

    def lets_in(self, key: str, data: bytes) -> bool:
        """Whether a message that came over Zenoh is to be recorded. The caller has the log's lock."""
        if self._repeated and self._repeated[key, data] > 0:
            self._repeated[key, data] -= 1
            return False
        return self.rings.lets_in(key, data)

    def begin(self, write: Callable[[str, bytes], None]) -> None:
        """Write what had come before. The caller has the log's lock."""
        for one in self._early:
            if self.rings.lets_in(*one):
                write(*one)

    def turn(self, lock: threading.Lock, write_all: WriteAll, drain: Callable[[FairMailbox], None]) -> None:
        """Write what has come since, and subscribe, or end that, where it is time. drain: writes what a mailbox has."""
        for group in self._groups:
            for box in group.boxes:
                drain(box)
        self._write_waiting(lock, write_all)
        if time.monotonic() - self._looked < _LOOK_SECONDS:
            return
        self._looked = time.monotonic()
        for group in self._groups:
            with lock:
                lacks = self.rings.lacks(group.agents)
            if lacks and not group.boxes:
                self._subscribe(group)
            elif not lacks:
                self._unsubscribe(group, drain)

    def _write_waiting(self, lock: threading.Lock, write_all: WriteAll) -> bool:
        """Write what is in the rings, at most a portion of each; whether there was anything."""
        found = False
        with lock:
            self.rings.look()
            for keys, said in self.rings.read():
                write_all(keys, said)
                found = True
        return found

    def finish(self, lock: threading.Lock, write_all: WriteAll, drain: Callable[[FairMailbox], None]) -> None:
        """Write what is left. Agents that go on would keep the recorder for ever."""
        until = time.monotonic() + _LAST_SECONDS
        with lock:
            self.rings.look(now=True)
        while self._write_waiting(lock, write_all) and time.monotonic() < until:
            pass
        for group in self._groups:
            self._unsubscribe(group, drain)

    def close(self) -> None:
        """All that was written is safe: let go of the rings."""
        self.rings.save()
        self.rings.close()

    def _unsubscribe(self, group: Group, drain: Callable[[FairMailbox], None]) -> None:
        ended, group.boxes = group.boxes, []
        for box in ended:
            drain(box)
            box.close()


def at_source(
    node: Node, log: RunLog, scenario: Scenario, mailboxes: list[FairMailbox], capacity: int
) -> tuple[AtSource | None, list[FairMailbox]]:
    """What reads rings, where the scenario has them, and the mailboxes of everything else."""
    parts = apart(node.identity.run, [mailbox.key for mailbox in mailboxes])
    own = [*parts.agents, *parts.target]
    if not scenario.record.rings or not own or TARGET not in node.presence:  # a replay has no agents
        return None, mailboxes
    covers, keys = covering(own), node.keys
    ids = [
        agent
        for agent in range(scenario.count)
        if any(map(covers, (keys.range(agent), keys.round(agent), keys.estimate(agent), keys.smoothed(agent))))
    ]
    groups = [Group(parts.agents, ids)] + ([Group(parts.target, [OF_TARGET])] if parts.target else [])
    kept = [mailbox for mailbox in mailboxes if mailbox.key in parts.others]
    known = {mailbox.key for mailbox in kept}
    kept += [FairMailbox(node.session, one, capacity) for one in parts.others if one not in known]
    rings = Rings(node, log, covers, [agent for group in groups for agent in group.agents])
    source = AtSource(node, rings, groups, capacity)
    source.take_over([mailbox for mailbox in mailboxes if mailbox not in kept])
    return source, kept
