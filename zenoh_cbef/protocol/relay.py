"""Messages that another process wrote, published as they are."""

from __future__ import annotations

from collections.abc import Iterable

import zenoh

from zenoh_cbef.errors import UserError


class Relay:
    """A publisher for each of some keys. It drops nothing: it waits for a subscriber that does not keep up.

    Raises UserError for a key that Zenoh refuses.
    """

    def __init__(self, session: zenoh.Session, keys: Iterable[str]) -> None:
        self._publishers: dict[str, zenoh.Publisher] = {}
        for key in keys:
            try:
                self._publishers[key] = session.declare_publisher(
                    key,
                    congestion_control=zenoh.CongestionControl.BLOCK,
                    allowed_destination=zenoh.Locality.REMOTE,
                )
            except zenoh.ZError:
                raise UserError(f"{key!r} is no key that can be published on; correct --remap") from None

    def publish(self, key: str, data: bytes) -> None:
        """Publish one message."""
        self._publishers[key].put(data)

    @property
    def heard(self) -> bool:
        """Whether any process subscribes to one of the keys."""
        # Zenoh's types call it a bool, but it is not.
        return any(publisher.matching_status.matching for publisher in self._publishers.values())  # type: ignore[attr-defined]
