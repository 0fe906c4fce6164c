"""`receive` feeds a run: in realtime, and in lockstep with the bits of a run of the recording."""

import math
import socket
import threading
import time

import numpy as np
import pytest

from tests.processes.conftest import ended, unused_port
from tests.processes.target.test_receivers import block
from tests.receiver.cable import Cable
from tests.receiver.frames import linktrack_frame, mavlink_message
from tests.waiting import until
from zenoh_cbef.tracking.status import TRACKING

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


def fed(world, port, scenario, source, *options):
    """What a receiver printed that fed a run of four agents, through a router at a port."""
    router = f"tcp/127.0.0.1:{port}"
    join = ["--run", world.run, "--client", "--connect", router, "--patience", "100"]
    assert world.start("router", "--listen", router).stdout.readline()
    receiver = world.start("receive", source, *options, *join)
    others = [world.start("record", *join, "--output", str(world.log))]
    others += [world.start("agent", str(agent), *join) for agent in range(len(PLACES))]
    others.append(world.start("target", scenario, *join, "--receivers"))
    for process in others:
        ended(process, timeout=250)
    printed, _ = ended(receiver, timeout=250)
    assert " 0 of unknown anchors" in printed
    return printed


def test_a_stream_of_lines_over_udp_is_tracked(world, free_port):
    (world.folder / "live.toml").write_text(block("toml", 'name = "live"'))
    port = unused_port(socket.SOCK_DGRAM)
    over = threading.Event()
    tag = threading.Thread(target=send, args=(port, over))
    tag.start()
    try:
        assert not fed(world, free_port, "live.toml", f"udp:127.0.0.1:{port}").startswith("0 ranges")
    finally:
        over.set()
        tag.join()
    world.done("export", str(world.log), "--output", "live.npz")
    arrays = np.load(world.folder / "live.npz")
    ranges = arrays["ranges"]
    assert np.isfinite(ranges).any(axis=1).all(), "the receiver's steps are those of the run"
    path = np.array([place(angle) for angle in np.linspace(0.0, 2.0 * math.pi, 1000)])
    for heard, at in zip(ranges, PLACES, strict=True):
        distances = np.linalg.norm(path - at, axis=1)
        known = heard[np.isfinite(heard)]
        assert distances.min() - 0.01 < known.min() <= known.max() < distances.max() + 0.01


def lines_of(metres):
    """What a DWM1001 says to `lec`, of anchors AA00 to AA03."""
    told = ",".join(f"AN{each},AA0{each},0,0,0,{one:.2f}" for each, one in enumerate(metres))
    return f"DIST,{len(metres)},{told}\n".encode()


def replugged(port, over):
    """A DWM1001 that rests, plugged in and out until the test is over; ranges of every second cable are 1 cm longer."""
    number = 0
    while not over.is_set():
        cable = Cable(port, over)
        cable.plug()
        for _ in range(20):
            if not over.wait(0.03):
                cable.write(lines_of([math.dist(REST, at) + 0.01 * (number % 2) for at in PLACES]))
        cable.close()
        number += 1


REST = (4.0, 3.0, 1.0)
LIVE = """name = "live"
dt = 0.25
steps = 60
agents = {count = 4, labels = ["AA00", "AA01", "AA02", "AA03"], positions = %s}
timing.mode = "realtime"
filter = {motion = "stationary", range_std = 0.05}
"""


def test_a_dwm1001_goes_on_whenever_it_is_plugged_in_again(world, free_port):
    (world.folder / "live.toml").write_text(LIVE % [list(place) for place in PLACES])
    over = threading.Event()
    tag = threading.Thread(target=replugged, args=(world.folder / "ttyUSB0", over))
    tag.start()
    try:
        fed(world, free_port, "live.toml", "serial:ttyUSB0", "--format", "dwm1001")
    finally:
        over.set()
        tag.join()
    world.done("export", str(world.log), "--output", "live.npz")
    arrays = np.load(world.folder / "live.npz")
    for heard, at in zip(arrays["ranges"], PLACES, strict=True):
        expected = {round(math.dist(REST, at) + more, 2) for more in (0.0, 0.01)}
        assert set(np.round(heard[np.isfinite(heard)], 6)) == expected, "ranges of cables that follow one another"
    # Agents whose first rounds come too late, as on a busy machine, may take the mirror image, and say `lost` for long.
    sure = arrays["status"][:, -1] == TRACKING
    assert np.isfinite(arrays["estimates"][:, -1]).all()
    assert (np.linalg.norm(arrays["estimates"][sure, -1, :3] - REST, axis=1) < 0.2).all()


DT, STEPS, ANCHORS = 0.25, 24, 4
RECORDED = """name = "recorded"
dt = 0.25
steps = 22
filter.range_std = 0.1
target = {motion = "dataset", path = "set"}
"""


def recording(folder):
    """A data set with times in ms and ranges in mm, some of them after the run's last step: (ms, id, mm)."""
    (folder / "set").mkdir()
    dice = np.random.default_rng(5)
    ranges = []
    for ms in range(13, int(1000 * DT * STEPS), 61):
        anchor = int(dice.integers(ANCHORS))
        distance = math.dist(place(1e-3 * ms), PLACES[anchor]) + 0.05 * dice.normal()
        ranges.append((ms, anchor, round(1000 * distance)))
    write = (folder / "set" / "ranges.csv").write_text
    write("".join(["t,anchor_id,range\n", *(f"{ms / 1e3},{anchor},{mm / 1e3}\n" for ms, anchor, mm in ranges)]))
    rows = "".join(f"{number},{x},{y},{z}\n" for number, (x, y, z) in enumerate(PLACES))
    (folder / "set" / "anchors.csv").write_text("id,x,y,z\n" + rows)
    truth = "".join("{},{},{},{}\n".format(0.1 * tenth, *place(0.1 * tenth)) for tenth in range(70))
    (folder / "set" / "truth.csv").write_text("t,x,y,z\n" + truth)
    (folder / "recorded.toml").write_text(RECORDED)
    return ranges


def await_port(port):
    """Wait until a receiver listens on a UDP port: a test cannot bind it any more."""

    def is_taken():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                return True
        return False

    until(is_taken, "the receiver does not listen", 200.0)


def over_udp(ranges, port):
    """MAVLink messages, ten in a datagram."""
    await_port(port)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as tag:
        for first in range(0, len(ranges), 10):
            told = ranges[first : first + 10]
            tag.sendto(b"".join(mavlink_message(ms, anchor, mm) for ms, anchor, mm in told), ("127.0.0.1", port))


def over_serial(ranges, port):
    """Frames of LinkTrack; the cable is taken out within one, a third on the way, and plugged in again: returns it."""
    cable, third = Cable(port), len(ranges) // 3
    cable.plug()
    for number, (ms, anchor, mm) in enumerate(ranges):
        frame = linktrack_frame(ms, {anchor: mm})
        if number == third:
            cable.unplug(frame[: len(frame) // 2])
            cable.plug()
        cable.write(frame)
    return cable


@pytest.mark.parametrize("kind", ["udp", "file", "serial"])
def test_a_recording_that_is_received_in_lockstep_has_the_bits_of_its_run(world, free_port, kind):
    ranges = recording(world.folder)
    port = unused_port(socket.SOCK_DGRAM)
    source, form = {
        "udp": (f"udp:127.0.0.1:{port}", "mavlink"),
        "file": ("file:set/ranges.csv", "auto"),
        "serial": ("serial:ttyUSB0", "linktrack"),
    }[kind]

    cables = []

    def talk():
        if kind == "udp":
            over_udp(ranges, port)
        elif kind == "serial":
            cables.append(over_serial(ranges, world.folder / "ttyUSB0"))

    talking = threading.Thread(target=talk, daemon=True)
    talking.start()
    try:
        assert "late" not in fed(world, free_port, "recorded.toml", source, "--format", form, "--silence", "100")
    finally:
        talking.join()
        for cable in cables:
            cable.close()
    world.done("sim", "recorded.toml", "--output", "expected.npz")
    world.done("export", str(world.log), "--output", "received.npz")
    expected, received = (np.load(world.folder / f"{name}.npz") for name in ("expected", "received"))
    for name in ("ranges", "estimates", "covariances", "truth"):
        np.testing.assert_array_equal(received[name], expected[name])
    assert "equal bit for bit" in world.verdict()


def test_a_file_without_a_range_is_told_and_the_run_still_waits_for_one(world, free_port):
    (world.folder / "live.toml").write_text((LIVE % [list(place) for place in PLACES]).replace("realtime", "lockstep"))
    router = f"tcp/127.0.0.1:{free_port}"
    join = ["--run", world.run, "--client", "--connect", router, "--patience", "100"]
    assert world.start("router", "--listen", router).stdout.readline()
    target = world.start("target", "live.toml", *join, "--receivers")
    (world.folder / "other.csv").write_text("0.1,BB00,3.5\n")
    for form, told in (
        ("linktrack", "tells no range that --format linktrack reads"),
        ("csv", "of other anchors alone"),
    ):
        refused = world.call("receive", "file:other.csv", "--format", form, *join)
        assert (refused.returncode, told in refused.stderr) == (2, True), refused.stderr
    assert target.poll() is None
