"""From a recording to a trace."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.read.parts import open_logs
from zenoh_cbef.log.read.passing import passing_of
from zenoh_cbef.log.read.receipts import COUNTS, INJECTED, Receipts
from zenoh_cbef.log.read.recording import Recording, read_recording
from zenoh_cbef.log.read.tally import Tally
from zenoh_cbef.plain import count_in
from zenoh_cbef.protocol.keys import Keys, agent_named
from zenoh_cbef.protocol.kinds import EventMessage
from zenoh_cbef.scenario.paths import places_at, step_times
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import measured
from zenoh_cbef.trace import Links, SmoothedPath, Trace, Traffic
from zenoh_cbef.tracking.diagnostics import Diagnostics
from zenoh_cbef.tracking.graph import directed

_COUNTS = (*COUNTS, *INJECTED)


def read_trace(*paths: Path) -> Trace:
    """Read a log, complete or cut off, of one file or several.

    Raises UserError where it is no log of a run, or holds no step.
    """
    return trace_of(read_recording(open_logs(paths)))


def trace_of(recording: Recording) -> Trace:
    """The arrays of a run, as far as any agent got. Raises UserError where the log holds no estimate."""
    header, steps = recording.header, recording.estimates.last
    if steps == 0:
        raise UserError(f"the log of run {header.run!r} holds no estimate: {_why_none(recording.tally.undecodable)}")
    stretch, receipts = stretch_of(recording, 0, steps), recording.receipts
    unlogged, traffic = _unlogged(recording, stretch.diagnostics.innovation), _traffic(recording)
    links = _links(recording.plan, receipts, steps)
    return replace(
        stretch,
        links=links,
        passing=passing_of(receipts, links.source, links.destination, steps),
        traffic=traffic,
        smoothed=_smoothed(recording, recording.plan, steps),
        events=[_event(event.message) for event in recording.events],
        unlogged=unlogged if unlogged.any() else None,
        told=(said := _told(recording, traffic.recorded)),
        complete=(whole := _whole(recording, missing=traffic.missing) and said) and _ended(recording) == "finished",
        stopped=whole and _ended(recording) == "stopped" and recording.target_ended,
    )


def _why_none(refused: int) -> str:
    if refused:
        return (
            f"{refused} of its messages are not as this version writes them; zenoh-cbef check says which, "
            "and a newer version may read them"
        )
    return "the run ended before its first step, or this is a part of its log without them"


def stretch_of(recording: Recording, since: int, until: int) -> Trace:
    """The arrays of steps since+1 to until of a recording that may still grow, without what is told of whole runs.

    So links, traffic, smoothed paths and events are empty. unlogged: where an agent tells of an innovation, but no
    beacon is there.
    """
    plan, part, estimates = recording.plan, slice(since, until), recording.estimates
    heard = recording.beacons.numbers("heard", until)[:, part]
    ranges, age = _measured(plan, since, *np.moveaxis(heard, 2, 0)[:2])
    diagnostics = Diagnostics.read(estimates.numbers("said", until)[:, part])
    positions = recording.ranges.numbers("position", until)[:, part]
    time = step_times(plan.scenario, until)[part]
    covariances = estimates.numbers("covariance", until)[:, part]
    unlogged = ~recording.beacons.seen(until)[:, part] & np.isfinite(diagnostics.innovation)
    return Trace(
        name=recording.header.run,
        plan=plan,
        time=time,
        truth=recording.truth.numbers("state", until)[0, part],
        positions=np.where(np.isfinite(positions), positions, places_at(plan.scenario, time)),
        ranges=ranges,
        age=age,
        initial=plan.initial_states,
        estimates=estimates.numbers("state", until)[:, part],
        covariances=covariances.reshape(plan.scenario.count, until - since, 6, 6),
        diagnostics=diagnostics,
        edges=plan.edges,
        links=_links(plan, [], 0),
        traffic=Traffic(sent=0, recorded=0, missing=0, rejected=0),
        unlogged=unlogged if unlogged.any() else None,
    )


def _whole(recording: Recording, *, missing: int) -> bool:
    return recording.complete and missing == 0


def _ended(recording: Recording) -> str:
    return (recording.header.end or {}).get("status", "")


def _told(recording: Recording, recorded: int) -> bool:
    """Whether the nodes' reports are there: all of them are gone where messages were taken out and no event is left."""
    written = (recording.header.end or {}).get("messages", "")
    return bool(recording.events) or not (written.isdecimal() and int(written) > recorded)


def _smoothed(recording: Recording, plan: Plan, steps: int) -> SmoothedPath | None:
    told = recording.smoothed
    if not told.last:
        return None
    covariances = told.numbers("covariance", steps).reshape(plan.scenario.count, steps, 6, 6)
    return SmoothedPath(told.numbers("state", steps), covariances, plan.smoothing_lag)


def _unlogged(recording: Recording, innovation: Floats) -> Bools:
    """Which measurements are not in the log, (n, K), although an agent says that it measured, or may have.

    A receiver that hears nothing may say nothing. So a beacon is missing where the agent's own estimate tells of an
    innovation; and without that estimate, where numbers of its key are missing, or nothing is in the log of either.
    """
    count, steps = innovation.shape
    missing: Counter[str] = Counter()
    for (key, _), sequence in recording.tally.sequences:
        missing[key] += sequence.missing
    heard, told = recording.beacons.seen(steps), recording.estimates.seen(steps)
    keys = Keys(recording.header.run)
    gone = np.array([missing[keys.beacon(agent)] > 0 for agent in range(count)])
    gone |= ~heard.any(axis=1) & ~told.any(axis=1)
    return np.asarray(~heard & (np.isfinite(innovation) | (~told & gone[:, None])))


def _measured(plan: Plan, since: int, emitted: Floats, arrived: Floats) -> tuple[Floats, Floats]:
    steps = np.arange(since + 1, since + emitted.shape[1] + 1, dtype=np.float64)
    ranges, age = measured(plan, emitted, arrived, steps)
    return ranges, np.where(np.isfinite(age), age, 0.0)


def _links(plan: Plan, receipts: list[Receipts], steps: int) -> Links:
    """What the receivers counted: the last counts of each of their lives, and the mean of their latencies."""
    links = directed(plan.edges)
    told = [_counted(one, steps) for one in receipts]
    nothing = (*[0.0] * len(_COUNTS), np.nan)
    rows = [told[destination].get(source, nothing) if told else nothing for source, destination in links.tolist()]
    source, destination = links.T
    table = np.array(rows, dtype=np.float64).reshape(-1, len(_COUNTS) + 1)
    delivered, *others = table[:, :-1].astype(np.int64).T
    counted = dict(zip(_COUNTS[1:], others, strict=True))
    sent = delivered + counted["lost"] + counted["late"]
    return Links(
        source=source, destination=destination, sent=sent, delivered=delivered, **counted, latency=table[:, -1]
    )


def _counted(receipts: Receipts, steps: int) -> dict[int, tuple[float, ...]]:
    """One receiver's counts of the whole run, and its mean latency, s, by neighbour."""
    begun = receipts.begun(steps)
    last = np.append(begun[1:], True)[: len(begun)]
    totals = [np.nan_to_num(receipts.counts(name, steps)[last]).sum(axis=0) for name in _COUNTS]
    return {
        neighbour: (*(float(total[place]) for total in totals), _mean(receipts.counts("latency", steps)[:, place]))
        for place, neighbour in enumerate(receipts.neighbours)
    }


def _mean(values: Floats) -> float:
    """The mean of what there is, NaN for nothing, summed from first to last."""
    known = values[~np.isnan(values)]
    return float(np.cumsum(known)[-1] / len(known)) if len(known) else np.nan


def _traffic(recording: Recording) -> Traffic:
    tally, rejected = recording.tally, dict[str, int]()
    for event in recording.events:
        data, sender = event.message.get("data", {}), event.message["from"]
        for name in ("rejected", "total"):
            rejected[sender] = max(rejected.get(sender, 0), count_in(data, name) or 0)
    total = tally.sequences.sent
    agents_missing = [each.missing for (_, sender), each in tally.sequences if agent_named(sender) is not None]
    return Traffic(
        sent=total,
        recorded=tally.recorded,
        missing=max(0, total - tally.recorded),
        rejected=max(tally.undecodable, sum(rejected.values())),
        agent_bytes=tally.agent_bytes,
        agents_missing=sum(agents_missing),
        gaps=_gaps(tally),
    )


def _gaps(tally: Tally) -> dict[str, list[tuple[int, int]]]:
    gaps: dict[str, list[tuple[int, int]]] = {}
    for (key, _), sequence in tally.sequences:
        if sequence.gaps:
            gaps.setdefault(key, []).extend(sequence.gaps)
    return gaps


def _event(message: EventMessage) -> dict[str, object]:
    return {name: value for name, value in message.items() if name not in {"v", "run", "seq"}}
