"""Where ranges bend over what a prior leaves open, so that agents share squared ranges and linearise their average."""

from __future__ import annotations

from math import sqrt

import numpy as np

from zenoh_cbef.scenario import paths, start
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.tracking.motion import LinearMotion, Motion
from zenoh_cbef.tracking.sight import MIRRORED, open_axes

MOST = 1.0
"""Curvature of ranges over a step's uncertainty, in units of their noise, from which on they are not linear there."""

STRAIGHT = 0.01
"""Below this curvature it is no matter where ranges are linearised. Above it, a target that leaves the box is lost now
and then, as ranges bend more where agents see it from one side.
"""


def after(scenario: Scenario, motion: LinearMotion, range_std: float) -> bool:
    """Whether agents linearise after averaging; auto: where priors may be too wide for ranges to be linear.

    That is in steps that are long for the motion, across a line of agents in a plane, and across the plane of three
    agents. More agents in a plane tell a height so well that it grows on the side on which their guesses have the
    target, while an estimate from squared ranges may stay in the plane, in the middle between both sides; by the 24th
    rules these linearise afterwards, too. The same for all seeds, which may be one batch. motion: what the filter
    assumes. range_std: m.
    """
    chosen = scenario.filter
    if chosen.linearise != "auto" or chosen.defaults < 2:
        return chosen.linearise == "after"
    most = MOST if chosen.defaults < 4 else STRAIGHT
    squares = motion.axes < 3 or scenario.count <= 3 or chosen.defaults < 25
    if squares and mirrored(scenario, range_std, motion.axes):
        return True
    return bending(scenario, motion, range_std, scenario.dt)[1] > most


def may_pause(scenario: Scenario, motion: LinearMotion, range_std: float) -> bool:
    """Whether a filter may go by prediction for a step, while agents tell each other something else than its payload.

    By the tenth rules not where ranges bend over how uncertain the position is by then: an agent would judge its next
    range at a prior so wide that a wrong one fits, and the filter would follow it. Among outliers that the scenario
    tells of filters are lost in such steps anyway, and what agents tell each other shows that.
    """
    if scenario.filter.defaults < 10 or start.among_outliers(scenario):
        return True
    return bending(scenario, motion, range_std, 2.0 * scenario.dt)[1] < MOST


def mirrored(scenario: Scenario, range_std: float, axes: int) -> bool:
    """Whether agents are in one plane, or on one line in a plane, wherever a seed places them."""
    return _left_open(scenario, range_std, axes) == MIRRORED


def undetermined(scenario: Scenario, range_std: float, axes: int) -> bool:
    """Whether agents rest so that ranges fit more than a place and its mirror image, as on one line in space.

    So do those of an agent that is alone, as without rounds each is.
    """
    alone = not scenario.consensus.rounds and scenario.filter.defaults > 15
    return scenario.agents.motion == "static" and (alone or _left_open(scenario, range_std, axes) > MIRRORED)


def _left_open(scenario: Scenario, range_std: float, axes: int) -> int:
    """How many axes (see tracking.sight) the agents' places at first leave open, wherever a seed places them."""
    low, high = (corner[:axes] for corner in start.box(scenario))
    if scenario.agents.positions is None and scenario.agents.motion != "waypoints":
        return axes - min(scenario.count - 1, int((high - low > range_std).sum()))
    places = paths.placement(scenario)[:, None, :axes]
    return int(open_axes(places, np.ones(places.shape[:2], dtype=bool), 1, range_std)[0])


def weakest(scenario: Scenario, motion: Motion, range_std: float) -> float:
    """How much ranges bend along the axis that they determine the least, in units of their noise.

    Over what they and the motion leave open there in the long run. As in `bending`, but each axis has as much of a
    range as it has of the box around the agents.
    """
    low, high = (corner[: motion.axes] for corner in start.box(scenario))
    sides, half, step = (high - low) ** 2, start.half_box(scenario), motion.acceleration_std * scenario.dt**2
    most = 0.0
    for part in (sides[sides > 0.0] / sides.sum()).tolist():
        share = range_std**2 / (scenario.count * part)
        before = _uncertain(step, share)
        after = before * share / (before + share)
        most = max(most, after * (1.0 - part) / (2.0 * half) / range_std)
    return most


def bending(scenario: Scenario, motion: LinearMotion, range_std: float, dt: float) -> tuple[float, float]:
    """How uncertain the position gets in a step of dt (s), m, and how much ranges bend there, in units of their noise.

    The uncertainty is that of a Kalman filter of one axis that has its share of all ranges, in its steady state, which
    the tracking index tells (Kalata 1984, The tracking index: a generalized parameter for alpha-beta and
    alpha-beta-gamma target trackers, IEEE Trans. AES 20). A range over a distance d, here half of the box around the
    agents, bends by the square of it over 2 d.
    """
    uncertain = sqrt(_uncertain(motion.acceleration_std * dt**2, range_std**2 * motion.axes / scenario.count))
    half = start.half_box(scenario)
    return uncertain, uncertain**2 / (2.0 * half) / range_std if half else 0.0


def _uncertain(step: float, share: float) -> float:
    """The variance, m^2, before the ranges of a step, of which an axis has one of the variance share (m^2).

    step: q dt^2, m.
    """
    index = step / sqrt(share)
    kept = 4.0 / (4.0 + index + sqrt(8.0 * index + index**2))  # Its square: what a range leaves of the variance.
    return float(share * (kept**-2 - 1.0))
