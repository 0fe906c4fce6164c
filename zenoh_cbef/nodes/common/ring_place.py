"""Where the rings of a process's run are."""

from __future__ import annotations

from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.nodes.common.succession import TARGET
from zenoh_cbef.protocol.ring_folder import RingFolder

_PATIENCE_SECONDS = 5.0


def ring_folder(node: Node) -> RingFolder:
    """The folder of the run that the target has begun, made where it is not there yet. Raises OSError."""
    if node.identity.role == "target":
        life = str(node.session.zid())
    elif node.wait_for(lambda _: bool(node.presence.life(TARGET)), _PATIENCE_SECONDS):
        life = node.presence.life(TARGET)
    else:
        raise OSError("it has not heard which target began the run")
    folder = RingFolder(node.identity.run, life)
    folder.make()
    return folder
