"""The target's answers to questions and orders while a run goes on."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Protocol

from zenoh_cbef.errors import UserError
from zenoh_cbef.nodes.target.hold import Hold
from zenoh_cbef.nodes.target.injection import Injection
from zenoh_cbef.nodes.target.survey import Survey, Surveyed
from zenoh_cbef.plain import Json, read_json
from zenoh_cbef.protocol.control import Request
from zenoh_cbef.protocol.questions import HOLD, Added, Cleared, Holding, Listed, Stopped


class Asked(Surveyed, Protocol):
    """The parts of a target that its answers need."""

    survey: Survey
    injection: Injection | None
    hold: Hold


def answer(target: Asked, request: Request) -> Mapping[str, object]:
    """Answer one request, from another thread than the target's own. Raises UserError."""
    asked = request.get("ask")
    if asked == "stop":
        target.node.stop()
        return {"stopping": True, **Stopped(step=target.step)}
    if asked == "status":
        return target.survey.of(target)
    if asked == HOLD.name:
        return _held(target, request)
    if asked not in {"fault add", "fault list", "fault clear"}:
        raise UserError(f"a run does not know what {asked!r:.40} is; use the same zenoh-cbef on every host")
    injection = target.injection
    if injection is None:
        raise UserError(
            "faults are injected into runs that have started; in lockstep only where the target sends the beacons, as "
            "these tell agents with which step a fault begins: write it into the scenario"
        )
    if asked == "fault list":
        return Listed(faults=json.dumps(injection.listed()))
    if asked == "fault clear":
        return Cleared(ended=injection.clear(_numbers(request.get("numbers"))))
    number, warnings = injection.add(_table(request.get("fault")), _seconds(request.get("seconds")))
    since = next(one["from"] for one in injection.listed() if one["number"] == number)
    return Added({"number": number, "from": since, "warnings": warnings})


def _held(target: Asked, request: Request) -> Holding:
    """Let the run stand still, or go on."""
    if target.plan.realtime:
        raise UserError("a run in realtime cannot stand still; set timing.mode = 'lockstep'")
    on, steps, rounds = request.get("on") is True, _count(request.get("steps")), _count(request.get("rounds"))
    if rounds and target.injection is None:
        raise UserError("a run is held between rounds only where the target sends the beacons; let it take whole steps")
    target.hold.order(on=on, steps=steps, rounds=rounds)
    return Holding(held=target.hold.on, step=target.step, round=target.hold.round)


def _count(given: object) -> int:
    return given if isinstance(given, int) and not isinstance(given, bool) and given > 0 else 0


def _table(text: object) -> dict[str, Json]:
    try:
        table = read_json(text) if isinstance(text, str) else None
    except ValueError:
        table = None
    if not isinstance(table, dict):
        raise UserError("the fault is no table; use the same zenoh-cbef on every host")
    return table


def _numbers(given: object) -> list[int] | None:
    return [one for one in given if isinstance(one, int)] if isinstance(given, list) else None


def _seconds(given: object) -> float | None:
    return float(given) if isinstance(given, int | float) and given > 0.0 else None
