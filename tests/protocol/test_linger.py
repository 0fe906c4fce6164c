"""Only the ends of links are made to close at once: other files and sockets of the process stay as they are."""

from __future__ import annotations

import os
import socket
import struct

import pytest

from zenoh_cbef.protocol.linger import unset_all

WAITS = struct.pack("ii", 1, 7)


@pytest.mark.parametrize(
    ("family", "kind", "left"),
    [
        (socket.AF_INET, socket.SOCK_STREAM, 0),
        (socket.AF_INET, socket.SOCK_DGRAM, 1),
        (socket.AF_UNIX, socket.SOCK_STREAM, 1),
    ],
)
def test_only_streams_of_the_network_are_closed_at_once(family: int, kind: int, left: int) -> None:
    with socket.socket(family, kind) as one:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, WAITS)
        unset_all()
        assert struct.unpack("ii", one.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER, 8))[0] == left
        assert one.fileno() >= 0


def test_a_file_is_no_socket_and_stays_open() -> None:
    ends = os.pipe()
    unset_all()
    for end in ends:
        os.close(end)
