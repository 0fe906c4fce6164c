"""What a process sends is numbered, dated, remembered, and on its way; what another wrote is passed on as it is."""

from __future__ import annotations

import numpy as np
import pytest
import zenoh

from tests.protocol.conftest import Pair
from tests.waiting import until
from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol.kinds import RANGE
from zenoh_cbef.protocol.mailbox import Mailbox
from zenoh_cbef.protocol.memory import Memory
from zenoh_cbef.protocol.messages import decode
from zenoh_cbef.protocol.outbox import Outbox
from zenoh_cbef.protocol.relay import Relay
from zenoh_cbef.protocol.round_codec import RoundCodec

KEY = "cbef/test/agent/3/round"


def heard_by(pair: Pair, relay: Relay) -> Mailbox:
    mailbox = Mailbox(pair[0], KEY)
    until(lambda: relay.heard)
    return mailbox


def taken(mailbox: Mailbox) -> bytes:
    """The next message."""
    return until(mailbox.poll)


@pytest.mark.parametrize("may_drop", [True, False])
def test_messages_are_numbered_dated_and_remembered(pair: Pair, may_drop: bool) -> None:
    relay = Relay(pair[1], [KEY])
    assert not relay.heard
    mailbox, memory, times = heard_by(pair, relay), Memory(), iter([100, 200, 300])
    own = Mailbox(pair[1], KEY)
    outbox = Outbox(
        pair[1], KEY, run="test", sender="agent/3", may_drop=may_drop, clock=lambda: next(times), memory=memory
    )
    codec = RoundCodec("test", "agent/3", 2)
    outbox.send_round(codec, 7, 1, np.array([1.0, 2.0]))
    data = outbox.send(k=8, position=[0.0, 1.0, 2.0], range=None)
    outbox.send(kind="joined", text="", data={})
    assert outbox.sent == 3
    first, second, third = (taken(mailbox) for _ in range(3))
    assert codec.decode(first)[:3] == (7, 1, 100)
    assert second == data
    said = decode(RANGE, data, run="test", sender="agent/3")
    assert (said["seq"], said["sent"], said["k"]) == (1, 200, 8)
    assert memory.answer(zenoh.Parameters({"first": "0", "last": "9"})) == [first, second, third]
    assert memory.answer(zenoh.Parameters({"k": "7"})) == [first]
    assert memory.answer(zenoh.Parameters({"since": "8"})) == [second], "an event is of no step"
    assert own.poll() is None, "a process does not hear itself"


def test_what_is_relayed_comes_as_it_was_written_and_a_key_that_is_none_is_refused(pair: Pair) -> None:
    relay = Relay(pair[1], [KEY])
    mailbox = heard_by(pair, relay)
    for data in (b"any", b"bytes"):
        relay.publish(KEY, data)
    assert [taken(mailbox), taken(mailbox)] == [b"any", b"bytes"]
    with pytest.raises(UserError, match="correct --remap"):
        Relay(pair[1], ["cbef//x"])
