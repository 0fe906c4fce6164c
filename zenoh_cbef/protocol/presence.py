"""Which processes are there: liveliness tokens."""

from __future__ import annotations

import threading
import traceback
from collections import defaultdict
from collections.abc import Callable
from queue import SimpleQueue

import zenoh

from zenoh_cbef.protocol.tokens import is_token, life_token, life_told, over_token, over_told

_MOST = 10_000
"""Names that are known at once. Beyond it no more are taken that processes choose: without certificates, any can."""


def live_now(session: zenoh.Session, expression: str) -> set[str]:
    """The names, as in "agent/3", that answer now to a liveliness expression, asked of the whole network."""
    replies = session.liveliness().get(expression, timeout=2.0)
    prefix = expression.removesuffix("**")
    return {str(reply.ok.key_expr).removeprefix(prefix) for reply in replies if reply.ok is not None}


def follow_token(session: zenoh.Session, key: str, note: Callable[[bool], None]) -> None:
    """Say whether a process is there, by its token, whenever that changes, as long as the session is open."""

    def change(sample: zenoh.Sample) -> None:
        note(sample.kind == zenoh.SampleKind.PUT)

    session.liveliness().declare_subscriber(key, change, history=True)


class Presence:
    """Which processes are there: the liveliness tokens of a run, ours and others', updated in the background.

    Zenoh gives a callback of Python 256 places. While they are full it receives nothing else, and a thread that
    declares a token waits. If a listener waits for a lock that this thread holds, both wait for good. So Zenoh's
    callback puts tokens into a queue without a limit, and a thread of ours works it off.
    """

    def __init__(self, session: zenoh.Session, expression: str) -> None:
        self._session = session
        self._prefix = expression.removesuffix("**")
        self._tokens: dict[str, zenoh.LivelinessToken] = {}
        self._live: set[str] = set()
        self._lives: dict[str, str] = {}
        self._over: set[str] = set()
        self._changed = threading.Condition()
        self._listeners: list[Callable[[str, bool], None]] = []
        self._waiting: SimpleQueue[zenoh.Sample | None] = SimpleQueue()
        threading.Thread(target=self._work_off, name="presence", daemon=True).start()
        until_closed = zenoh.handlers.Callback(self._waiting.put, drop=lambda: self._waiting.put(None))
        session.liveliness().declare_subscriber(self._prefix + "**", until_closed, history=True)

    def follow(self, session: zenoh.Session, names: str) -> zenoh.Subscriber[None]:
        """Take in what a session, ours or another one, sees of these names, until the subscriber is undeclared."""
        return session.liveliness().declare_subscriber(self._prefix + names, self._waiting.put, history=True)

    def _work_off(self) -> None:
        while (sample := self._waiting.get()) is not None:
            try:
                self._notice(sample)
            except zenoh.ZError:
                pass  # a listener found the session closed
            except Exception:  # noqa: BLE001 - a listener that fails must not end what all others are told
                traceback.print_exc()

    def _notice(self, sample: zenoh.Sample) -> None:
        name = str(sample.key_expr).removeprefix(self._prefix)
        joined = sample.kind == zenoh.SampleKind.PUT
        chosen = is_token(name, chosen=True)
        if not (chosen or is_token(name, chosen=False)) or (joined and chosen and len(self._live) >= _MOST):
            return
        with self._changed:
            (self._live.add if joined else self._live.discard)(name)
            if joined:
                self._remember(name)
            self._changed.notify_all()
        for listener in self._listeners:
            listener(name, joined)

    def _remember(self, name: str) -> None:
        if told := life_told(name):
            owner, life = told
            if self._lives.get(owner) != life:
                self._lives[owner] = life
                self._over.discard(owner)
        elif over := over_told(name):
            self._over.add(over)

    def life(self, name: str) -> str:
        """The `life` of the process seen last under this name: each process has another; "" if none was seen."""
        return self._lives.get(name, "")

    def lives(self, live: set[str]) -> defaultdict[str, set[str]]:
        """The `life` of each process that has entered under a name, of the names that are there."""
        found: defaultdict[str, set[str]] = defaultdict(set)
        for token in live:
            if told := life_told(token):
                name, life = told
                found[name].add(life)
        return found

    def is_over(self, name: str) -> bool:
        """Whether the process seen last under this name has said that it leaves for good."""
        return name in self._over

    def enter(self, name: str) -> None:
        """Announce a name, after this process's `life`: another process may have had the name before."""
        self.announce(life_token(name, str(self._session.zid())))
        self.announce(name)

    def leave(self, name: str) -> None:
        """Say that a name does not come back, and take all tokens back. A broken link does only the second."""
        self.announce(over_token(name))
        self.withdraw()

    def announce(self, name: str) -> None:
        """Declare a token, as in "agent/3": all processes see it come, and go when this process ends."""
        self._tokens[name] = self._session.liveliness().declare_token(self._prefix + name)

    def retract(self, name: str) -> None:
        """Take one of our tokens back."""
        self._tokens.pop(name).undeclare()

    def withdraw(self) -> None:
        """Take our tokens back, the latest first."""
        while self._tokens:
            self._tokens.popitem()[1].undeclare()

    def asks_for(self, name: str) -> bool:
        """Whether a process has a name now, asked of the whole network."""
        return bool(live_now(self._session, self._prefix + name))

    def on_change(self, listener: Callable[[str, bool], None]) -> None:
        """Call listener(name, joined) from a background thread at every change; name is as in "agent/3"."""
        self._listeners.append(listener)

    def __contains__(self, name: str) -> bool:
        return name in self._live

    def names(self) -> set[str]:
        """The names of all processes that are there."""
        with self._changed:
            return set(self._live)

    def wait(self, condition: Callable[[set[str]], bool], timeout: float | None) -> bool:
        """Wait until a condition on the names holds; False after `timeout` s."""
        with self._changed:
            return self._changed.wait_for(lambda: condition(self._live), timeout)
