"""Addresses of this host, as the system lists them in other ways, and what endpoints are made of."""

from __future__ import annotations

import fcntl
import socket
import struct
import sys
from pathlib import Path

import pytest

from zenoh_cbef.protocol import addresses
from zenoh_cbef.protocol.addresses import (
    _interfaces,
    is_loopback,
    own_addresses,
    own_host,
    parts,
    reached_at,
    with_ports,
)
from zenoh_cbef.protocol.session import Connection

_ADDRESS_OF = 0x8915  # SIOCGIFADDR


def of_each_interface(asking: socket.socket) -> set[str]:
    """The first address of each interface that has one, asked for one by one."""
    found = set()
    for _, name in socket.if_nameindex():
        try:
            told = fcntl.ioctl(asking.fileno(), _ADDRESS_OF, struct.pack("256s", name.encode()))
        except OSError:
            continue
        found.add(socket.inet_ntoa(told[20:24]))
    return found


@pytest.mark.skipif(sys.platform != "linux", reason="other systems list them otherwise")
def test_the_addresses_are_those_of_the_interfaces() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
        found = _interfaces(asking)
        assert set(found) >= of_each_interface(asking) >= {"127.0.0.1"}
    for one in found:  # each is this host's
        with socket.socket() as probe:
            probe.bind((one, 0))
    assert sorted(own_addresses(socket.AF_INET)) == sorted(set(found))


def test_loopback_comes_last_and_no_address_twice(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(addresses, "_first_family", lambda: ["127.0.0.1", "10.0.0.1", "127.0.0.2", "10.0.0.1"])
    file = tmp_path / "if_inet6"
    lines = [
        "00000000000000000000000000000001 01 80 10 80       lo",
        "fe800000000000000000000000000001 02 40 20 80     eth0",
        "20010db8000000000000000000000002 02 40 00 80     eth0",
    ]
    file.write_text("\n".join(lines), encoding="ascii")
    monkeypatch.setattr(addresses, "_SECOND_FAMILY", file)
    assert own_addresses(socket.AF_INET) == ["10.0.0.1", "127.0.0.1", "127.0.0.2"]
    assert own_addresses(socket.AF_INET6) == ["[2001:db8::2]", "10.0.0.1", "[::1]", "127.0.0.1", "127.0.0.2"]
    file.unlink()
    assert own_addresses(socket.AF_INET6) == ["10.0.0.1", "[::1]", "127.0.0.1", "127.0.0.2"]
    assert reached_at(["tcp/[::]:7"]) == [
        "tcp/10.0.0.1:7", "tcp/[::1]:7", "tcp/127.0.0.1:7", "tcp/127.0.0.2:7",
    ]  # fmt: skip


def test_where_interfaces_are_not_listed_the_name_of_the_host_tells(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(_: str) -> None:
        raise socket.gaierror

    monkeypatch.setattr(sys, "platform", "other")
    monkeypatch.setattr(socket, "gethostbyname_ex", lambda _: ("name", [], ["192.0.2.1"]))
    assert own_addresses(socket.AF_INET) == ["192.0.2.1", "127.0.0.1"]
    monkeypatch.setattr(socket, "gethostbyname_ex", unknown)
    assert own_addresses(socket.AF_INET) == ["127.0.0.1"]


def test_a_host_is_told_by_its_boot_and_network_or_by_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    def unreadable(*_: object, **__: object) -> str:
        raise PermissionError

    boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
    assert own_host() == f"{boot} {Path('/proc/self/ns/net').stat().st_ino}"
    monkeypatch.setattr(Path, "read_text", unreadable)
    assert own_host() == socket.gethostname()


@pytest.mark.parametrize(
    ("endpoint", "expected"),
    [
        ("tcp/10.0.0.1:7447", ("tcp", "10.0.0.1", 7447)),
        ("tls/[::1]:99999", ("tls", "[::1]", 99999)),
        ("tcp/host:100000", ("tcp", "host", -1)),
        ("tcp/host:1?a=b:2#c:3", ("tcp", "host", 1)),
        ("tcp/host:1#c:3", ("tcp", "host", 1)),
        ("tcp/host:x", ("tcp", "host", -1)),
        ("unixsock-stream//run/a/b", ("unixsock-stream", "", -1)),
        ("tcp", ("tcp", "", -1)),
    ],
)
def test_an_endpoint_has_a_protocol_a_host_and_a_port(endpoint: str, expected: tuple[str, str, int]) -> None:
    assert parts(endpoint) == expected


def test_only_a_process_that_listens_on_a_port_of_a_stream_can_be_reached() -> None:
    listen = ["tcp/h:0", "tcp/h:1", "udp/h:2", "ws/h:3", "tls/[::1]:65535", "tcp/h:x", "quic/h:4"]
    assert reached_at(listen) == ["tcp/h:1", "ws/h:3", "tls/[::1]:65535"]


def test_loopback_is_what_no_other_host_reaches() -> None:
    hidden = ["tcp/127.0.0.1:1", "tls/127.9.9.9:1", "tcp/[::1]:1", "ws/localhost:1"]
    seen = ["tcp/10.0.0.1:1", "tcp/[fd00::1]:1", "tcp/localhost.example:1", "tcp/0.0.0.0:1"]
    assert [*map(is_loopback, hidden + seen)] == [True] * 4 + [False] * 4


def test_a_free_port_is_chosen_where_any_is_meant_and_nowhere_else() -> None:
    told = [
        "tcp/127.0.0.1:0",
        "tls/127.0.0.1:0",
        "udp/127.0.0.1:0",
        "tcp/127.0.0.1:7",
        "tcp/192.0.2.1:0",
        "tcp/[::1]:0",
    ]
    found = with_ports(Connection(listen=told))
    assert not found.unasked
    first, second, *others, last = found.listen
    assert [one.rpartition(":")[0] for one in (first, second)] == ["tcp/127.0.0.1", "tls/127.0.0.1"]
    for one in (first, second):
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", parts(one)[2]))
    assert others == told[2:5]
    assert last.startswith("tcp/[::1]:")
