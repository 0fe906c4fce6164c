"""Changed copies are those of the standard library."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from functools import cached_property

import pytest

from zenoh_cbef.tracking.copying import replace


@dataclass(frozen=True)
class Square:
    side: float
    name: str = "square"

    @cached_property
    def area(self) -> float:
        return self.side**2


@dataclass(frozen=True)
class Checked:
    side: float
    area: float = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "area", self.side**2)


def test_a_copy_differs_in_the_named_fields_alone_and_the_original_stays():
    small = Square(2.0, "small")
    assert small.area == 4.0
    large = replace(small, side=3.0)
    assert large == dataclasses.replace(small, side=3.0) == Square(3.0, "small")
    assert large.area == 9.0, "what the original found out is not handed on"
    assert (small.side, small.area) == (2.0, 4.0)
    with pytest.raises(dataclasses.FrozenInstanceError):
        large.side = 1.0  # type: ignore[misc]


def test_what_follows_from_the_fields_is_made_anew():
    assert replace(Checked(2.0), side=3.0).area == 9.0


@pytest.mark.parametrize("warm", [False, True])
def test_an_unknown_field_is_refused(warm):
    one = Square(2.0)
    assert not warm or one.area == 4.0
    with pytest.raises(TypeError, match=r"^Square has no field sides$"):
        replace(one, sides=3.0)  # type: ignore[call-arg]
