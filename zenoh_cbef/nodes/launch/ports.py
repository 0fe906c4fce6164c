"""Free TCP ports on loopback."""

from __future__ import annotations

import random
import socket
from pathlib import Path

from zenoh_cbef.errors import UserError

_RANGE = Path("/proc/sys/net/ipv4/ip_local_port_range")
_LEAST, _MOST = 10_000, 60_000


def free_ports(count: int) -> list[int]:
    """TCP ports that no program listens on now. Where one takes a port in the meantime, the launcher starts again.

    Ports that the kernel hands out to outgoing connections are avoided where others are left.
    """
    low, high = _handed_out()
    outside = [port for port in range(_LEAST, _MOST) if not low <= port <= high]
    candidates = outside if len(outside) > 1000 else list(range(_LEAST, _MOST))
    random.shuffle(candidates)
    ports: list[int] = []
    for port in candidates:
        if len(ports) == count:
            return ports
        with socket.socket() as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
        ports.append(port)
    raise UserError(f"this host has no {count} free TCP ports between {_LEAST} and {_MOST}; end what holds them")


def _handed_out() -> tuple[int, int]:
    try:
        low, high = _RANGE.read_text().split()
    except (OSError, ValueError):
        return 32_768, 60_999
    return int(low), int(high)
