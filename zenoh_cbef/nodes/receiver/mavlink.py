"""MAVLink: RANGING_BEACON (message 513 of the dialect `development`), by pymavlink."""

from __future__ import annotations

from zenoh_cbef.extras import from_extra
from zenoh_cbef.nodes.receiver.ranged import Found, Ranged, plausible

_DIALECT = "pymavlink.dialects.v20.development"


class MavLink:
    """Anchors are named by beacon_id, as "3". Times are of the sender's clock, which may begin anywhere."""

    def __init__(self) -> None:
        self._dialect = from_extra(_DIALECT, "MAVLink")
        self.forget()

    def feed(self, data: bytes) -> Found:
        """The ranges of all messages that are complete and whose sum is right."""
        found, other = list[Ranged](), 0
        for message in self._link.parse_buffer(data) or ():
            if message.get_type() == "RANGING_BEACON":
                found.append(Ranged(message.time_usec / 1e6, str(message.beacon_id), message.range / 1e3))
            else:
                other += 1
        return Found(plausible(found), other)

    def finish(self) -> Found:
        """Nothing: a message may be in two datagrams."""
        return Found([], 0)

    def forget(self) -> None:
        """A message that has begun is lost."""
        self._link = self._dialect.MAVLink(None)
        self._link.robust_parsing = True
