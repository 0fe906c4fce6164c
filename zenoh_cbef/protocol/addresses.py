"""Where this process can be reached: what it listens on, with every address of the host it is on."""

from __future__ import annotations

import socket
import struct
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from ipaddress import IPv6Address, ip_address
from pathlib import Path

from zenoh_cbef.protocol.session import Connection, configured_listen

STREAMS = ("tcp", "tls", "ws")
_EVERYWHERE = {"0.0.0.0": socket.AF_INET, "[::]": socket.AF_INET6}  # noqa: S104 - it asks what such an endpoint stands for
_LIST_ADDRESSES = 0x8912  # SIOCGIFCONF
_ENTRY, _ENTRIES = 40, 256
_SECOND_FAMILY = Path("/proc/net/if_inet6")
_GLOBAL = "00"


def with_ports(connection: Connection) -> Connection:
    """The connection with a free port wherever it listens on any, so that others can be told of it.

    Another program can take such a port before this process listens on it.
    """
    told = list(connection.listen) or configured_listen(connection)
    return replace(connection, listen=[_with_port(one) for one in told or [connection.loopback()]], unasked=not told)


def _with_port(endpoint: str) -> str:
    protocol, host, port = parts(endpoint)
    if protocol not in STREAMS or port != 0:
        return endpoint
    family = socket.AF_INET6 if host.startswith("[") else socket.AF_INET
    with suppress(OSError), socket.socket(family) as probe:  # Zenoh says what is wrong with the address
        probe.bind((host.strip("[]"), 0))
        return f"{protocol}/{host}:{probe.getsockname()[1]}"
    return endpoint


def parts(endpoint: str) -> tuple[str, str, int]:
    """Protocol, host and port of an endpoint; port -1 where it has none."""
    protocol, _, rest = endpoint.partition("/")
    host, _, port = rest.split("?")[0].split("#")[0].rpartition(":")
    return protocol, host, int(port) if port.isdecimal() and len(port) <= 5 else -1


def reached_at(listen: Sequence[str]) -> list[str]:
    """The endpoints at which a process that listens there can be reached, in the order in which to try them."""
    found = []
    for endpoint in listen:
        protocol, host, port = parts(endpoint)
        if protocol not in STREAMS or port < 1:
            continue
        hosts = own_addresses(_EVERYWHERE[host]) if host in _EVERYWHERE else [host]
        found += [f"{protocol}/{one}:{port}" for one in hosts]
    return found


def is_loopback(endpoint: str) -> bool:
    """Whether only this host can reach an endpoint."""
    host = parts(endpoint)[1].strip("[]")
    with suppress(ValueError):
        return ip_address(host).is_loopback
    return host == "localhost"


def own_host() -> str:
    """A name of this host's network stack: processes that share it reach each other on loopback."""
    with suppress(OSError):
        # Containers and virtual hosts on one machine share its boot, but not its network.
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
        return f"{boot} {Path('/proc/self/ns/net').stat().st_ino}"
    return socket.gethostname()


def own_addresses(family: int) -> list[str]:
    """Addresses of this host, as they are written in endpoints; loopback last."""
    found = [] if family == socket.AF_INET6 else _first_family()
    if family == socket.AF_INET6:
        found = [*_second_family(), *_first_family()]  # [::] accepts both
    return sorted(dict.fromkeys(found), key=lambda one: ip_address(one.strip("[]")).is_loopback)


def _first_family() -> list[str]:
    if sys.platform == "linux":
        with suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
            return _interfaces(asking)
    with suppress(OSError):
        return [*socket.gethostbyname_ex(socket.gethostname())[2], "127.0.0.1"]
    return ["127.0.0.1"]


def _interfaces(asking: socket.socket) -> list[str]:
    """Linux's list of all interfaces that have an address."""
    import array  # noqa: PLC0415 - these two exist or are of use on some systems only
    import fcntl  # noqa: PLC0415

    entries = array.array("B", bytes(_ENTRY * _ENTRIES))
    place, _ = entries.buffer_info()
    told = fcntl.ioctl(asking.fileno(), _LIST_ADDRESSES, struct.pack("iP", len(entries), place))
    used = struct.unpack("iP", told)[0]
    raw = entries.tobytes()
    return [socket.inet_ntoa(raw[start + 20 : start + 24]) for start in range(0, used, _ENTRY)]


def _second_family() -> list[str]:
    found = ["[::1]"]
    with suppress(OSError):
        for line in _SECOND_FAMILY.read_text(encoding="ascii").splitlines():
            digits, _, _, scope, *_ = line.split()
            if scope == _GLOBAL:
                found.append(f"[{IPv6Address(int(digits, 16))}]")
    return found
