"""No cooperation: every agent alone with its own ranges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.base import Sharing
from zenoh_cbef.tracking.filters.kinds.ci import CovarianceIntersection
from zenoh_cbef.tracking.filters.settings import FilterSettings


@dataclass(frozen=True)
class Local(CovarianceIntersection):
    """ci without an exchange: it shows what an agent achieves alone, and so what cooperation gains."""

    abilities: ClassVar = replace(CovarianceIntersection.abilities, information=False)

    @classmethod
    def sharing(cls, settings: FilterSettings) -> Sharing:
        """No payload is exchanged: every agent keeps its own posterior."""
        return replace(super().sharing(settings), cooperates=False)
