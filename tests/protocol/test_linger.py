"""Only the ends of links are made to close at once: other files and sockets of the process stay as they are."""

from __future__ import annotations

import os
import socket
import struct
import threading
import time
from types import SimpleNamespace
from typing import Any

import pytest
import zenoh

from zenoh_cbef.protocol import linger
from zenoh_cbef.protocol.linger import _PAUSE_SECONDS, _Unsetting, unset_all

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


def event(kind: zenoh.SampleKind) -> Any:
    return SimpleNamespace(kind=kind)


def test_of_many_links_at_once_the_first_is_looked_at_at_once_and_all_others_together(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looks, last = list[float](), threading.Event()

    def look() -> None:
        looks.append(time.monotonic())
        if len(looks) > 1:
            last.set()

    monkeypatch.setattr(linger, "unset_all", look)
    unsetting = _Unsetting()
    unsetting.take(event(zenoh.SampleKind.DELETE))
    assert looks == []
    for _ in range(5):
        unsetting.take(event(zenoh.SampleKind.PUT))
    assert len(looks) == 1
    assert last.wait(10.0)
    assert len(looks) == 2
    assert looks[1] - looks[0] >= _PAUSE_SECONDS
    # Those that come later are looked at again.
    last.clear()
    unsetting.take(event(zenoh.SampleKind.PUT))
    assert last.wait(10.0)
    assert len(looks) == 3
