"""From a recording to a part of what its nodes exchanged, with times and fates, for the space-time picture."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from zenoh_cbef.errors import UserError
from zenoh_cbef.faults.injected import IN_TIME
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.read.receipts import Receipt
from zenoh_cbef.log.read.recording import Recording, read_recording
from zenoh_cbef.log.read.times import times_of
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
    recording = read_recording(open_log(path), rounds="times")
    builder = _Builder(recording)
    spans = builder.times.steps()
    if not spans:
        raise UserError(f"the log of run {recording.header.run!r} holds no estimate, so there is nothing to draw")
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
    _refuse_too_large(builder.count(since, until), chosen if steps else [], since, until)
    return builder.exchange(chosen, since, until, by_time=not steps)


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

    def __init__(self, recording: Recording) -> None:
        self._recording, self.times = recording, times_of(recording)
        plan, self._scenario = recording.header.plan, recording.header.scenario
        self._lag, self._turns = self._scenario.consensus.lag, recording.rounds_per_step + 1
        self._ranges = plan.sharing.uses_neighbour_ranges
        self._fates = cache(lambda agent, sources: fates_into(plan, agent, list(sources)))
        self._told = cache(self._estimate)

    def _estimate(self, agent: int, step: int) -> Receipt | None:
        """What an agent told of its neighbours' messages in a step; None where the log does not have it."""
        return self._recording.receipts[agent].told(step)

    def count(self, since: float, until: float) -> int:
        """About how many messages were sent to agents between two times."""
        links = sum(len(one.neighbours) for one in self._recording.receipts)
        inside = [(times >= since) & (times <= until) for times in (self.times.sends, self.times.beacons)]
        sent = int(inside[0][:, :, 0 if self._ranges else 1 :].sum())
        return int(inside[1].sum()) + round(sent * links / self._scenario.count)

    def exchange(self, steps: list[int], since: float, until: float, *, by_time: bool) -> Exchange:
        """Everything of some steps, as far as it lies between two times.

        by_time: with late messages of steps before, which were still under way.
        """
        passages = [one for step in steps for one in (*self._beacons(step), *self._messages(step))]
        passages += self._late(steps[0], since) if by_time else []
        near = [one for one in passages if one.ended >= since and one.sent <= until]
        times, scenario = self.times, self._scenario
        notes = self._lacking(steps)
        if any(one.fortune in {"in time", "duplicated"} and one.ended < one.sent for one in near):
            notes.append("Some messages seem to be used before they were sent: their hosts' clocks differ.")
        return Exchange(
            name=self._recording.header.run,
            labels=scenario.agents.names,
            dt=scenario.dt,
            since=since,
            until=until,
            passages=sorted(near, key=lambda one: one.sent),
            rounds=[one for step in steps for one in self._rounds(step)],
            estimates=[
                (agent, step, float(time))
                for step in steps
                for agent, time in enumerate(times.estimates[:, step - 1])
                if since <= time <= until
            ],
            events=[event for event in times.events if since <= event[1] <= until],
            notes=notes,
        )

    def _lacking(self, steps: list[int]) -> list[str]:
        """What the log does not hold of these steps, and the picture therefore does not show, in sentences."""
        times, rows = self.times, np.array(steps) - 1
        there = {
            "beacon": np.isfinite(times.beacons[:, rows]).any(),
            "range": np.isfinite(times.sends[:, rows, 0]).any(),
            "consensus message": self._turns == 1 or np.isfinite(times.sends[:, rows, 1:]).any(),
        }
        gone = [name for name, found in there.items() if not found]
        silent = np.flatnonzero(np.isnan(times.estimates).all(axis=1)).tolist()
        notes = [f"The log holds no {' and no '.join(gone)} of these steps, so none is drawn."] if gone else []
        if silent:
            notes.append(f"The log holds no estimate of agent {', '.join(map(str, silent))}.")
        return notes

    def _rounds(self, step: int) -> Iterator[tuple[int, int, float]]:
        for round_ in range(self._turns):
            times = self.times.sends[:, step - 1, round_]
            sent = np.sort(times[np.isfinite(times)]).tolist()
            if sent:
                yield step, round_, sent[len(sent) // 2]

    def _beacons(self, step: int) -> Iterator[Passage]:
        for agent in range(self._scenario.count):
            sent, ended = float(self.times.beacons[agent, step - 1]), self.times.sent(agent, step, 0)
            if math.isfinite(sent):
                fortune: Fortune = "in time" if self.times.heard[agent, step - 1] else "unheard"
                yield Passage(None, agent, step, 0, sent, math.inf if math.isnan(ended) else ended, fortune)

    def _messages(self, step: int) -> Iterator[Passage]:
        """The messages that all agents were to use in a step."""
        for agent in range(self._scenario.count):
            told = self._told(agent, step)
            if told is not None:
                for place in range(len(told.neighbours)):
                    yield from self._from(place, told, agent, step)

    def _late(self, first: int, since: float) -> Iterator[Passage]:
        """Messages of the steps before the first one that came after a time."""
        for step in range(first - 1, 0, -1):
            late = [one for one in self._messages(step) if one.ended >= since]
            if not late:
                return
            yield from late

    def _due(self, step: int) -> list[tuple[int, int]]:
        """Step and round of the messages that each neighbour should have brought by a step, in the order of marks."""
        rounds = [(step - self._lag, round_) for round_ in range(1, self._turns)] if step > self._lag else []
        return [(step, 0), *rounds] if self._ranges else rounds

    def _from(self, place: int, told: Receipt, agent: int, step: int) -> list[Passage]:
        """The messages of one neighbour that an agent was to use in a step."""
        source, due = told.neighbours[place], self._due(step)
        marks = told.marks[place] if told.marks else IN_TIME * len(due)
        found = []
        for mark, (sent_step, round_) in zip(marks, due, strict=False):
            sent = self.times.sent(source, sent_step, round_)
            if math.isnan(sent) or mark not in _FORTUNES:
                continue
            ended = self.times.used(agent, step, round_)
            if mark == ">":
                fate = self._fates(agent, tuple(told.neighbours)).of(sent_step, round_)
                ended = self._arrived(agent, (step, round_), sent, float(fate.delay[place]))
            found.append(Passage(source, agent, sent_step, round_, sent, ended, _FORTUNES[mark]))
        return self._missed(found, place, told, self._told(agent, step - 1), step)

    def _arrived(self, agent: int, due: tuple[int, int], sent: float, delay: float) -> float:
        """When a delayed message came; in lockstep, where delays count in rounds, that many rounds later.

        due: the step and round in which it was to be used.
        """
        if self._scenario.timing.mode == "realtime" and delay > 0.0:
            return sent + delay
        slot = self._scenario.dt / self._turns
        # Compared with a little slack: a delay of exactly one slot is one round.
        rounds = max(1, math.ceil(delay / slot - 1e-9))
        later = self.times.used(agent, due[0], due[1] + rounds)
        if math.isfinite(later):
            # An agent that does not wait for a message can be past that round before the message is sent.
            return max(later, sent)
        pace = self.times.used(agent, *due) - self.times.sent(agent, *due)
        return sent + (rounds + 1) * pace if math.isfinite(pace) else math.inf

    def _missed(
        self, found: list[Passage], place: int, told: Receipt, before: Receipt | None, step: int
    ) -> list[Passage]:
        """Mark the messages that were missed without a fault. Receivers count them; the latest will have been those."""
        if before is None and step > 1:
            return found
        received = told.counts["received"][place] - (before.counts["received"][place] if before else 0)
        good = [one for one in found if one.fortune in {"in time", "duplicated"}]
        if received < 0:
            return found  # The agent began anew.
        good.sort(key=lambda one: one.ended - one.sent)
        missed = {id(one) for one in good[: max(0, len(good) - received)]}
        return [replace(one, fortune="missed") if id(one) in missed else one for one in found]
