"""A target that is started again begins another run of the same name, to which processes of the first do not belong."""

from __future__ import annotations

from collections.abc import Callable

from zenoh_cbef.protocol.presence import Presence
from zenoh_cbef.protocol.tokens import life_told

TARGET = "target/target"


class Succession:
    """Notices that another target than the one first seen has come. replaced: whether one has.

    on_replaced: called once, from a background thread. Tokens of one process come in any order over a new link, so
    both that name it are looked at.
    """

    def __init__(self, presence: Presence, on_replaced: Callable[[], None] = lambda: None) -> None:
        self._presence, self._on_replaced = presence, on_replaced
        self._first = presence.life(TARGET)
        self.replaced = False
        presence.on_change(self._look)

    def _look(self, name: str, joined: bool) -> None:
        if not joined or (name != TARGET and (life_told(name) or ("",))[0] != TARGET):
            return
        life = self._presence.life(TARGET)
        self._first = self._first or life
        if life != self._first and not self.replaced:
            self.replaced = True
            self._on_replaced()
