"""Writes everything that crosses the network into one log, and survives being killed."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress

from zenoh_cbef.errors import UserError
from zenoh_cbef.log.write.run_log import RunLog
from zenoh_cbef.nodes.common.node import Node
from zenoh_cbef.nodes.common.recording import Status
from zenoh_cbef.nodes.recorder.acknowledgements import Acknowledgements
from zenoh_cbef.nodes.recorder.at_source import AtSource
from zenoh_cbef.nodes.recorder.attendance import Attendance, takes_part
from zenoh_cbef.nodes.recorder.overview import Overview
from zenoh_cbef.nodes.recorder.recovery import Recovery
from zenoh_cbef.plain import count_in, counts_in
from zenoh_cbef.protocol.fair_mailbox import FairMailbox
from zenoh_cbef.protocol.keys import address
from zenoh_cbef.protocol.kinds import EVENT, FAULTS
from zenoh_cbef.protocol.messages import BadMessage, decode
from zenoh_cbef.protocol.recorded import belongs, covering
from zenoh_cbef.protocol.ring import Said
from zenoh_cbef.protocol.slow import SLOW
from zenoh_cbef.scenario.injected import liars
from zenoh_cbef.scenario.plan import Plan

CAPACITY = 1 << 17
"""Messages that a mailbox of a recorder holds."""
_REPORT_SECONDS = 0.2
_GATHER_SECONDS, _AT_SOURCE_SECONDS = 0.005, 0.05
"""How long messages gather before they are written; and where agents leave theirs in rings, in which they are safe."""
_PORTION = 10_000
_BEHIND_SECONDS = 1.0
_LOCKED_SECONDS = 0.05
_PROMISES = 2000
"""Beyond so many processes that say what they sent, none is believed whose name is its own choice."""


class Recorder:
    """Writes messages from the network into the log: each mailbox in a thread, the first in the caller's.

    With a source, the caller's thread looks at all of them, and at the rings, twenty times a second: each wake-up would
    take a core from the agents, and wait for what it has pushed out of the caches.

    record.on_full "stop" in the scenario: the recording ends when the log can no longer be written.
    """

    def __init__(
        self,
        node: Node,
        log: RunLog,
        overview: Overview,
        mailboxes: Sequence[FairMailbox],
        plan: Plan,
        *,
        source: AtSource | None = None,
    ) -> None:
        self.node, self.log, self.overview, self._source = node, log, overview, source
        self._mailboxes, self._plan, self._settings = mailboxes, plan, plan.scenario.record
        self._covers = covering([mailbox.key for mailbox in mailboxes] + (source.expressions if source else []))
        self._lock = threading.Lock()
        self._done = threading.Event()
        self._full_since: dict[FairMailbox, float] = {}
        self._told: set[str] = set()
        self._promised: dict[str, dict[str, int]] = {}
        self._acknowledgements = Acknowledgements(node)
        self._shared = [mailbox.key for mailbox in mailboxes] if len(mailboxes) > 1 else []
        self.target_ended: int | None = None
        self._attendance = Attendance(node, self._tell, plan.scenario.timing.patience)
        believes = (lambda _: True) if source is None else source.rings.is_the_same
        self._recovery = Recovery(node, log, self._lock, self._write, believes)
        node.on_stop(self._wake)

    def run(self, *, sync: bool, report: Callable[[Status], None]) -> None:
        """Record until all processes have left, or until told to stop."""
        threads = [threading.Thread(target=self._tick, args=(sync, report), daemon=True)]
        threads.append(threading.Thread(target=self._recovery.run, args=(self._done,), daemon=True))
        if self._source is None:
            threads += [threading.Thread(target=self._drain, args=(one,), daemon=True) for one in self._mailboxes[1:]]
        else:
            with self._lock:
                self._source.begin(self._write)
        for thread in threads:
            thread.start()
        try:
            while not self._finished():
                self._turn()
        finally:
            self._done.set()
            self._wake()
            for thread in threads:
                thread.join()
        for mailbox in self._mailboxes:
            self._empty(mailbox)
        if self._source is not None:
            self._source.finish(self._lock, self._write_all, self._empty)

    def _turn(self) -> None:
        """Wait for messages, and write them."""
        if self._source is None:
            self._write_waiting(self._mailboxes[0], self._mailboxes[0].receive_from())
            # A wake-up for every single message costs more than writing it: let a few gather.
            time.sleep(_GATHER_SECONDS)
            return
        time.sleep(_AT_SOURCE_SECONDS)
        for mailbox in self._mailboxes:
            self._write_waiting(mailbox, mailbox.poll_from())
        self._source.turn(self._lock, self._write_all, self._empty)

    def _drain(self, mailbox: FairMailbox) -> None:
        while not self._done.is_set():
            self._write_waiting(mailbox, mailbox.receive_from())
            time.sleep(_GATHER_SECONDS)
        self._write_waiting(mailbox, mailbox.poll_from())

    def _empty(self, mailbox: FairMailbox) -> None:
        for _ in range(0, CAPACITY, _PORTION):  # a flood has no end
            self._write_waiting(mailbox, mailbox.poll_from())

    def _wake(self) -> None:
        for mailbox in self._mailboxes:
            mailbox.wake()

    def _write_waiting(self, mailbox: FairMailbox, received: tuple[str, bytes] | None) -> None:
        """Write a message and those behind it.

        No more than a portion: in a flood, too, the log is flushed and the end of the run is seen.
        """
        left = _PORTION
        with self._lock:
            while received is not None:
                if not self._shared or belongs(received[0], mailbox.key, self._shared):
                    self._write_heard(*received)
                left -= 1
                received = mailbox.poll_from() if left else None
            if left:
                self._full_since.pop(mailbox, None)
            else:
                self._full_since.setdefault(mailbox, time.monotonic())

    def _tick(self, sync: bool, report: Callable[[Status], None]) -> None:
        flushed, seconds = time.monotonic(), self._settings.flush_seconds
        while not self._done.wait(min(seconds, _REPORT_SECONDS)):
            if time.monotonic() - flushed >= seconds:
                with self._lock:
                    self.log.flush(sync=sync)
                    if self._source is not None:
                        self._source.rings.save()
                flushed = time.monotonic()
            self._warn()
            self._acknowledgements.catch_up()
            if self._source is None:
                self._wake()
            report(self.status())

    def _warn(self) -> None:
        """Report each problem once, each time that it begins."""
        behind = time.monotonic() - min(self._full_since.values(), default=time.monotonic())
        if behind < _BEHIND_SECONDS:
            self._told.discard("behind")
        elif "behind" not in self._told:
            self._told.add("behind")
            self.overview.status.behind += 1
            text = f"the recorder has not kept up for {behind:.1f} s; what does not fit its mailbox is lost to the log"
            self.say("behind", text, seconds=behind, missing=self.log.missing)
        if self.log.failure and "full" not in self._told:
            self._told.add("full")
            stops = self._settings.on_full == "stop"
            goes_on = "the recorder ends" if stops else "the run goes on without what does not fit"
            self.say("full", f"{self.log.failure}; {goes_on}", dropped=self.log.dropped)
            if stops:
                self.node.stop()

    def status(self) -> Status:
        """The present status."""
        status = self.overview.status
        status.agents = self.overview.present()
        with self._lock:
            self.overview.catch_up()
            status.messages, status.missing = self.log.count, self.log.missing
            status.dropped, status.failure, status.foreign = self.log.dropped, self.log.failure, self.log.foreign
        return status

    def reached(self) -> dict[int, int]:
        """Of each agent, the step of the last estimate that was taken in.

        Zenoh's thread asks, for which the holder of the lock may be waiting.
        """
        if self._lock.acquire(timeout=_LOCKED_SECONDS):
            try:
                self.overview.catch_up()
            finally:
                self._lock.release()
        return dict(self.overview.heard)

    def _write_heard(self, key: str, data: bytes) -> None:
        if self._source is None or self._source.lets_in(key, data):
            self._write(key, data)

    def _write(self, key: str, data: bytes) -> None:
        kind = self.log.add(key, data, time.time_ns())
        if kind in ("truth", "estimate"):
            self.overview.see(kind, key, [data])
        elif kind == "event":
            self._note_promises(key, data)
        elif kind == FAULTS.name:
            self._note_liars(data)

    def _write_all(self, keys: Sequence[str], said: Sequence[Said]) -> None:
        self.log.add_all(keys, said, time.time_ns())
        for kind, key in enumerate(keys):
            at = address(key)
            if at is not None and at.kind in {"truth", "estimate"}:
                self.overview.see(at.kind, key, [one[3] for one in said if one[0] == kind])

    def _note_liars(self, data: bytes) -> None:
        with suppress(BadMessage, UserError):
            message = decode(FAULTS, data, run=self.node.identity.run, sender="target")
            self.overview.left_out = liars(self._plan, message["tables"])

    def _note_promises(self, key: str, data: bytes) -> None:
        at = address(key)
        try:
            message = decode(EVENT, data, run=self.node.identity.run, sender=at.owner if at else "")
        except BadMessage:
            return
        if at is None or not (at.owner or message["from"] == "target"):
            return  # An old log that is replayed: its senders are not there.
        sender, told = message["from"], message.get("data", {})
        if not self._recovery.lacks(sender):  # It asks again.
            self._acknowledgements.hear(sender, count_in(told, "word"))
        if message["kind"] == SLOW and takes_part(sender, self.node.presence):
            self.overview.note_slow(sender)
        if message["kind"] in {"finished", "killed"}:
            self._attendance.farewell(sender)
        if message["kind"] == "finished":
            if sender == "target" and (step := count_in(told, "step")) is not None:
                self.target_ended = step
            if not at.chosen or sender in self._promised or len(self._promised) < _PROMISES:
                self._promised[sender] = self._owned(sender, counts_in(told, "sent"))

    def _owned(self, sender: str, sent: dict[str, int]) -> dict[str, int]:
        """How many messages a process says that it sent on its own keys, for keys that are recorded."""
        addresses = ((key, count, address(key)) for key, count in sent.items())
        return {key: count for key, count, at in addresses if at and at.is_of(sender) and self._covers(key)}

    def _tell(self, kind: str, text: str, name: str) -> None:
        self.say(kind, text, name=name)

    def say(self, kind: str, text: str, **data: object) -> None:
        """Publish an event and write it: we do not hear ourselves."""
        message = self.node.events.send(kind=kind, text=text, data=data)
        with self._lock:
            self._write(self.node.events.key, message)

    def _finished(self) -> bool:
        """Whether all processes have left and all that they say they sent has come, or we are told to stop."""
        promised = ((key, sender, count) for sender, sent in self._promised.items() for key, count in sent.items())
        lacking = any(self.log.lacks(*one) for one in promised)
        if self._source is not None:
            with self._lock:
                lacking |= self._source.rings.waiting
        return self.node.stopping or self._attendance.over(lacking=lacking, step=self.overview.reached)
