"""What zenoh-cbef asks of every fault, asked of this one."""

from cbef_example.faults import Fading

from zenoh_cbef.testing import check_fault


def test_fading_is_a_fault() -> None:
    """On all links, and on those of one agent."""
    check_fault(Fading)
    check_fault(Fading, links="agent:2", options={"period": 1.0})
