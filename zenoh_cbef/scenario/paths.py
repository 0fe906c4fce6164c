"""Where the agents of a scenario are, and when its steps are."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from zenoh_cbef import streams
from zenoh_cbef.arrays import Floats
from zenoh_cbef.courses.waypoints import along
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.scenario.table import Corner


def step_times(scenario: Scenario, steps: int) -> Floats:
    """Run times of steps 1 to K, (K,), s."""
    return scenario.dt * np.arange(1, steps + 1, dtype=np.float64)


def placement(scenario: Scenario, seed: int | None = None) -> Floats:
    """The agents' positions at step 0, (n, 3), m: with the scenario's seed, or as another seed places them."""
    agents, count = scenario.agents, scenario.count
    if agents.motion == "waypoints":
        return np.array([points[0] for points in agents.waypoints])
    if agents.positions is not None:
        return np.array(agents.positions[:count])
    return _drawn(scenario.seed if seed is None else seed, count, agents.low, agents.high)


@lru_cache(maxsize=256)
def _drawn(seed: int, count: int, low: Corner, high: Corner) -> Floats:
    key = streams.stream(seed, "placement", np.arange(count))[:, None]
    places = np.add(low, np.subtract(high, low) * streams.uniform(key, 0, np.arange(3)))
    places.flags.writeable = False  # All callers that ask for these get the same array.
    return places


def agent_positions(scenario: Scenario, agent: int | None = None) -> Floats:
    """The positions of all agents in steps 1 to K, (n, K, 3); of one agent alone (1, K, 3)."""
    return places_at(scenario, step_times(scenario, scenario.length), agent)


def places_at(scenario: Scenario, time: Floats, agent: int | None = None) -> Floats:
    """The positions of all agents at run times (t,), s: (n, t, 3); of one agent alone (1, t, 3)."""
    chosen = slice(agent, None if agent is None else agent + 1)
    agents = scenario.agents
    if agents.motion == "waypoints":
        return np.stack([along(np.array(points), agents.speed, time)[:, :3] for points in agents.waypoints[chosen]])
    drift = np.array(agents.velocity) if agents.motion == "formation" else np.zeros(3)
    return np.asarray(placement(scenario)[chosen, None, :] + time[None, :, None] * drift)
