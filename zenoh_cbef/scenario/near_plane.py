"""Whether agents are so near one plane that their ranges hardly tell a target from its mirror image."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.scenario import bending, paths, start, trust
from zenoh_cbef.scenario.model import Scenario

Plane = tuple[tuple[float, ...], tuple[float, ...]]
"""A point of it and its normal, by the estimated axes, m and 1."""

_NEAR = 3.0
"""How far off it agents are, root mean square in units of the noise: a range tells mirror images apart by twice that at
most, and by less of a target that is not straight above.
"""

_FLAT = 4.0
"""By what factor agents reach farther along the plane."""


def flat(scenario: Scenario, range_std: float, axes: int) -> bool:
    """Whether agents are in one plane (of two axes on one line) or near it: ranges fit mirror images. range_std: m."""
    return bending.mirrored(scenario, range_std, axes) or plane(scenario, range_std, axes) is not None


def plane(scenario: Scenario, range_std: float, axes: int) -> Plane | None:
    """The plane (or of two axes the line) that resting agents are near, wherever a seed places them; None: none.

    Of agents in one plane the network shares squared ranges (bending.py). range_std: m.
    """
    agents = scenario.agents
    unfit = (
        scenario.filter.defaults < 9
        or scenario.filter.recovery
        or trust.real(scenario)
        or scenario.consensus.rounds == 0
    )
    if unfit or agents.motion != "static" or scenario.count <= axes or bending.mirrored(scenario, range_std, axes):
        return None
    spread, directions, middle = _of_box(scenario, axes) if agents.positions is None else _of_places(scenario, axes)
    if spread[0] > _NEAR * range_std or spread[1] < _FLAT * spread[0]:
        return None
    return tuple(middle.tolist()), tuple(directions[0].tolist())


def _of_box(scenario: Scenario, axes: int) -> tuple[Floats, Floats, Floats]:
    """Standard deviations of places along directions, least first, these, and the middle."""
    low, high = (corner[:axes] for corner in start.box(scenario))
    spread = (high - low) / np.sqrt(12.0)
    order = np.argsort(spread, kind="stable")
    return spread[order], np.eye(axes)[order], 0.5 * (low + high)


def _of_places(scenario: Scenario, axes: int) -> tuple[Floats, Floats, Floats]:
    places = paths.placement(scenario)[:, :axes]
    middle = places.mean(axis=0)
    _, sizes, directions = np.linalg.svd(places - middle, full_matrices=False)
    return sizes[::-1] / np.sqrt(len(places)), directions[::-1], middle
