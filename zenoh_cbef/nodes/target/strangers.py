"""Peers at the target that are no process of this program: they hear the target alone, and are told so."""

from __future__ import annotations

import sys
import time

from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.protocol.lives import is_life

_EVERY_SECONDS = 1.0
_MOST = 100


class Strangers:
    """Says once of each such peer what it does not hear, in the log and on standard error."""

    def __init__(self, node: Node) -> None:
        self._node, self._told = node, set[str]()
        self._next = 0.0

    def look(self) -> None:
        """Look at those that are linked; cheap enough to be called in every step."""
        now = time.monotonic()
        # Only where the target tells processes of each other have these ids by which they are known.
        if now < self._next or not self._node.connection.told:
            return
        self._next = now + _EVERY_SECONDS
        for peer in map(str, self._node.session.info.peers_zid()):
            if not is_life(peer) and peer not in self._told and len(self._told) < _MOST:
                self._told.add(peer)
                text = (
                    f"the peer {peer} is no process of this run and hears the target alone; to hear the agents, let it "
                    'connect as a client (mode: "client"), with certificates to a router'
                )
                self._node.event("stranger", text, peer=peer)
                sys.stderr.write(f"note: {text}\n")
