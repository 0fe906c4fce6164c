"""A random search for scenarios that lose the network where a centralised filter holds; what it finds becomes a case.

Each try combines a few of the choices below, and is simplified, key by key, as long as the network is still lost.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.stress import CASES, Scores, cases, scenario_of, scores
from zenoh_cbef.errors import UserError

CHOICES: dict[str, Sequence[Sequence[str]]] = {
    "motion": (
        ["target.acceleration_std=3"],
        ["target.acceleration_std=0.01"],
        ["target.velocity=[4,2,0]"],
        ["target.motion=circle", "target.radius=3", "target.period=5"],
        ["target.motion=circle", "target.radius=8", "target.period=20"],
        ["target.motion=lemniscate", "target.radius=6", "target.period=12"],
        ["target.motion=waypoints", "target.speed=3", "target.waypoints=[[0,0,0],[6,6,0],[-6,6,3],[6,-6,-3],[0,0,0]]"],
        ["target.motion=waypoints", "target.speed=8", "target.waypoints=[[-9,0,0],[0,9,2],[9,0,0],[0,-9,2],[-9,0,0]]"],
        ["target.position=[25,0,0]"],
    ),
    "agents": (
        ["agents.count=3"],
        ["agents.count=4"],
        ["agents.count=5"],
        ["agents.count=12"],
        ["agents.low=[-10,-10,-0.5]", "agents.high=[10,10,0.5]"],
        ["agents.low=[-20,-1,-1]", "agents.high=[20,1,1]"],
        ["agents.low=-2", "agents.high=2"],
        ["agents.low=-50", "agents.high=50"],
    ),
    "sensor": (
        ["sensor.range_std=0.01"],
        ["sensor.range_std=1"],
        ["sensor.range_std=5"],
        ["sensor.dropout_probability=0.8"],
        ["sensor.bias_std=0.5"],
        ["sensor.bias=1"],
        ["sensor.outlier_probability=0.3", "sensor.outlier_scale=20"],
    ),
    "dt": (["dt=0.5"], ["dt=1"], ["dt=2"], ["dt=0.02"]),
    "network": (
        ["network.graph=ring"],
        ["network.graph=path"],
        ["consensus.rounds=2"],
        ["consensus.rounds=4"],
        ['fault=[{kind="loss",probability=0.6}]'],
        ['fault=[{kind="sensor-dropout",probability=1.0,from=4.0,until=12.0}]'],
        ['fault=[{kind="crash",agents=[1,2],from=5.0,until=9.0}]'],
        ['fault=[{kind="sensor-bias",bias=3.0,agents=[1]}]'],
        ['fault=[{kind="sensor-stuck",agents=[2],from=5.0}]'],
    ),
    "start": (
        ["filter.initial_position_std=5"],
        ["filter.initial_position_std=20"],
        ["filter.initial_velocity_std=5"],
        ["filter.initial_position=[-8,8,2]"],
        ["filter.initial_velocity=[3,3,0]"],
        ["filter.initial_position=[0,0,30]", "filter.initial_position_std=20"],
    ),
}
WRONG = (*[""] * 12, "liar", "bursts", "40 %")
_SEEDS, _STEPS = 4, 200


@dataclass(frozen=True)
class Found:
    """A case with its scores."""

    case: Mapping[str, object]
    scores: Scores

    @property
    def excess(self) -> int:
        """In how many more seeds than the best centralised filter the network is lost."""
        network, *central = map(self.scores.lost, (self.scores.network, self.scores.twin, self.scores.strong))
        return network - min(central)


def search(tries: int, seed: int) -> Iterator[Found]:
    """Cases, simplified, each with another set of parts."""
    chance = np.random.default_rng(seed)
    met: set[str] = set()
    for _ in range(tries):
        parts = chance.choice(list(CHOICES), size=int(chance.integers(1, 4)), replace=False).tolist()
        chosen = [list(CHOICES[part][int(chance.integers(len(CHOICES[part])))]) for part in parts]
        found = _tried(chosen, WRONG[int(chance.integers(len(WRONG)))])
        if found is None:
            continue
        found = _simplified(found, chosen)
        key = str(found.case)
        if key not in met:
            met.add(key)
            yield found


def keep(found: Found) -> str:
    """Add a case to the file under the names of its parts, and return them; an empty name for one that is there."""
    wrong, keys = str(found.case.get("wrong", "")), found.case["set"]
    assert isinstance(keys, list)
    name = re.sub(r"[^a-z0-9.-]+", "-", "-".join([*([wrong] if wrong else []), *keys]).lower()).strip("-")[:60]
    name = name.replace(".", "-").strip("-")
    if not name or name in cases() or found.case in cases().values():
        return ""
    listed = "".join(f"    {json.dumps(key)},\n" for key in keys)
    added = f"\n[{name}]\nset = [\n{listed}]\n" + (f"wrong = {json.dumps(wrong)}\n" if wrong else "")
    CASES.write_text(CASES.read_text(encoding="utf-8") + added, encoding="utf-8")
    return name


def _tried(chosen: Sequence[Sequence[str]], wrong: str) -> Found | None:
    """The case, if it loses the network in at least half of the seeds more than the best centralised filter."""
    case: dict[str, object] = {"set": [key for keys in chosen for key in keys]} | ({"wrong": wrong} if wrong else {})
    try:
        scenario = scenario_of(case).changed(steps=_STEPS)
        found = Found(case, scores(scenario, wrong, _SEEDS))
    except UserError:
        return None
    return found if 2 * found.excess >= _SEEDS else None


def _simplified(found: Found, chosen: Sequence[Sequence[str]]) -> Found:
    wrong = str(found.case.get("wrong", ""))
    if wrong and (plain := _tried(chosen, "")):
        found, wrong = plain, ""
    for part in list(chosen):
        rest = [other for other in chosen if other is not part]
        if (rest or wrong) and (simpler := _tried(rest, wrong)):
            found, chosen = simpler, rest
    return found
