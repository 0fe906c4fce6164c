"""The scenario, asked for over the network by processes that know only the run's name and an endpoint."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass

import msgpack
import zenoh

from zenoh_cbef.errors import UserError
from zenoh_cbef.plain import count_in
from zenoh_cbef.protocol.answering import Answering
from zenoh_cbef.protocol.asking import all_answers
from zenoh_cbef.protocol.fields import Counts, field_of
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.messages import VERSION, BadMessage, unpack
from zenoh_cbef.protocol.reach import why_no_answer
from zenoh_cbef.protocol.renewing import Renewal
from zenoh_cbef.protocol.session import Connection

_TIME_ONLY = "only=time"
_APART_SECONDS, _ASK_SECONDS = 1.0, 1.0
_LONGEST_SECONDS = 10.0
"""How long one question for a scenario may take, s: a process that gives up asks again; a target that hundreds ask
at once would never get over that."""


@dataclass(frozen=True)
class ScenarioText:
    """A scenario as written and as resolved, both TOML, and the version of the program that serves it.

    step: the last one that the run has begun, None before its start. agents: those that take part in that step. faults:
    those that were injected meanwhile, a JSON list of tables, or empty.
    """

    source: str
    resolved: str
    program: str
    step: int | None = None
    agents: tuple[int, ...] = ()
    faults: str = ""


@dataclass(frozen=True)
class Clock:
    """How far our clock is ahead of the target's, s, and how long question and answer took, s.

    The true value is within half of `round_trip` of `ahead`.
    """

    ahead: float
    round_trip: float

    def ours(self, theirs: float) -> float:
        """A moment of the target's clock on ours, s.

        Unchanged where the clocks are less than a second apart: NTP then knows the difference better than we do.
        """
        return theirs + self.ahead if abs(self.ahead) > _APART_SECONDS + self.round_trip else theirs


def serve_scenario(session: zenoh.Session, run: str, text: Callable[[], ScenarioText]) -> Answering:
    """Answer queries for the scenario, as it is then, until the returned one is undeclared."""
    key = Keys(run).scenario

    def reply(query: zenoh.Query) -> None:
        answer = {"v": VERSION, "run": run, "time": time.time_ns()}
        if str(query.parameters) != _TIME_ONLY:
            answer |= asdict(text())
        query.reply(key, msgpack.packb(answer))

    return Answering(session, key, reply)


def fetch_scenario(
    session: zenoh.Session,
    run: str,
    connection: Connection,
    *,
    patience: float,
    stopped: Callable[[], bool] = lambda: False,
) -> ScenarioText:
    """Ask for the scenario again and again for `patience` s, and make a link anew over which no answer comes.

    Raises UserError where no target gives a valid answer.
    """
    until, renewal = time.monotonic() + patience, Renewal(session, connection)
    while not stopped():
        left = min(max(_ASK_SECONDS, until - time.monotonic()), _LONGEST_SECONDS)
        answers = all_answers(session, Keys(run).scenario, left)
        if answers:
            texts = [read_scenario(answer, run) for answer in answers]
            if len({text.resolved for text in texts}) > 1:
                raise UserError(
                    f"{len(texts)} targets answer for run {run!r}, with different scenarios; "
                    "end all but one, or give them different names with --run"
                )
            return texts[0]
        if time.monotonic() > until:
            break
        renewal.note_silence()
        time.sleep(0.03)
    raise UserError(f"no target of run {run!r} answers: {why_no_answer(session, connection, run)}")


def measure_clock(session: zenoh.Session, run: str, tries: int = 4) -> Clock | None:
    """Compare our clock with the target's as NTP does; the fastest of a few tries, None where no target answers."""
    found: list[Clock] = []
    for _ in range(tries):
        before = time.time_ns()
        answers = all_answers(session, f"{Keys(run).scenario}?{_TIME_ONLY}")
        after = time.time_ns()
        told = time_in(answers[0]) if answers else None
        if told is None:
            break
        found.append(Clock(((before + after) / 2 - told) * 1e-9, (after - before) * 1e-9))
    return min(found, key=lambda one: one.round_trip, default=None)


def time_in(data: bytes) -> int | None:
    """The time (ns) in an answer, None where it tells none."""
    try:
        return count_in(unpack(data), "time")
    except BadMessage:
        return None


def read_scenario(data: bytes, run: str) -> ScenarioText:
    """The scenario in a target's answer. Raises UserError where there is none, or one of another version."""
    try:
        answer = unpack(data)
    except BadMessage as error:
        raise UserError(f"run {run!r} answers with something that is no scenario ({error})") from None
    if answer.get("v") != VERSION:
        raise UserError(
            f"run {run!r} speaks protocol version {answer.get('v')!r:.40}, this program {VERSION}; "
            "install the same zenoh-cbef on every host"
        )
    parts = [answer.get(name) for name in ("source", "resolved", "program")]
    if not all(isinstance(part, str) for part in parts):
        raise UserError(f"run {run!r} answers with something that is no scenario; is its target a zenoh-cbef?")
    faults = answer.get("faults")
    source, resolved, program = (str(part) for part in parts)
    return ScenarioText(
        source,
        resolved,
        program,
        step=count_in(answer, "step"),
        agents=_agents(answer.get("agents")),
        faults=faults if isinstance(faults, str) else "",
    )


_COUNTS = field_of(Counts)


def _agents(value: object) -> tuple[int, ...]:
    return tuple(value) if isinstance(value, list) and _COUNTS.hold([value]) else ()
