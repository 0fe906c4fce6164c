"""Where a scene comes from: a log, or a run that goes on. The page does not know which."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path

from zenoh_cbef.errors import UserError
from zenoh_cbef.lab.listening import Listener
from zenoh_cbef.lab.scene import Scene
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.read.recording import filling_recording
from zenoh_cbef.protocol.questions import Added, Holding
from zenoh_cbef.protocol.session import Connection

_KINDS = ("truth", "estimate", "event", "faults")
"""What a scene shows of a log; the messages of consensus, most of a log, are passed over."""
_MORE = (*_KINDS, "beacon", "signal", "range")
"""What viewers show beside."""
_AT_ONCE_SECONDS, _SHOWN_SECONDS = 0.3, 3.0
"""A log whose reading takes longer (CPU time) is shown before it is read to its end.

The rest of it is read when a page has been shown, or none has come: reading would slow the page. Others may take the
lock between two portions."""
_PORTION_SECONDS, _YIELD_SECONDS = 0.004, 0.001
"""How long a page waits at most for what is read, and how long it has to take its turn."""
_END = object()


LIVE = frozenset({"goes on", "is out of reach"})
"""States of a run of which more may come."""


class _Past:
    """Takes no orders."""

    def inject(self, fault: Mapping[str, object], seconds: float | None) -> Added:  # noqa: ARG002
        """Refuse."""
        raise UserError("this is a log; start a run to inject faults into it")

    def clear(self, numbers: list[int]) -> list[int]:  # noqa: ARG002
        """Refuse."""
        raise UserError("this is a log; its faults are what they were")

    def stop(self) -> None:
        """Refuse."""
        raise UserError("this is a log; its run has ended")

    def hold(self, *, on: bool, steps: int, rounds: int) -> Holding:  # noqa: ARG002
        """Refuse."""
        raise UserError("this is a log; its run has ended")


class LogSource:
    """A log. A long one is shown while the rest of it is read. Raises UserError where it is none.

    measured: whether ranges and beacons are read, too, which only viewers show.
    """

    live = False
    orders = _Past()

    def __init__(self, path: Path, at_once: float = _AT_ONCE_SECONDS, *, measured: bool = False) -> None:
        self.lock = threading.Lock()
        recording, self._rest = filling_recording(open_log(path), _MORE if measured else _KINDS)
        self.scene = Scene(recording)
        self.shown, self._closed = threading.Event(), threading.Event()
        until = time.thread_time() + at_once
        while (more := next(self._rest, _END) is None) and not (self.scene.newest and time.thread_time() > until):
            pass
        if not self.scene.newest:
            raise UserError(f"{path} holds no estimate: the run ended before its first step")
        self.state = "is read" if more else "log"
        if more:
            threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        """Read the rest; between two portions the page is answered."""
        self.shown.wait(_SHOWN_SECONDS)
        more = True
        while more and not self._closed.is_set():
            with self.lock:
                until = time.perf_counter() + _PORTION_SECONDS
                while (more := next(self._rest, _END) is None) and time.perf_counter() < until:
                    pass
            time.sleep(_YIELD_SECONDS)
        self.state = "log"

    def close(self) -> None:
        """Read no further."""
        self._closed.set()
        self.shown.set()


class RunSource:
    """A run that goes on. measured: as of a log. Raises UserError where it does not answer."""

    live = True

    def __init__(self, run: str, connection: Connection, patience: float, *, measured: bool = False) -> None:
        self._held, self.shown = ExitStack(), threading.Event()
        self._listener = self._held.enter_context(Listener(run, connection, patience, measured=measured))
        self.lock, self.orders = self._listener.lock, self._listener.operator
        self.scene = Scene(self._listener.recording)

    @property
    def state(self) -> str:
        """Whether the run goes on, as far as can be seen from here."""
        if self._listener.ended:
            return "ended"
        return "goes on" if self._listener.there else "is out of reach"

    def close(self) -> None:
        """Leave the run, which goes on."""
        self._held.close()


Source = LogSource | RunSource
"""A scene, and what can be done to it.

lock: held while the scene is read. shown: set when a page has a frame. live: whether it is a run. orders: an operator,
or what refuses. state, as the page calls it: "log", "is read" (a log), "goes on", "is out of reach" or "ended".
"""
