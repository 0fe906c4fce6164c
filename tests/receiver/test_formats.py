"""The formats of receivers: ranges in bytes that come in pieces, are damaged, or are something else."""

import pytest

from tests.receiver.frames import LINK, development, linktrack_frame, mavlink_message
from zenoh_cbef.nodes.receiver.formats import FORMATS
from zenoh_cbef.nodes.receiver.lines import Lines, ranges_in


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("1.5, a7 ,3.25\n", [(1.5, "a7", 3.25)]),
        ("\ufeff1.5,a7,3.25", [(1.5, "a7", 3.25)]),
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


def test_a_line_that_was_cut_is_no_range():
    lines = Lines("csv")
    assert lines.feed(b"1.0,a,2.0\n1.5,a,3") == ([(1.0, "a", 2.0)], 0)
    lines.forget()
    assert lines.feed(b"2.0,a,4.0\nnoise\n2.5,a,5.0") == ([(2.0, "a", 4.0)], 1)
    assert lines.finish() == ([(2.5, "a", 5.0)], 0)


FRAMES = linktrack_frame(1500, {0: 3210, 7: 4500}) + linktrack_frame(1550, {3: 100_000})
MESSAGES = mavlink_message(1500, 0, 3210) + mavlink_message(1500, 7, 4500) + mavlink_message(1550, 3, 100_000)
RANGES = [(1.5, "0", 3.21), (1.5, "7", 4.5), (1.55, "3", 100.0)]


@pytest.mark.parametrize(("form", "told"), [("linktrack", FRAMES), ("mavlink", MESSAGES)])
@pytest.mark.parametrize("size", [1, 7, 100, 10_000])
def test_ranges_are_found_in_pieces_of_any_length_between_noise(form, told, size):
    reader = FORMATS[form]()
    stream = b"\x55\x00\x55\x04\x01" + told + b"\xff\x55"
    pieces = [reader.feed(stream[first : first + size]) for first in range(0, len(stream), size)]
    assert [one for piece in pieces for one in piece.ranges] == RANGES
    assert not reader.finish().ranges


@pytest.mark.parametrize(("form", "told", "first"), [("linktrack", FRAMES, 2), ("mavlink", MESSAGES, 1)])
def test_a_damaged_message_is_left_out_and_the_next_is_read(form, told, first):
    reader = FORMATS[form]()
    damaged = told[:20] + bytes([told[20] ^ 1]) + told[21:]
    assert list(reader.feed(damaged).ranges) == RANGES[first:]


@pytest.mark.parametrize(("form", "told"), [("linktrack", FRAMES), ("mavlink", MESSAGES)])
def test_what_was_begun_before_a_break_is_forgotten(form, told):
    reader = FORMATS[form]()
    assert not reader.feed(told[:30]).ranges or form == "mavlink"
    reader.forget()
    assert list(reader.feed(told).ranges) == RANGES


def test_distances_below_zero_and_other_messages_are_no_ranges():
    assert FORMATS["linktrack"]().feed(linktrack_frame(10, {1: -1})) == ([], 0)
    beat = development.MAVLink_heartbeat_message(1, 0, 0, 0, 0, 3).pack(LINK)
    assert FORMATS["mavlink"]().feed(bytes(beat)) == ([], 1)
