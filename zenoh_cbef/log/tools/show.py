"""Messages as JSON."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import numpy as np

from zenoh_cbef.errors import UserError
from zenoh_cbef.log.mcap.contents import RawMessage
from zenoh_cbef.log.read.header import read_header
from zenoh_cbef.log.read.parts import Log
from zenoh_cbef.log.tools.selection import Selection
from zenoh_cbef.protocol.messages import BadMessage, unpack
from zenoh_cbef.protocol.short import ENCODING, ShortCodec


def lines(log: Log, selection: Selection) -> Iterator[str]:
    """One JSON object for each selected message, by log time: topic, sequence, log_time, publish_time (ns), data.

    Bin fields of float64 are lists of numbers. What cannot be decoded has its bytes as "base64", and "error" says why.
    """
    wanted = selection.test()
    known = _codecs(log)
    encode: Callable[[Any], str] = json.JSONEncoder(allow_nan=False, default=_plain, separators=(",", ":")).encode
    for message in log.messages_in_order():
        if wanted(message):
            yield _line(message, encode, known)


def _codecs(log: Log) -> Callable[[RawMessage], dict[str, object]]:
    """Decodes any message; of those in few bytes the plan of the run says what is in them."""
    compact = cache(lambda: read_header(log).plan.compact)

    def decoded(message: RawMessage) -> dict[str, object]:
        if message.channel.message_encoding != ENCODING:
            return unpack(message.data)
        try:
            known = compact()
        except UserError:
            known = None
        if known is None:
            raise BadMessage("the log does not say how its payloads are laid out")
        step, round_, sent, payload = ShortCodec(known).decode(message.data)
        numbers = {"seq": message.sequence, "sent": sent, "k": step, "l": round_}
        told = np.frombuffer(payload)
        return {**numbers, "payload": None if np.isnan(told[0]) else told.tolist()}  # NaN: the agent keeps silent

    return decoded


def _line(message: RawMessage, encode: Callable[[Any], str], decoded: Callable[[RawMessage], dict[str, object]]) -> str:
    head = {
        "topic": message.channel.topic,
        "sequence": message.sequence,
        "log_time": message.log_time,
        "publish_time": message.publish_time,
    }
    try:
        return encode({**head, "data": decoded(message)})
    except (BadMessage, ValueError, TypeError, RecursionError) as error:
        reason = str(error) if isinstance(error, BadMessage) else "not expressible in JSON"
        return encode({**head, "data": None, "base64": base64.b64encode(message.data).decode(), "error": reason})


def _plain(value: Any) -> Any:
    if isinstance(value, bytes) and len(value) % 8 == 0:
        numbers = np.frombuffer(value, "<f8")
        if np.isfinite(numbers).all():
            return numbers.tolist()
    raise TypeError(f"{type(value).__name__} has no JSON")
