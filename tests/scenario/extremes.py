"""Scenarios at the ends of the ranges of their numbers, found by walking over the model itself."""

from __future__ import annotations

from random import Random
from typing import Any, Literal, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from zenoh_cbef.faults import KINDS as FAULTS
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.tracking.filters import KINDS

AGENTS = 4
# Lengths of time and memory, which are no matter of arithmetic, and what a scenario needs files for.
LEFT_ALONE = {"steps", "count", "rounds", "name", "path", "labels", "waypoints", "edges", "zenoh", "record", "graph"}


def limits(metadata: Any) -> tuple[float | None, float | None]:
    """The least and the largest value that annotations allow; None where there is no limit."""
    least = most = None
    for one in metadata:
        if isinstance(one, FieldInfo):
            low, high = limits(one.metadata)
            least, most = (low if least is None else least), (high if most is None else most)
        elif isinstance(one, Ge | Gt):
            least = _limit(one.ge if isinstance(one, Ge) else one.gt)
        elif isinstance(one, Le | Lt):
            most = _limit(one.le if isinstance(one, Le) else one.lt)
    return least, most


def _limit(limit: object) -> float:
    assert isinstance(limit, int | float)
    return limit


def drawn(annotation: Any, metadata: Any, random: Random) -> Any:
    """A value of a type: mostly at an end of its range, or of a size drawn between the two."""
    if hasattr(annotation, "__metadata__"):
        return drawn(annotation.__origin__, [*metadata, *annotation.__metadata__], random)
    parts = get_args(annotation)
    if annotation in (float, int):
        value: Any = _number(annotation, *limits(metadata), random)
    elif annotation is bool:
        value = random.random() < 0.5
    elif get_origin(annotation) is Literal:
        value = random.choice(parts)
    elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
        value = table(annotation, random)
    elif get_origin(annotation) is tuple:
        value = [drawn(parts[0], (), random) for _ in range(AGENTS if parts[-1] is ... else len(parts))]
    else:  # of a union one; text, and what is left out, are None
        value = drawn(random.choice(parts), metadata, random) if parts else None
    return value


def _number(kind: type, least: float | None, most: float | None, random: Random) -> float:
    if least is None or most is None:
        raise AssertionError("a number of the scenario has no range")
    if kind is int:
        return random.choice([int(least), min(int(least) + 3, int(most))])
    inside = max(least, min(most, _of_any_size(least, most, random)))
    return random.choice([least, most, inside, inside, inside, inside]) or 0.0


def _of_any_size(least: float, most: float, random: Random) -> float:
    if least < 0.0:
        return random.choice([-1.0, 1.0]) * most * 10.0 ** random.uniform(-15.0, 0.0)
    low = least if least > 0.0 else 1e-12 * most
    return float(low * (most / low) ** random.random())


def table(model: type[BaseModel], random: Random, share: float = 1.0) -> dict[str, Any]:
    """A table whose required keys are drawn, and a share of the others."""
    found = {}
    for name, field in model.model_fields.items():
        if name in LEFT_ALONE or not (field.is_required() or random.random() < share):
            continue
        value = drawn(field.annotation, field.metadata, random)
        if value is not None:
            found[field.alias or name] = value
    return found


def scenario_of(random: Random) -> dict[str, Any]:
    """A short scenario, with a few of its numbers anywhere in their ranges."""
    share = random.choice([0.05, 0.2, 0.5])
    found: dict[str, Any] = {
        "steps": random.choice([3, 8]),
        "agents": {"count": AGENTS},
        "consensus": {"rounds": random.choice([0, 2])},
        "network": {"graph": random.choice(["ring", "complete", "radio", "geometric"])},
        "filter": {},
    }
    kinds = list(FAULTS.values())
    for name, field in Scenario.model_fields.items():
        if name == "fault":
            found[name] = [_fault(random.choice(kinds), random) for _ in range(random.choice([0, 0, 1]))]
        elif isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            if name not in LEFT_ALONE:
                found[name] = {**found.get(name, {}), **table(field.annotation, random, share)}
        elif name not in LEFT_ALONE and random.random() < share:
            found[name] = drawn(field.annotation, field.metadata, random)
    found["agents"]["motion"] = random.choice(["static", "formation"])
    found["target"]["motion"] = random.choice(["ncv", "ncv", "circle", "lemniscate"])
    found["filter"]["kind"] = random.choice(list(KINDS))
    return found


def _fault(model: type[BaseModel], random: Random) -> dict[str, Any]:
    found = table(model, random, 0.3)
    found["kind"] = get_args(model.model_fields["kind"].annotation)[0]
    found.pop("links", None)
    return found
