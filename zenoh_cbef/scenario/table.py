"""What every table of the scenario is made of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, JsonValue, model_validator

from zenoh_cbef.quantities import Metres, Motion, Position

Eigenvalue = Annotated[
    float, Field(gt=-1.0, lt=1.0, allow_inf_nan=False, description="a number between -1 and 1, both excluded")
]
Name = Annotated[
    str,
    Field(
        pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$",
        max_length=100,
        description="at most 100 letters, digits, dots, dashes and underscores, the first a letter or digit",
    ),
]
_POINT = Field(description="a list of three numbers, as in [1.0, 2.0, 3.0]")
_EACH = Field(description="three numbers [x, y, z], or a list with three numbers for each agent")
Point = Annotated[Position, _POINT]
Drift = Annotated[Motion, _POINT]
Corner = Annotated[Metres | Position, Field(description="a number, or three numbers [x, y, z], each from -1e7 to 1e7")]
Options = Annotated[dict[str, JsonValue] | None, Field(description="a table of options")]
EachPosition = Annotated[Position | tuple[Position, ...] | None, _EACH]
EachVelocity = Annotated[Motion | tuple[Motion, ...] | None, _EACH]


class Table(BaseModel):
    """A table of the scenario file: unknown keys are refused, values never change.

    Pydantic makes its validator where one is needed: few processes need any but the whole scenario's.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)

    def changed(self, **values: object) -> Self:
        """The same with other values, which nothing checks: of keys, and as mappings those of the tables in it."""
        tables = {
            name: inner.changed(**value)
            for name, value in values.items()
            if isinstance(value, Mapping) and isinstance(inner := getattr(self, name), Table)
        }
        return self.model_copy(update=values | tables)

    def mistakes(self) -> Mapping[str, bool]:
        """What keys may be that do not fit each other, in sentences with the remedy, each with whether they are."""
        return {}

    @model_validator(mode="after")
    def _fitting(self) -> Self:
        for sentence, made in self.mistakes().items():
            if made:
                raise ValueError(sentence)
        return self


def one_of(value: str, choices: tuple[str, ...]) -> str:
    """The value, if it is one of the choices. Raises ValueError."""
    if value not in choices:
        raise ValueError(f"must be one of {', '.join(choices)}, not {value!r}")
    return value
