"""Some agents of a run as processes of this host: started, watched, and started again where they die."""

from __future__ import annotations

import json
import os
import select
import signal
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from zenoh_cbef.machine import keep_to_core
from zenoh_cbef.nodes.common.ending import PLACE, Ending, ending_at
from zenoh_cbef.nodes.common.node import FLEET, LEASH
from zenoh_cbef.nodes.launch.children import Child, Nursery, how_ended, last_words

_REFUSED = 2
"""Exit status of a process that was called in a way that cannot work."""
_LOOK_SECONDS = 0.1
_POLITE_SECONDS = 8.0
"""How long processes that are told to end may take: their last words take a while where the recorder is busy."""
_AGAIN_SECONDS, _MOST_SECONDS = 0.5, 30.0
"""After how long a process that died is started again: at first, and at most."""
_MOST_IN_A_ROW = 5
_AT_ONCE = 4
SLOW_SECONDS = 10.0
"""An agent that takes longer to get into its run waits for others, and holds up no further starts."""
_LONG_SECONDS = 60.0
"""A process that lived for so long did not die of its start."""


@dataclass
class Member:
    """An agent of a fleet, and what became of it.

    command: what starts it. stage: "starting", "joined", "began" or "ended", as it says itself. step: the last one
    that it took part in. starts: how often it was started. over: whether it is left as it is. why: why it is missing;
    "" where it is not.
    """

    agent: int
    command: Sequence[str]
    stage: str = "starting"
    step: int = 0
    starts: int = 0
    over: bool = False
    refused: bool = False
    why: str = ""
    in_a_row: int = 0
    began: float = 0.0
    due: float = 0.0
    child: Child | None = None


class Fleet:
    """The processes. Use as a context manager: leaving it ends all of them.

    commands: the agents' command lines by their ids; they say how far they are with --status-json.
    restart: whether a process that dies is started again. One that is refused is not: it would be again.
    at_once: how many may be on their way into the run at the same time, None: four for each core.
    """

    def __init__(
        self, commands: Mapping[int, Sequence[str]], *, restart: bool = True, at_once: int | None = None
    ) -> None:
        self.members = [Member(agent, command) for agent, command in commands.items()]
        self._by_id = {member.agent: member for member in self.members}
        self.news: list[str] = []
        """What happened lately, in sentences; the reader takes them out."""
        self._restart, self._asked = restart, 0
        self._at_once = at_once or _AT_ONCE * (os.cpu_count() or 1)
        self._killed_at = 0.0

    def __enter__(self) -> Self:
        self._folder = tempfile.TemporaryDirectory(prefix="zenoh-cbef-")
        self._told, self._tell = os.pipe()
        os.set_blocking(self._told, False)
        self._rest = b""
        self._nursery = Nursery(("agent",)).__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        for member in self._running():
            self._send(member, signal.SIGKILL)
        for member in self._running():
            if member.child is not None:
                member.child.wait(_POLITE_SECONDS)
        self._nursery.__exit__()
        for end in (self._told, self._tell):
            os.close(end)
        self._folder.cleanup()

    def watch(self, changed: Callable[[], None], asked_to_stop: Callable[[], int]) -> None:
        """Start all, and watch them until each has ended for good.

        changed: called now and then, to show `members`. asked_to_stop: how often the user asked; once tells all to
        end, twice ends them at once.
        """
        while any(not member.over for member in self.members):
            self._start_due()
            self._listen(_LOOK_SECONDS)
            for member in self._running():
                self._note_end(member)
            self._obey(asked_to_stop())
            changed()

    def _running(self) -> list[Member]:
        return [member for member in self.members if member.child is not None]

    def _start_due(self) -> None:
        """Start those that are due, no more at once than get into the run in time: a start takes much of a core."""
        now = time.monotonic()
        getting_in = sum(one.stage == "starting" and now - one.began < SLOW_SECONDS for one in self._running())
        waiting = [one for one in self.members if not one.over and one.child is None and now >= one.due]
        for member in waiting[: max(0, self._at_once - getting_in)]:
            self._start(member)

    def _start(self, member: Member) -> None:
        place = self._place(member)
        place.with_suffix(".json").unlink(missing_ok=True)
        place.unlink(missing_ok=True)
        environment = {LEASH: FLEET, PLACE: str(place.with_suffix(".json"))}
        member.child = self._nursery.start([*member.command], environment, place, self._tell)
        member.stage, member.began = "starting", time.monotonic()
        member.starts += 1
        keep_to_core(member.child.pid, self.members.index(member), len(self.members))

    def _place(self, member: Member) -> Path:
        return Path(self._folder.name) / f"agent-{member.agent}"

    def _listen(self, seconds: float) -> None:
        """Take in what the processes say of themselves."""
        if not select.select([self._told], [], [], seconds)[0]:
            return
        with suppress(BlockingIOError):
            self._rest += os.read(self._told, 1 << 16)
        *lines, self._rest = self._rest.split(b"\n")
        for line in lines:
            with suppress(ValueError, KeyError, TypeError):
                told = json.loads(line)
                member = self._by_id[told["agent"]]
                member.stage, member.step = told["stage"], told["step"] or member.step

    def _note_end(self, member: Member) -> None:
        status = None if member.child is None else member.child.poll()
        if status is None:
            return
        member.child = None
        words, ending = last_words(self._place(member)), ending_at(self._place(member).with_suffix(".json"))
        if status == 0:
            member.over = True
        elif self._asked:
            member.over, member.why = True, "" if status < 0 else words
        elif ending is not None and ending.cause == "crash":
            self._obey_scenario(member, ending)
        elif status == _REFUSED and ending is None:
            member.over, member.refused, member.why = True, True, words
        else:
            self._start_again(member, f"{how_ended(status)}: {words}" if words else how_ended(status))

    def _obey_scenario(self, member: Member, ending: Ending) -> None:
        if ending.steps_away is None:
            member.over = True
        else:
            member.due = time.monotonic() + ending.seconds_away

    def _start_again(self, member: Member, why: str) -> None:
        now = time.monotonic()
        member.in_a_row = 0 if now - member.began > _LONG_SECONDS else member.in_a_row + 1
        member.due = now + min(_AGAIN_SECONDS * 2.0**member.in_a_row, _MOST_SECONDS)
        if not self._restart or member.in_a_row > _MOST_IN_A_ROW:
            member.over, member.why = True, why
        else:
            self.news.append(f"agent {member.agent} {why}; it is started again")

    def _obey(self, asked: int) -> None:
        now = time.monotonic()
        if asked and not self._asked:
            self._killed_at = now + _POLITE_SECONDS
            for member in self.members:
                member.over |= member.child is None
            for member in self._running():
                self._send(member, signal.SIGTERM)
        self._asked = max(asked, self._asked)
        if self._asked > 1 or (self._asked and now > self._killed_at):
            for member in self._running():
                self._send(member, signal.SIGKILL)

    @staticmethod
    def _send(member: Member, number: int) -> None:
        if member.child is not None:
            member.child.send(number)


def missing(members: Iterable[Member]) -> dict[str, list[int]]:
    """The agents that are missing, by why they are."""
    found: dict[str, list[int]] = {}
    for member in members:
        if member.why:
            found.setdefault(member.why.replace(f"agent {member.agent} ", "it "), []).append(member.agent)
    return found
