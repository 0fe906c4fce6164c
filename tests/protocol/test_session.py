"""Sessions: what they let in, and where they listen when nothing is said."""

import os
import socket
import struct
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import zenoh

from tests.processes.conftest import unused_endpoint
from tests.waiting import until
from zenoh_cbef.protocol.messages import LARGEST
from zenoh_cbef.protocol.session import Connection, open_session


def test_a_message_above_the_limit_is_dropped_and_the_next_one_comes():
    endpoint = unused_endpoint()
    with open_session(Connection(listen=[endpoint])) as receiver, open_session(Connection([endpoint])) as sender:
        mailbox = receiver.declare_subscriber("cbef/run/agent/0/round", zenoh.handlers.FifoChannel(10))
        # Zenoh's stubs take a matching status for a bool.
        publisher: Any = sender.declare_publisher(
            "cbef/run/agent/0/round", congestion_control=zenoh.CongestionControl.BLOCK
        )
        until(lambda: publisher.matching_status.matching)
        for size in (LARGEST + 1, 4 * LARGEST, LARGEST, 7):
            publisher.put(bytes(size))
        received: list[int] = []

        def comes_to_its_end() -> bool:
            while (sample := mailbox.handler.try_recv()) is not None:
                received.append(len(sample.payload.to_bytes()))
            return 7 in received

        until(comes_to_its_end)
        assert received == [LARGEST, 7]


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_no_link_waits_when_it_is_closed():
    endpoint = unused_endpoint()
    with open_session(Connection(listen=[endpoint])), open_session(Connection([endpoint])):
        until(lambda: lingering() == [False, False])


def lingering() -> list[bool]:
    """For the two ends of a link within this process, whether closing them waits."""
    found = []
    for one in Path("/proc/self/fd").iterdir():
        with suppress(OSError):
            if not one.readlink().name.startswith("socket:"):
                continue
            with socket.socket(fileno=os.dup(int(one.name))) as copy:
                if copy.family == socket.AF_INET and not copy.getsockopt(socket.SOL_SOCKET, socket.SO_ACCEPTCONN):
                    on, _ = struct.unpack("ii", copy.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8))
                    found.append(bool(on))
    return found


@pytest.mark.parametrize(
    "endpoint", ["tcp/0.0.0.0:7447", "tcp/192.168.1.10:7447", "udp/host:1", "tcp/[::]:0", "ws/a:1"]
)
def test_a_plain_endpoint_off_loopback_is_exposed(endpoint):
    assert Connection(listen=[endpoint]).exposed == [endpoint]


@pytest.mark.parametrize(
    "endpoint",
    ["tcp/127.0.0.1:7447", "tcp/localhost:1", "tcp/[::1]:1", "tls/0.0.0.0:7447", "quic/h:1", "unixsock-stream//run/x"],
)
def test_loopback_and_endpoints_with_certificates_are_not(endpoint):
    assert Connection(listen=[endpoint]).exposed == []


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize("mode", ["peer", "router"])
def test_no_process_listens_off_loopback_unless_told_to(mode):
    before = addresses()
    with open_session(Connection(mode=mode)):
        new = addresses() - before
    assert new
    assert all(address.startswith("0100007F:") for address in new)


def addresses() -> set[str]:
    """Where this process listens, from the kernel."""
    inodes = set()
    for one in Path("/proc/self/fd").iterdir():
        with suppress(OSError):  # that of this very listing
            inodes.add(str(one.readlink()))
    found = set()
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            words = line.split()
            if words[3] == "0A" and f"socket:[{words[9]}]" in inodes:
                found.add(words[1])
    return found
