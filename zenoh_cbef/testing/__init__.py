"""What every filter, motion and fault must hold to, as tests that a plug-in calls: `check_filter(Mine)`, and so on."""

from zenoh_cbef.testing.faults import check_fault
from zenoh_cbef.testing.filters import check_filter
from zenoh_cbef.testing.motions import check_motion
from zenoh_cbef.testing.nonconforming import Nonconforming

__all__ = ["Nonconforming", "check_fault", "check_filter", "check_motion"]
