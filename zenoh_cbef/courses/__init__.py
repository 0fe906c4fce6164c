"""The ways that a target takes, one per file.

Adding one is a file with a class as in waypoints.py, and a line in COURSES.
A course of another package is named by its class, see plugins.py.
"""

from __future__ import annotations

from collections.abc import Mapping

from zenoh_cbef.courses.base import Course, CourseSettings, Order, course_of
from zenoh_cbef.courses.circle import Circle
from zenoh_cbef.courses.lemniscate import Lemniscate
from zenoh_cbef.courses.manual import Manual
from zenoh_cbef.courses.random_acceleration import RandomAcceleration
from zenoh_cbef.courses.waypoints import Waypoints
from zenoh_cbef.plugins import Plugin, find, told_options

__all__ = ["COURSES", "RECORDED", "Course", "CourseSettings", "Order", "kind_of", "mark_of", "options_of"]

COURSES: dict[str, type[Course]] = {
    "ncv": RandomAcceleration,
    "waypoints": Waypoints,
    "circle": Circle,
    "lemniscate": Lemniscate,
    "manual": Manual,
}

RECORDED = "dataset"
"""The name of what is no course: a target that was recorded."""


def kind_of(name: str) -> type[Course]:
    """The course of a name. Raises ValueError, to stand after `target.motion`, where there is none."""
    return COURSES[name] if name in COURSES else course_of(_plugin(name).found, name)


def mark_of(name: str) -> str | None:
    """Package, version and source of a course of another package; None for one of our own."""
    return None if name in COURSES or name == RECORDED else _plugin(name).mark


def options_of(name: str, given: Mapping[str, object]) -> dict[str, object]:
    """All options of a course of another package. Raises ValueError with a sentence that names the option."""
    kind = None if name == RECORDED else kind_of(name)
    return told_options(getattr(kind, "options", None), name, given, "target.options")


def _plugin(name: str) -> Plugin:
    return find("motions", name, (*COURSES, RECORDED))
