"""The numbers of a scenario: every kind of quantity has one range, which the model, the checks and the messages share.

The ranges are wide (coordinates centred on the Earth fit), and narrow enough that no square of them leaves float64.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field


def _within(least: float, most: float) -> Any:
    said = f"a number from {least:.12g} to {most:.12g}"
    return Field(ge=least, le=most, allow_inf_nan=False, description=said)


Finite = Annotated[float, Field(allow_inf_nan=False)]
"""A limit to compare with; nothing is computed from it."""

Metres = Annotated[float, _within(-1e7, 1e7)]
"""A coordinate, or an error of either sign."""

Length = Annotated[float, _within(1e-9, 1e7)]
Spread = Annotated[float, _within(0.0, 1e7)]
"""A length that may be nothing, m."""

Velocity = Annotated[float, _within(-1e6, 1e6)]
Speed = Annotated[float, _within(1e-6, 1e6)]
SignalSpeed = Annotated[float, _within(1e-3, 1e9)]
Acceleration = Annotated[float, _within(0.0, 1e6)]
"""m/s^2."""

Rate = Annotated[float, _within(1e-9, 1e3)]
"""How fast a direction turns, rad/s."""

Seconds = Annotated[float, _within(0.0, 1e9)]
"""A run time."""

Moment = Annotated[float, _within(-1e12, 1e12)]
"""A time on a recording's own clock, as that since 1970, s."""

Duration = Annotated[float, _within(1e-6, 1e6)]
"""A stretch of time that is not nothing, s."""

Milliseconds = Annotated[float, _within(0.0, 1e9)]
Probability = Annotated[float, _within(0.0, 1.0)]
Chance = Annotated[float, _within(1e-9, 1.0)]
"""A probability of something that can happen."""

Factor = Annotated[float, _within(1e-6, 1e12)]
"""A multiple of something, above zero."""

Deviations = Annotated[float, _within(0.0, 100.0)]
"""How many standard deviations."""

Agent = Annotated[int, Field(ge=0, lt=10**6)]
"""A number that may be an agent's; whether the scenario has it, its check says."""

Count = Annotated[int, Field(ge=1, le=1000)]

MOST_AGENTS = 1000
"""How many agents of a run can be processes; a simulation has no limit but memory."""

AgentCount = Annotated[int, Field(ge=1, le=10**9)]
"""How many agents: what fits into memory, which is said before a simulation, and fewer as processes."""

SEEDS = 2**64
"""How many seeds there are; after the last comes the first."""

Seed = Annotated[int, Field(ge=0, lt=SEEDS)]

Position = tuple[Metres, Metres, Metres]
Motion = tuple[Velocity, Velocity, Velocity]
