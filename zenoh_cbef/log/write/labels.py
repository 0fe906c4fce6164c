"""What the record of a message in a log repeats of it."""

from __future__ import annotations

from typing import NamedTuple

from zenoh_cbef.protocol.fields import LONGEST
from zenoh_cbef.protocol.keys import address
from zenoh_cbef.protocol.messages import BadMessage, unpack
from zenoh_cbef.protocol.short import ENCODING, is_short, numbered

_MOST = 1 << 63
_MSGPACK = "msgpack"


class Label(NamedTuple):
    """Number and sending time (ns), as the sender says them, the sender, and how the message is written."""

    seq: int
    sent: int
    sender: str
    encoding: str = _MSGPACK


def label_of(key: str, data: bytes) -> Label | None:
    """The label of a message on a key; None where it is no message of ours."""
    try:
        message = unpack(data)
    except BadMessage:
        return _short_label(key, data)
    seq, sent, sender = message.get("seq"), message.get("sent"), message.get("from")
    if type(seq) is not int or type(sent) is not int or type(sender) is not str:
        return None
    return Label(seq, sent, sender) if 0 <= seq < _MOST and 0 <= sent < _MOST and len(sender) <= LONGEST else None


def _short_label(key: str, data: bytes) -> Label | None:
    at = address(key)
    if at is None or not is_short(data, at):
        return None
    seq, sent = numbered(data)
    return Label(seq, sent, at.owner, ENCODING) if sent < _MOST else None
