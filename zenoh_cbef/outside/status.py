"""The state of a run that goes on, made of its target's answer: each process and its host, errors, losses."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from math import sqrt
from typing import TypedDict, TypeVar

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.faults import SenderFault, kind_of
from zenoh_cbef.protocol.directory import Apart
from zenoh_cbef.protocol.keys import agent_named
from zenoh_cbef.protocol.kinds import ESTIMATE, EVENT, EstimateMessage, EventMessage
from zenoh_cbef.protocol.messages import BadMessage, decode, unpack_floats
from zenoh_cbef.protocol.questions import StatusAnswer
from zenoh_cbef.protocol.slow import AGAIN_SECONDS, SLOW, WINDOW_SECONDS
from zenoh_cbef.protocol.tokens import is_recorder, ready_token
from zenoh_cbef.tracking.status import status_name

_Value = TypeVar("_Value")
SaidEvent = TypedDict(
    "SaidEvent", {"from": str, "at": float, "kind": str, "text": str, "data": Mapping[str, object] | None}
)
"""What a process told. at: when, s since the Unix epoch."""

_LATELY_SECONDS = AGAIN_SECONDS + 2.0 * WINDOW_SECONDS


@dataclass(frozen=True)
class Whereabouts:
    """A process as it introduced itself; None where it has not yet.

    clock: s that its clock is ahead of the target's, known to within half of round_trip (s).
    """

    host: str | None = None
    pid: int | None = None
    version: str | None = None
    zenoh: str | None = None
    clock: float | None = None
    round_trip: float | None = None


@dataclass(frozen=True)
class AgentStatus:
    """One agent. error: position error in `step`, m; spread: what its covariance claims that to be, m.

    estimate: what it says of its estimate, one of STATUSES, and for how long that has been so, s.
    """

    agent: int
    state: str
    where: Whereabouts
    step: int | None = None
    error: float | None = None
    spread: float | None = None
    nis: float | None = None
    nis_degrees: int | None = None
    estimate: str | None = None
    estimate_seconds: float | None = None


@dataclass(frozen=True)
class LinkStatus:
    """What an agent has received from a neighbour since the start; latency: of the last step, s.

    recent_...: the same counts of the last recent_seconds, some five; None where that is not known yet.
    """

    source: int
    destination: int
    received: int
    lost: int
    late: int
    latency: float | None
    recent_received: int | None = None
    recent_lost: int | None = None
    recent_late: int | None = None
    recent_seconds: float | None = None


@dataclass(frozen=True)
class RunStatus:
    """A run. error, disagreement: root mean squares over the agents that take part, m, in the step that all have done.

    step: the last one that has begun, None before the start. time: s since the start. now: the target's clock, s since
    the Unix epoch. slow: processes that have lately said that they do not keep up with real time. unobservable: in
    words why the agents that take part cannot determine the position; empty where they can. apart: the processes
    between which no link can be made.
    """

    run: str
    filter: str
    mode: str
    state: str
    step: int | None
    steps: int
    dt: float
    time: float | None
    now: float
    error: float | None
    disagreement: float | None
    target: Whereabouts
    recorder: Whereabouts | None
    agents: list[AgentStatus]
    links: list[LinkStatus]
    faults: list[dict[str, object]]
    events: list[SaidEvent]
    slow: list[str] = field(default_factory=list)
    unobservable: str = ""
    apart: list[Apart] = field(default_factory=list)


def read_status(told: StatusAnswer) -> RunStatus:
    """The status in a target's answer."""
    run, count = told["run"], told["agents"]
    estimates, earlier = _estimates(told["estimates"], run), _estimates(told["earlier"], run)
    events = sorted(_events(told["events"], run), key=lambda one: one["sent"])
    cards = {message["from"]: message.get("data", {}) for message in _events(told["cards"], run)}
    truth = {k: np.array(state) for k, state in told["truth"]}
    axes = 2 if told["planar"] else 3
    agents = []
    for agent in range(count):
        name = f"agent/{agent}"
        status = AgentStatus(agent, _state(told, agent), _whereabouts(cards.get(name, {})))
        agents.append(_with_quality(status, estimates[name], truth, axes) if name in estimates else status)
    faults = json.loads(told["faults"])
    honest = [agent for agent in told["members"] if agent not in _liars(faults)]
    taking_part = [estimates[f"agent/{agent}"] for agent in honest if f"agent/{agent}" in estimates]
    error, disagreement = _network(taking_part, truth, axes)
    started, recorder = told["step"] is not None, any(map(is_recorder, told["live"]))
    return RunStatus(
        run=run,
        filter=told["filter"],
        mode=told["mode"],
        state="ending" if told["stopping"] else "running" if started else "waiting",
        step=told["step"],
        steps=told["steps"],
        dt=told["dt"],
        time=told["time"] - told["start"] if started else None,
        now=told["time"],
        error=error,
        disagreement=disagreement,
        target=_whereabouts(told["target"]),
        recorder=_whereabouts(cards.get("record", {})) if recorder else None,
        agents=agents,
        links=[link for name, message in estimates.items() for link in _links(name, message, earlier.get(name))],
        faults=faults,
        events=[_said(one) for one in events],
        slow=_slow(events, told["time"]),
        unobservable=told.get("unobservable", ""),
        apart=[Apart(*one) for one in told.get("apart", [])],
    )


def _liars(faults: Sequence[Mapping[str, object]]) -> set[int]:
    """The agents that faults let send wrong values now: they tell nothing of how the others track."""
    found: set[int] = set()
    for fault in faults:
        agents = fault.get("agents")
        with suppress(ValueError):  # a fault of a package that is not on this host
            if issubclass(kind_of(str(fault["kind"])), SenderFault) and isinstance(agents, list):
                found.update(agents)
    return found


def _estimates(raw: list[bytes], run: str) -> dict[str, EstimateMessage]:
    """The latest estimate of each sender."""
    found = {}
    for data in raw:
        with suppress(BadMessage):
            message = decode(ESTIMATE, data, run=run)
            found[message["from"]] = message
    return found


def _events(raw: list[bytes], run: str) -> list[EventMessage]:
    found = []
    for data in raw:
        with suppress(BadMessage):
            found.append(decode(EVENT, data, run=run))
    return found


def _slow(events: list[EventMessage], now: float) -> list[str]:
    """The processes that reported themselves as too slow so lately that they could not have repeated it yet."""
    lately = (one["from"] for one in events if one["kind"] == SLOW and now - 1e-9 * one["sent"] < _LATELY_SECONDS)
    return sorted({name for name in lately if name == "target" or agent_named(name) is not None})


def _said(event: EventMessage) -> SaidEvent:
    return {
        "from": event["from"],
        "at": event["sent"] * 1e-9,
        "kind": event["kind"],
        "text": event["text"],
        "data": event.get("data"),
    }


def _state(told: StatusAnswer, agent: int) -> str:
    live = told["live"]
    away = agent in told["away"]
    if f"agent/{agent}" not in live:
        return "killed" if away else "missing" if told["step"] is None else "gone"
    if away:
        return "paused"
    if agent in told["silent"]:
        return "silent"
    if told["step"] is None:
        return "ready" if ready_token(agent) in live else "linking"
    return "on" if agent in told["members"] else "joining"


def _told(data: Mapping[str, object], name: str, kind: type[_Value]) -> _Value | None:
    """A value that another process told, None where it is of another kind."""
    value = data.get(name)
    return value if isinstance(value, kind) else None


def _whereabouts(data: Mapping[str, object]) -> Whereabouts:
    return Whereabouts(
        host=_told(data, "host", str),
        pid=_told(data, "pid", int),
        version=_told(data, "version", str),
        zenoh=_told(data, "zenoh", str),
        clock=_told(data, "clock", float),
        round_trip=_told(data, "round_trip", float),
    )


def _with_quality(status: AgentStatus, message: EstimateMessage, truth: Mapping[int, Floats], axes: int) -> AgentStatus:
    """The status with what an estimate says, and with its error."""
    packed, error, spread = message["covariance"], _distance(message, truth, axes), None
    if packed is not None:
        with suppress(BadMessage):
            spread = sqrt(max(0.0, float(np.trace(unpack_floats(packed, 6, 6)[:axes, :axes]))))
    return replace(
        status,
        step=message["k"],
        error=None if error is None else sqrt(error),
        spread=spread,
        nis=_told(message, "nis", float),
        nis_degrees=_told(message, "nis_degrees", int),
        estimate=status_name(_told(message, "status", float)),
        estimate_seconds=_told(message, "status_seconds", float),
    )


def _distance(message: EstimateMessage, truth: Mapping[int, Floats], axes: int) -> float | None:
    """Squared distance from the truth, m²; None where the truth is unknown."""
    real = truth.get(message["k"])
    if real is None or not np.isfinite(real[:axes]).all():
        return None
    return float(((np.array(message["state"]) - real)[:axes] ** 2).sum())


def _network(
    messages: list[EstimateMessage], truth: Mapping[int, Floats], axes: int
) -> tuple[float | None, float | None]:
    """Error and disagreement, m, of the agents in the step that most of them are at."""
    steps = [message["k"] for message in messages]
    if not steps:
        return None, None
    common = max(set(steps), key=lambda step: (steps.count(step), step))
    together = [message for message in messages if message["k"] == common]
    errors = [found for one in together if (found := _distance(one, truth, axes)) is not None]
    places = np.array([message["state"][:axes] for message in together])
    apart = ((places - places.mean(axis=0)) ** 2).sum(axis=1)
    return sqrt(float(np.mean(errors))) if errors else None, sqrt(float(apart.mean()))


def _links(name: str, message: EstimateMessage, before: EstimateMessage | None) -> list[LinkStatus]:
    agent, sources = agent_named(name), message["neighbours"]
    received, lost, late, latency = message["received"], message["lost"], message["late"], message["latency"]
    if agent is None or {len(received), len(lost), len(late), len(latency)} != {len(sources)}:
        return []
    rows = zip(sources, received, lost, late, latency, strict=True)
    links = [LinkStatus(row[0], agent, row[1], row[2], row[3], row[4]) for row in rows]
    return links if before is None else [_with_recent(link, message, before) for link in links]


def _with_recent(link: LinkStatus, message: EstimateMessage, before: EstimateMessage) -> LinkStatus:
    """The link with what it did since an earlier estimate, where that is of the same life of its agent."""
    seconds = (message["sent"] - before["sent"]) * 1e-9
    former = zip(before["neighbours"], before["received"], before["lost"], before["late"], strict=False)
    then = next((counts for source, *counts in former if source == link.source), None)
    if then is None or seconds <= 0.0 or then[0] > link.received:
        return link
    # A message that was given up and came later is late instead of lost.
    now = link.received, link.lost, link.late
    received, lost, late = (max(0, count - before) for count, before in zip(now, then, strict=True))
    return replace(link, recent_received=received, recent_lost=lost, recent_late=late, recent_seconds=seconds)
