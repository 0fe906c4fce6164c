"""`receive` feeds a run from UDP: the user counts no steps."""

import math
import os
import pty
import socket
import threading
import time
import tty

import numpy as np
import pytest

from tests.processes.target.test_receivers import block
from zenoh_cbef.errors import UserError
from zenoh_cbef.nodes.receiver.formats import ranges_in
from zenoh_cbef.nodes.receiver.sources import lines_of, serial_lines

PLACES = [(0.0, 0.0, 2.0), (8.0, 0.0, 0.5), (8.0, 6.0, 2.5), (0.0, 6.0, 1.0)]


def place(seconds):
    return (4.0 + math.cos(seconds), 3.0 + math.sin(seconds), 1.0)


def send(port, over):
    """A tag at a clock of its own, s, until the test is over; a line in ten is noise."""
    begin = time.time()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as tag:
        number = 0
        while not over.wait(0.02):
            now = time.time()
            lines = [
                f"{now - begin + 5.0:.6f},{each},{math.dist(place(now), at):.6f}" for each, at in enumerate(PLACES)
            ]
            tag.sendto("\n".join([*lines, "noise"] if number % 10 == 0 else lines).encode(), ("127.0.0.1", port))
            number += 1


def test_a_stream_of_lines_over_udp_is_tracked(world, free_port):
    (world.folder / "live.toml").write_text(block("toml", 'name = "live"'))
    router = f"tcp/127.0.0.1:{free_port}"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    join = ["--run", world.run, "--client", "--connect", router, "--patience", "60"]
    started = world.start("router", "--listen", router)
    assert started.stdout.readline()
    over = threading.Event()
    tag = threading.Thread(target=send, args=(port, over))
    tag.start()
    try:
        receiver = world.start("receive", f"udp:127.0.0.1:{port}", *join)
        processes = [world.start("record", *join, "--output", str(world.log))]
        processes += [world.start("agent", str(agent), *join) for agent in range(4)]
        processes.append(world.start("target", "live.toml", *join, "--receivers"))
        for process in [*processes, receiver]:
            out, err = process.communicate(timeout=150)
            assert process.returncode == 0, err
        assert "0 of unknown anchors" in out
        assert not out.startswith("0 ranges")
    finally:
        over.set()
        tag.join()
    exported = world.call("export", str(world.log), "--output", "live.npz")
    assert exported.returncode == 0, exported.stderr
    arrays = np.load(world.folder / "live.npz")
    ranges = arrays["ranges"]
    assert np.isfinite(ranges).any(axis=1).all(), "the receiver's steps are those of the run"
    path = np.array([place(angle) for angle in np.linspace(0.0, 2.0 * math.pi, 1000)])
    for heard, at in zip(ranges, PLACES, strict=True):
        distances = np.linalg.norm(path - at, axis=1)
        known = heard[np.isfinite(heard)]
        assert distances.min() - 0.01 < known.min() <= known.max() < distances.max() + 0.01


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("1.5, a7 ,3.25\n", [(1.5, "a7", 3.25)]),
        ('{"t": 1.5, "anchor": 3, "range": 2}', [(1.5, "3", 2.0)]),
        ('{"anchor": "b", "range": 2}', [(None, "b", 2.0)]),
        ("0C16[0.00,0.00,2.00]=3.21 0c17[1.00,0.00,2.00]=4.5 le_us=2576", [(None, "0C16", 3.21), (None, "0C17", 4.5)]),
        ("DIST,1,AN0,0C16,0.00,0.00,2.00,3.21,POS,1,2,3,60", [(None, "0C16", 3.21)]),
        ("1.5,a,-3", []),
        ("t,anchor,range", []),
        ('["noise"', []),
    ],
)
def test_lines_of_receivers_are_read(line, found):
    assert ranges_in(line, "auto") == found


def talk(tag, line, over):
    while not over.wait(0.05):
        os.write(tag, line)


def test_a_serial_port_that_was_unplugged_is_opened_again(tmp_path):
    port = tmp_path / "ttyUSB0"
    lines = serial_lines(str(port), lambda: False)
    for number in range(2):
        tag, end = pty.openpty()
        tty.setraw(end)
        port.unlink(missing_ok=True)
        port.symlink_to(os.ttyname(end))
        over = threading.Event()
        # What is written before a port is opened is lost, so the tag says it again and again.
        talking = threading.Thread(target=talk, args=(tag, f"{number},a,1\n".encode(), over))
        talking.start()
        try:
            while next(lines).strip() != f"{number},a,1":
                pass
        finally:
            over.set()
            talking.join()
        os.close(end)
        os.close(tag)


@pytest.mark.parametrize("source", ["usb", "tcp:a:1", "udp:nowhere", "file:"])
def test_what_is_no_source_is_told(source):
    with pytest.raises(UserError, match="as "):
        next(lines_of(source, lambda: False))
