"""What a run says while it goes on, taken into a recording as if it were read from a log."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Self

import numpy as np

import zenoh_cbef.protocol.keys as run_keys
from zenoh_cbef.log.read.decoding import Logged, in_columns
from zenoh_cbef.log.read.header import Header
from zenoh_cbef.log.read.recording import Recording
from zenoh_cbef.outside.operator import Operator
from zenoh_cbef.plain import read_toml
from zenoh_cbef.protocol.kinds import BEACON, ESTIMATE, EVENT, FAULTS, RANGE, TRUTH, Kind, M
from zenoh_cbef.protocol.mailbox import Mailbox
from zenoh_cbef.protocol.memory import ask_latest
from zenoh_cbef.protocol.messages import BadMessage, decode
from zenoh_cbef.protocol.presence import follow_token
from zenoh_cbef.protocol.scenario_service import fetch_scenario
from zenoh_cbef.protocol.session import Connection
from zenoh_cbef.scenario.legacy import as_meant
from zenoh_cbef.scenario.load import parse
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.size import refuse_too_many_processes

_CAPACITY = 1 << 15
"""Messages that wait while the page is served: some seconds of three hundred agents."""


class Listener:
    """A client of a run's target that hears truth, estimates, events and injected faults. Use as a context manager.

    lock: held while the recording changes. measured: whether ranges and beacons are heard, too.
    news: told of each change. refused: how many messages were not as their keys promise. Raises UserError where the
    run does not answer. there: whether the target is seen: it was not killed, and no link to it is broken.
    """

    def __init__(self, run: str, connection: Connection, patience: float, *, measured: bool = False) -> None:
        self.run, self._measured = run, measured
        self.operator = Operator(run, connection, patience)
        self._connection, self._patience = connection, patience
        self.lock, self.refused = threading.Lock(), 0
        self.news = threading.Condition(self.lock)
        self._over = threading.Event()
        self.there = True

    def __enter__(self) -> Self:
        self.operator.__enter__()
        try:
            session, keys = self.operator.session, run_keys.Keys(self.run)
            told = fetch_scenario(session, self.run, self._connection, patience=self._patience)
            scenario = parse(as_meant(read_toml(told.resolved)), f"the scenario of run {self.run!r}")
            refuse_too_many_processes(scenario)
            self.recording = Recording(Header(self.run, Plan(scenario), None))
            hear_faults = self._hearing(FAULTS, self.recording.take_faults)
            heard = {
                keys.truth: self._hearing(TRUTH, in_columns(self.recording.take_truth)),
                keys.all_estimates: self._hearing(ESTIMATE, in_columns(self.recording.take_estimates)),
                keys.all_events: self._hearing(EVENT, self.recording.take_events),
                keys.faults: hear_faults,
            }
            if self._measured:
                heard |= {
                    keys.all_beacons: self._hearing(BEACON, in_columns(self.recording.take_beacons)),
                    keys.all_ranges: self._hearing(RANGE, in_columns(self.recording.take_ranges)),
                }
            follow_token(session, keys.target_live, self._note)
            boxes = [(Mailbox(session, key, _CAPACITY), hear) for key, hear in heard.items()]
            for data in ask_latest(session, keys.faults):
                hear_faults(keys.faults, data)
        except BaseException:
            self.operator.__exit__()
            raise
        self._threads = [threading.Thread(target=self._follow, args=box, daemon=True) for box in boxes]
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self.operator.__exit__()

    def _note(self, there: bool) -> None:
        with self.lock:
            self.there = there
            self.news.notify_all()

    @property
    def ended(self) -> bool:
        """Whether the target has said that the run is over."""
        return self.recording.target_ended

    def _follow(self, box: Mailbox, hear: Callable[[str, bytes], None]) -> None:
        with suppress(Exception):  # the session was closed
            while not self._over.is_set():
                found = box.receive_from()
                if found is not None:
                    hear(*found)

    def _hearing(
        self, kind: Kind[M], take: Callable[[run_keys.Address, Logged, Sequence[M]], None]
    ) -> Callable[[str, bytes], None]:
        """How a message of a kind is checked, and taken into the recording."""

        def hear(key: str, data: bytes) -> None:
            at = run_keys.address(key)
            try:
                if at is None or at.agent >= self.recording.header.scenario.count:
                    raise BadMessage("a key that the run does not have")
                message = decode(kind, data, run=self.run, sender=at.owner)
            except BadMessage:
                self.refused += 1
                return
            with self.lock:
                take(at, np.array([time.time_ns()], dtype=np.uint64), [message])
                self.news.notify_all()

        return hear
