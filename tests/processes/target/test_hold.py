"""A run in lockstep stands still by order, between steps and between the rounds of one, and stays what it is."""

from functools import partial

import numpy as np
import pytest
import zenoh

from tests.waiting import until
from zenoh_cbef.lab.bench import reach
from zenoh_cbef.log.read.header import read_header
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.outside.operator import Operator
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.messages import unpack

AGENTS, ROUNDS = 4, 3
LIAR = AGENTS - 1


def test_a_held_run_makes_single_rounds_and_is_proved(world):
    run = world.under_way("steps=100000")
    latest: dict[str, tuple[int, int]] = {}

    def hear(sample: zenoh.Sample) -> None:
        told = unpack(sample.payload.to_bytes())
        latest[str(told["from"])] = int(str(told["k"])), int(str(told["l"]))

    def all_at(step: int, round_: int) -> None:
        """All agents have sent the messages of this round, and none of the next one."""
        until(lambda: {*latest.values()} == {(step, round_)} and len(latest) == AGENTS, latest)

    def stands_at(step: int, round_: int | None) -> bool:
        told = operator.hold(on=True)
        return (told["step"], told["round"]) == (step, round_)

    with Operator(*reach(world.run)) as operator:
        operator.session.declare_subscriber(Keys(world.run).round(0).replace("/0/", "/*/"), hear)
        until(lambda: len(latest) == AGENTS, latest)
        assert operator.hold(on=True)["held"]
        until(lambda: len({*latest.values()}) == 1 and latest["agent/0"][1] == ROUNDS, latest)
        operator.hold(on=True, rounds=1)
        until(lambda: operator.hold(on=True)["round"] == 1, latest)
        began = operator.hold(on=True)["step"] or 0
        all_at(began, 1)
        for number in range(1, 2 * ROUNDS - 1):
            step, round_ = began + number // ROUNDS, number % ROUNDS + 1
            operator.hold(on=True, rounds=1)
            until(partial(stands_at, step, round_ if round_ < ROUNDS else None), latest)
            all_at(step, round_)
        # An order in the middle of a step begins with a later one; a single step ends the one that is under way.
        assert operator.inject({"kind": "loss", "probability": 0.5}, None)["from"] > 0.1 * (began + 1)
        # What agents would have decided otherwise, had they known of a liar, they do not.
        assert len(operator.inject({"kind": "byzantine", "agents": [LIAR], "magnitude": 1000.0}, None)["warnings"]) == 1
        operator.hold(on=True, steps=1)
        all_at(began + 1, ROUNDS)
        operator.hold(on=True, rounds=1)
        all_at(began + 2, 1)
        operator.hold(on=False)
        until(lambda: min(latest.values()) > (began + 8, 0), latest)
        operator.hold(on=True)
        until(lambda: len({*latest.values()}) == 1 and latest["agent/0"][1] == ROUNDS, latest)
        operator.hold(on=True, rounds=1)
        # It is stopped in the middle of a step, which agents then end.
        assert operator.stop() is not None
    run.communicate(timeout=100)
    world.verdict()
    trace = read_trace(world.log)
    assert [fault.kind for fault in trace.scenario.fault] == ["loss", "byzantine"]
    # Its error, as the line of progress has it, is that of honest agents.
    told = read_header(open_log(world.log)).end or {}
    last = int(told["step"]) - 1
    apart = (trace.estimates[:LIAR, last, :3] - trace.truth[last, :3]) ** 2
    assert float(told["error"]) == pytest.approx(float(np.sqrt(apart.sum(axis=1).mean())))


def test_an_agent_that_comes_back_knows_the_faults_that_begin_with_its_first_step(world):
    run = world.under_way("steps=100000", "network.graph=complete")
    with Operator(*reach(world.run)) as operator:

        def pid() -> int | None:
            return operator.status().agents[LIAR].where.pid

        step, before = operator.hold(on=True)["step"] or 0, pid()
        since = operator.inject({"kind": "crash", "agents": [LIAR]}, 1.0)["from"]
        back = round(since / 0.1) + 10
        operator.hold(on=True, steps=back - 5 - step)  # some more may be under way
        # It is there again, and has been told of all faults until now.
        until(lambda: pid() != before, back)
        operator.inject({"kind": "outage", "agents": [0], "from": since + 1.0}, 0.5)
        operator.hold(on=False)
        until(lambda: (operator.status().step or 0) > back + 10, back)
        operator.stop()
    run.communicate(timeout=100)
    world.verdict()
