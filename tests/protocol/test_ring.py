"""What a process leaves in its ring is there whole or not at all, once, and in order, also of killed processes."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule

from zenoh_cbef.protocol.ring import (
    FRAME_BYTES,
    LEAST_BYTES,
    RingError,
    RingReader,
    RingWriter,
    Said,
    fill_of,
    is_written,
)
from zenoh_cbef.protocol.ring_folder import FOLDER, RingFolder, clear_rings, tag_of

NAMES = ["range", "round"]
HERE, THERE = 1, 2
MOMENT = (1 << 63) + 5

WRITER = """
import os, signal, sys, time
from pathlib import Path
from zenoh_cbef.protocol import ring
path, bytes_, at = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
writer = ring.RingWriter(Path(path), ["count"], bytes_, lambda _: True)
number, checksum = 0, ring.crc32
def dying(data, start):
    if number == at:
        os.kill(os.getpid(), signal.SIGKILL)  # the bytes are there, the rest is not
    return checksum(data, start)
ring.crc32 = dying
while True:
    data = number.to_bytes(8, "little") * (1 + number % 40)
    while not writer.write(0, len(data), (1 << 63) + 5, data):
        time.sleep(0.001)
    number += 1
"""


def alive(_tag: int) -> bool:
    return True


def read_all(reader: RingReader) -> list[tuple[str, bytes]]:
    return [named(reader, one) for one in reader.read(1 << 30)]


def named(reader: RingReader, said: Said) -> tuple[str, bytes]:
    """The name of its kind, and its bytes, of a message whose number and time are those that `leave` gives it."""
    kind, number, sent, data = said
    assert (number, sent) == (len(data), MOMENT)
    return reader.names[kind], data


def leave(writer: RingWriter, kind: int, data: bytes) -> bool:
    return writer.write(kind, len(data), MOMENT, data)


@pytest.fixture
def path() -> Iterator[Path]:
    base = Path("/dev/shm") if os.access("/dev/shm", os.W_OK) else Path("/tmp")  # noqa: S108
    place = base / f"zenoh-cbef-test-{os.getpid()}.ring"
    yield place
    place.unlink(missing_ok=True)


class OneRing(RuleBasedStateMachine):
    """Every message comes once and in order to each reader, whichever process reads, saves its place, or is killed."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = tempfile.TemporaryDirectory()
        self.path = Path(self.folder.name) / "one.ring"
        self.writer = RingWriter(self.path, NAMES, LEAST_BYTES, alive)
        self.reader, self.other = RingReader(self.path, HERE, alive), RingReader(self.path, THERE, alive)
        self.due: list[tuple[str, bytes]] = []
        self.unsaved: list[tuple[str, bytes]] = []
        self.others_due: list[tuple[str, bytes]] = []

    @rule(kind=st.integers(0, 1), data=st.binary(max_size=900))
    def write(self, kind: int, data: bytes) -> None:
        if leave(self.writer, kind, data):
            self.due.append((NAMES[kind], data))
            self.others_due.append((NAMES[kind], data))

    @rule(most=st.sampled_from([1, 3, 1000]))
    def read(self, most: int) -> None:
        got = [named(self.reader, one) for one in self.reader.read(most)]
        assert got == self.due[:most]
        del self.due[:most]
        self.unsaved += got

    @rule()
    def save(self) -> None:
        self.reader.save()
        self.unsaved.clear()

    @rule()
    def the_next_goes_on(self) -> None:
        self.reader.close()
        self.reader = RingReader(self.path, HERE, alive)
        self.due[:0] = self.unsaved
        self.unsaved.clear()

    @rule()
    def the_other_reads(self) -> None:
        assert read_all(self.other) == self.others_due
        self.others_due.clear()
        self.other.save()

    def teardown(self) -> None:
        assert read_all(self.reader) == self.due
        self.reader.close()
        self.other.close()
        self.writer.close(remove=True)
        self.folder.cleanup()


TestOneRing = OneRing.TestCase
TestOneRing.settings = settings(max_examples=30, stateful_step_count=40, deadline=None)


def test_a_full_ring_takes_nothing_and_loses_nothing(path: Path) -> None:
    writer, reader = RingWriter(path, NAMES, LEAST_BYTES, alive), None
    sent = 0
    while leave(writer, 0, sent.to_bytes(50, "little")):
        sent += 1
    reader = RingReader(path, HERE, alive)
    assert [int.from_bytes(data, "little") for _, data in read_all(reader)] == [*range(sent)]
    assert not leave(writer, 0, b"read, but not safe yet")
    assert fill_of(path) > 0.9
    reader.save()
    assert fill_of(path) == 0.0
    assert leave(writer, 1, b"room again")
    assert read_all(reader) == [("round", b"room again")]
    reader.close()
    writer.close(remove=True)
    assert fill_of(path) == 0.0


def test_a_dead_reader_holds_a_ring_up_only_while_no_other_reads_it(path: Path) -> None:
    living = {HERE}
    writer = RingWriter(path, NAMES, LEAST_BYTES, lambda tag: tag in living)
    dead = RingReader(path, THERE, alive)
    dead.close()
    sent = 0
    while leave(writer, 0, bytes(50)):
        sent += 1
    reader = RingReader(path, HERE, lambda tag: tag in living)
    assert len(read_all(reader)) == sent
    assert not leave(writer, 0, bytes(50))
    reader.save()
    assert leave(writer, 0, bytes(50))
    assert writer.readers
    living.clear()
    assert not writer.readers
    reader.close()
    writer.close(remove=True)


def test_what_the_slower_of_two_readers_has_not_taken_stays(path: Path) -> None:
    writer = RingWriter(path, NAMES, LEAST_BYTES, alive)
    fast, slow = RingReader(path, HERE, alive), RingReader(path, THERE, alive)
    sent = 0
    while leave(writer, 0, sent.to_bytes(50, "little")):
        sent += 1
    assert len(read_all(fast)) == sent
    fast.save()
    assert not leave(writer, 0, bytes(50))
    assert [int.from_bytes(data, "little") for _, data in read_all(slow)] == [*range(sent)]
    for end in (fast, slow):
        end.close()
    path.unlink()
    writer.close(remove=True)  # also where the file is gone


def test_a_message_that_does_not_fit_is_refused(path: Path) -> None:
    writer = RingWriter(path, NAMES, LEAST_BYTES, alive)
    assert not leave(writer, 0, bytes(LEAST_BYTES))
    assert leave(writer, 0, bytes(LEAST_BYTES - FRAME_BYTES))
    writer.close(remove=True)


@pytest.mark.processes
@pytest.mark.parametrize("at", [0, 1, 7, 100, 2000])
def test_a_writer_that_is_killed_in_the_middle_of_a_message_leaves_all_before_it(path: Path, at: int) -> None:
    size = 1 << 14
    with subprocess.Popen([sys.executable, "-c", WRITER, path, str(size), str(at)]) as process:
        got: list[bytes] = []
        reader = None
        try:
            while process.poll() is None:
                if reader is None and path.exists():
                    reader = RingReader(path, HERE, alive)
                elif reader is not None:
                    got += [data for _, data in read_all(reader)]
                    reader.save()
                time.sleep(0.001)
            reader = reader or RingReader(path, HERE, alive)
            got += [data for _, data in read_all(reader)]
            assert process.returncode == -signal.SIGKILL
            assert [int.from_bytes(data[:8], "little") for data in got] == [*range(at)]
            assert all(data == data[:8] * (1 + number % 40) for number, data in enumerate(got))
            assert not reader.written
        finally:
            process.kill()
            if reader is not None:
                reader.close()


def test_a_ring_is_known_to_be_written_while_its_writer_lives(path: Path) -> None:
    writer = RingWriter(path, NAMES, LEAST_BYTES, alive)
    reader = RingReader(path, HERE, alive)
    assert reader.written
    assert is_written(path)
    assert not reader.left
    writer.leave()
    assert reader.left
    writer.close(remove=False)
    assert not reader.written
    reader.close()


def test_bytes_that_are_not_the_writer_s_are_not_read(path: Path) -> None:
    writer = RingWriter(path, NAMES, LEAST_BYTES, alive)
    leave(writer, 0, b"true")
    leave(writer, 0, b"false")
    with path.open("r+b") as file:
        file.seek(path.read_bytes().index(b"false"))
        file.write(b"x")
    reader = RingReader(path, HERE, alive)
    assert read_all(reader) == [("range", b"true")]
    assert read_all(reader) == []
    reader.pass_over()
    leave(writer, 1, b"later")
    assert read_all(reader) == [("round", b"later")]
    reader.close()
    writer.close(remove=True)


@pytest.mark.parametrize("content", [b"", b"no ring", bytes(8192), os.urandom(8195)])
def test_another_file_is_no_ring(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    with pytest.raises(RingError, match="is no ring"):
        RingReader(path, HERE, alive)


def test_more_readers_than_a_ring_has_room_for_are_refused(path: Path) -> None:
    writer = RingWriter(path, NAMES, LEAST_BYTES, alive)
    readers = [RingReader(path, tag, alive) for tag in range(1, 9)]
    with pytest.raises(RingError, match="8 readers"):
        RingReader(path, 9, alive)
    for reader in readers:
        reader.close()
    late = RingReader(path, 9, lambda _: False)
    late.close()
    writer.close(remove=True)


def test_a_disk_that_is_full_refuses_a_ring_at_once(path: Path) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, hard))
    try:
        with pytest.raises(OSError, match="too large"):
            RingWriter(path, NAMES, 1 << 22, alive)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert not path.exists()
    assert not path.with_suffix(".new").exists()
    assert not any(path.stem in str(one.resolve()) for one in Path("/dev/fd").iterdir()), "it is let go of"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RingFolder:
    monkeypatch.setenv(FOLDER, str(tmp_path / "rings"))
    found = RingFolder("mine", "ab12")
    found.make()
    return found


def test_a_folder_names_the_rings_of_a_run_by_age(folder: RingFolder) -> None:
    assert folder.rings() == []
    writers = [RingWriter(folder.ring(agent, "c0"), NAMES, LEAST_BYTES, folder.is_read) for agent in (7, 3)]
    (folder.path / "no.ring").touch()
    assert [name.agent for name, _ in folder.rings()] == [7, 3]
    assert {name.life for name, _ in folder.rings()} == {"c0"}
    for writer in writers:
        writer.close(remove=True)


@pytest.mark.slow
def test_a_reader_of_a_name_is_alone_and_known_to_live(folder: RingFolder) -> None:
    tag = tag_of("record/record")
    assert not folder.is_read(tag)
    held = folder.enter(tag)
    assert held is not None
    assert folder.is_read(tag)
    assert folder.enter(tag) is None
    os.close(held)
    assert not folder.is_read(tag)
    with folder.alone():
        pass


def test_what_ended_processes_left_is_cleared_and_nothing_else(folder: RingFolder) -> None:
    ended = RingWriter(folder.ring(0, "c0"), NAMES, LEAST_BYTES, folder.is_read)
    ended.close(remove=False)
    living = RingWriter(folder.ring(1, "c1"), NAMES, LEAST_BYTES, folder.is_read)
    other = RingFolder("mine.too", "ab12")
    other.make()
    RingWriter(other.ring(0, "c0"), NAMES, LEAST_BYTES, folder.is_read).close(remove=False)
    clear_rings("mine")
    assert [name.agent for name, _ in folder.rings()] == [1]
    living.close(remove=True)
    clear_rings("mine")
    assert not folder.path.exists()
    assert len(other.rings()) == 1


@pytest.mark.usefixtures("folder")
def test_a_folder_of_another_user_is_not_used(tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    stranger = RingFolder("his", "ab12")
    stranger.path.symlink_to(elsewhere)
    with pytest.raises(PermissionError, match="another user"):
        stranger.make()
