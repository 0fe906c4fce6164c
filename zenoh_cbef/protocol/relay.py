"""Messages that somebody else wrote, published as they are."""

from __future__ import annotations

from collections.abc import Iterable

import zenoh

from zenoh_cbef.errors import UserError


class Relay:
    """A publisher for each of some keys. Nothing is dropped: who cannot keep up is waited for.

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
                raise UserError(f"{key!r} is no key that can be published on; mend --remap") from None

    def publish(self, key: str, data: bytes) -> None:
        """Publish one message."""
        self._publishers[key].put(data)

    @property
    def heard(self) -> bool:
        """Whether somebody subscribes to any of the keys."""
        # Zenoh calls it a bool in its types, and it is none.
        return any(publisher.matching_status.matching for publisher in self._publishers.values())  # type: ignore[attr-defined]
