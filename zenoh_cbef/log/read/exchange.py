"""From a log to a part of what its nodes exchanged, with times and fates, for the space-time picture."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from zenoh_cbef.errors import UserError
from zenoh_cbef.faults.injected import FATES, IN_TIME
from zenoh_cbef.log.read.contents import Header, read_header
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.read.times import MessageTimes, read_times
from zenoh_cbef.protocol.messages import decode
from zenoh_cbef.scenario.build import fates_into
from zenoh_cbef.trace import Exchange, Fortune, Passage

MOST = 4000
"""Messages that a picture can hold and still be read."""

_FORTUNES: dict[str, Fortune] = {IN_TIME: "in time", "x": "lost", ">": "late", "!": "damaged", "+": "duplicated"}
_FIRST_STEPS = 3


def read_exchange(
    path: Path, *, steps: tuple[int, int] | None = None, since: float | None = None, until: float | None = None
) -> Exchange:
    """Read what was exchanged in some steps (first, last), or between two times (s since the start).

    Without any of these: the first steps. Raises UserError where the log has nothing there, or too much.
    """
    file = open_log(path)
    header = read_header(file, path)
    times = read_times(file, header)
    spans = times.steps()
    if not spans:
        raise UserError(f"the log of run {header.run!r} holds no estimate, so there is nothing to draw")
    if since is None and until is None:
        first, last = steps or (min(spans), min(spans) + _FIRST_STEPS - 1)
        chosen = [step for step in spans if first <= step <= last]
        if not chosen:
            raise UserError(f"the log has steps {min(spans)} to {max(spans)}, none of {first}:{last}; change --steps")
        since, until = spans[chosen[0]][0], max(spans[step][1] for step in chosen)
    else:
        end = max(last for _, last in spans.values())
        since, until = 0.0 if since is None else since, end if until is None else until
        chosen = [step for step, (begin, end) in spans.items() if begin <= until and end >= since]
        if not chosen:
            raise UserError(f"the log has steps between {min(spans.values())[0]:.3f} s and {end:.3f} s; change --from")
    builder = _Builder(header, times)
    _refuse_too_large(builder.count(since, until), chosen if steps else [], since, until)
    return builder.exchange(chosen, since, until)


def _refuse_too_large(count: int, steps: list[int], since: float, until: float) -> None:
    if count <= MOST:
        return
    fitting = len(steps) * MOST // count
    if fitting:
        narrower = f"--steps {steps[0]}:{steps[fitting - 1]}"
    else:
        narrower = f"--from {since:.6g} --until {since + (until - since) * MOST / count:.6g}"
    raise UserError(f"about {count} messages are in this part, and {MOST} can be told apart; try {narrower}")


class _Builder:
    """Makes passages of what receivers said of the messages, and of when these were sent and used."""

    def __init__(self, header: Header, times: MessageTimes) -> None:
        self._header, self._times = header, times
        scenario = self._scenario = header.scenario
        self._lag = scenario.consensus.lag
        self._ranges = header.plan.sharing.uses_neighbour_ranges
        self._fates = cache(lambda agent, sources: fates_into(header.plan, agent, list(sources)))
        self._told = cache(self._estimate)

    def _estimate(self, agent: int, step: int) -> dict[str, Any] | None:
        found = self._times.estimates.get((agent, step))
        return found and decode("estimate", found[1], run=self._header.run)

    def count(self, since: float, until: float) -> int:
        """About how many messages were sent to agents between two times."""
        links, times = 0, self._times
        for agent in range(self._scenario.count):
            told = next((message for key in times.estimates if key[0] == agent and (message := self._told(*key))), None)
            links += len(told["neighbours"]) if told else 0
        sent = sum(
            since <= time <= until for (_, turn), time in times.sends.items() if turn % times.turns or self._ranges
        )
        heard = sum(since <= time <= until for time, _ in times.beacons.values())
        return heard + round(sent * links / self._scenario.count)

    def exchange(self, steps: list[int], since: float, until: float) -> Exchange:
        """Everything of some steps, as far as it lies between two times."""
        passages = [one for step in steps for one in (*self._beacons(step), *self._messages(step))]
        near = [one for one in passages if one.ended >= since and one.sent <= until]
        times, scenario = self._times, self._scenario
        notes = self._lacking(steps)
        if any(one.fortune in {"in time", "duplicated"} and one.ended < one.sent for one in near):
            notes.append("Some messages seem to be used before they were sent: their hosts' clocks differ.")
        return Exchange(
            name=self._header.run,
            labels=scenario.agents.labels or tuple(map(str, range(scenario.count))),
            dt=scenario.dt,
            since=since,
            until=until,
            passages=sorted(near, key=lambda one: one.sent),
            rounds=[one for step in steps for one in self._rounds(step)],
            estimates=[
                (agent, step, time)
                for (agent, step), (time, _) in times.estimates.items()
                if step in set(steps) and since <= time <= until
            ],
            events=[event for event in times.events if since <= event[1] <= until],
            notes=notes,
        )

    def _lacking(self, steps: list[int]) -> list[str]:
        """What the log does not hold of these steps, and the picture therefore does not show, in sentences."""
        times, first, last = self._times, steps[0] * self._times.turns, (steps[-1] + 1) * self._times.turns
        there = {
            "beacon": any(step in steps for _, step in times.beacons),
            "range": any(first <= turn < last and turn % times.turns == 0 for _, turn in times.sends),
            "consensus message": times.turns == 1
            or any(first <= turn < last and turn % times.turns for _, turn in times.sends),
        }
        gone = [name for name, found in there.items() if not found]
        silent = sorted(set(range(self._scenario.count)) - {agent for agent, _ in times.estimates})
        notes = [f"The log holds no {' and no '.join(gone)} of these steps, so none is drawn."] if gone else []
        if silent:
            notes.append(f"The log holds no estimate of agent {', '.join(map(str, silent))}.")
        return notes

    def _rounds(self, step: int) -> Iterator[tuple[int, int, float]]:
        agents, turns = range(self._scenario.count), self._times.turns
        for round_ in range(turns):
            turn = step * turns + round_
            sent = [self._times.sends[agent, turn] for agent in agents if (agent, turn) in self._times.sends]
            if sent:
                yield step, round_, sorted(sent)[len(sent) // 2]

    def _beacons(self, step: int) -> Iterator[Passage]:
        for agent in range(self._scenario.count):
            sent, heard = self._times.beacons.get((agent, step), (math.nan, False))
            ended = self._times.sends.get((agent, step * self._times.turns), math.inf)
            if math.isfinite(sent):
                yield Passage(None, agent, step, 0, sent, ended, "in time" if heard else "unheard")

    def _messages(self, step: int) -> Iterator[Passage]:
        """The messages that all agents were to use in a step."""
        for agent in range(self._scenario.count):
            told = self._told(agent, step)
            for place, source in enumerate(told["neighbours"] if told else ()):
                yield from self._from(source, agent, step, place)

    def _due(self, step: int) -> list[tuple[int, int]]:
        """Step and round of the messages that each neighbour should have brought by a step, in the order of marks."""
        rounds = [(step - self._lag, round_) for round_ in range(1, self._times.turns)] if step > self._lag else []
        return [(step, 0), *rounds] if self._ranges else rounds

    def _from(self, source: int, agent: int, step: int, place: int) -> list[Passage]:
        told, due = self._told(agent, step) or {}, self._due(step)
        marks = told[FATES][place] if FATES in told else IN_TIME * len(due)
        found = []
        for mark, (sent_step, round_) in zip(marks, due, strict=False):
            turn = step * self._times.turns + round_
            sent = self._times.sends.get((source, sent_step * self._times.turns + round_))
            if sent is None or mark not in _FORTUNES:
                continue
            ended = self._times.used(agent, turn)
            if mark == ">":
                fate = self._fates(agent, tuple(told["neighbours"])).of(sent_step, round_)
                ended = self._arrived(agent, turn, sent, float(fate.delay[place]))
            found.append(Passage(source, agent, sent_step, round_, sent, ended, _FORTUNES[mark]))
        return self._missed(found, place, agent, step)

    def _arrived(self, agent: int, turn: int, sent: float, delay: float) -> float:
        """When a delayed message came; in lockstep, where delays count in rounds, that many rounds later."""
        if self._scenario.timing.mode == "realtime" and delay > 0.0:
            return sent + delay
        slot = self._scenario.dt / self._times.turns
        # Compared with a little slack: a delay of exactly one slot is one round.
        rounds = max(1, math.ceil(delay / slot - 1e-9))
        later = self._times.used(agent, turn + rounds)
        if math.isfinite(later):
            # Who does not wait for a message can be past that round before the message is sent.
            return max(later, sent)
        pace = self._times.used(agent, turn) - self._times.sends.get((agent, turn), math.nan)
        return sent + (rounds + 1) * pace if math.isfinite(pace) else math.inf

    def _missed(self, found: list[Passage], place: int, agent: int, step: int) -> list[Passage]:
        """Mark the messages that were missed without a fault. Receivers count them; the latest will have been those."""
        told, before = self._told(agent, step), self._told(agent, step - 1)
        if told is None or (before is None and step > 1):
            return found
        received = told["received"][place] - (before["received"][place] if before else 0)
        good = [one for one in found if one.fortune in {"in time", "duplicated"}]
        if received < 0:
            return found  # The agent began anew.
        good.sort(key=lambda one: one.ended - one.sent)
        missed = {id(one) for one in good[: max(0, len(good) - received)]}
        return [
            Passage(one.source, agent, one.step, one.round, one.sent, one.ended, "missed") if id(one) in missed else one
            for one in found
        ]
