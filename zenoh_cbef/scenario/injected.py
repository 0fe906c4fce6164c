"""A plan with faults that were injected while its run went on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from zenoh_cbef.errors import UserError
from zenoh_cbef.plain import Json, read_json
from zenoh_cbef.scenario import fault_checks
from zenoh_cbef.scenario.load import parse
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.plugged import stamped

STEER = "steer"
"""Kind of the table that is no fault but an order to the target, of `[[target.orders]]`: they travel together."""


def with_faults(plan: Plan, tables: Sequence[Mapping[str, object]]) -> Plan:
    """The plan with more faults, as tables of `[[fault]]`, and orders to its target. Raises UserError where it is none.

    What the scenario leaves to be derived from its faults stays as it was: a run cannot change its messages.
    """
    data = plan.scenario.model_dump(mode="json", by_alias=True, exclude_none=True)
    data["fault"] = [*data["fault"], *({**one, "injected": True} for one in tables if one.get("kind") != STEER)]
    orders = [{key: value for key, value in one.items() if key != "kind"} for one in tables if one.get("kind") == STEER]
    data["target"]["orders"] = [*data["target"]["orders"], *orders]
    extended = Plan(stamped(parse(data, "the fault")))
    fault_checks.refuse(extended)
    return extended


def marked(extended: Plan, tables: Sequence[Mapping[str, Json]]) -> list[dict[str, Json]]:
    """The tables of `with_faults`, with what each fault of another package is on this host: so they travel."""
    injected = [one for one in tables if one.get("kind") != STEER]
    faults = iter(extended.scenario.fault[len(extended.scenario.fault) - len(injected) :])
    marks = [None if one.get("kind") == STEER else next(faults).plugin for one in tables]
    return [{**one, "plugin": mark} if mark else dict(one) for one, mark in zip(tables, marks, strict=True)]


def liars(plan: Plan, text: str) -> set[int]:
    """The agents that ever send wrong values, by the scenario or by faults as JSON, "" for none. Raises UserError."""
    return fault_checks.liars((with_faults(plan, read_tables(text)) if text else plan).scenario)


def read_tables(text: str) -> list[dict[str, Json]]:
    """Tables of faults from JSON. Raises UserError."""
    try:
        tables = read_json(text)
    except ValueError as error:
        raise UserError(f"the injected faults are no JSON: {error}") from None
    found = [one for one in tables if isinstance(one, dict)] if isinstance(tables, list) else []
    if tables != found:
        raise UserError("the injected faults are no list of tables")
    return found
