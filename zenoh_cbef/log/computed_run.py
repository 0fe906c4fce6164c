"""A run that was computed, written as its processes would have sent it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.faults import Fate
from zenoh_cbef.faults.injected import Injected
from zenoh_cbef.log.run_log import RunLog
from zenoh_cbef.protocol.bodies import estimate_body, range_body
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.messages import encode
from zenoh_cbef.protocol.round_codec import RoundCodec
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.build import absences_of, fates_into, filter_of, message_size, rounds_of
from zenoh_cbef.simulator import Step
from zenoh_cbef.tracking.graph import Neighbours

Floats = NDArray[np.float64]


class _Received:
    """What became of the messages to one agent, as its process counts them. links: its places among all links."""

    def __init__(self, ids: Sequence[int], links: slice, *, quiet: bool) -> None:
        self._ids, self._links, self._quiet = list(ids), links, quiet
        self._due = 0
        self._missed = {
            name: np.zeros(len(self._ids), dtype=np.int64) for name in ("absent", "lost", "late", "corrupted")
        }
        self._injected = Injected(len(self._ids))

    def counts(self, due: int, fates: Sequence[Fate]) -> dict[str, Any]:
        """The fields of an estimate, after a step in which `due` messages of each neighbour were to be used."""
        self._due += due
        for fate in fates:
            mine = fate.on(self._links)
            self._injected.note(mine)
            for name in self._missed:
                self._missed[name] += getattr(mine, name)
        lost = self._missed["lost"] + self._missed["corrupted"]
        found: dict[str, Any] = {
            "neighbours": self._ids,
            "received": (self._due - lost - self._missed["late"] - self._missed["absent"]).tolist(),
            "lost": lost.tolist(),
            "late": self._missed["late"].tolist(),
            "latency": [None] * len(self._ids),
        }
        return found if self._quiet else found | self._injected.take()

    def forget(self) -> None:
        """Count from now on: the agent will be started again."""
        self._due = 0
        for counts in self._missed.values():
            counts[:] = 0
        self._injected.forget(slice(None))

    @property
    def rejected(self) -> int:
        """Messages that faults damaged."""
        return int(self._missed["corrupted"].sum())


class ComputedRun:
    """Writes the messages of target and agents into a log, step after step."""

    def __init__(self, log: RunLog, run: str, scenario: Scenario, neighbours: Neighbours) -> None:
        self._log, self._run, self._scenario = log, run, scenario
        self._keys, self._absences = Keys(run), absences_of(scenario)
        self._rounds, self._shares_ranges = rounds_of(scenario), filter_of(scenario).uses_neighbour_ranges
        self._sent: Counter[tuple[str, str]] = Counter()
        self._now = 0
        width = message_size(scenario)
        self._codecs = [RoundCodec(run, f"agent/{agent}", width) for agent in range(scenario.count)]
        self._received = []
        first = 0
        for agent, present in enumerate(neighbours.present):
            ids = neighbours.index[agent][present].tolist()
            quiet = fates_into(scenario, agent, ids).quiet
            self._received.append(_Received(ids, slice(first, first + len(ids)), quiet=quiet))
            first += len(ids)

    def say(self, sender: str, key: str, moment: int, body: Mapping[str, Any]) -> None:
        """One message of anybody; moment: ns since the Unix epoch. Time in a log does not go back."""
        seq = self._number(sender, key, moment)
        self._log.add(key, encode(self._run, sender, seq, self._now, body), self._now)

    def step(self, number: int, positions: Floats, step: Step, begin: int, end: int) -> None:
        """All that the agents send in a step from one moment (ns) to another. positions: (n, 3)."""
        pause = (end - begin) // (self._rounds + 2)
        there = np.flatnonzero(~step.absent).tolist()
        for agent in there:
            body = range_body(number, positions[agent], step.told[agent])
            self.say(f"agent/{agent}", self._keys.range(agent), begin, body)
        for round_, sent in enumerate(step.sent, 1):
            moment = begin + round_ * pause
            for agent in there:
                key = self._keys.round(agent)
                seq = self._number(f"agent/{agent}", key, moment)
                self._log.add(key, self._codecs[agent].encode(seq, self._now, number, round_, sent[agent]), self._now)
        used = number - self._scenario.consensus.lag
        due = self._shares_ranges + (self._rounds if used >= 1 else 0)
        for agent, received in enumerate(self._received):
            counts = received.counts(due, step.fates)
            if not step.absent[agent]:
                body = estimate_body(number, step.estimate, agent, agent, counts)
                self.say(f"agent/{agent}", self._keys.estimate(agent), begin + (self._rounds + 1) * pause, body)
            elif self._absences.crashed(number)[agent]:
                received.forget()

    def end(self, last: int) -> None:
        """What every process says when it ends."""
        for agent, received in enumerate(self._received):
            self._finished(f"agent/{agent}", f"agent {agent}", last, received.rejected)
        self._finished("target", "the target", last, 0)

    def _finished(self, sender: str, name: str, last: int, rejected: int) -> None:
        sent = {key: count for (each, key), count in self._sent.items() if each == sender}
        sent.pop(self._keys.event, None)
        data = {"step": last, "sent": sent, "rejected": rejected}
        body = {"kind": "finished", "text": f"{name} ended after step {last}", "data": data}
        self.say(sender, self._keys.event, self._now, body)

    def _number(self, sender: str, key: str, moment: int) -> int:
        self._now = max(self._now, moment)
        seq = self._sent[sender, key]
        self._sent[sender, key] = seq + 1
        return seq
