"""The information-weighted consensus filter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.kinds.sicf import SaturatedInformation
from zenoh_cbef.tracking.filters.settings import FilterSettings


@dataclass(frozen=True)
class InformationWeighted(SaturatedInformation):
    """ICF of Kamal, Farrell, Roy-Chowdhury (IEEE TAC 58(12), 2013): sicf that does not saturate."""

    abilities: ClassVar = replace(SaturatedInformation.abilities, saturates=False, outliers=False)

    @classmethod
    def of(cls, settings: FilterSettings) -> Self:
        """The filter of these settings."""
        return super().of(replace(settings, xi=np.inf))
