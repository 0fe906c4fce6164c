"""The agents' estimates of the target before the first step, and their standard deviations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from zenoh_cbef import streams
from zenoh_cbef.arrays import Floats
from zenoh_cbef.courses import COURSES
from zenoh_cbef.faults import Absences
from zenoh_cbef.scenario import paths, trust
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.scenario.world import target_start
from zenoh_cbef.tracking.filters import abilities_of
from zenoh_cbef.tracking.filters.damping import Damping
from zenoh_cbef.tracking.filters.settings import UNLIKELY
from zenoh_cbef.tracking.motion import Motion, begun
from zenoh_cbef.tracking.ranging import Space

_FARTHEST = 10.0
"""Where a first fix looks for the target: least standard deviation in half diagonals of the box around the agents."""

_FEW = 12
"""The most agents that tell each other what they measured: one wrong receiver among more does little."""

_FASTEST = 3.0
"""Least standard deviation of the target's velocity before the first fix, m/s."""

_MOST = 6.0
"""How many standard deviations no guess is off: a target is no faster than that where it is told to be slow."""


def initial_std(scenario: Scenario) -> Floats:
    """Standard deviations of the initial estimate, (6,): m, then m/s."""
    position, velocity = scenario.filter.initial_position_std, scenario.filter.initial_velocity_std
    if position is None and scenario.target.motion == "dataset":
        position = half_diagonal(scenario) or None
    return np.repeat([position or 1.0, velocity or 1.0], 3)


def widened_std(scenario: Scenario) -> Floats:
    """As initial_std, where the network looks for its target by a first fix, (6,)."""
    least = np.repeat([_FARTHEST * half_diagonal(scenario), _FASTEST], 3)
    return np.asarray(np.maximum(initial_std(scenario), least))


def first_std(scenario: Scenario, *, fixed: bool) -> Floats:
    """That with which agents begin, (6,): wide before a first fix of a target of whose start nothing is said."""
    return (widened_std if fixed and unknown(scenario) else initial_std)(scenario)


def reach(scenario: Scenario) -> float:
    """How far an emulated target gets in a step, m, if it is as fast as agents are told at first, in any direction.

    By the twentieth rules it is fast, 3 m/s, also where agents are told of a slow one.
    """
    given, std = scenario.filter.initial_velocity, float(initial_std(scenario)[3])
    least = min(_FASTEST, _MOST * std) if scenario.filter.defaults > 20 else _FASTEST
    # A motion of another package may begin otherwise under another seed, and plans are the same for all.
    known = np.zeros(3) if scenario.target.motion not in COURSES else target_start(scenario)[3:]
    told = np.linalg.norm(np.atleast_2d(known if given is None else given), axis=1)
    return max(least, std, float(told.max())) * scenario.dt


def leaps(scenario: Scenario, range_std: float) -> bool:
    """Whether ranges bend by more than their noise (m) over that: then a step is long for any target that turns."""
    return scenario.filter.defaults > 14 and reach(scenario) ** 2 > 2.0 * half_box(scenario) * range_std


def unknown(scenario: Scenario) -> bool:
    """Whether the scenario says nothing of where its target, a recorded one, starts."""
    return scenario.target.motion == "dataset" and scenario.filter.initial_position is None


def unguided_seconds(scenario: Scenario, fix: int) -> float:
    """For how long, s, estimates are of no place: until a first fix of so many steps, where no guess is given."""
    return fix * scenario.dt if unknown(scenario) else 0.0


def _adds_up(scenario: Scenario) -> bool:
    """Whether what agents know of the target can be added up for a fix, and none of them lies."""
    return abilities_of(scenario.filter.kind).biases and not trust.suspects(scenario)


def settling_steps(scenario: Scenario) -> int:
    """After how many steps a network has found its target: at least 20, and about five ranges of every agent."""
    interval = scenario.filter.acceleration_interval or scenario.dt
    return max(20, int(np.ceil(5.0 * interval / scenario.dt)))


def absences(scenario: Scenario) -> Absences:
    """When the scenario's agents are not there."""
    return Absences(scenario.fault, agents=scenario.count, dt=scenario.dt, steps=scenario.length)


def fix_steps(scenario: Scenario, settling: int, absences: Absences) -> int:
    """How many steps a first fix takes that needs `settling` of them; 0 where the network begins without one."""
    chosen = scenario.filter
    if not _adds_up(scenario):
        return 0
    if unknown(scenario):
        return settling
    alone = scenario.count == 1 or scenario.consensus.rounds == 0
    if chosen.start == "given" or chosen.defaults < 2 or alone:
        return 0
    # By the fifteenth rules an agent that has lost its memory cannot join a fix that is under way.
    back = any(absences.reborn(step).any() for step in range(1, min(settling, scenario.length) + 1))
    return 0 if back and chosen.defaults < 16 else settling


def window(scenario: Scenario, settling: int) -> int:
    """How many steps a later fix takes where the first one takes `settling`; 0 where there is none."""
    chosen = scenario.filter
    alone = scenario.count == 1 or scenario.consensus.rounds == 0
    asked = chosen.status and chosen.reacquire and _adds_up(scenario)
    return settling // 2 if asked and not alone else 0


def supposes(scenario: Scenario, window: int) -> bool:
    """Whether agents tell each other what they measured, where ranges of one do not fit: where they are few.

    Not where ranges are real: there errors last, and no hypothesis of one wrong receiver explains them.
    """
    chosen = scenario.filter
    axes = 3 if chosen.planar_height is None else 2
    few = axes + 1 < scenario.count <= _FEW
    return window > 0 and few and chosen.defaults > 4 and chosen.range_std != "auto" and not trust.real(scenario)


def spreading(scenario: Scenario, window: int) -> int:
    """In how many steps all agents know a decision, whatever the graph, at most half of a window of steps."""
    steps = 1 + np.ceil((scenario.count - 1) / max(1, scenario.consensus.rounds))
    return int(min(steps, window // 2))


def deciding(scenario: Scenario, window: int) -> int:
    """Every how many steps agents decide whether another fix begins; 0: once in each window.

    Where ranges are real they may be rare: a window of them is seconds, which a network that was silent need not wait.
    """
    return spreading(scenario, window) + 1 if trust.real(scenario) and scenario.filter.defaults > 12 else 0


def squared_steps(scenario: Scenario, steps: int) -> int:
    """How many steps of a first fix are on squared ranges: half, or as few as give every unknown a range."""
    half = steps // 2
    if scenario.target.motion == "dataset" or among_outliers(scenario):
        return half
    unknowns = 4 if scenario.filter.planar_height is None else 3
    heard = scenario.count * (1.0 - scenario.sensor.dropout_probability)
    return int(min(half, np.ceil(unknowns / max(heard, 1.0))))


def among_outliers(scenario: Scenario) -> bool:
    """Whether the scenario tells of outliers: few squared steps, or a guess, cannot tell them from ranges."""
    return scenario.filter.defaults > 2 and scenario.sensor.outlier_probability > 0.0


def outliers(scenario: Scenario) -> tuple[float, float] | None:
    """What share of the ranges are outliers, and their mean, m, where a first fix takes them into account."""
    sensor = scenario.sensor
    return (sensor.outlier_probability, sensor.outlier_scale) if among_outliers(scenario) else None


def implausible_share(scenario: Scenario) -> float:
    """From which share of implausible innovations on a network takes its estimate for lost, not ranges for outliers.

    Half of the ranges that are none, and all outliers of which the scenario tells.
    """
    told = outliers(scenario) if scenario.filter.defaults > 13 else None
    return 0.5 if told is None else 0.5 * (1.0 + told[0])


def tries_guess(scenario: Scenario) -> bool:
    """Whether a first fix tries the guess: where ranges are straight lines over how far that may be off."""
    return scenario.filter.defaults > 2 and not among_outliers(scenario) and not bends_over_guess(scenario)


def bends_over_guess(scenario: Scenario) -> bool:
    """Whether ranges bend by more than their noise over how far a guess may be off."""
    return bool(sag(scenario, initial_std(scenario)[0]) >= scenario.sensor.range_std)


def sag(scenario: Scenario, std: float) -> float:
    """By how much, m, a range over half of the box bends over so many metres across it."""
    return float(std**2 / (2.0 * max(half_box(scenario), 1e-3)))


def search(scenario: Scenario) -> tuple[Floats, Floats]:
    """Where a first fix looks for a target, and how far around that: a state and its standard deviations, (6,).

    It is at rest in the middle of the box that agents are placed in, and at least ten of its half diagonals around: the
    same for all agents and for all seeds, as these are one batch.
    """
    low, high = box(scenario)
    if unknown(scenario):
        return initial_states(scenario)[0], widened_std(scenario)
    given = initial_std(scenario)
    far = np.full(3, _FARTHEST * max(half_box(scenario), 1e-3))
    return np.concatenate([0.5 * (low + high), np.zeros(3)]), np.concatenate([np.maximum(far, given[0]), given[3:]])


def anywhere(scenario: Scenario, motion: Motion, space: Space) -> tuple[Floats, Floats]:
    """Where a fix looks for the target, as a state of the filter (1, s) with its covariance (1, s, s)."""
    state, std = (each[space.kept] for each in search(scenario))
    return begun(motion, state[None], np.diag(std**2)[None])


def guesses(scenario: Scenario) -> tuple[int, int]:
    """How many guesses of position, and of velocity, agents make independently of one another: one if it is given."""
    chosen = scenario.filter
    if scenario.target.motion == "dataset":
        return 1, 1
    return _independent(chosen.initial_position, scenario.count), _independent(chosen.initial_velocity, scenario.count)


def guessed(scenario: Scenario) -> tuple[float, float]:
    """Standard deviations of the mean of all guesses, of position, m, and of velocity, m/s."""
    std, (places, speeds) = initial_std(scenario), guesses(scenario)
    return float(std[0] / np.sqrt(places)), float(std[3] / np.sqrt(speeds))


def _independent(given: Sequence[float] | Sequence[Sequence[float]] | None, count: int) -> int:
    return 1 if given is not None and not isinstance(given[0], Sequence) else count


def middle(scenario: Scenario) -> tuple[float, ...]:
    """A point near all agents, (3,), m: the same for all seeds, as these are one batch."""
    return tuple(paths.placement(scenario, seed=0).mean(axis=0).tolist())


def box(scenario: Scenario) -> tuple[Floats, Floats]:
    """Least and largest coordinates (3,) of where agents may be placed at first, whatever the seed."""
    agents = scenario.agents
    if agents.motion == "waypoints" or agents.positions is not None:
        places = paths.placement(scenario)
        return places.min(axis=0), places.max(axis=0)
    return np.broadcast_to(agents.low, 3), np.broadcast_to(agents.high, 3)


def half_box(scenario: Scenario) -> float:
    """Half of the diagonal of that box, m."""
    low, high = box(scenario)
    return float(np.linalg.norm(high - low)) / 2.0


def half_diagonal(scenario: Scenario) -> float:
    """Half of the diagonal of the box around the agents, m."""
    return float(np.linalg.norm(np.ptp(paths.placement(scenario), axis=0))) / 2.0


def damping(scenario: Scenario, axes: int) -> Damping | None:
    """Of fixes on real ranges, of which any number may be wrong."""
    if scenario.filter.defaults < 23 or not trust.real(scenario):
        return None
    return Damping(middle(scenario)[:axes], 2.0 * half_diagonal(scenario))


def initial_states(scenario: Scenario) -> Floats:
    """The agents' estimates before step 1, as configured, (n, 6).

    A given position or velocity is taken as it is. What is not given is drawn around the target's own start with
    the initial standard deviations; for recorded data it is the middle of the agents, at rest.
    """
    count, chosen = scenario.count, scenario.filter
    if scenario.target.motion == "dataset":
        derived = np.zeros((count, 6))
        derived[:, :3] = paths.placement(scenario).mean(axis=0)
    else:
        key = streams.stream(scenario.seed, "initial estimate", np.arange(count))[:, None]
        noise = streams.normal(key, np.arange(6))
        derived = target_start(scenario) + initial_std(scenario) * noise
    if chosen.initial_position is not None:
        derived[:, :3] = np.array(chosen.initial_position)
    if chosen.initial_velocity is not None:
        derived[:, 3:] = np.array(chosen.initial_velocity)
    if chosen.planar_height is not None:
        derived[:, 2], derived[:, 5] = chosen.planar_height, 0.0
    return derived


def most_bias(scenario: Scenario, range_std: float, *, joint: bool) -> float:
    """From what size on a bias of real ranges is beyond belief, m: as in a status, with the share over half of the box.

    range_std: m. joint: whether agents estimate all biases together, and a share.
    """
    if scenario.filter.defaults < 29 or not trust.real(scenario):
        return np.inf
    share = trust.scale_std(scenario) * half_box(scenario) if joint else 0.0
    common = trust.common_bias_std(scenario, range_std, joint=joint)
    return UNLIKELY * float(np.linalg.norm([common, trust.own_bias_std(scenario, range_std), share]))
