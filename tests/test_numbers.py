"""Numbers as people read them."""

from math import inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zenoh_cbef.numbers import number, written


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (0.00014208000000000002, "0.0001421"),
        (1795314853.3601525, "1795314853"),
        (1795314856018216261, "1795314856018216261"),
        (1e300, "1e+300"),
        (nan, "nan"),
        (True, "True"),
        (None, "None"),
        ("as it is", "as it is"),
        ({"a": [0.1, 2], "b": (0.30000000000000004,)}, "{a: [0.1, 2], b: [0.3]}"),
    ],
)
def test_values_are_written_for_people(value: object, words: str) -> None:
    assert written(value) == words


def test_there_may_be_no_number() -> None:
    assert (number(None), number(inf), number(nan, "m", nothing="n/a")) == ("-", "-", "n/a")
    assert number(12.3456, "m") == "12.35 m"


@given(st.floats(-1e300, 1e300))
def test_what_is_written_is_near_and_short(value: float) -> None:
    assert float(written(value)) == pytest.approx(value, rel=1e-3)
    assert len(written(value)) <= 17
