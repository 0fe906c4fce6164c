"""Where agents tell each other their ranges, as each range alone, or a fix over many steps, says too little."""

from __future__ import annotations

from collections.abc import Sequence
from math import isclose, sqrt

import numpy as np

from zenoh_cbef.scenario import bending, near_plane, network, start, trust, weighing
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.scenario.motion import reversing, turning_round
from zenoh_cbef.tracking.filters import abilities_of
from zenoh_cbef.tracking.filters.models.splitting import CLOSELY, ROUGHLY
from zenoh_cbef.tracking.motion import Motion, NearlyConstantVelocity

_BENT = 0.1
"""By how much of its noise a range bends over what a bias leaves open, where agents tell each other their ranges."""


def tells_ranges(
    scenario: Scenario, motions: Sequence[Motion], range_std: float, settling: int, *, leaps: bool
) -> bool:
    """Whether agents tell each other their ranges: where a first fix would fail, or may, and they are few.

    Or where the target switches between motions: which ranges are wrong, and which motion is right, all ranges of a
    step tell together. By earlier rules only if a step may have too few, as agents are away, or cut off from others. Or
    where biases are large. motions: what the filter assumes, the most agile one last. range_std: m. settling: steps of
    a fix. leaps: whether one motion that leaps would do, as by the twentieth rules; but wrong ranges lose it.
    """
    agile = motions[-1]
    if (len(motions) > 1 or _bends_over_biases(scenario)) and tells_biased(scenario, agile.axes):
        return True
    several = len(motions) > 1 and scenario.filter.defaults > 13
    fewest = agile.axes - (several and scenario.filter.defaults > 15)
    if not _may(scenario, fewest + (not several), several=several):
        return False
    if several and not (leaps and scenario.filter.defaults < 21) and _tells_turns(scenario):
        return True
    if len(motions) == 1 and may_mistake(scenario, range_std, agile.axes):
        return True
    if leaves_curves(scenario, motions, range_std):
        return True
    heard = scenario.count * (1.0 - scenario.sensor.dropout_probability)
    needs = len(motions) == 1 or heard < agile.axes + 1 or (several and network.parts(scenario))
    return needs and _strays(scenario, agile, range_std, settling)


def _tells_turns(scenario: Scenario) -> bool:
    """Whether agents tell each other their ranges of any target that switches between motions, and find it by these.

    Not in real time: all agents of a host need its CPU at once, between two rounds, and several times as much of it.
    """
    in_time = scenario.timing.mode == "lockstep"
    return scenario.filter.defaults > 16 and in_time and scenario.filter.start != "given" and _comes(scenario)


def tells_biased(scenario: Scenario, axes: int) -> bool:
    """Whether agents that estimate all biases together do so beside several motions, as they tell each other ranges.

    What they share otherwise is the information of one motion.
    """
    biased = trust.tells_biases(scenario) and trust.shares_biases(scenario)
    # Hypotheses that stay need no agent beyond those that tell a place.
    least = axes if scenario.filter.defaults > 25 else axes + 1
    told = biased and _everywhere(scenario) and _may(scenario, least, several=True)
    return told and scenario.filter.defaults > 15


def _bends_over_biases(scenario: Scenario) -> bool:
    """Whether ranges bend over what drawn biases leave open of the place, by much less than their noise, too.

    In each step by as much, so that it does not average out. Agents that share information leave it out. In a plane
    such agents are no better off.
    """
    if scenario.filter.planar_height is not None:
        return False
    sag = start.sag(scenario, scenario.sensor.bias_std)
    return sag > _BENT * scenario.sensor.range_std and scenario.filter.defaults > 26


def needs_biases(scenario: Scenario, range_std: float, axes: int) -> bool:
    """Whether ranges of a target that turns may be lastingly wrong, as only one motion with biases beside it explains.

    Several motions explain biases of which the scenario tells, where agents tell each other their ranges. And those of
    receivers with larger faults, as ranges that are wrong, where each agent weighs how likely that is; by the
    twenty-fifth rules they did not. range_std: m.
    """
    chosen, sensor = scenario.filter, scenario.sensor
    if not trust.may_be_biased(scenario) or chosen.bias == "none" or tells_biased(scenario, axes):
        return False
    constant = trust.real(scenario) or sensor.bias_std > 0.0 or bool(np.any(np.array(sensor.bias)))
    wrong = not (constant or trust.hidden_bias(scenario)) and chosen.bias == "auto" and chosen.defaults > 25
    return not (wrong and weighing.weighed_errors(scenario, range_std, several=True))


def _may(scenario: Scenario, least: int, *, several: bool) -> bool:
    """Whether the scenario leaves it open, and its agents, all honest, are few and hear each other's very numbers.

    But more than there are unknowns in a step, the least number: with less ranges any place fits, or its mirror image
    does. Hypotheses that are kept from step to step need no place that is known in each, and by the sixteenth rules
    none but a mirror image that is denied: of several motions as many agents are enough as there are axes.
    """
    chosen, stage = scenario.filter, scenario.consensus
    able = abilities_of(chosen.kind)
    left_open = (chosen.xi, chosen.saturation, chosen.linearise, chosen.bias) == ("auto",) * 4
    exact = stage.precision == "float64" and not (stage.trigger or stage.lag or stage.trim)
    honest = not (trust.suspects(scenario) or trust.real(scenario))
    few = least < scenario.count <= network.FEW and stage.rounds > 0
    left_open &= not trust.recovers(scenario)
    fits = able.saturates and able.biases and left_open and _explained(scenario, several=several)
    return chosen.defaults > 11 and few and exact and honest and fits


def may_mistake(scenario: Scenario, range_std: float, axes: int) -> bool:
    """Whether a first fix may take wrong ranges for right ones: there are some, or guesses are too wide to be tried.

    Of a wrong receiver only if the others are as few as the unknowns: then no other agent proves which it is.

    Only where the scenario leaves it to agents how they find their target. Mirror images are better estimated without.
    """
    chosen, sensor = scenario.filter, scenario.sensor
    if chosen.defaults < 13:
        return False
    none_to_spare = trust.errs(scenario) and scenario.count == axes + 2
    wrong = sensor.outlier_probability > 0.0 or none_to_spare or start.bends_over_guess(scenario)
    wanted = chosen.start != "given" and chosen.reacquire
    return wrong and _comes(scenario) and wanted and not near_plane.flat(scenario, range_std, axes)


def leaves_curves(scenario: Scenario, motions: Sequence[Motion], range_std: float) -> bool:
    """Whether a Gaussian may not say what ranges leave open, as that is a curve, or several places.

    Where receivers may fall silent, and where ranges bend over what motion and geometry leave open. Of several motions
    the most agile one is assumed seldom, so there it takes more: over one half as agile ranges bend, which all do
    alike, by more than the noise of their mean; or steps are so long that the target may turn round in one.
    """
    agile = motions[-1]
    if scenario.filter.defaults < 15 or not _comes(scenario):
        return False
    if network.counts_hearers(scenario):
        return True
    if len(motions) > 1:
        between = sqrt(motions[-2].acceleration_std * agile.acceleration_std)
        motion = NearlyConstantVelocity(scenario.dt, between, agile.axes)
        bend = bending.bending(scenario, motion, range_std, scenario.dt)[1]
        swift = agile.acceleration_std
        turns = swift <= turning_round(scenario) or isclose(swift, reversing(scenario))
        return turns or bend * sqrt(scenario.count) > bending.MOST
    flat = (near_plane.flat if scenario.filter.defaults < 26 else bending.mirrored)(scenario, range_std, agile.axes)
    return not flat and bending.weakest(scenario, agile, range_std) > bending.STRAIGHT


def splits(scenario: Scenario, motions: Sequence[Motion], range_std: float) -> int:
    """How agents that tell each other their ranges split hypotheses: see `FilterSettings.splits`."""
    if leaves_curves(scenario, motions, range_std) or none_to_spare(scenario, motions):
        return CLOSELY
    return ROUGHLY * (len(motions) > 1 and scenario.filter.defaults > 13)


def none_to_spare(scenario: Scenario, motions: Sequence[Motion]) -> bool:
    """Whether agents that keep several hypotheses of each of several motions are no more than a step's unknowns.

    Between turns ranges then leave curves, and a seed may place four agents in one plane.
    """
    return len(motions) > 1 and scenario.count <= motions[0].axes + 1 and scenario.filter.defaults > 15


def _comes(scenario: Scenario) -> bool:
    """Whether every range comes to every agent in its step, whatever the graph, with an error that is noise as known.

    Or, by today's rules, as each agent learns it. What doubts a noise that is told stands around other filters, and
    small biases that are drawn are better estimated without.
    """
    noise = scenario.filter.range_std
    known = noise is None or (noise == "auto" and scenario.filter.defaults > 15)
    return _everywhere(scenario) and known and scenario.sensor.bias_std == 0.0


def _everywhere(scenario: Scenario) -> bool:
    """Whether every range comes to every agent in its step, whatever the graph."""
    return scenario.consensus.rounds >= scenario.count - 1


def _explained(scenario: Scenario, *, several: bool) -> bool:
    """Whether ranges have no constant errors, but such as are estimated together, or are so large that they show.

    Beside several motions these may have a part in common.
    """
    sensor, given = scenario.sensor, bool(np.any(np.array(scenario.sensor.bias)))
    if scenario.filter.bias_common_std is not None or (given and not (several and scenario.filter.defaults > 16)):
        return False
    return (sensor.bias_std == 0.0 and not given) or trust.shares_biases(scenario)


def _strays(scenario: Scenario, motion: Motion, range_std: float, settling: int) -> bool:
    """Whether ranges bend over how far the target strays from a straight line while a first fix is made.

    By a white acceleration, twice integrated, of variance q^2 D T^3/3. A range over a distance d, here half of the box
    around the agents, bends by that over 2 d.
    """
    power, half = motion.acceleration_std**2 * scenario.dt, start.half_box(scenario)
    strays = power * (settling * scenario.dt) ** 3 / 3.0
    return half > 0.0 and strays / (2.0 * half) > bending.MOST * range_std
