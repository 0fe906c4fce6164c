"""Faults that are injected into a run while it goes on."""

from __future__ import annotations

import json
import math
import threading
import time
from collections.abc import Callable, Sequence
from itertools import count
from typing import Any

from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol.fields import LONGEST
from zenoh_cbef.scenario import fault_checks
from zenoh_cbef.scenario.injected import STEER, marked, with_faults
from zenoh_cbef.scenario.plan import Plan

_LEAD_SECONDS = 0.3
"""How long before its beginning the target makes a fault known: all agents must begin with the same message."""

_MOMENT = 1e-7
_LEAD_STEPS = 2
"""In lockstep a fault begins with a step whose beacon tells of it: the one after the next, as that may be under way."""


_ORDERS = 100_000
"""The number of the first order to the target: more faults than that fit no message."""


class RealTime:
    """The run time of a run in realtime. epoch: when it starts, s on the monotonic clock."""

    def __init__(self, epoch: float) -> None:
        self._epoch = epoch

    def now(self) -> float:
        """The run time, s."""
        return time.monotonic() - self._epoch

    def soon(self) -> float:
        """When a fault can begin of which no process knows yet, s."""
        return round(max(self.now(), 0.0) + _LEAD_SECONDS, 3)


class StepTime:
    """The run time of a run in lockstep, which stands still with the run. step: the last one that the target began."""

    def __init__(self, dt: float, step: Callable[[], int]) -> None:
        self._dt, self._step = dt, step

    def now(self) -> float:
        """The run time of the last step that the target began, s."""
        return self._dt * self._step()

    def soon(self) -> float:
        """The run time of the first step of which no agent can know yet, s."""
        return self._dt * (self._step() + _LEAD_STEPS)


class Injection:
    """The list of injected faults, which the target keeps: it only grows, and a cleared one ends.

    Their numbers go on from those of the scenario's own faults, as events, `status` and refusals name them.
    """

    def __init__(self, plan: Plan, clock: RealTime | StepTime) -> None:
        self._given, self._clock = plan, clock
        self.plan = plan
        self._tables: list[dict[str, Any]] = []
        self._lock = threading.Lock()
        self._fresh = False

    def add(self, table: dict[str, Any], seconds: float | None) -> tuple[int, list[str]]:
        """Add a fault that begins at its `from`, or now, and lasts so long; returns its number, and warnings."""
        with self._lock:
            soon = self._clock.soon()
            since = table.setdefault("from", soon)
            if not isinstance(since, int | float) or since < soon:
                raise UserError(
                    f"from = {since} is over: the run is at {self._clock.now():.1f} s; leave it out for now"
                )
            if seconds is not None:
                table["until"] = round(since + seconds, 3)
            before = fault_checks.warnings(self.plan)
            self._accept([*self._tables, table])
            return self._numbers()[-1], [one for one in fault_checks.warnings(self.plan) if one not in before]

    def clear(self, numbers: Sequence[int] | None) -> list[int]:
        """End faults now, None: all; returns which were still to end."""
        with self._lock:
            soon = self._clock.soon()
            known = {number: place for place, number in enumerate(self._numbers())}
            unknown = sorted(set(numbers or ()) - known.keys())
            if unknown:
                raise UserError(f"there is no injected fault {unknown[0]}; 'fault list' tells which there are")
            ended = [one for one in numbers or known if self._tables[known[one]].get("until", soon + 1.0) > soon]
            tables = [dict(one) for one in self._tables]
            for one in map(known.__getitem__, ended):
                # One that has not begun yet is left with a moment that no step falls into.
                moment = soon + _MOMENT
                tables[one] |= {"from": min(tables[one]["from"], moment), "until": moment + _MOMENT}
            self._accept(tables)
            return ended

    def listed(self) -> list[dict[str, Any]]:
        """All injected faults, each with its number and whether it is on."""
        now = self._clock.now()
        return [
            {"number": number, "active": table["from"] <= now < table.get("until", math.inf), **table}
            for number, table in zip(self._numbers(), self._tables, strict=True)
        ]

    def _numbers(self) -> list[int]:
        """The numbers of all tables."""
        steers = [table.get("kind") == STEER for table in self._tables]
        faults, orders = count(len(self._given.scenario.fault)), count(_ORDERS)
        return [next(orders if one else faults) for one in steers]

    def news(self) -> str | None:
        """The list as JSON, where it has changed since the last time."""
        with self._lock:
            fresh, self._fresh = self._fresh, False
            return self.tables() if fresh else None

    def tables(self) -> str:
        """All injected faults as JSON."""
        return json.dumps(self._tables)

    def _accept(self, tables: list[dict[str, Any]]) -> None:
        if len(json.dumps(tables)) > LONGEST:
            raise UserError(f"{len(self._tables)} faults were injected, and no more fit a message; start another run")
        self.plan = with_faults(self._given, tables)
        self._tables, self._fresh = marked(self.plan, tables), True
