"""Which processes of a run in realtime did not keep up, by their own reports."""

from __future__ import annotations

from collections.abc import Mapping

from zenoh_cbef.analysis.results import Slowness
from zenoh_cbef.plain import count_in
from zenoh_cbef.protocol.slow import REMEDY, SLOW, too_slow
from zenoh_cbef.protocol.tokens import in_words
from zenoh_cbef.trace import Trace
from zenoh_cbef.words import counted


def slowness(trace: Trace) -> Slowness | None:
    """Which share of its rounds each agent, and of its steps the target, came to too late by its own slowness.

    As each told last, in its `finished` or `slow` event; None for one that told nothing. None where none did: in
    lockstep, in a simulation, and in older logs.
    """
    agents = [f"agent/{agent}" for agent in range(trace.scenario.count)]
    told = dict.fromkeys([*agents, "target"], (0, 0))
    for event in trace.events:
        counts, sender = _counts(event.get("data")), str(event.get("from"))
        if counts is not None and event.get("kind") in {"finished", SLOW} and sender in told:
            told[sender] = counts
    shares = {sender: late / due if due else None for sender, (late, due) in told.items()}
    if all(share is None for share in shares.values()):
        return None
    slow = [in_words(sender) for sender, counts in told.items() if too_slow(*counts)]
    return Slowness([shares[agent] for agent in agents], shares["target"], slow)


def _counts(data: object) -> tuple[int, int] | None:
    table = data if isinstance(data, Mapping) else {}
    late, due = count_in(table, "late"), count_in(table, "due")
    return (late, due) if late is not None and due and late <= due else None


def slow_note(slow: Slowness | None) -> str:
    """A note for the reader of a run that did not keep up; "" for one that did."""
    if slow is None or not slow.too_slow:
        return ""
    names = slow.too_slow
    found = max(((share, agent) for agent, share in enumerate(slow.agents) if share is not None), default=None)
    who = names[0] if len(names) == 1 else counted(len(names), "process", "processes")
    how = "" if found is None else f" (agent {found[1]} came too late to {found[0]:.0%} of its rounds)"
    return f"{who} did not keep up with real time{how}, so errors and NEES are those of an overloaded host: {REMEDY}"
