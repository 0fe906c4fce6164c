"""Runs of hard scenarios come out as before: each number of theirs that a change moves, it moves on purpose.

`python -m tests.simulator.test_stress_runs` computes the numbers anew, where a change is meant to alter them.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.stress import cases, scenario_of
from zenoh_cbef import simulator
from zenoh_cbef.analysis.yardsticks import centralized_run
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate

FILE = Path(__file__).parents[1] / "golden" / "stress.json"


BIASED, LOSS = "fault=[{kind='sensor-bias',bias=3.0,agents=[1]}]", "fault=[{kind='loss',probability=0.3}]"
MORE = {
    "one of seven biased in a plane": ["agents.count=7", "filter.planar_height=0.4", BIASED],
    "two of nine biased": ["agents.count=9", BIASED.replace("[1]", "[1,7]")],
    "several motions": ["filter.motion='imm'", "filter.kind='icf'"],
    "several motions of few bits": ["filter.motion='imm'", "consensus.precision='int16'", LOSS],
    "silence and few bits": ["consensus.trigger=0.1", "consensus.precision='int12'", "filter.planar_height=0.4"],
    "running sums of few bits": ["consensus.scheme='running-sums'", "consensus.precision='float32'", LOSS],
    "delays and smoothing": ["filter.lag_seconds=1.0", "fault=[{kind='delay',milliseconds=100.0}]"],
    "loss of a memory": [
        "agents.count=9",
        "filter.bias='auto'",
        "fault=[{kind='crash',agents=[1,4],from=2.3,until=2.6},{kind='loss',probability=0.3}]",
    ],
    "liars that neighbours name": ["fault=[{kind='byzantine',agents=[3],mode='constant',magnitude=3.0}]"],
    "half of the squared ranges": [
        "filter.range_std=0.2",
        "agents.low=[-10,-10,0]",
        "agents.high=[10,10,0]",
        "filter.linearise=after",
    ],
    "many agents": ["agents.count=30", "network.graph='grid'", "filter.kind='cbef-scaled'"],
}
"""Scenarios beside those of benchmarks/stress.toml: what is laid over the built-in `tracking`."""


LONG = 40
SHORT = {
    "fast-lemniscate": 20,
    "fast-lemniscate-and-bursts": 20,
    "precise-ranges-in-a-small-box": 12,
    "slow-steps-and-lemniscate": 30,
}
"""How many steps are compared, of cases in which targets turn far in one: which of many hypotheses stay is decided by
ever smaller differences, and processors agree on them for so long."""


def steps_of(name: str) -> int:
    return SHORT.get(name, LONG)


def scenario(name: str) -> Scenario:
    """The first steps."""
    short = [f"steps={steps_of(name)}", "seed=1001"]
    return load("tracking", [*MORE[name], *short]).scenario if name in MORE else scenario_of(cases()[name], short)


def numbers(name: str) -> dict[str, float]:
    """Of all agents and steps: the sums of what is said, in size, and how much is said."""
    (trace,) = simulate([scenario(name)])
    told = {"estimates": trace.estimates, "last": trace.estimates[:, -1], **trace.diagnostics.named()}
    for what in ("covariances", "payloads", "smoothed"):
        if isinstance(values := getattr(trace, what), np.ndarray):
            told[what] = values
    central = [*centralized_run([trace], steps_of(name))]
    told["central states"] = np.stack([belief.state for belief in central])
    told["central covariances"] = np.stack([belief.known_covariance for belief in central])
    found: dict[str, float] = {}
    for what, values in told.items():
        known = np.isfinite(values)
        if known.any():
            found[what], found[f"known {what}"] = float(np.abs(values[known]).sum()), int(known.sum())
    return found


if __name__ == "__main__":
    again = {name: numbers(name) for name in [*cases(), *MORE]}
    FILE.write_text(json.dumps(again, indent=1) + "\n", encoding="utf-8")

RECORDED: dict[str, dict[str, float]] = json.loads(FILE.read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", RECORDED)
def test_a_hard_run_comes_out_as_before(name: str) -> None:
    assert_as_before(name)


@pytest.mark.parametrize("name", ["loss of a memory", "delays and smoothing", "several motions of few bits"])
def test_a_hard_run_in_parts_comes_out_as_in_one(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulator, "_BLOCK", 2)
    assert_as_before(name)


def assert_as_before(name: str) -> None:
    # Processors differ in the last bits, and many steps make more of that; most where numbers are rounded to few bits.
    assert numbers(name) == pytest.approx(RECORDED[name], rel=1e-3 if "few bits" in name else 1e-6, abs=1e-9)
