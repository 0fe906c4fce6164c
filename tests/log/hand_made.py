"""Small logs of a run that never was, with every kind of message as a process would send it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from zenoh_cbef.log.write.run_log import RunLog
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.messages import encode
from zenoh_cbef.protocol.round_codec import RoundCodec
from zenoh_cbef.scenario.load import load, to_toml
from zenoh_cbef.scenario.plan import Plan

RUN, START = "made", 1_700_000_000_000_000_000
KEYS = Keys(RUN)


class Maker:
    """Writes messages one after the other; each is logged after its sender's `way` (ns), by a clock that is `ahead`."""

    def __init__(self, path: Path, *overrides: str, ahead: int = 0, run: str = RUN, host: str = "a") -> None:
        self.scenario = load("tracking", ["agents.count=3", "steps=50", *overrides]).scenario
        self.ahead, self.run, self.now = ahead, run, START
        self.log = RunLog(path, self.scenario.record)
        described = {"run": run, "host": host, "started": "then"}
        self.log.describe(source="as written", resolved=to_toml(self.scenario), run=described)
        self.codecs = [RoundCodec(run, f"agent/{agent}", Plan(self.scenario).message_size) for agent in range(3)]
        self.way: dict[str, int] = {}
        self.seq: dict[tuple[str, str], int] = {}

    def send(self, key: str, sender: str, *, logged: bool = True, **body: Any) -> bytes:
        self.now += 1_000_000
        seq = self.seq.get((key, sender), 0)
        self.seq[key, sender] = seq + 1
        data = encode(self.run, sender, seq, self.now, body)
        if logged:
            self.log.add(key, data, self.now + self.way.get(sender, 0) + self.ahead)
        return data

    def step(self, k: int, *, logged: bool = True) -> None:
        """One step of all, with one round."""
        self.send(KEYS.truth, "target", k=k, state=[float(k)] * 6, logged=logged)
        for agent in range(3):
            me = f"agent/{agent}"
            own: dict[str, Any] = {"logged": logged}
            self.send(KEYS.beacon(agent), "target", k=k, emitted=0.1 * k, arrived=0.1 * k + 1e-8, **own)
            self.send(KEYS.range(agent), me, k=k, position=[1.0, 2.0, 3.0], range=None, **own)
            key = KEYS.round(agent)
            seq = self.seq.get((key, me), 0)
            self.seq[key, me] = seq + 1
            self.now += 1_000_000
            payload = np.full(Plan(self.scenario).message_size, float(k))
            if logged:
                data = self.codecs[agent].encode(seq, self.now, k, 1, payload)
                self.log.add(key, data, self.now + self.way.get(me, 0) + self.ahead)
            counts: dict[str, Any] = {
                "neighbours": [(agent + 1) % 3],
                "received": [k],
                "lost": [0],
                "late": [0],
                "latency": [1e-3],
            }
            body = {"k": k, "state": [0.5] * 6, "innovation": 0.1, "weight": None, **counts}
            self.send(KEYS.estimate(agent), me, **body, covariance=np.eye(6).tobytes(), **own)

    def close(self, status: str = "finished") -> None:
        self.log.close({"status": status})


def written(path: Path, steps: int, *overrides: str) -> Path:
    """A log of so many steps that has an end."""
    maker = Maker(path, *overrides)
    for k in range(1, steps + 1):
        maker.step(k)
    maker.close()
    return path
