"""How many bytes a scenario's agents will publish, found by encoding their messages."""

from __future__ import annotations

from functools import cache

import numpy as np

from zenoh_cbef.faults.injected import Injected, Told
from zenoh_cbef.protocol.bodies import estimate_body, range_body
from zenoh_cbef.protocol.messages import encode
from zenoh_cbef.protocol.round_codec import RoundCodec
from zenoh_cbef.protocol.short import HEAD_BYTES
from zenoh_cbef.scenario.build import agent_tracker, fates_into
from zenoh_cbef.scenario.paths import agent_positions
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.tracking.ranging import Measurement
from zenoh_cbef.tracking.tracker import Estimate

_SENT = 1_700_000_000_000_000_000
_AGENTS, _STEPS = 12, 4
"""How many agents and steps of a run are looked at."""
_PLACE = np.full(3, 0.5)


def round_bytes(plan: Plan) -> int:
    """Bytes of one consensus message; with less precision, of most of them."""
    if plan.compact is not None:
        return HEAD_BYTES + plan.compact.size
    return _whole_bytes(plan.scenario.name, plan.message_size)


@cache
def _whole_bytes(run: str, width: int) -> int:
    return len(RoundCodec(run, "agent/0", width).encode(0, _SENT, 1, 1, np.zeros(width)))


def range_bytes(plan: Plan) -> int:
    """Bytes of an agent's position and range."""
    return len(encode(plan.scenario.name, "agent/0", 1, _SENT, range_body(1, _PLACE, 0.5)))


def beacon_bytes(plan: Plan) -> int:
    """Bytes of what a receiver measures in a step."""
    return len(encode(plan.scenario.name, "target", 1, _SENT, {"k": 1, "emitted": 0.5, "arrived": 0.5}))


def truth_bytes(plan: Plan) -> int:
    """Bytes of the target's true state."""
    return len(encode(plan.scenario.name, "target", 1, _SENT, {"k": 1, "state": [0.5] * 6}))


def other_bytes(plan: Plan) -> float:
    """Bytes that an agent publishes in a step besides its consensus messages: its range and its estimate.

    The mean over some agents and steps, as estimates report faults only in steps in which these do something.
    """
    scenario, lists = plan.scenario, plan.neighbours
    agents = np.unique(np.linspace(0, scenario.count - 1, _AGENTS).round().astype(int))
    steps = np.unique(np.linspace(1, scenario.length, _STEPS + 2).round().astype(int))
    estimate = _estimate(plan)

    def published(agent: int, step: int) -> int:
        counts = _counts(plan, agent, lists.row(agent).index[0].tolist(), step)
        bodies = range_body(step, _PLACE, 0.5), estimate_body(step, estimate, 0, agent, counts)
        return sum(len(encode(scenario.name, f"agent/{agent}", step, _SENT, body)) for body in bodies)

    return float(np.mean([published(agent, step) for agent in agents.tolist() for step in steps[1:-1].tolist() or [1]]))


def _estimate(plan: Plan) -> Estimate:
    """What agent 0 says once its filter is past the first fix: which numbers there are matters, not what they are."""
    # Where the scenario lets agents begin at their initial estimates they need no first fix.
    plan = Plan(plan.scenario.changed(filter={"start": "given"}))
    tracker, neighbours = agent_tracker(plan, 0)
    places = agent_positions(plan.scenario)[:, 0]
    # Ranges to a point beside the agents: no row of any filter is without information.
    ranges = np.linalg.norm(places - places[0], axis=1) + 1.0
    around = places[None, neighbours], ranges[None, neighbours]
    measurement = Measurement(places[:1], ranges[:1], np.zeros(1), *around, agent=np.zeros(1, dtype=np.int64))
    for _ in range(plan.first_fix_steps):
        tracker.measure(measurement)
        tracker.conclude()
    tracker.measure(measurement)
    return tracker.conclude()


def _counts(plan: Plan, agent: int, neighbours: list[int], step: int) -> dict[str, object]:
    """An agent's counts of its neighbours' messages in a step, as if all steps before had been like this one."""
    rounds = range(not plan.sharing.uses_neighbour_ranges, plan.rounds + 1)
    due = [step * len(rounds)] * len(neighbours)
    none = dict.fromkeys(("lost", "late"), [0] * len(neighbours))
    counts = {"neighbours": neighbours, "latency": [0.5] * len(neighbours), "received": due, **none}
    fates = fates_into(plan, agent, neighbours)
    if fates.quiet:
        return counts
    injected = Injected(len(neighbours))
    for round_ in rounds:
        injected.note(fates.of(step, round_))
    now = injected.take()
    told = Told({name: [step * one for one in ones] for name, ones in now.counts.items()}, now.marks)
    gone = [*zip(*(told.counts[name] for name in ("injected_lost", "corrupted", "injected_late")), strict=True)]
    used = {
        "received": [most - sum(each) for most, each in zip(due, gone, strict=True)],
        "lost": [lost + corrupted for lost, corrupted, _ in gone],
        "late": told.counts["injected_late"],
    }
    return {**counts, **used, **told.fields()}
