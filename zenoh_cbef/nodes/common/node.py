"""The parts of every process: a session, its liveliness token, an event channel, and a clean way to stop."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from types import FrameType
from typing import Self

from zenoh_cbef.errors import Interrupted, UserError
from zenoh_cbef.machine import require, yield_to_others
from zenoh_cbef.nodes.common.ending import Ending
from zenoh_cbef.protocol.addresses import reached_at, with_ports
from zenoh_cbef.protocol.claims import claim
from zenoh_cbef.protocol.closing import close_soon
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.lives import new_life
from zenoh_cbef.protocol.mailbox import Mailbox
from zenoh_cbef.protocol.memory import KEPT_BYTES, Archive
from zenoh_cbef.protocol.outbox import Outbox
from zenoh_cbef.protocol.presence import Presence
from zenoh_cbef.protocol.session import Connection, PortInUseError, open_joined
from zenoh_cbef.protocol.tokens import heard_token, in_words, is_recorder

LEASH = "ZENOH_CBEF_LEASH"
"""The environment variable of a process whose standard input ends with its launcher, with what that launches."""
RUN, FLEET = "run", "fleet"
"""A whole run on this host, or some agents of one."""
_FAREWELLS = 10
_JOIN_SECONDS = 5.0
_TOLD = 50
_PORT_ATTEMPTS = 4
_QUIET_SECONDS = 3.0
_PATIENCE_WITHOUT_LAUNCHER = {"target": 0.0, "agent": 4.0, "record": 6.0}


@dataclass(frozen=True)
class Identity:
    """Which process of which run this is. patience: s that it waits for the others to appear."""

    run: str
    role: str
    name: str
    connection: Connection = field(default_factory=Connection)
    patience: float = 30.0

    @property
    def sender(self) -> str:
        """The name in messages: "agent/3", "record/host-b", or the bare role where that is the name."""
        return self.role if self.name == self.role else f"{self.role}/{self.name}"


def _settled(connection: Connection) -> Connection:
    """The connection with what others have to know of it before they link to it."""
    if not connection.told:
        return connection
    listening = with_ports(connection)
    return replace(listening, life=new_life(reached_at(listening.listen)))


class Node:
    """A process on the network. Use as a context manager: leaving it closes the session whatever happened."""

    def __init__(self, identity: Identity) -> None:
        self.identity, self.connection = identity, identity.connection
        self.keys = Keys(identity.run)
        self.clock: Callable[[], int] = time.time_ns
        self.stopping = False
        self.leashed, self.launched = LEASH in os.environ, os.environ.get(LEASH, FLEET) != FLEET
        self.born, self._said_waiting = time.monotonic(), False
        self.told: deque[bytes] = deque(maxlen=_TOLD)
        self._on_stop: list[Callable[[], None]] = []
        self._on_close: list[Callable[[], None]] = []
        self._readers: list[threading.Thread] = []

    def __enter__(self) -> Self:
        require(links=1)
        if self.leashed:
            yield_to_others()
        self._open()
        try:
            self.presence = Presence(self.session, self.keys.all_live)
            self.archive = Archive(self.session)
            self.events = self.outbox(self.keys.event(self.identity.sender))
            self.archive.serve(self.events.key)
            self._obey_signals()
        except BaseException:
            self.session.close()
            raise
        return self

    def waits(self) -> bool:
        """Say once that this process waits, where a user started it; whether it is to stop, as those ask who wait."""
        patient = self.identity.patience > 2.0 * _QUIET_SECONDS and not self.leashed
        if patient and not self._said_waiting and time.monotonic() - self.born > _QUIET_SECONDS:
            self._said_waiting = True
            who, run, links = self.identity.sender, self.identity.run, ", ".join(self.identity.connection.connect)
            where = f" at {links}" if links else ""
            sys.stderr.write(f"{who} waits for run {run}{where}, {self.identity.patience:g} s at most\n")
        return self.stopping

    def _open(self) -> None:
        given = self.identity.connection
        for left in reversed(range(_PORT_ATTEMPTS)):
            wanted = _settled(given)
            try:
                self.session, self.connection = open_joined(wanted, self.identity.patience, self.waits)
            except PortInUseError:
                if not left or list(wanted.listen) == list(given.listen):
                    Ending("port").tell()
                    raise
            else:
                return

    def __exit__(self, *_: object) -> None:
        self.stop()
        for action in self._on_close:
            action()
        close_soon(self.session, self.identity.connection)
        # Python ends threads at its exit by unwinding them, which aborts the process inside a call of Zenoh.
        for reader in self._readers:
            reader.join(_JOIN_SECONDS)

    def follow(self, mailbox: Mailbox, take: Callable[[bytes], None]) -> None:
        """Hand on every message of a mailbox as it comes, in a thread that ends with the session."""
        reader = threading.Thread(target=mailbox.follow, args=(take,), daemon=True)
        self.await_at_end(reader)
        reader.start()

    def await_at_end(self, thread: threading.Thread) -> None:
        """Wait at the end for a thread that uses the session."""
        self._readers.append(thread)

    def outbox(self, key: str, *, may_drop: bool = True, keep: int = KEPT_BYTES) -> Outbox:
        """A publisher in this process's name. keep: bytes of its messages to keep for receivers that missed them."""
        run, sender, memory = self.identity.run, self.identity.sender, self.archive.open(key, keep)
        return Outbox(self.session, key, run=run, sender=sender, may_drop=may_drop, clock=self.clock, memory=memory)

    def refuse_twin(self) -> None:
        """Raise UserError where a process with this role and name is in the run already, as far as we are linked."""
        if self.presence.asks_for(f"{self.identity.role}/{self.identity.name}"):
            raise self._twin("--run")

    def claim_name(self) -> None:
        """Become the one process of this name in the run. Raises UserError where another is, as the target tells.

        Peers do not relay, so only the target is sure to see both.
        """
        run, name = self.identity.run, f"{self.identity.role}/{self.identity.name}"
        patience, claims = self.identity.patience, self.keys.claims
        about, stopped = self.identity.connection, lambda: self.stopping
        ours = claim(self.session, claims, self.presence, name, patience, connection=about, stopped=stopped)
        if ours is None and self.stopping:
            raise Interrupted
        if ours is None:
            raise UserError(f"the target of run {run!r} does not answer any more; start it again, or check --connect")
        if not ours:
            raise self._twin("--name" if self.identity.role == "record" else "id")

    def _twin(self, what: str) -> UserError:
        name, run = in_words(self.identity.sender), self.identity.run
        return UserError(f"{name} is already in run {run!r}; give another {what}, or end that process")

    def event(self, kind: str, text: str, **data: object) -> None:
        """Tell the log what happened."""
        self.told.append(self.events.send(kind=kind, text=text, data=data))

    def last_words(self, kind: str, text: str, **data: object) -> None:
        """Tell the log that we are done, again and again until a recorder says that it has heard it.

        Zenoh keeps the order of a session's messages, so the recorder then has all others, too. Messages that are still
        on their way to a busy recorder are lost when a session closes.
        """
        word = time.time_ns()

        def heard(live: set[str]) -> bool:
            return heard_token(self.identity.sender, word) in live or not any(map(is_recorder, live))

        for _ in range(_FAREWELLS):
            self.event(kind, text, word=word, **data)
            if self.presence.wait(heard, 1.0):
                return

    @property
    def grace(self) -> float:
        """The share, 0 or 1, of its patience that this process waits for one out of sight, whose link may come back.

        Where all processes of a run are on one host, a link ends only with its process.
        """
        return 0.0 if self.launched else 1.0

    def on_stop(self, action: Callable[[], None]) -> None:
        """Call an action, from another thread, when the process is told to stop."""
        self._on_stop.append(action)

    def on_close(self, action: Callable[[], None]) -> None:
        """Call an action just before the session is closed."""
        self._on_close.append(action)

    def stop(self) -> None:
        """Tell the process to stop."""
        if not self.stopping:
            self.stopping = True
            for action in self._on_stop:
                action()

    def wait_for(
        self,
        condition: Callable[[set[str]], bool],
        timeout: float | None = None,
        meanwhile: Callable[[], None] = lambda: None,
    ) -> bool:
        """Wait until a condition on the processes that are there holds; False at a stop, or after `timeout` s.

        meanwhile is called every now and then: a caller with mailboxes must empty them, as a full one drops messages.
        """
        until = None if timeout is None else time.monotonic() + timeout
        while not self.stopping:
            if self.presence.wait(condition, 0.1):
                return True
            meanwhile()
            if until is not None and time.monotonic() > until:
                return False
        return False

    def _obey_signals(self) -> None:
        # The handler runs in the main thread, perhaps inside a blocking receive: only another thread may send
        # the wake-ups that end it.
        asked = threading.Event()

        def ask(_signum: int, _frame: FrameType | None) -> None:
            asked.set()

        def obey() -> None:
            asked.wait()
            self.stop()

        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, ask)
        threading.Thread(target=obey, daemon=True).start()
        if self.leashed:
            threading.Thread(target=self._follow_leash, args=(asked,), daemon=True).start()

    def _follow_leash(self, asked: threading.Event) -> None:
        # The launcher holds the other end of our standard input: its end is the launcher's, however it died. The
        # target then ends the run for all at the same step; the others stop by themselves only if it does not.
        # Read past sys.stdin, whose lock a thread that still holds it at exit would turn into an abort.
        while os.read(0, 4096):
            pass
        if self.launched:
            time.sleep(_PATIENCE_WITHOUT_LAUNCHER.get(self.identity.role, 4.0))
        asked.set()
        time.sleep(6.0)
        os._exit(1)
