"""Faults that were injected since the run began, as the target tells an agent of them."""

from __future__ import annotations

import time
from collections.abc import Callable

from zenoh_cbef.errors import UserError
from zenoh_cbef.nodes.common.inbox import MISSED
from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.nodes.common.rejections import Rejections
from zenoh_cbef.protocol.kinds import FAULTS
from zenoh_cbef.protocol.mailbox import Mailbox
from zenoh_cbef.protocol.memory import ask_latest
from zenoh_cbef.protocol.messages import BadMessage, decode

_AGAIN_SECONDS = 0.05


class News:
    """The lists of injected faults that an agent takes in; each list has all of them.

    heard: how many lists there were. take: lives with the faults of a list; raises UserError where it is none.
    patience: s that the agent waits in lockstep for a list of which a beacon has told.
    """

    def __init__(self, node: Node, rejections: Rejections, take: Callable[[str], None], patience: float) -> None:
        self._node, self._rejections, self._take, self._patience = node, rejections, take, patience
        self._box = Mailbox(node.session, node.keys.faults)
        self.heard = 0
        self._uninformed = False
        node.presence.on_change(self._note_target)

    def _note_target(self, name: str, joined: bool) -> None:
        # What the target told while it was out of sight did not come.
        self._uninformed |= joined and name == "target/target"

    def begin(self) -> None:
        """The agent has what the target told it at its start."""
        self._uninformed = False

    def heed(self) -> None:
        """In realtime: take in what has come since."""
        told = ask_latest(self._node.session, self._box.key) if self._uninformed else []
        self._uninformed = False
        self._read(told)

    def await_(self, due: int, step: int) -> None:
        """In lockstep: take in lists until there were as many as a step's beacon tells of."""
        until = time.monotonic() + self._patience
        self._read([])
        while self.heard < due and not self._node.stopping:
            if time.monotonic() > until:
                self.heard = due
                text = f"agent {self._node.identity.name} did not hear of the faults that begin with step {step}"
                self._node.event(MISSED, text, step=step)
                return
            self._read(ask_latest(self._node.session, self._box.key))
            if self.heard < due:
                time.sleep(_AGAIN_SECONDS)

    def _read(self, told: list[bytes]) -> None:
        while (data := self._box.poll()) is not None:
            told.append(data)
        for data in told:
            try:
                message = decode(FAULTS, data, run=self._node.identity.run, sender="target")
                if message["seq"] >= self.heard:
                    self._take(message["tables"])
                    self.heard = message["seq"] + 1
            except (BadMessage, UserError) as error:
                self._rejections.add(self._box.key, str(error))
