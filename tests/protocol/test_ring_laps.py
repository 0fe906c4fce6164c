"""Many laps of a ring: messages of all sizes come as they were left, and room is counted to the byte."""

from __future__ import annotations

from pathlib import Path

from zenoh_cbef.protocol.ring import DATA_BYTE, FRAME_BYTES, LEAST_BYTES, RingReader, RingWriter, fill_of


def alive(_tag: int) -> bool:
    return True


def said(number: int) -> bytes:
    return (number % 251).to_bytes(1, "little") * (number * 37 % 700)


def room(data: bytes) -> int:
    """Bytes of a message and its frame, in whole words."""
    return (FRAME_BYTES + len(data) + 7) // 8 * 8


def test_messages_of_all_sizes_come_as_they_were_left_lap_after_lap(tmp_path: Path) -> None:
    path = tmp_path / "one.ring"
    writer = RingWriter(path, ["a", "b"], LEAST_BYTES, alive)
    reader = RingReader(path, 1, alive)
    place = 0
    for number in range(150):
        data = said(number)
        if place % LEAST_BYTES + room(data) > LEAST_BYTES:  # it is passed over to the next lap
            place += LEAST_BYTES - place % LEAST_BYTES
        assert writer.write(number % 2, number, 0, data)
        place += room(data)
        assert reader.waiting > 0
        assert reader.read(9) == [(number % 2, number, 0, data)]
        assert reader.waiting == 0
        reader.save()
        assert fill_of(path) == 0.0
    assert place > 10 * LEAST_BYTES
    reader.close()
    writer.close(remove=True)


def test_a_ring_takes_as_much_as_it_has_room_for_and_no_more(tmp_path: Path) -> None:
    path = tmp_path / "one.ring"
    writer = RingWriter(path, ["a"], LEAST_BYTES + 5, alive)
    assert path.stat().st_size == DATA_BYTE + LEAST_BYTES
    data = bytes(64 - FRAME_BYTES)  # of 64 with its frame
    count = LEAST_BYTES // 64
    for number in range(count):
        assert fill_of(path) == number / count
        assert writer.write(0, 0, 0, data)
    assert fill_of(path) == 1.0
    assert not writer.write(0, 0, 0, b"")
    reader = RingReader(path, 1, alive)
    assert reader.waiting == LEAST_BYTES
    assert len(reader.read(1)) == 1
    assert reader.waiting == LEAST_BYTES - 64
    assert not writer.write(0, 0, 0, data)
    reader.save()
    assert not writer.write(0, 0, 0, bytes(65 - FRAME_BYTES))
    assert writer.write(0, 0, 0, data)
    assert len(reader.read(1000)) == count
    reader.close()
    writer.close(remove=True)


def test_a_new_reader_begins_where_the_slowest_one_is(tmp_path: Path) -> None:
    path = tmp_path / "one.ring"
    writer = RingWriter(path, ["a"], LEAST_BYTES, alive)
    for letter in (b"1", b"2", b"3"):
        writer.write(0, 0, 0, letter)
    first = RingReader(path, 1, alive)
    assert len(first.read(2)) == 2
    first.save()
    second = RingReader(path, 2, alive)
    assert [one[3] for one in second.read(9)] == [b"3"]
    second.save()
    third = RingReader(path, 3, alive)
    assert [one[3] for one in third.read(9)] == [b"3"]
    again = RingReader(path, 2, alive)
    assert again.read(9) == []
    for one in (first, second, third, again):
        one.close()
    writer.close(remove=True)


def test_a_reader_that_was_forgotten_goes_on_with_what_comes(tmp_path: Path) -> None:
    path, living = tmp_path / "one.ring", {1}
    writer = RingWriter(path, ["a"], LEAST_BYTES, lambda tag: tag in living)
    slow, quick = RingReader(path, 2, alive), RingReader(path, 1, alive)
    for number in range(3 * LEAST_BYTES // 64):
        assert writer.write(0, 0, 0, number.to_bytes(40, "little"))
        assert len(quick.read(9)) == 1
        quick.save()
    assert slow.read(9) == []
    assert writer.write(0, 0, 0, b"late")
    assert [one[3] for one in slow.read(9)] == [b"late"]
    slow.close()
    quick.close()
    writer.close(remove=True)


def test_a_ring_has_room_for_the_names_of_all_beacons(tmp_path):
    path, names = tmp_path / "ring", [f"cbef/a-run-with-a-long-name/beacon/{agent}" for agent in range(1000)]
    writer = RingWriter(path, names, LEAST_BYTES, alive)
    reader = RingReader(path, 7, alive)
    assert reader.names == names
    said = [(999, 3, 5, b"last"), (255, 4, 6, bytes(200))]
    for one in said:
        assert writer.write(*one)
    assert reader.read(10) == said
    reader.close()
    writer.close(remove=True)
