"""The messages of a log, checked and sorted by what they are."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.errors import UserError
from zenoh_cbef.log.common.naming import END, RESOLVED, RUN
from zenoh_cbef.log.read.decoding import Decoder
from zenoh_cbef.log.read.parts import Log
from zenoh_cbef.plain import read_toml
from zenoh_cbef.protocol.round_codec import Rounds
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.load import parse
from zenoh_cbef.scenario.plan import Plan

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Header:
    """What a log says of itself: the run's name, its scenario, and whether the recorder ended it."""

    run: str
    plan: Plan
    end: dict[str, str] | None

    @property
    def scenario(self) -> Scenario:
        """What the run was to be."""
        return self.plan.scenario


def read_header(log: Log, path: Path) -> Header:
    """The run and its scenario. Raises UserError where the log lacks them."""
    attached, described = log.attachments.get(RESOLVED), log.metadata.get(RUN)
    if attached is None or described is None or "run" not in described:
        cut = "it is damaged before its scenario" if log.damage else "it is no log of zenoh-cbef"
        raise UserError(f"{path} holds no scenario, as {cut}; 'info' tells what it holds")
    try:
        data = read_toml(attached.decode())
    except ValueError as error:
        raise UserError(f"the scenario in {path} is damaged: {error}") from None
    return Header(described["run"], Plan(parse(data, f"the scenario in {path}")), log.metadata.get(END))


@dataclass
class Contents:
    """All valid messages of a run, the first of each kind, agent, step and round.

    truth: by step. beacons, ranges, estimates: by (agent, step). rounds: payloads (d,) by (agent, step, round).
    faults: the last list of injected ones, JSON, or empty.
    """

    truth: dict[int, dict[str, Any]] = field(default_factory=dict)
    beacons: dict[tuple[int, int], dict[str, Any]] = field(default_factory=dict)
    ranges: dict[tuple[int, int], dict[str, Any]] = field(default_factory=dict)
    estimates: dict[tuple[int, int], dict[str, Any]] = field(default_factory=dict)
    rounds: dict[tuple[int, int, int], Floats] = field(default_factory=dict)
    events: list[dict[str, Any]] = field(default_factory=list)
    keeps_rounds: bool = True
    faults: str = ""

    def take(self, kind: str, agent: int, messages: list[dict[str, Any]]) -> None:
        """Keep messages."""
        tables = {"beacon": self.beacons, "range": self.ranges, "estimate": self.estimates}
        if kind == "event":
            self.events += messages
        elif kind == "signal":
            return  # They are of the run's time, which is no part of what is compared.
        elif kind == "faults":
            self.faults = messages[-1]["tables"]
        elif kind == "truth":
            for message in messages:
                self.truth.setdefault(message["k"], message)
        else:
            for message in messages:
                tables[kind].setdefault((agent, message["k"]), message)

    def take_rounds(self, agent: int, rounds: Rounds) -> None:
        """Keep payloads."""
        if not self.keeps_rounds:
            return
        for step, round_, payload in zip(rounds.step.tolist(), rounds.round.tolist(), rounds.payload, strict=True):
            self.rounds.setdefault((agent, step, round_), payload)


def read_contents(log: Log, header: Header, *, rounds: bool = True) -> Contents:
    """Read all messages of a log; with rounds=False consensus payloads are checked but not kept."""
    contents = Contents(keeps_rounds=rounds)
    Decoder(header.run, header.plan, contents).take_all(log)
    return contents
