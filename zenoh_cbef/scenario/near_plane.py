"""Whether agents are so near one plane that their ranges hardly tell a target from its mirror image."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.scenario import bending, paths, start, trust
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.tracking.mirroring import APART, Plane

NEAR = 3.0
"""How far off it agents are, root mean square in units of the noise: a range tells mirror images apart by twice that at
most, and by less of a target that is not straight above.
"""

_FLAT = 4.0
"""By what factor agents reach farther along the plane."""


def flat(scenario: Scenario, range_std: float, axes: int) -> bool:
    """Whether agents are in one plane (of two axes on one line) or near it: ranges fit mirror images. range_std: m."""
    return bending.mirrored(scenario, range_std, axes) or plane(scenario, range_std, axes) is not None


def plane(scenario: Scenario, range_std: float, axes: int, *, several: bool = False) -> Plane | None:
    """The plane (or of two axes the line) that resting agents are near, wherever a seed places them; None: none.

    Agents in one plane are another matter (bending.py, one_side.py). Real ones, as along a wall, may be farther off it:
    errors that last, outliers, and a target that turns hide for long which side ranges fit. range_std: m. several:
    whether agents keep several hypotheses, or assume several motions, which by the twenty-fifth rules did not go with
    mirror images.
    """
    real = trust.real(scenario)
    unfit = scenario.filter.defaults < (29 if real else 26 if several else 9) or scenario.consensus.rounds == 0
    unfit |= scenario.agents.motion != "static" or scenario.count <= axes
    if unfit or (trust.recovers(scenario) and not real) or bending.mirrored(scenario, range_std, axes):
        return None
    near = _lies_flat(scenario, NEAR * range_std, axes)
    if real:
        # Of anchors that are as near as that a guess tells the side, where there is one.
        near = _lies_flat(scenario, np.inf, axes) and not (near and guess_tells_side(scenario, axes))
    if not near:
        return None
    _, directions, middle = _spread(scenario, axes)
    return tuple(middle.tolist()), tuple(directions[0].tolist())


def anchors_leave_sides(scenario: Scenario, range_std: float, axes: int) -> bool:
    """Whether nothing tells on which side of real anchors a target is that are in one plane, as under a ceiling.

    Or near it, and no guess is given that is as surely on one side as an estimate has to be. By the twentieth rules
    agents presume to be on the side that they are on.
    """
    real = trust.real(scenario) and scenario.filter.defaults > 20 and scenario.agents.motion == "static"
    flat = real and scenario.count >= axes and _lies_flat(scenario, NEAR * range_std, axes)
    return flat and not guess_tells_side(scenario, axes)


def guess_tells_side(scenario: Scenario, axes: int) -> bool:
    """Whether a guess is given that is surely on one side of the plane that agents are nearest to."""
    guess = scenario.filter.initial_position
    if guess is None:
        return False
    _, directions, middle = _spread(scenario, axes)
    heights = (np.atleast_2d(guess)[:, :axes] - middle) @ directions[0]
    return bool((2.0 * np.abs(heights) >= APART * start.initial_std(scenario)[0]).all())


def _lies_flat(scenario: Scenario, near: float, axes: int) -> bool:
    """Whether agents are at most so far off a plane, m, root mean square, and reach far along it."""
    spread = _spread(scenario, axes)[0]
    return bool(spread[0] <= near and spread[1] >= _FLAT * spread[0])


def _spread(scenario: Scenario, axes: int) -> tuple[Floats, Floats, Floats]:
    """Standard deviations of places along directions, least first, these, and the middle."""
    return _of_box(scenario, axes) if scenario.agents.positions is None else _of_places(scenario, axes)


def _of_box(scenario: Scenario, axes: int) -> tuple[Floats, Floats, Floats]:
    low, high = (corner[:axes] for corner in start.box(scenario))
    spread = (high - low) / np.sqrt(12.0)
    order = np.argsort(spread, kind="stable")
    return spread[order], np.eye(axes)[order], 0.5 * (low + high)


def _of_places(scenario: Scenario, axes: int) -> tuple[Floats, Floats, Floats]:
    places = paths.placement(scenario)[:, :axes]
    middle = places.mean(axis=0)
    _, sizes, directions = np.linalg.svd(places - middle, full_matrices=False)
    return sizes[::-1] / np.sqrt(len(places)), directions[::-1], middle
