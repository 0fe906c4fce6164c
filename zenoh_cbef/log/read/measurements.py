"""What a log says was measured, without what its agents made of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from zenoh_cbef.errors import UserError
from zenoh_cbef.faults import SensorFault
from zenoh_cbef.log.common.naming import RESOLVED, SOURCE
from zenoh_cbef.log.mcap.contents import RawMessage
from zenoh_cbef.log.read.contents import Header, read_header
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.protocol.keys import Address, address
from zenoh_cbef.protocol.messages import BadMessage, decode, nil_to_nan
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.load import Loaded, apply, parse
from zenoh_cbef.scenario.paths import agent_positions, step_times
from zenoh_cbef.scenario.world import World

_PAST = ("seed", "dt", "target", "agents", "sensor")
_KINDS = ("truth", "beacon", "signal", "range")


@dataclass
class Measurements:
    """The measurements of a run.

    source: its scenario as it was written. truth: messages by step. beacons, ranges: by (agent, step); of ranges the
    position counts. logged: when each step's last beacon, or the start signal of step 0, was (ns). start: when step 0
    was, s since the Unix epoch.
    """

    header: Header
    source: str
    truth: dict[int, dict[str, Any]] = field(default_factory=dict)
    beacons: dict[tuple[int, int], dict[str, Any]] = field(default_factory=dict)
    ranges: dict[tuple[int, int], dict[str, Any]] = field(default_factory=dict)
    logged: dict[int, int] = field(default_factory=dict)
    start: float | None = None

    @property
    def steps(self) -> int:
        """As far as beacons go for every agent that has any, 0 for none."""
        last: dict[int, int] = {}
        for agent, step in self.beacons:
            last[agent] = max(last.get(agent, 0), min(step, self.header.scenario.length))
        return min(last.values(), default=0)

    def lacks(self) -> list[str]:
        """What the log does not say of the steps that are estimated from it, a sentence each."""
        heard = {agent for agent, step in self.beacons if step > 0}
        silent = [str(agent) for agent in range(self.header.scenario.count) if agent not in heard]
        first = min((step for _, step in self.beacons if step > 0), default=1)
        truth = [step for step in self.truth if 1 <= step <= self.steps]
        said = []
        if silent:
            said.append(f"no beacon of agent {', '.join(silent)} is in the log: as if nothing had been measured there")
        if first > 1:
            said.append(f"no beacon of steps 1 to {first - 1} is in the log: the filter only predicts until then")
        if len(truth) < self.steps:
            said.append(f"the log has the truth of {len(truth)} of {self.steps} steps: only these can be scored")
        return said

    def loaded(self, overrides: Sequence[str]) -> Loaded:
        """The run's scenario with `a.b=c` overrides, for estimating again from what was measured.

        Raises UserError for an override that would change what was measured, as that is in the log already.
        """
        before, steps = self.header.scenario, self.steps
        data = before.model_dump(mode="json", by_alias=True, exclude_none=True)
        data["steps"] = steps
        for one in overrides:
            apply(data, one)
        scenario = parse(data, f"the scenario of run {self.header.run!r}")
        changed = [key for key in _PAST if getattr(scenario, key) != getattr(before, key)]
        if changed:
            raise UserError(
                f"{changed[0]} says how the log's ranges came about, which is past; set keys of filter, consensus, "
                "network, fault or timing, such as filter.range_std in place of sensor.range_std"
            )
        if _of_sensors(scenario) != _of_sensors(before):
            raise UserError("faults of sensors are in the log's ranges already; add or take away other faults only")
        if scenario.length > steps:
            raise UserError(f"steps = {scenario.length}, but the log has the beacons of {steps} steps; lower it")
        return Loaded(self.source, scenario)

    def world(self, scenario: Scenario) -> World:
        """What was measured in the scenario's steps, where agents said they were, and the truth, NaN without one.

        A beacon that is not in the log was not heard.
        """
        steps = scenario.length
        truth, positions = np.full((steps, 6), np.nan), agent_positions(scenario)
        times = np.full((2, scenario.count, steps), np.nan)
        for step, message in self.truth.items():
            if 1 <= step <= steps:
                truth[step - 1] = message["state"]
        for (agent, step), message in self.ranges.items():
            if 1 <= step <= steps:
                positions[agent, step - 1] = message["position"]
        for (agent, step), message in self.beacons.items():
            if 1 <= step <= steps:
                times[:, agent, step - 1] = nil_to_nan(message["emitted"]), nil_to_nan(message["arrived"])
        return World(step_times(scenario, steps), truth, positions, times[0], times[1])


def read_measurements(path: Path) -> Measurements:
    """Read a log's measurements. Raises UserError where it is no log of a run, or holds none."""
    file = open_log(path)
    header = read_header(file, path)
    source = file.attachments.get(SOURCE) or file.attachments[RESOLVED]
    found = Measurements(header, source.decode(errors="replace"))
    _gather(file.messages(), found)
    if found.steps == 0:
        raise UserError(f"the log of run {header.run!r} holds no beacons, so there is nothing to estimate from")
    return found


def _gather(messages: Iterable[RawMessage], found: Measurements) -> None:
    run, known = found.header.run, dict[str, Address | None]()
    for raw in messages:
        topic = raw.channel.topic
        at = known[topic] if topic in known else known.setdefault(topic, _measured(topic, found.header))
        if at is None:
            continue
        try:
            message = decode(at.kind, raw.data, run=run, sender=at.owner)
        except BadMessage:
            continue
        step = message["k"]
        if at.kind == "truth":
            found.truth.setdefault(step, message)
            continue
        if "signal" in message:
            # Others end the run, or let an agent come back.
            if step == 0:
                found.start = message.get("at", found.start)
                found.logged[0] = max(found.logged.get(0, 0), raw.log_time)
            continue
        table = found.beacons if at.kind == "beacon" else found.ranges
        table.setdefault((at.agent, step), message)
        if at.kind == "beacon":
            found.logged[step] = max(found.logged.get(step, 0), raw.log_time)


def _measured(topic: str, header: Header) -> Address | None:
    """What a key of the run carries; None where that is nothing that was measured."""
    at = address(topic)
    if at is None or at.kind not in _KINDS or at.run != header.run:
        return None
    return None if at.agent >= header.scenario.count else at


def _of_sensors(scenario: Scenario) -> list[SensorFault]:
    return [fault for fault in scenario.fault if isinstance(fault, SensorFault)]
