"""A run that was computed, written as its processes would have sent it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.faults import Fate
from zenoh_cbef.faults.injected import Injected
from zenoh_cbef.log.write.run_log import RunLog
from zenoh_cbef.protocol.bodies import estimate_body, range_body, smoothed_body
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.messages import encode
from zenoh_cbef.protocol.round_codec import RoundCodec
from zenoh_cbef.protocol.short import framed, packed
from zenoh_cbef.scenario.build import fates_into
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import Step
from zenoh_cbef.tracking.graph import Neighbours


class _Received:
    """What became of the messages on all links, as the agents' processes count them."""

    def __init__(self, plan: Plan, neighbours: Neighbours) -> None:
        self._ids, self._links = neighbours.ids, neighbours.links
        self._quiet = [fates_into(plan, agent, ids).quiet for agent, ids in enumerate(self._ids)]
        links = int(neighbours.present.sum())
        self._injected = Injected(links)
        self._received, self._lost, self._late, self._corrupted = np.zeros((4, links), dtype=np.int64)

    def step(self, due: int, fates: Sequence[Fate]) -> Iterator[dict[str, object]]:
        """The fields of every agent's estimate, after a step in which `due` messages of each link were to be used."""
        self._received += due
        for fate in fates:
            self._injected.note(fate)
            self._received -= ~fate.due
            self._lost += fate.lost | fate.corrupted
            self._late += fate.late
            self._corrupted += fate.corrupted
        injected = self._injected.take()
        for ids, mine, quiet in zip(self._ids, self._links, self._quiet, strict=True):
            yield {
                "neighbours": ids,
                "received": self._received[mine].tolist(),
                "lost": self._lost[mine].tolist(),
                "late": self._late[mine].tolist(),
                "latency": [None] * len(ids),
                **({} if quiet else injected.of(mine).fields()),
            }

    def forget(self, agent: int) -> None:
        """Count from now on: the agent will be started again."""
        mine = self._links[agent]
        for counts in (self._received, self._lost, self._late, self._corrupted):
            counts[mine] = 0
        self._injected.forget(mine)

    def rejected(self, agent: int) -> int:
        """How many messages to an agent faults damaged."""
        return int(self._corrupted[self._links[agent]].sum())


class ComputedRun:
    """Writes the messages of target and agents into a log, step after step."""

    def __init__(self, log: RunLog, run: str, plan: Plan, neighbours: Neighbours) -> None:
        self._log, self._run, self._scenario = log, run, plan.scenario
        self._keys, self._absences = Keys(run), plan.absences
        self._rounds, self._shares_ranges = plan.rounds, plan.sharing.uses_neighbour_ranges
        self._sent: Counter[tuple[str, str]] = Counter()
        self._now = 0
        self._compact = plan.compact
        names = (f"agent/{agent}" for agent in range(plan.scenario.count))
        self._codecs = [RoundCodec(run, name, plan.message_size) for name in names]
        self._received = _Received(plan, neighbours)

    def say(self, sender: str, key: str, moment: int, body: Mapping[str, object]) -> None:
        """Write one message of any process; moment: ns since the Unix epoch. Time in a log does not go back."""
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
            self._round(number, round_, sent, there, begin + round_ * pause)
        used, plugged = number - self._scenario.consensus.lag, self._scenario.filter.plugged
        due = self._shares_ranges + (self._rounds if used >= 1 else 0)
        for agent, counts in enumerate(self._received.step(due, step.fates)):
            if not step.absent[agent]:
                body = estimate_body(number, step.estimate, agent, agent, counts, plugged=plugged)
                self.say(f"agent/{agent}", self._keys.estimate(agent), begin + (self._rounds + 1) * pause, body)
                for one in step.smoothed:
                    if one.known[agent]:
                        self.say(f"agent/{agent}", self._keys.smoothed(agent), self._now, smoothed_body(one, agent))
            elif self._absences.crashed(number)[agent]:
                self._received.forget(agent)
                self._forget(f"agent/{agent}")

    def _round(self, number: int, round_: int, sent: Floats, there: Sequence[int], moment: int) -> None:
        """The consensus messages of a round, of all agents (n, d), of which some are there."""
        short = [] if self._compact is None else packed(self._compact, sent[there])
        for place, agent in enumerate(there):
            key = self._keys.round(agent)
            seq = self._number(f"agent/{agent}", key, moment)
            if self._compact is None:
                data = self._codecs[agent].encode(seq, self._now, number, round_, sent[agent])
            else:
                data = framed(seq, self._now, number, round_, short[place])
            self._log.add(key, data, self._now)

    def end(self, last: int) -> None:
        """What every process says when it ends."""
        for agent in range(self._scenario.count):
            self._finished(f"agent/{agent}", f"agent {agent}", last, self._received.rejected(agent))
        self._finished("target", "the target", last, 0)

    def _finished(self, sender: str, name: str, last: int, rejected: int) -> None:
        sent = {key: count for (each, key), count in self._sent.items() if each == sender}
        sent.pop(self._keys.event(sender), None)
        data = {"step": last, "sent": sent, "rejected": rejected}
        body = {"kind": "finished", "text": f"{name} ended after step {last}", "data": data}
        self.say(sender, self._keys.event(sender), self._now, body)

    def _forget(self, sender: str) -> None:
        """An agent that is started again numbers its messages from 0."""
        for name in [name for name in self._sent if name[0] == sender]:
            del self._sent[name]

    def _number(self, sender: str, key: str, moment: int) -> int:
        self._now = max(self._now, moment)
        seq = self._sent[sender, key]
        self._sent[sender, key] = seq + 1
        return seq
