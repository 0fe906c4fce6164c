"""Every reader of input from other processes, as a function that takes one input and accepts or refuses it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgpack

from benchmarks.fuzz_material import AGENTS, KEYS, RUN, WIDTH, Material
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.mcap.contents import Channel, RawMessage
from zenoh_cbef.log.mcap.heads import Batch
from zenoh_cbef.log.read.decoding import Decoder
from zenoh_cbef.log.read.header import Header
from zenoh_cbef.log.read.recording import Recording
from zenoh_cbef.log.tools.playlist import step_in
from zenoh_cbef.log.write.run_log import UNKNOWN, RunLog
from zenoh_cbef.nodes.common.recording import Status
from zenoh_cbef.nodes.recorder.overview import Overview
from zenoh_cbef.nodes.target.control import answer
from zenoh_cbef.nodes.target.injection import Injection, RealTime
from zenoh_cbef.outside.status import read_status
from zenoh_cbef.plain import read_json, read_toml
from zenoh_cbef.protocol.control import read_answer, read_request
from zenoh_cbef.protocol.keys import address, agent_named, run_of
from zenoh_cbef.protocol.kinds import MESSAGE_KINDS
from zenoh_cbef.protocol.messages import BadMessage, decode, decode_all, peek, unpack
from zenoh_cbef.protocol.questions import STATUS
from zenoh_cbef.protocol.round_codec import RoundCodec
from zenoh_cbef.protocol.scenario_service import read_scenario, time_in
from zenoh_cbef.scenario.injected import read_tables, with_faults
from zenoh_cbef.scenario.load import load, parse, to_toml
from zenoh_cbef.scenario.plan import Plan

Door = Callable[[Material], str]
"""Takes one input; returns "accepted", or the sentence with which the reader refused it."""

REFUSALS = (BadMessage, UserError)
"""Errors that a reader may raise: its callers catch each, and make it a count or a sentence."""


@dataclass
class Doors:
    """All of them, over a folder for files."""

    folder: Path

    def __post_init__(self) -> None:
        self.scenario = load("tracking", [f"agents.count={AGENTS}", "steps=50", "timing.mode=realtime"]).scenario
        self._codec = RoundCodec(RUN, "agent/0", WIDTH)
        self._log = self._new_log(0)
        self._logged = 0
        self._overview = Overview(Status(RUN, "", 50), lambda: AGENTS)
        self._plan = Plan(self.scenario)
        header = Header(RUN, self._plan, None)
        self._recording = Recording(header, "payloads")
        self._decoder = Decoder(header, self._recording)
        self._target: Any = SimpleNamespace(
            node=SimpleNamespace(stop=lambda: None),
            survey=SimpleNamespace(of=lambda _: {}),
            injection=Injection(self._plan, RealTime(time.time())),
            step=3,
        )
        self._toml = to_toml(self.scenario)
        self._tables = self.scenario.model_dump(mode="json", by_alias=True, exclude_none=True)

    def _new_log(self, number: int) -> RunLog:
        return RunLog(self.folder / f"fuzz-{number}.mcap", self.scenario.record)

    def close(self) -> None:
        """Close the log that messages went into."""
        self._log.close({"status": "finished"})

    def of_messages(self) -> dict[str, Door]:
        """The readers of messages from the network."""
        return {
            "message": self.message,
            "messages of one key": self.several,
            "round message": self.round,
            "recorder": self.recorder,
            "log reader": self.log_reader,
        }

    def of_texts(self) -> dict[str, Door]:
        """The readers of other input from the network and from files."""
        return {
            "key": self.key,
            "JSON": self.json,
            "TOML": self.toml,
            "injected faults": self.faults,
            "scenario's tables": self.scenario_tables,
            "scenario reply": self.scenario_reply,
            "request to a run": self.request,
            "answer of a run": self.answer,
        }

    def message(self, material: Material) -> str:
        """The general decoder, as live readers use it."""
        kind, _, data = material.message()
        sender = material.pick(("", "agent/0", "target"))
        decode(MESSAGE_KINDS[kind], data, run=RUN, sender=sender)
        if "k" in MESSAGE_KINDS[kind].fields:
            peek(MESSAGE_KINDS[kind], data, run=RUN, sender=sender)
        return "accepted"

    def several(self, material: Material) -> str:
        """The decoder of many messages of one key."""
        kind, _, data = material.message()
        decode_all(MESSAGE_KINDS[kind], [data, data], run=RUN)
        return "accepted"

    def round(self, material: Material) -> str:
        """The decoder of consensus messages."""
        _, _, data = material.message()
        self._codec.decode(data)
        self._codec.decode_all([data, data])
        return "accepted"

    def recorder(self, material: Material) -> str:
        """The recorder's log and its overview."""
        kind, key, data = material.message()
        key = material.key() if material.random.random() < 0.3 else key
        self._logged += 1
        if not self._logged % 50_000:
            self._log.close({"status": "stopped"})
            self._log.path.unlink()
            self._log = self._new_log(self._logged)
        kind = self._log.add(key, data, self._logged)
        if kind in {"truth", "estimate"}:
            self._overview.see(kind, key, [data])
        return "refused: not a message of the run" if kind == UNKNOWN else "accepted"

    def log_reader(self, material: Material) -> str:
        """The reader of logs, and a replay's look at steps."""
        _, key, data = material.message()
        key = material.key() if material.random.random() < 0.3 else key
        before = self._decoder.tally.recorded
        channel = Channel(1, key, "msgpack", "", "", b"", {})
        raw = RawMessage(channel, 5, *_label(data), data)
        step_in(f"cbef/{RUN}/agent/0/round", data)
        self._decoder.take(Batch.of([raw] * material.pick((1, 20)), {1: channel}))
        if len(self._recording.events) > 1000:
            self._recording.events.clear()
            self._recording.signals.clear()
        return "accepted" if self._decoder.tally.recorded > before else "refused: not as its key promises"

    def key(self, material: Material) -> str:
        """The parser of keys."""
        key = material.key()
        run_of(key)
        agent_named(key.removeprefix(f"{KEYS.root}/"))
        return "refused: no key of a run" if address(key) is None else "accepted"

    def json(self, material: Material) -> str:
        """JSON, as in injected faults."""
        return _read(read_json, material.json(self._tables))

    def toml(self, material: Material) -> str:
        """TOML, as a scenario's text."""
        return _read(read_toml, material.bytes(self._toml.encode()).decode(errors="replace"))

    def faults(self, material: Material) -> str:
        """Injected faults, and the scenario with them."""
        fault = {"kind": material.pick(("loss", "delay", "crash", "clock")), "probability": 0.5, "from": 1.0}
        with_faults(self._plan, read_tables(material.json([fault])))
        return "accepted"

    def scenario_tables(self, material: Material) -> str:
        """A scenario's tables."""
        parse(material.changed(self._tables), "the scenario")
        return "accepted"

    def scenario_reply(self, material: Material) -> str:
        """A target's answer with the scenario."""
        reply = {"v": 1, "run": RUN, "time": 5, "source": self._toml, "resolved": self._toml, "program": "1"}
        reply |= {"step": 3, "agents": [0, 1], "faults": "[]"}
        data = _mutated(material, reply)
        time_in(data)
        read_scenario(data, RUN)
        return "accepted"

    def request(self, material: Material) -> str:
        """A request to a target."""
        fault = '{"kind": "loss", "probability": 0.5}'
        order = {"ask": "fault add", "fault": fault, "seconds": 5.0, "numbers": [0]}
        request = read_request(_mutated(material, {"v": 1, **order}))
        if material.random.random() < 0.02:
            self._target.injection = Injection(self._plan, RealTime(time.time()))
        answer(self._target, request)
        return "accepted"

    def answer(self, material: Material) -> str:
        """A target's answer to `status`."""
        truth, lists = [[3, [0.5] * 6]], {name: [0, 1] for name in ("members", "silent", "away")}
        told = {"run": RUN, "name": "n", "filter": "sicf", "mode": "lockstep", "agents": AGENTS, "steps": 50, "dt": 0.1}
        told |= {"planar": False, "step": 3, "start": 1.0, "time": 2.0, "stopping": False, "target": {"host": "h"}}
        told |= {"live": ["agent/0"], **lists, "faults": '[{"fault": 0, "kind": "loss"}]', "truth": truth}
        told |= {
            name: [material.message()[2] for _ in range(3)] for name in ("estimates", "earlier", "cards", "events")
        }
        read_status(read_answer(_mutated(material, told), STATUS, KEYS.control))
        return "accepted"


def _read(read: Callable[[str], Any], text: str) -> str:
    try:
        read(text)
    except ValueError as error:
        return f"refused: {str(error).split(':')[0]:.40}"
    return "accepted"


def _mutated(material: Material, value: dict[str, Any]) -> bytes:
    try:
        data = bytes(msgpack.packb(material.changed(value)))
    except (ValueError, OverflowError):
        data = b""
    return material.bytes(data) if material.random.random() < 0.3 else data


def _label(data: bytes) -> tuple[int, int]:
    """Sending time and number, as the recorder writes them beside a message."""
    try:
        message = unpack(data)
    except BadMessage:
        return 0, 0
    sent, seq = message.get("sent"), message.get("seq")
    return (sent, seq & 0xFFFFFFFF) if isinstance(sent, int) and isinstance(seq, int) else (0, 0)
