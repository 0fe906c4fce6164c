"""Somebody who asks a run that goes on, from any host, without taking part in it."""

from __future__ import annotations

import time
from types import TracebackType
from typing import Any, Self

from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol.control import ask_control
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.presence import live_now
from zenoh_cbef.protocol.reach import wait_for_link, why_nobody
from zenoh_cbef.protocol.session import Connection, open_session

_PATIENCE_SECONDS = 3.0
_RETRY_SECONDS = 0.05
_PROCESSES = ("target/", "agent/", "record/")


class Operator:
    """A session that puts questions to a run's target. Use as a context manager."""

    def __init__(self, run: str, connection: Connection, patience: float = _PATIENCE_SECONDS) -> None:
        self.run, self._connection, self.patience = run, connection, patience
        self._keys = Keys(run)

    def __enter__(self) -> Self:
        self._until = time.monotonic() + self.patience
        self.session = open_session(self._connection, self.patience)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.session.close()

    def ask(self, request: dict[str, Any]) -> dict[str, Any]:
        """What the run answers. Raises UserError with its own sentence, or with why nobody answers."""
        said = self.try_to_ask(request)
        if said is None:
            why = why_nobody(self.session, self._connection, self.run)
            raise UserError(f"run {self.run!r} does not answer: {why}")
        return said

    def try_to_ask(self, request: dict[str, Any]) -> dict[str, Any] | None:
        """As ask, but None where nobody answers."""
        wait_for_link(self.session, self._until - time.monotonic())
        while True:
            # A new link knows of nobody who answers: no answer may come at once, and one a moment later.
            left = self._until - time.monotonic()
            said = ask_control(self.session, self._keys.control, request, timeout=max(left, 1.0))
            if said is not None or left < 0.0:
                self._until = time.monotonic() + self.patience
                return said
            time.sleep(_RETRY_SECONDS)

    def processes(self) -> set[str]:
        """The processes of the run that can be seen from here, as in "agent/3"."""
        return {name for name in live_now(self.session, self._keys.all_live) if name.startswith(_PROCESSES)}
