"""Answers to the questions of many processes, given in a thread that cannot hold up what a session receives."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable
from contextlib import suppress

import zenoh

MOST_WAITING = 4096
"""Questions that wait for their answer: several from each agent that a scenario can have."""
_END_SECONDS = 5.0


class Answering:
    """Answers each question on a key, one after the other, until it is undeclared.

    Zenoh gives a callback of Python 256 places. While they are full it receives nothing, also not on other keys, and
    hundreds of processes that ask at once fill them. Here, where too many questions wait, the one that has waited
    longest is dropped; its process hears at once that no answer comes, and asks again.
    """

    def __init__(
        self, session: zenoh.Session, key: str, answer: Callable[[zenoh.Query], None], waiting: int = MOST_WAITING
    ) -> None:
        self._queryable = session.declare_queryable(key, zenoh.handlers.RingChannel(waiting))
        self._receive, self._answer = self._queryable.handler.recv, answer
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        with suppress(zenoh.ZError):  # there are no more questions
            while True:
                with self._receive() as query:
                    self._answer_one(query)

    def _answer_one(self, query: zenoh.Query) -> None:
        try:
            self._answer(query)
        except zenoh.ZError:
            pass  # the process that asked may be gone
        except Exception:  # noqa: BLE001 - one question that cannot be answered must not leave all others unanswered
            traceback.print_exc()

    def undeclare(self) -> None:
        """Answer no more."""
        with suppress(zenoh.ZError):  # the session has ended before
            self._queryable.undeclare()
        self._thread.join(_END_SECONDS)
