"""What zenoh-cbef asks of every filter, asked of this one."""

from cbef_example.filters import FixedGains

from zenoh_cbef.testing import check_filter


def test_fixed_gains_are_a_filter() -> None:
    """With the options that it has by itself, and with others."""
    check_filter(FixedGains)
    check_filter(FixedGains, alpha=0.2, beta=0.01)
