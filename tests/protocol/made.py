"""Messages of one run and sender as they are written, and what a receiver makes of any bytes."""

from __future__ import annotations

import math

from zenoh_cbef.protocol.kinds import MESSAGE_KINDS
from zenoh_cbef.protocol.messages import (
    VERSION,
    BadMessage,
    decode,
    encode,
)

RUN, SENDER = "run-1", "agent/3"


def written(body, *, run=RUN, sender=SENDER, seq=5, sent=1_700_000_000_000_000_000):
    return encode(run, sender, seq, sent, body)


def is_sound(value):
    """Whether no number in a message is NaN or infinite; what an event says in `data` is free."""
    if type(value) is float:
        return math.isfinite(value)
    return all(map(is_sound, value)) if type(value) is list else True


def read_or_refused(kind, data):
    """The message, checked as a reader relies on it; None where it was refused."""
    try:
        message = decode(MESSAGE_KINDS[kind], data, run=RUN, sender=SENDER)
    except BadMessage:
        return None
    known = {"v", "run", "from", "seq", "sent", *MESSAGE_KINDS[kind].fields}
    assert message.keys() <= known
    assert {name for name, field in MESSAGE_KINDS[kind].fields.items() if not field.optional} <= message.keys()
    assert (message["v"], message["run"], message["from"]) == (VERSION, RUN, SENDER)
    assert all(is_sound(value) for name, value in message.items() if name != "data")
    return message
