"""The operator of a run: asks it and gives it orders while it goes on, from any host, without taking part in it."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

from zenoh_cbef.errors import UserError
from zenoh_cbef.outside.status import RunStatus, read_status
from zenoh_cbef.protocol.control import ask_control
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.lives import new_life
from zenoh_cbef.protocol.presence import live_now
from zenoh_cbef.protocol.questions import (
    ADD,
    CLEAR,
    HOLD,
    LIST,
    STATUS,
    STOP,
    Added,
    Answer,
    Holding,
    InjectedTable,
    Question,
)
from zenoh_cbef.protocol.reach import wait_for_link, why_no_answer
from zenoh_cbef.protocol.session import Connection, open_session

_PATIENCE_SECONDS = 3.0
_RETRY_SECONDS = 0.05
_PROCESSES = ("target/", "agent/", "record/")


@dataclass(frozen=True)
class InjectedFault:
    """A fault that was injected into a run: its number, whether it is on, from when and until when (run time, s).

    keys: the others of its table, as probability.
    """

    number: int
    active: bool
    kind: str
    since: float
    until: float | None
    keys: dict[str, object]

    @property
    def table(self) -> dict[str, object]:
        """All of it, as it stands in a scenario."""
        until = {} if self.until is None else {"until": self.until}
        named = {"number": self.number, "active": self.active, "kind": self.kind, "from": self.since, **until}
        return named | self.keys

    @classmethod
    def of(cls, table: InjectedTable) -> Self:
        """A fault as the run tells it."""
        keys = {name: value for name, value in table.items() if name not in InjectedTable.__annotations__}
        return cls(table["number"], table["active"], table["kind"], table["from"], table.get("until"), keys)


class Operator:
    """A session that puts questions to a run's target. Use as a context manager.

    What it asks raises UserError with the run's own sentence, or with why the run does not answer.
    """

    def __init__(self, run: str, connection: Connection, patience: float = _PATIENCE_SECONDS) -> None:
        # A life, by which the target knows that it is no stranger.
        self.run, self._connection, self.patience = run, replace(connection, life=new_life(())), patience
        self._keys = Keys(run)

    def __enter__(self) -> Self:
        self._until = time.monotonic() + self.patience
        self.session = open_session(self._connection, self.patience)
        return self

    def __exit__(self, *_: object) -> None:
        self.session.close()

    def status(self) -> RunStatus:
        """How the run is doing."""
        return read_status(self._ask(STATUS))

    def status_if_on(self) -> RunStatus | None:
        """As status, but None where the run does not answer, as it has ended."""
        told = self._answer(STATUS)
        return None if told is None else read_status(told)

    def stop(self) -> int | None:
        """End the run. Returns the step after which it ends, None before the first."""
        return self._ask(STOP)["step"]

    def hold(self, *, on: bool, steps: int = 0, rounds: int = 0) -> Holding:
        """Let a run in lockstep stand still after so many more steps, or rounds of a step, or go on."""
        return self._ask(HOLD, on=on, steps=steps, rounds=rounds)

    def inject(self, fault: Mapping[str, object], seconds: float | None) -> Added:
        """Inject a fault for so many s, or for good."""
        return self._ask(ADD, fault=json.dumps(fault), seconds=seconds)

    def injected(self) -> list[InjectedFault]:
        """The faults that were injected."""
        tables: list[InjectedTable] = json.loads(self._ask(LIST)["faults"])
        return [InjectedFault.of(table) for table in tables]

    def clear(self, numbers: Sequence[int]) -> list[int]:
        """End injected faults, all if none is named. Returns which were ended."""
        return self._ask(CLEAR, numbers=list(numbers) or None)["ended"]

    def _ask(self, what: Question[Answer], **more: object) -> Answer:
        told = self._answer(what, **more)
        if told is None:
            why = why_no_answer(self.session, self._connection, self.run)
            raise UserError(f"run {self.run!r} does not answer: {why}")
        return told

    def _answer(self, what: Question[Answer], **more: object) -> Answer | None:
        """What the run answers, None where it does not."""
        wait_for_link(self.session, self._until - time.monotonic())
        while True:
            # A new link does not know yet which processes answer: no answer may come at once, and one a moment later.
            left = self._until - time.monotonic()
            told = ask_control(self.session, self._keys.control, what, timeout=max(left, 1.0), **more)
            if told is not None or left < 0.0:
                self._until = time.monotonic() + self.patience
                return told
            time.sleep(_RETRY_SECONDS)

    def processes(self) -> set[str]:
        """The processes of the run that can be seen from here, as in "agent/3"."""
        return {name for name in live_now(self.session, self._keys.all_live) if name.startswith(_PROCESSES)}
