"""Parts of a plan that neither seeds nor injected faults change: plans of many seeds make them once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, wraps
from typing import Self, TypeVar, cast

from zenoh_cbef.scenario.model import Scenario


@dataclass(frozen=True, eq=False)
class Meant:
    """What a scenario means. like: of one that differs in the seed alone, or None."""

    scenario: Scenario
    like: Self | None = None

    @cached_property
    def known(self) -> Self:
        """What agents go by: the scenario without injected faults; itself where there are none."""
        told = tuple(fault for fault in self.scenario.fault if not fault.injected)
        return self if len(told) == len(self.scenario.fault) else type(self)(self.scenario.changed(fault=told))


Whole = TypeVar("Whole", bound=Meant)
Part = TypeVar("Part")


def alike(make: Callable[[Whole], Part]) -> cached_property[Part]:
    """A cached property that is taken from the plan's `like`, or `known`, where that is another plan."""

    @wraps(make)
    def made(plan: Whole) -> Part:
        source = plan.like or plan.known
        return make(plan) if source is plan else cast("Part", getattr(source, make.__name__))

    return cached_property(made)
