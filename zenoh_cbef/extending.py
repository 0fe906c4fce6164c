"""What a plug-in imports: the parts of which filters, motions and faults are made, at one place that stays."""

from zenoh_cbef.arrays import Bools, Floats, Ids, Ints
from zenoh_cbef.courses.base import Course, CourseSettings
from zenoh_cbef.faults.absence import Absence
from zenoh_cbef.faults.base import Effect, LinkFault, MessageFault, Messages
from zenoh_cbef.faults.outgoing import SenderFault, Sent
from zenoh_cbef.faults.sensing import Readings, SensorFault
from zenoh_cbef.streams import exponential, normal, stream, uniform
from zenoh_cbef.tracking.diagnostics import Diagnostics
from zenoh_cbef.tracking.filters.base import Abilities, Belief, Filter, Kind, Sharing, Update
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.linalg import inverse, matvec
from zenoh_cbef.tracking.motion import Motion
from zenoh_cbef.tracking.ranging import Measurement, Space, own_range

__all__ = [
    "Abilities",
    "Absence",
    "Belief",
    "Bools",
    "Course",
    "CourseSettings",
    "Diagnostics",
    "Effect",
    "Filter",
    "FilterSettings",
    "Floats",
    "Ids",
    "Ints",
    "Kind",
    "LinkFault",
    "Measurement",
    "MessageFault",
    "Messages",
    "Motion",
    "Readings",
    "SenderFault",
    "SensorFault",
    "Sent",
    "Sharing",
    "Space",
    "Update",
    "exponential",
    "inverse",
    "matvec",
    "normal",
    "own_range",
    "stream",
    "uniform",
]
