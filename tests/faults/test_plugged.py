"""What a fault of another package is read from."""

from __future__ import annotations

import pytest

from zenoh_cbef.extending import LinkFault
from zenoh_cbef.faults.plugged import read_fault


class Plain(LinkFault):
    """A fault without options."""


def test_a_fault_without_options_says_so_where_it_is_given_some():
    with pytest.raises(ValueError, match="has most, but 'mine:Plain' has no options; leave"):
        read_fault(Plain, {"kind": "mine:Plain", "options": {"most": 0.5}})
    assert read_fault(Plain, {"kind": "mine:Plain"}).kind == "mine:Plain"
