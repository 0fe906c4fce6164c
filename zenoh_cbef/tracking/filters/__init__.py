"""The filters by kind. Adding one is a file with a class as in base.py, and a line here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from zenoh_cbef.tracking.filters.base import Belief, Filter, Update
from zenoh_cbef.tracking.filters.cbef import Cbef
from zenoh_cbef.tracking.filters.information import SaturatedInformation
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Space

__all__ = ["KINDS", "Belief", "Cbef", "Filter", "FilterSettings", "SaturatedInformation", "Update", "make_filter"]


@dataclass(frozen=True)
class FilterSettings:
    """What any filter may need to know. range_std: m. xi: see the filter. network_size: number of agents."""

    motion: NearlyConstantVelocity
    space: Space
    range_std: float
    xi: float
    network_size: int


def _cbef(settings: FilterSettings) -> Filter:
    return Cbef(settings.motion, settings.space, settings.xi)


def _information(settings: FilterSettings, network_size: int, xi: float) -> Filter:
    return SaturatedInformation(settings.motion, settings.space, settings.range_std, network_size, xi)


KINDS: dict[str, Callable[[FilterSettings], Filter]] = {
    "sicf": lambda settings: _information(settings, settings.network_size, settings.xi),
    "icf": lambda settings: _information(settings, settings.network_size, np.inf),
    "cbef": _cbef,
    "local": lambda settings: _information(settings, 1, settings.xi),
}


def make_filter(kind: str, settings: FilterSettings) -> Filter:
    """The filter of one kind."""
    return KINDS[kind](settings)
