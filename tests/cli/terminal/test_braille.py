"""Curves in braille characters."""

from hypothesis import given
from hypothesis import strategies as st

from zenoh_cbef.cli.terminal.braille import plot

BLANK = "\u2800"
VALUES = st.lists(st.none() | st.floats(1e-9, 1e9), max_size=60)


@given(VALUES, st.integers(12, 50), st.integers(2, 12))
def test_every_plot_has_the_size_that_was_asked_for(values, width, height):
    lines = plot(values, width, height)
    assert [len(line) for line in lines] == [width] * height
    drawn = any("\u2800" < character <= "\u28ff" for line in lines for character in line)
    assert drawn == any(one is not None for one in values[-2 * (width - 9) :])


def test_larger_is_higher_and_the_axis_holds_every_value():
    lines = plot([1.0, 0.01] * 4, 13, 8)
    assert (lines[0].split()[0], lines[-1].split()[0]) == ("3.2", "0.01")
    # A decade is twice as many points as half a one: 1 stands a fifth below the top, 0.01 at the bottom.
    rising = plot([0.01, 0.1, 1.0], 12, 5)
    heights = [next(row for row, line in enumerate(rising) if line[9 + column // 2] != BLANK) for column in (0, 2)]
    assert heights[1] < heights[0]


def test_only_the_latest_values_are_shown_and_gaps_stay_open():
    assert plot([5.0] * 100 + [None] * 8, 13, 2) == [" " * 13] * 2
    lines = plot([1.0, 1.0, None, None, 1.0, 1.0], 13, 1)
    assert lines[0][9] != BLANK
    assert lines[0][10] == BLANK
    assert lines[0][11] != BLANK
    assert plot([0.0, -1.0, float("nan"), float("inf")], 13, 2) == [" " * 13] * 2
