"""A rival's process: the same rounds of consensus as an agent's, step after step, and nothing else.

What travels is the payload and eight bytes with step and round. Our agents also check sender, run, numbers and sizes,
measure, filter, and say what came out.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass

import numpy as np

from benchmarks.exchange_part import Outcome, Part, end_with, end_with_parent, part_of, timed
from benchmarks.rival_ways import WAYS, mpi_place
from zenoh_cbef.machine import yield_to_others
from zenoh_cbef.tracking.consensus import Average, Chebyshev


@dataclass(frozen=True)
class Loop:
    """What all processes of a rival do.

    way: a name in WAYS. batch: ask the scheduler for fewer preemptions, as our agents do. width: numbers in a payload.
    weights: of each process's neighbours. bounds: of each process, the least and the greatest eigenvalue; none for
    averaging without acceleration. benchmark: its process's id.
    """

    way: str
    batch: bool
    steps: int
    rounds: int
    width: int
    weights: list[list[float]]
    bounds: list[list[float]]
    benchmark: int

    def stage(self, me: int) -> Average:
        """The averaging of one process, as an agent's."""
        weights = np.array([self.weights[me]])
        if not self.bounds:
            return Average(weights)
        low, high = np.array(self.bounds[me])[:, None, None]
        return Chebyshev(weights, low=low, high=high)


def first_payload(me: int, width: int) -> list[float]:
    """What a process begins each step with: any numbers that differ between processes."""
    return [me + place / width for place in range(width)]


def take_part(part: Part, loop: Loop) -> Outcome:
    """Be one process. Raises RuntimeError where a message of another step or round comes."""
    if loop.batch:
        yield_to_others()
    stage, payload = loop.stage(part.me), np.array([first_payload(part.me, loop.width)])
    own, others = np.empty(1 + loop.width), np.full((len(part.neighbours), 1 + loop.width), np.nan)
    stamp, stamps = own.view(np.int64), others.view(np.int64)[:, 0]
    received, message = others[None, :, 1:], payload

    with WAYS[loop.way](part, own, others) as swap:

        def turn(number: int) -> None:
            nonlocal message
            step, round_ = divmod(number, loop.rounds)
            if round_ == 0:
                message = stage.start(payload)
            stamp[0] = step << 16 | round_
            own[1:] = message[0]
            swap()
            if not (stamps == stamp[0]).all():
                raise RuntimeError(f"process {part.me} has a message that is not of step {step}, round {round_}")
            message = stage.mix(received, None)

        rate = timed(loop.steps * loop.rounds, turn)
    return Outcome(part.me, rate, stage.result()[0].tolist())


if __name__ == "__main__":
    part, loop = part_of(sys.argv[1], mpi_place), Loop(**json.loads(sys.argv[2]))
    if loop.way == "mpi":
        end_with(loop.benchmark)
    else:
        end_with_parent()
    take_part(part, loop).tell()
