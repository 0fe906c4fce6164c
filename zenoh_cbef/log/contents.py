"""The messages of a log, checked and sorted by what they are."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.errors import UserError
from zenoh_cbef.log.mcap_contents import NotMcapError, RawMessage
from zenoh_cbef.log.mcap_reader import McapFile
from zenoh_cbef.log.run_log import ACTIVE, END, RESOLVED, RUN
from zenoh_cbef.protocol.keys import address, agent_of
from zenoh_cbef.protocol.messages import BadMessage, decode
from zenoh_cbef.protocol.round_codec import RoundCodec
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.build import message_size
from zenoh_cbef.scenario.load import parse

Floats = NDArray[np.float64]


def find_log(path: Path) -> Path:
    """The log meant by a file, a run's folder or its name in logs/, or the name that a killed recorder left."""
    if not path.exists() and len(path.parts) == 1 and (Path("logs") / path).is_dir():
        path = Path("logs") / path
    candidates = [path / "run.mcap"] if path.is_dir() else [path]
    candidates += [one.with_name(one.name + ACTIVE) for one in candidates]
    for candidate in candidates:
        if candidate.is_file():
            return candidate
    raise UserError(f"there is no log {path}; give an .mcap file or a run's folder, such as logs/latest")


def open_log(path: Path) -> McapFile:
    """The MCAP file of a log. Raises UserError where it is none."""
    found = find_log(path)
    try:
        return McapFile(found)
    except NotMcapError as error:
        raise UserError(f"{found} is no MCAP file ({error}); give a log that 'run' or 'record' wrote") from None
    except OSError as error:
        raise UserError(f"cannot read {found}: {error.strerror}") from None


@dataclass(frozen=True)
class Header:
    """What a log says of itself: the run's name, its scenario, and whether the recorder ended it."""

    run: str
    scenario: Scenario
    end: dict[str, str] | None


def read_header(file: McapFile, path: Path) -> Header:
    """The run and its scenario. Raises UserError where the log lacks them."""
    attached, described = file.attachments.get(RESOLVED), file.metadata.get(RUN)
    if attached is None or described is None or "run" not in described:
        raise UserError(f"{path} holds no scenario, so it is no log of zenoh-cbef; 'info' tells what it holds")
    try:
        data = tomllib.loads(attached.decode())
    except ValueError as error:
        raise UserError(f"the scenario in {path} is damaged: {error}") from None
    return Header(described["run"], parse(data, f"the scenario in {path}"), file.metadata.get(END))


@dataclass
class Contents:
    """All valid messages of a run, the first of each kind, agent, step and round.

    truth: by step. beacons, ranges, estimates: by (agent, step). rounds: payloads (d,) by (agent, step, round).
    faults: the last list of injected ones, JSON, or empty. next_seq: by (key, sender), one past the last sequence
    number. recorded: messages that are what their key promises; undecodable: the others. agent_bytes: of the recorded
    messages that agents own.
    """

    truth: dict[int, dict[str, Any]] = field(default_factory=dict)
    beacons: dict[tuple[int, int], dict[str, Any]] = field(default_factory=dict)
    ranges: dict[tuple[int, int], dict[str, Any]] = field(default_factory=dict)
    estimates: dict[tuple[int, int], dict[str, Any]] = field(default_factory=dict)
    rounds: dict[tuple[int, int, int], Floats] = field(default_factory=dict)
    events: list[dict[str, Any]] = field(default_factory=list)
    faults: str = ""
    next_seq: dict[tuple[str, str], int] = field(default_factory=dict)
    recorded: int = 0
    agent_bytes: int = 0
    undecodable: int = 0


class _Sorter:
    def __init__(self, header: Header, contents: Contents) -> None:
        self._run, self._count = header.run, header.scenario.count
        self._contents = contents
        width = message_size(header.scenario)
        self._codecs = [RoundCodec(header.run, f"agent/{agent}", width) for agent in range(self._count)]

    def take(self, raw: RawMessage) -> None:
        """Check and sort one message. Raises BadMessage."""
        key = raw.channel.topic
        found = address(key)
        if found is None or key.split("/")[1] != self._run:
            raise BadMessage("a key that the run does not have")
        contents = self._contents
        if found.kind == "round":
            agent = self._agent(key)
            step, round_, _, payload = self._codecs[agent].decode(raw.data)
            contents.rounds.setdefault((agent, step, round_), np.frombuffer(payload))
            sender = found.owner
        else:
            message = decode(found.kind, raw.data, run=self._run, sender=found.owner)
            sender = message["from"]
            if found.kind == "event":
                contents.events.append(message)
            elif found.kind == "faults":
                contents.faults = message["tables"]
            elif found.kind == "truth":
                contents.truth.setdefault(message["k"], message)
            else:
                table = {"beacon": contents.beacons, "range": contents.ranges, "estimate": contents.estimates}
                table[found.kind].setdefault((self._agent(key), message["k"]), message)
        contents.recorded += 1
        if found.owner.startswith("agent/"):
            contents.agent_bytes += len(raw.data)
        name = (key, sender)
        contents.next_seq[name] = max(contents.next_seq.get(name, 0), raw.sequence + 1)

    def _agent(self, key: str) -> int:
        agent = agent_of(key)
        if agent >= self._count:
            raise BadMessage("an agent that the run does not have")
        return agent


def read_contents(file: McapFile, header: Header, *, rounds: bool = True) -> Contents:
    """Read all messages; with rounds=False consensus payloads are counted but not kept."""
    contents = Contents()
    sorter = _Sorter(header, contents)
    for raw in file.messages():
        try:
            sorter.take(raw)
        except BadMessage:
            contents.undecodable += 1
        if not rounds:
            contents.rounds.clear()
    return contents
