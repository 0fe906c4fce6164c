"""Logs of simulated runs, message by message as the processes of a run would have sent them."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from zenoh_cbef.log.write.run_log import RunLog
from zenoh_cbef.protocol.bodies import estimate_body
from zenoh_cbef.protocol.fields import START
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.messages import encode, nan_to_nil
from zenoh_cbef.protocol.round_codec import RoundCodec
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.load import load, to_toml
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.world import make_world
from zenoh_cbef.simulator import Heard, Simulation, Step, heard_in

_START = 1_700_000_000_000_000_000


class MadeLog:
    """Writes the log of a scenario without processes. Times go on by a microsecond from message to message."""

    def __init__(self, path: Path, scenario: Scenario, run: str = "made") -> None:
        self.plan, self.scenario, self.run, self.keys = Plan(scenario), scenario, run, Keys(run)
        self.log = RunLog(path, scenario.record)
        described = {
            "run": run,
            "name": scenario.name,
            "seed": str(scenario.seed),
            "version": "",
            "host": "",
            "started": "",
        }
        self.log.describe(source="", resolved=to_toml(scenario), run=described)
        width = self.plan.message_size
        self._codecs = [RoundCodec(run, f"agent/{agent}", width) for agent in range(scenario.count)]
        self._seq: dict[str, int] = {}
        self._now = _START
        pairs = self.plan.edges.tolist()
        self._neighbours = [
            sorted({a + b - agent for a, b in pairs if agent in (a, b)}) for agent in range(scenario.count)
        ]

    def write(self) -> None:
        """Simulate the run and write all of it."""
        world = make_world(self.scenario)
        heard: Heard = heard_in(self.plan, world)
        for agent in range(self.scenario.count):
            self._send(self.keys.signal(agent), "target", k=0, signal=START, at=1e-9 * _START)
        for number, step in enumerate(Simulation([self.plan], [heard]), 1):
            self._send(self.keys.truth, "target", k=number, state=world.truth[number - 1].tolist())
            for agent in range(self.scenario.count):
                times = (nan_to_nil(each[agent, number - 1]) for each in (world.emitted, world.arrived))
                self._send(
                    self.keys.beacon(agent), "target", k=number, **dict(zip(("emitted", "arrived"), times, strict=True))
                )
            self._agents(number, step, heard)
        for agent in range(self.scenario.count):
            sent = {key: count for key, count in self._seq.items() if f"/agent/{agent}/" in key}
            name = f"agent/{agent}"
            self._send(self.keys.event(name), name, kind="finished", text="", data={"sent": sent})
        self.log.close({"status": "finished"})

    def _agents(self, number: int, step: Step, heard: Heard) -> None:
        rounds, estimate = len(step.sent), step.estimate
        for agent in range(self.scenario.count):
            place, told = heard.positions[agent, number - 1], heard.ranges[agent, number - 1]
            self._send(
                self.keys.range(agent), f"agent/{agent}", k=number, position=place.tolist(), range=nan_to_nil(told)
            )
        for round_, sent in enumerate(step.sent, 1):
            for agent, payload in enumerate(sent):
                key, now = self.keys.round(agent), self._tick()
                data = self._codecs[agent].encode(self._number(key), now, number, round_, payload)
                self.log.add(key, data, now)
        for agent, neighbours in enumerate(self._neighbours):
            counts: dict[str, Any] = {"neighbours": neighbours, "received": [number * rounds] * len(neighbours)}
            counts |= {name: [0] * len(neighbours) for name in ("lost", "late")} | {"latency": [1e-4] * len(neighbours)}
            body = estimate_body(number, estimate, agent, agent, counts)
            self._send(self.keys.estimate(agent), f"agent/{agent}", **body)

    def _send(self, key: str, sender: str, **body: Any) -> None:
        now = self._tick()
        self.log.add(key, encode(self.run, sender, self._number(key), now, body), now)

    def _number(self, name: str) -> int:
        number = self._seq.get(name, 0)
        self._seq[name] = number + 1
        return number

    def _tick(self) -> int:
        self._now += 1000
        return self._now


if __name__ == "__main__":
    MadeLog(Path(sys.argv[1]), load("tracking", [f"steps={sys.argv[2]}"]).scenario).write()
