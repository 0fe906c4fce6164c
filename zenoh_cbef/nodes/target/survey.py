"""What a target knows of its run, for processes that ask: messages as they came, which the asking process decodes.

While the run goes on the target decodes a few events only, and it puts an answer together only when it is asked.
"""

from __future__ import annotations

import json
import threading
import time
from collections import defaultdict, deque
from typing import Protocol

import numpy as np

from zenoh_cbef.nodes.common.briefing import HERE, card
from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.nodes.target.lookout import Lookout
from zenoh_cbef.nodes.target.progress import Progress
from zenoh_cbef.plain import Json
from zenoh_cbef.protocol.directory import Directory
from zenoh_cbef.protocol.fair_mailbox import FairMailbox
from zenoh_cbef.protocol.keys import Address, address, agent_named
from zenoh_cbef.protocol.kinds import EVENT
from zenoh_cbef.protocol.messages import BadMessage, decode
from zenoh_cbef.protocol.questions import StatusAnswer
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.world import World

_KEPT_OF_EACH = 10
_PORTION = 50
_WAITING = 1 << 10
_CHOSEN = 100
_SHOWN = ("agent/", "ready/", "record/")


class Surveyed(Protocol):
    """The parts of a target that a status contains."""

    node: Node
    plan: Plan
    world: World
    progress: Progress
    lookout: Lookout
    directory: Directory
    step: int | None

    @property
    def start(self) -> float:
        """When step 0 is or was, s since the Unix epoch."""
        ...

    def members(self) -> list[int]:
        """The agents that take part in the run, and are here."""
        ...


class Survey:
    """The latest events of a run, the processes' introductions, and the other parts of a status."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._mailbox = FairMailbox(node.session, node.keys.all_events, _WAITING)
        self._events: defaultdict[str, deque[bytes]] = defaultdict(lambda: deque(maxlen=_KEPT_OF_EACH))
        self._cards: dict[str, bytes] = {}
        self._lock = threading.Lock()

    def drain(self) -> None:
        """Take in the events that have come, or a portion of them."""
        with self._lock:
            for _ in range(_PORTION):
                received = self._mailbox.poll_from()
                if received is None:
                    return
                self._take(*received)

    def _take(self, key: str, data: bytes) -> None:
        at = address(key)
        sender = at.owner if at else ""
        try:
            message = decode(EVENT, data, run=self._node.identity.run, sender=sender)
        except BadMessage:
            return  # the recorder counts those
        known = at is not None and self._known(sender) and self._has_room(at)
        if message["kind"] == HERE and known:
            self._cards[sender] = data
        # Keep the latest events of each process, so that one that sends many does not displace the others'.
        self._events[sender if known or sender in self._events else ""].append(data)

    def _known(self, sender: str) -> bool:
        return any(name == sender or name.startswith(f"{sender}/") for name in self._node.presence.names())

    def _has_room(self, at: Address) -> bool:
        """Whether a process's events get a place of their own: of chosen names there can be any number."""
        chosen = (one for one in self._events if one != "target" and agent_named(one) is None)
        return not at.chosen or at.owner in self._events or sum(1 for _ in chosen) < _CHOSEN

    def _latest(self) -> list[bytes]:
        return [data for events in list(self._events.values()) for data in list(events)]

    def of(self, target: Surveyed) -> StatusAnswer:
        """All data from which a status is made."""
        self.drain()
        scenario, step = target.plan.scenario, target.step
        estimates = target.progress.estimates()
        truth = {k: target.world.truth[k - 1] for k, _ in estimates if 1 <= k <= scenario.length}
        away = [] if step is None else target.plan.absences.at(step).nonzero()[0].tolist()
        return {
            "run": self._node.identity.run,
            "name": scenario.name,
            "filter": scenario.filter.kind,
            "mode": scenario.timing.mode,
            "agents": scenario.count,
            "steps": scenario.length,
            "dt": scenario.dt,
            "planar": scenario.filter.planar_height is not None,
            "step": step,
            "start": target.start,
            "time": time.time(),
            "stopping": self._node.stopping,
            "target": card(),
            "live": sorted(name for name in self._node.presence.names() if name.startswith(_SHOWN)),
            "members": target.members(),
            "silent": target.progress.silent(),
            "away": away,
            "unobservable": target.lookout.problem,
            "apart": [(one.first, one.second, one.carried) for one in target.directory.apart()],
            "faults": json.dumps(_faults_on(target)),
            "truth": [(k, state.tolist()) for k, state in truth.items() if np.isfinite(state).all()],
            "estimates": [data for _, data in estimates],
            "earlier": target.progress.earlier(),
            "cards": list(self._cards.values()),
            "events": [*self._latest(), *self._node.told],
        }


def _faults_on(target: Surveyed) -> list[dict[str, Json]]:
    if target.step is None:
        return []
    now = target.step * target.plan.scenario.dt
    return [
        {"fault": place, **fault.model_dump(mode="json", by_alias=True, exclude_defaults=True), "kind": fault.kind}
        for place, fault in enumerate(target.plan.scenario.fault)
        if fault.active(now)
    ]
