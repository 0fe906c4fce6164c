"""When a process is too slow: at least ten, and at least a tenth of all."""

import pytest

from zenoh_cbef.protocol.slow import too_slow


@pytest.mark.parametrize(("late", "due", "slow"), [(10, 100, True), (10, 10, True), (9, 9, False), (10, 101, False)])
def test_ten_and_a_tenth_are_too_many(late: int, due: int, slow: bool) -> None:
    assert too_slow(late, due) is slow
