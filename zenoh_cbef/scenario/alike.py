"""Parts of a plan that no seed changes: plans of many seeds make them once."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, wraps
from typing import Protocol, TypeVar, cast


class Seeded(Protocol):
    """What may be like another one, under another seed."""

    @property
    def like(self) -> Seeded | None:
        """That other one."""


Whole = TypeVar("Whole", bound=Seeded)
Part = TypeVar("Part")


def alike(make: Callable[[Whole], Part]) -> cached_property[Part]:
    """A cached property that is taken from the plan's `like`, one under another seed, where there is one."""

    @wraps(make)
    def made(plan: Whole) -> Part:
        return make(plan) if plan.like is None else cast("Part", getattr(plan.like, make.__name__))

    return cached_property(made)
