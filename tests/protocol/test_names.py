"""Which names of runs are taken."""

from __future__ import annotations

import pytest

from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol.names import LONGEST, check_run, checked


def test_a_name_is_what_it_was_and_none_stays_none() -> None:
    assert check_run(None) is None
    for name in (
        "a",
        "run-1.b_2",
        "\N{LATIN SMALL LETTER E WITH ACUTE}t\N{LATIN SMALL LETTER E WITH ACUTE}",
        "x" * LONGEST,
    ):
        assert check_run(name) == checked(name, "--name") == name


@pytest.mark.parametrize("name", ["", ".hidden", "-a", "a/b", "a b", "a*"])
def test_a_name_that_is_no_part_of_a_key_is_refused(name: str) -> None:
    with pytest.raises(UserError, match="is no run name; use letters, digits"):
        check_run(name)


def test_a_name_that_is_too_long_is_refused() -> None:
    with pytest.raises(UserError, match=f"has {LONGEST + 1} characters; use at most {LONGEST}"):
        check_run("x" * (LONGEST + 1))
