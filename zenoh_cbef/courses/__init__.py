"""The ways that a target takes, one per file.

Adding one is a file with a class as in waypoints.py, and a line in COURSES.
A course of another package is named by its class, see plugins.py.
"""

from __future__ import annotations

from zenoh_cbef.courses.base import Course, CourseSettings, Order, course_of
from zenoh_cbef.courses.circle import Circle
from zenoh_cbef.courses.lemniscate import Lemniscate
from zenoh_cbef.courses.manual import Manual
from zenoh_cbef.courses.random_acceleration import RandomAcceleration
from zenoh_cbef.courses.waypoints import Waypoints
from zenoh_cbef.plugins import Registry

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

_REGISTRY: Registry[Course] = Registry("motions", COURSES, course_of, RECORDED)
kind_of, mark_of, options_of = _REGISTRY.kind_of, _REGISTRY.mark_of, _REGISTRY.options_of
