"""The measurements in a log, without the agents' estimates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from pydantic import BaseModel

from zenoh_cbef.arrays import Bools
from zenoh_cbef.errors import UserError
from zenoh_cbef.faults import SensorFault
from zenoh_cbef.log.common.naming import RESOLVED, SOURCE
from zenoh_cbef.log.read.header import Header
from zenoh_cbef.log.read.parts import open_logs
from zenoh_cbef.log.read.recording import Recording, read_recording
from zenoh_cbef.protocol.messages import nan_to_nil
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.load import Loaded, apply, parse, put_all
from zenoh_cbef.scenario.paths import agent_positions, step_times
from zenoh_cbef.scenario.plugged import forget_plugins, same_but_for_plugins, stamped
from zenoh_cbef.scenario.world import World

_PAST = ("seed", "dt", "target", "agents", "sensor")
_KINDS = ("truth", "beacon", "signal", "range")


@dataclass
class Measurements:
    """The measurements of a run.

    source: its scenario as it was written. recording: of the truth, beacons, signals and ranges; of ranges the
    position counts.
    """

    source: str
    recording: Recording

    @property
    def header(self) -> Header:
        """What run it is."""
        return self.recording.header

    @cached_property
    def _heard(self) -> Bools:
        return self.recording.beacons.seen(self.recording.beacons.last)

    @cached_property
    def _senders(self) -> list[str]:
        return [*self.recording.senders]

    @cached_property
    def steps(self) -> int:
        """As far as beacons go for every agent that has any, 0 for none."""
        last = np.where(self._heard, np.arange(1, self._heard.shape[1] + 1), 0).max(axis=1, initial=0)
        return int(last[last > 0].min()) if last.any() else 0

    @cached_property
    def start(self) -> float | None:
        """When step 0 was, s since the Unix epoch; None where the log does not say."""
        told = [one.at for one in self.recording.signals if one.step == 0 and one.at is not None]
        return told[-1] if told else None

    @cached_property
    def logged(self) -> dict[int, int]:
        """When each step's last beacon, or the start signal of step 0, was logged, ns."""
        steps = np.flatnonzero(self._heard.any(axis=0))
        times = self.recording.beacons.stamps(self._heard.shape[1]).logged[:, steps].max(axis=0)
        begun = [one.logged for one in self.recording.signals if one.step == 0]
        return ({0: max(begun)} if begun else {}) | dict(zip((steps + 1).tolist(), times.tolist(), strict=True))

    def truth(self, step: int) -> dict[str, Any] | None:
        """The truth in a step, as the target published it."""
        if not self.recording.truth.seen(step)[0, step - 1]:
            return None
        return {"k": step, "state": self.recording.truth.numbers("state", step)[0, step - 1].tolist()}

    def beacon(self, agent: int, step: int) -> tuple[str, dict[str, Any]]:
        """Sender and content of a beacon; a beacon that is not in the log counts as not heard."""
        beacons = self.recording.beacons
        if not beacons.seen(step)[agent, step - 1]:
            return "target", {"k": step, "emitted": None, "arrived": None}
        emitted, arrived, sender = beacons.numbers("heard", step)[agent, step - 1].tolist()
        emitted, arrived = nan_to_nil(emitted), nan_to_nil(arrived)
        return self._senders[int(sender)], {"k": step, "emitted": emitted, "arrived": arrived}

    def lacks(self) -> list[str]:
        """What the log lacks of the steps that are estimated from it, a sentence each."""
        heard, truth = self._heard, int(self.recording.truth.seen(self.steps).sum())
        silent = map(str, np.flatnonzero(~heard.any(axis=1)).tolist())
        first = int(heard.any(axis=0).argmax()) + 1
        said = []
        if not heard.any(axis=1).all():
            said.append(f"no beacon of agent {', '.join(silent)} is in the log: as if nothing had been measured there")
        if first > 1:
            said.append(f"no beacon of steps 1 to {first - 1} is in the log: the filter only predicts until then")
        if truth < self.steps:
            said.append(f"the log has the truth of {truth} of {self.steps} steps: only these can be scored")
        return said

    def loaded(self, overrides: Sequence[str], values: Mapping[str, object] = MappingProxyType({})) -> Loaded:
        """The run's scenario with `a.b=c` overrides, and values at keys, for estimating again from what was measured.

        Raises UserError for an override that would change what was measured, as that is in the log already.
        """
        before, steps = self.header.scenario, self.steps
        data = before.model_dump(mode="json", by_alias=True, exclude_none=True)
        data["steps"] = steps
        forget_plugins(data, [*(one.partition("=")[0].strip() for one in overrides), *values])
        for one in overrides:
            apply(data, one)
        put_all(data, values)
        scenario = stamped(parse(data, f"the scenario of run {self.header.run!r}"))
        changed = [key for key in _PAST if not _same(getattr(scenario, key), getattr(before, key))]
        if changed:
            raise UserError(
                f"{changed[0]} says how the log's ranges came about, which is past; set keys of filter, consensus, "
                "network, fault or timing, such as filter.range_std in place of sensor.range_std"
            )
        if not _same(_of_sensors(scenario), _of_sensors(before)):
            raise UserError("faults of sensors are in the log's ranges already; add or take away other faults only")
        if scenario.length > steps:
            raise UserError(f"steps = {scenario.length}, but the log has the beacons of {steps} steps; lower it")
        return Loaded(self.source, scenario)

    def world(self, scenario: Scenario) -> World:
        """What was measured in the scenario's steps, where agents said they were, and the truth, NaN without one.

        A beacon that is not in the log was not heard.
        """
        steps, recording = scenario.length, self.recording
        positions, expected = recording.ranges.numbers("position", steps), agent_positions(scenario)
        emitted, arrived, _ = np.moveaxis(recording.beacons.numbers("heard", steps), 2, 0)
        return World(
            step_times(scenario, steps),
            recording.truth.numbers("state", steps)[0],
            np.where(np.isfinite(positions), positions, expected),
            emitted,
            arrived,
        )


def read_measurements(*paths: Path) -> Measurements:
    """Read the measurements of a log of one file or several. Raises UserError where it is no log, or holds none."""
    log = open_logs(paths)
    recording = read_recording(log, kinds=_KINDS)
    source = log.attachments.get(SOURCE) or log.attachments[RESOLVED]
    found = Measurements(source.decode(errors="replace"), recording)
    if found.steps == 0:
        raise UserError(
            f"the log of run {recording.header.run!r} holds no beacons, so there is nothing to estimate from"
        )
    return found


def _same(one: object, other: object) -> bool:
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(_same, one, other))
    if isinstance(one, BaseModel) and isinstance(other, BaseModel):
        return same_but_for_plugins(one, other)
    return one == other


def _of_sensors(scenario: Scenario) -> list[SensorFault]:
    return [fault for fault in scenario.fault if isinstance(fault, SensorFault)]
