"""Parts of a plan that no seed changes: plans of many seeds make them once."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, wraps
from typing import Any, TypeVar

Part = TypeVar("Part")


def alike(make: Callable[[Any], Part]) -> cached_property[Part]:
    """A cached property that is taken from the plan's `like`, one under another seed, where there is one."""

    @wraps(make)
    def made(plan: Any) -> Part:
        like = plan.like
        return make(plan) if like is None else getattr(like, make.__name__)

    return cached_property(made)
