"""What a plug-in imports: the parts of which filters, motions and faults are made, at one place that stays."""

from zenoh_cbef.arrays import Bools, Floats, Ids, Ints
from zenoh_cbef.tracking.diagnostics import Diagnostics
from zenoh_cbef.tracking.filters.base import Abilities, Belief, Filter, Kind, Sharing, Update
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.linalg import inverse, matvec
from zenoh_cbef.tracking.motion import Motion
from zenoh_cbef.tracking.ranging import Measurement, Space, own_range

__all__ = [
    "Abilities",
    "Belief",
    "Bools",
    "Diagnostics",
    "Filter",
    "FilterSettings",
    "Floats",
    "Ids",
    "Ints",
    "Kind",
    "Measurement",
    "Motion",
    "Sharing",
    "Space",
    "Update",
    "inverse",
    "matvec",
    "own_range",
]
