"""What zenoh-cbef asks of every motion, asked of this one."""

from cbef_example.motions import Helix

from zenoh_cbef.testing import check_motion


def test_a_helix_is_a_motion() -> None:
    """With the options that it has by itself, and with others."""
    check_motion(Helix)
    check_motion(Helix, rate=-1.0)
