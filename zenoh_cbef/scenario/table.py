"""What every table of the scenario is made of."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Probability = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]
Eigenvalue = Annotated[
    float, Field(gt=-1.0, lt=1.0, allow_inf_nan=False, description="a number between -1 and 1, both excluded")
]
Vector = tuple[Finite, Finite, Finite]
Name = Annotated[
    str,
    Field(
        pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$",
        max_length=100,
        description="at most 100 letters, digits, dots, dashes and underscores, the first a letter or digit",
    ),
]
Point = Annotated[Vector, Field(description="a list of three numbers, as in [1.0, 2.0, 3.0]")]
Corner = Annotated[Finite | Vector, Field(description="a number, or three numbers [x, y, z]")]
EachVector = Annotated[
    Vector | tuple[Vector, ...] | None,
    Field(description="three numbers [x, y, z], or a list with three numbers for each agent"),
]


class Table(BaseModel):
    """A table of the scenario file: unknown keys are refused, values never change."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def one_of(value: str, choices: tuple[str, ...]) -> str:
    """The value, if it is one of the choices. Raises ValueError."""
    if value not in choices:
        raise ValueError(f"must be one of {', '.join(choices)}, not {value!r}")
    return value
