"""A recorder whose run is over stays, so that its log can be fetched from another host."""

from __future__ import annotations

import time
from collections.abc import Callable
from itertools import count, takewhile
from pathlib import Path

from zenoh_cbef.log.common.naming import part_path
from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.protocol.addresses import reached_at
from zenoh_cbef.protocol.log_service import LogService

_LOOK_SECONDS = 0.1
_LAST_SECONDS = 0.5
"""How long the answer to the last question may take to leave."""


def hand_over(node: Node, log: Path, seconds: float, say: Callable[[str], None]) -> None:
    """Hand out the files of a closed log until they are fetched, for so many seconds, or until told to stop."""
    files = [*takewhile(Path.exists, (part_path(log, number) for number in count(1)))]
    recorder = f"{node.identity.role}/{node.identity.name}"
    service = LogService(node.session, node.keys, recorder, files)
    client = node.connection.mode == "client"
    endpoint = next(iter(node.connection.connect if client else reached_at(node.connection.listen)), "ENDPOINT")
    how = f"zenoh-cbef fetch --run {node.identity.run} --connect {endpoint}" + " --client" * client
    how += "" if node.connection.tls is None else f" --tls {node.connection.tls.ca.parent}"
    say(f"{log} waits {seconds:g} s to be fetched: {how}")
    until = time.monotonic() + seconds
    while not (node.stopping or service.fetched.is_set() or time.monotonic() > until):
        service.fetched.wait(_LOOK_SECONDS)
    if service.fetched.is_set():
        time.sleep(_LAST_SECONDS)
        say(f"{log} was fetched")
    service.close()
