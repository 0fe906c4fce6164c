"""Agent 0's process, which tells what a run's rounds cost; it takes the arguments of `zenoh-cbef`.

Writes JSON into the file that WATCHED names: between a tenth of the steps and the end, seconds, and what each process
of the run has used. With PLACES also the time of a round of its own by place, ns, medians: exclusive, one in the other.
"""

from __future__ import annotations

import json
import os
import statistics
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

from benchmarks.processes import Used, used_by
from benchmarks.putting import put
from benchmarks.watched import WATCHED
from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.cli.calling.main import main
from zenoh_cbef.nodes.agent import neighbour
from zenoh_cbef.nodes.agent.agent import Agent
from zenoh_cbef.nodes.agent.entrance import Entry
from zenoh_cbef.nodes.agent.neighbour import Neighbourhood
from zenoh_cbef.nodes.common.alarm import Alarm
from zenoh_cbef.protocol.outbox import Outbox
from zenoh_cbef.protocol.round_codec import RoundCodec
from zenoh_cbef.tracking.moderation import is_within
from zenoh_cbef.tracking.tracker import Estimate

PLACES = "WATCHED_PLACES"
WAKE_UP, READ, CHECK, MIX, WRITE, HAND_OVER = "wake-up", "read", "check", "mix", "write", "hand over"
STEP = "the rest of the step"
Given = ParamSpec("Given")
Found = TypeVar("Found")


class Stopwatch:
    """Time by place. A place within another one takes its time from that one's."""

    def __init__(self) -> None:
        self._since, self._inside = time.perf_counter_ns(), STEP
        self._now: dict[str, int] = defaultdict(int)
        self._rounds: dict[str, list[int]] = defaultdict(list)

    def enter(self, place: str) -> str:
        """Be in another place from now on; returns the one before."""
        now = time.perf_counter_ns()
        self._now[self._inside] += now - self._since
        before, self._since, self._inside = self._inside, now, place
        return before

    def turn(self) -> None:
        """End a round."""
        for place, spent in self._now.items():
            self._rounds[place].append(spent)
        self._now.clear()

    def around(self, function: Callable[Given, Found], place: str) -> Callable[Given, Found]:
        """The function, timed."""

        def timed(*given: Given.args, **named: Given.kwargs) -> Found:
            before = self.enter(place)
            try:
                return function(*given, **named)
            finally:
                self.enter(before)

        return timed

    def medians(self) -> dict[str, float]:
        """Nanoseconds of a round by place; of the first and of all other rounds' rest of the step the mean.

        A round that was not at a place, as it had not to wait, counts as none there.
        """
        count = len(self._rounds[MIX])
        found = {place: statistics.median(spent + [0] * (count - len(spent))) for place, spent in self._rounds.items()}
        return found | {STEP: sum(self._rounds[STEP]) / count}


class Watch:
    """What agent 0 looks at. run, steps: its own. stopwatch: where places are wanted."""

    def __init__(self, agent: Agent) -> None:
        self._run, self._steps = agent.node.identity.run, agent.scenario.length
        self._step = 0
        self.begun: tuple[float, dict[str, Used]] | None = None
        self.ended: tuple[float, dict[str, Used]] | None = None
        self.stopwatch = Stopwatch() if PLACES in os.environ else None

    def look(self) -> None:
        """Note what has been used, where the step that ends is the first or the last one that counts."""
        self._step += 1
        step = self._step
        if step == self._steps // 10:
            self.begun = time.monotonic(), used_by(self._run)
        elif step == self._steps:
            self.ended = time.monotonic(), used_by(self._run)

    def told(self) -> dict[str, object]:
        """What to write."""
        assert self.begun is not None
        assert self.ended is not None
        (began, before), (ended, after) = self.begun, self.ended
        used = {name: [now - then for now, then in zip(after[name], before[name], strict=True)] for name in before}
        places = {} if self.stopwatch is None else self.stopwatch.medians()
        return {"seconds": ended - began, "steps": self._steps - self._steps // 10, "used": used, "places": places}


def _time_places(agent: Agent, watch: Stopwatch) -> None:
    """Let the parts of a round tell when they begin and end."""
    put(Alarm, "receive", watch.around(Alarm.receive, WAKE_UP))
    put(Neighbourhood, "round", watch.around(Neighbourhood.round, READ))
    put(neighbour, "is_within", watch.around(is_within, CHECK))
    put(Outbox, "send_round", watch.around(Outbox.send_round, HAND_OVER))
    put(RoundCodec, "encode", watch.around(RoundCodec.encode, WRITE))
    put(agent.outgoing, "message", watch.around(agent.outgoing.message, CHECK))
    mix = watch.around(agent.tracker.exchange, MIX)

    def exchange(received: Floats, delivered: Bools | None) -> Floats:
        try:
            return mix(received, delivered)
        finally:
            watch.turn()

    put(agent.tracker, "exchange", exchange)


def _run(agent: Agent, entry: Entry) -> int:
    watch = Watch(agent)
    if watch.stopwatch is not None:
        _time_places(agent, watch.stopwatch)
    conclude = agent.tracker.conclude

    def looked() -> Estimate:
        estimate = conclude()
        watch.look()
        return estimate

    put(agent.tracker, "conclude", looked)
    last = _original(agent, entry)
    Path(os.environ[WATCHED]).write_text(json.dumps(watch.told()), encoding="utf-8")
    return last


_original = Agent.run

if __name__ == "__main__":
    put(Agent, "run", _run)
    main()
