"""What can be asked of a run that goes on, and what its answers say: the one list of both."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Generic, NotRequired, TypedDict, TypeVar

from zenoh_cbef.plain import read_json
from zenoh_cbef.protocol.fields import (
    FARTHEST,
    LONGEST,
    Count,
    Counts,
    Field,
    Flag,
    Table,
    Text,
    Texts,
    Values,
    are,
    field_of,
    fields_of,
    lists_of,
    or_nil,
)

_COUNT, _TEXT = field_of(Count), field_of(Text)


def _finite(values: Values) -> bool:
    return all(
        isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value) for value in values
    )


def _few(values: Values) -> bool:
    return _COUNT.hold(values) and are(values, int) and max(values) <= LONGEST


def _states(values: Values) -> bool:
    """Steps, and the true states in them, NaN where these are unknown."""
    return all(
        isinstance(value, list)
        and len(value) == 2
        and _COUNT.hold(value[:1])
        and isinstance(value[1], list)
        and len(value[1]) == 6
        and all(type(one) is float and not abs(one) > FARTHEST for one in value[1])
        for value in values
    )


def _pairs(values: Values) -> bool:
    """Names of two processes, and whether the target carries what they tell each other."""
    return all(
        isinstance(value, list)
        and len(value) == 3
        and _TEXT.hold(value[:1])
        and _TEXT.hold(value[1:2])
        and isinstance(value[2], bool)
        for value in values
    )


def _tables_of(fields: Mapping[str, Field]) -> Field:
    """JSON of a list of tables that have these fields."""

    def tables(text: object) -> bool:
        try:
            found = read_json(text) if isinstance(text, str) else None
        except ValueError:
            return False
        return isinstance(found, list) and all(
            isinstance(one, dict) and all(field.hold([one.get(name)]) for name, field in fields.items())
            for one in found
        )

    return Field(lambda values: all(map(tables, values)), {"type": "string"})


# A time of a run can be a whole number, as people write it.
_Time = Annotated[float, Field(_finite, {"type": "number"})]
_TimeOrNil = Annotated[float | None, Field(or_nil(_finite), {"type": ["number", "null"]})]
_StepOrNil = Annotated[int | None, Field(or_nil(_COUNT.hold), {"type": ["integer", "null"]})]
_Agents = Annotated[int, Field(_few, {"type": "integer", "maximum": LONGEST})]
_Messages = Annotated[list[bytes], Field(lists_of(lambda values: are(values, bytes)), {"type": "array"})]
_Apart = Annotated[list[tuple[str, str, bool]], Field(lists_of(_pairs), {"type": "array"})]
_States = Annotated[list[tuple[int, list[float]]], Field(lists_of(_states), {"type": "array"})]

InjectedTable = TypedDict(
    "InjectedTable", {"kind": Text, "number": Count, "from": _Time, "until": NotRequired[_TimeOrNil], "active": Flag}
)
"""A fault that was injected; its other keys are those of its kind."""

_Injected = Annotated[str, _tables_of(fields_of(InjectedTable))]
_Faults = Annotated[str, _tables_of({"kind": _TEXT, "fault": _COUNT})]


class Stopped(TypedDict):
    """After which step the run ends, nil before the first."""

    step: _StepOrNil


class Holding(TypedDict):
    """Whether a run in lockstep stands still by order, and the last step that it began.

    round: the last one of this step that agents were let make, where it goes by rounds and is not over.
    """

    held: Flag
    step: _StepOrNil
    round: NotRequired[_StepOrNil]


Added = TypedDict("Added", {"number": Count, "from": _Time, "warnings": NotRequired[Texts]})
"""The number of an injected fault, the run time at which it begins, s, and what is likely a mistake about it."""


class Cleared(TypedDict):
    """The numbers of the faults that were ended."""

    ended: Counts


class Listed(TypedDict):
    """All injected faults, as JSON."""

    faults: _Injected


class StatusAnswer(TypedDict):
    """All from which a status is made: messages as they came, and what the target knows besides.

    start: of step 0; time: now; both s since the Unix epoch. live: names of processes that are there. apart: processes
    that have found no way to each other. truth: states by step. earlier: estimates of some seconds ago. cards: events
    with which processes introduced themselves.
    """

    run: Text
    name: NotRequired[Text]
    filter: Text
    mode: Text
    agents: _Agents
    steps: Count
    dt: _Time
    planar: Flag
    step: _StepOrNil
    start: _Time
    time: _Time
    stopping: Flag
    target: Table
    live: Texts
    members: Counts
    silent: Counts
    away: Counts
    unobservable: NotRequired[Text]
    apart: NotRequired[_Apart]
    faults: _Faults
    truth: _States
    estimates: _Messages
    earlier: _Messages
    cards: _Messages
    events: _Messages


Answer = TypeVar("Answer")


@dataclass(frozen=True)
class Question(Generic[Answer]):
    """name: as it is asked. answer: a TypedDict, what the run answers."""

    name: str
    answer: type[Answer]

    @cached_property
    def fields(self) -> Mapping[str, Field]:
        """The fields of the answer."""
        return fields_of(self.answer)

    def known(self, checked: Any) -> Answer:
        """A map whose fields are as promised, as what it is."""
        found: Answer = checked
        return found


STOP = Question("stop", Stopped)
HOLD = Question("hold", Holding)
ADD = Question("fault add", Added)
CLEAR = Question("fault clear", Cleared)
LIST = Question("fault list", Listed)
STATUS = Question("status", StatusAnswer)
