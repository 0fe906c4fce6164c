"""The cost of the code for faults in an agent's round, in a scenario without faults."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np
from rich.table import Table

from benchmarks.common import below, plain_table, results
from zenoh_cbef.protocol.round_codec import RoundCodec
from zenoh_cbef.scenario.build import agent_tracker, fates_into, outgoing_of
from zenoh_cbef.scenario.load import load
from zenoh_cbef.tracking.ranging import Measurement, no_neighbours

ROUNDS = 20_000
_SENT = 1_700_000_000_000_000_000


class Rounds:
    """Agent 0 of `tracking` in a loop: a round's arithmetic and messages, without sockets, and its fault path alone."""

    def __init__(self) -> None:
        plan = load("tracking").plan
        self.tracker, self.neighbours = agent_tracker(plan, 0)
        here = Measurement(np.zeros((1, 3)), np.array([5.0]), np.zeros(1), *no_neighbours(1))
        self.message = self.tracker.measure(here)
        self.outgoing = outgoing_of([plan], [0])
        self.codecs = [RoundCodec("run", f"agent/{one}", plan.message_size) for one in self.neighbours]
        self.coming = [codec.encode(0, _SENT, 1, 1, self.message[0]) for codec in self.codecs]
        self.fates = fates_into(plan, 0, self.neighbours)

    def faults(self) -> None:
        """What a round asks of faults: what is sent, with its bound, and whether all is due."""
        self.outgoing.message(1, 1, self.message)
        _ = True if self.fates.quiet else self.fates.of(1, 1).due.all()

    def rest(self) -> None:
        """A round's other work: writing one message, reading the neighbours', and mixing."""
        self.codecs[0].encode(0, _SENT, 1, 1, self.message[0])
        payloads = [codec.decode(data)[3] for codec, data in zip(self.codecs, self.coming, strict=True)]
        self.tracker.exchange(np.stack([np.frombuffer(one) for one in payloads])[None], None)


def microseconds(do: Callable[[], None], count: int = ROUNDS) -> float:
    """CPU time of one call."""
    begin = time.process_time()
    for _ in range(count):
        do()
    return 1e6 * (time.process_time() - begin) / count


def run(repeats: int) -> Iterator[Table]:
    """Measure both in turn, so that other work of the machine slows both; medians."""
    rounds = Rounds()
    pairs = [(microseconds(rounds.faults), microseconds(rounds.rest)) for _ in range(repeats)]
    path, rest = (float(np.median(each)) for each in zip(*pairs, strict=True))
    share = float(np.median([100.0 * first / (first + second) for first, second in pairs]))
    yield plain_table("CPU of one round, agent 0 of tracking", ["part", "µs"], [["faults", path], ["the rest", rest]])
    yield results("cost of faults where there are none", [below("share of a round's own work", share, 3.0, "%")])
