"""What every course is: the way of the target, which `target.motion` names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, Self, cast

from zenoh_cbef.arrays import Floats

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Order:
    """Where a target that is steered goes while since <= time < until, s. to: m."""

    to: Point
    since: float
    until: float


@dataclass(frozen=True, kw_only=True)
class CourseSettings:
    """What any course may need to know: the keys of the scenario's [target] table, which has defaults, and of the run.

    seed: of the run, for streams. dt: s, from one step to the next. position: m. velocity, speed: m/s.
    acceleration_std: m/s^2. waypoints, radius: m. period: s. options: of a class of another package, `target.options`.
    """

    seed: int
    dt: float
    position: Point
    velocity: Point
    acceleration_std: float
    waypoints: tuple[Point, ...]
    speed: float
    radius: float
    period: float
    orders: tuple[Order, ...]
    options: Mapping[str, object]


class Course(Protocol):
    """The way of a target: a pure function of its settings."""

    @classmethod
    def of(cls, settings: CourseSettings) -> Self:
        """The course of these settings."""

    def states(self, time: Floats) -> Floats:
        """The target's true states at run times (t,), s: (t, 6), position (m) and velocity (m/s).

        time: of steps 0, 1, 2, ...; a longer run begins as a shorter one does.
        """


@dataclass(frozen=True)
class Settled:
    """What our own courses have in common: they are made of their settings alone."""

    settings: CourseSettings

    @classmethod
    def of(cls, settings: CourseSettings) -> Self:
        """The course of these settings."""
        return cls(settings)


def course_of(found: type, name: str) -> type[Course]:
    """A class of another package as a course. Raises ValueError, to stand after its key, if it is none."""
    if lacking := [f"{one}()" for one in ("of", "states") if not callable(getattr(found, one, None))]:
        raise ValueError(
            f"names {name!r}, which is no motion: it lacks {', '.join(lacking)}; add it, see docs/plugins.md"
        )
    return cast("type[Course]", found)
