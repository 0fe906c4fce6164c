"""What the filter assumes of the target's motion, where the scenario leaves it open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from zenoh_cbef.scenario import start, trust
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.tracking.filters import abilities_of
from zenoh_cbef.tracking.motion import LinearMotion, Motion, MotionSettings, NearlyConstantVelocity, make_motion

RECORDED_ACCELERATION = 1.0
"""Acceleration of a real target where the scenario gives none, m/s^2: a walking person, a trolley, a slow vehicle."""

_INDEX, _CALM, _AGILE = 0.5, 0.01, 10.0
"""Tracking indices q dt^2/sigma (Kalata, IEEE TAES 20(2), 1984) of a target of which nothing else is known.

Below the first a filter averages over many steps, and lags where the target turns; above it the filter hardly averages.
The others are of a target that goes straight on, or round, as long as it does, and of one that changes its velocity as
it likes: in one step it goes astray by several standard deviations of a range, and its velocity jumps at any moment of
that step. Between these two a covariance would be
far too small or too large for a turn that is not quite round, so the first is one of several motions, too.
"""

_CALMEST = 0.002
"""The index of the calm motions since rules 14. Ranges of a few hundred steps hardly tell it from smaller ones."""

_ROUND = 2.0
"""By how many times its velocity a target changes it that turns round."""

_SUDDEN = 10.0
"""By what factor a sudden turn has to be beyond the most agile index for one more motion to allow for it."""

_LASTING, _OFTEN, _ALWAYS = 0.005, 0.03, 0.3
"""How likely a target leaves its motion in a step: a few times in a run, in a turn, and as soon as it begins another.

The last is for few ranges: what happens between two of them then looks like one motion.
"""

_TURNS, _STEP = 0.01, 0.1
"""By what share of its standard deviation at first a turn's rate changes in a step, and in how long a one at most, s.

A target that goes round keeps to its rate. In a longer step the velocity would turn by a larger angle for it.
"""

_FACTORS, _FEWER = (tuple(2.0**power for power in range(least, 5, step)) for least, step in ((-6, 1), (-4, 2)))
"""By what a noise that is in doubt is multiplied: of two that differ by a factor of two, either does."""

_LESS = tuple(2.0**power for power in range(-10, 1))
"""By what the largest noise that a target can have is multiplied."""


def switches(scenario: Scenario, *, alone: bool) -> bool:
    """Whether the filter assumes several motions. alone: whether there is a reason to let a filter stand alone."""
    chosen, target = scenario.filter, scenario.target
    if chosen.motion != "auto" or chosen.defaults == 1:
        return chosen.motion == "imm"
    emulated = target.motion not in ("ncv", "dataset")
    alone |= chosen.recovery is True and chosen.defaults < 4
    return emulated and chosen.acceleration_std is None and not alone


def leaving(scenario: Scenario, *, doubted: bool, told: bool) -> tuple[float, ...]:
    """The probabilities that the target leaves its motion in a step, between which ranges decide; one that is given.

    doubted: its noise, which lasts. told: agents tell each other their ranges.
    """
    chosen = scenario.filter
    if doubted:
        return (_LASTING,)
    if chosen.switching != "auto":
        return (chosen.switching,)
    if chosen.defaults < 13:
        return (_OFTEN,)
    return (_LASTING, _OFTEN, _ALWAYS) if told else (_LASTING, _OFTEN)


def assumed_models(
    scenario: Scenario, range_std: float, axes: int, *, told: bool | None = None, leaps: bool = False
) -> tuple[Motion, ...]:
    """The motions between which the target switches, the most agile one last.

    told: agents tell each other their ranges, so a motion more makes no message longer; None: that is not decided yet.
    leaps: the target may be anywhere a step later.
    """
    chosen, settings = scenario.filter, _settings(scenario, range_std, axes)
    if chosen.models:
        given = [one.model_dump(exclude={"motion"}, exclude_none=True) for one in chosen.models]
        names = [one.motion for one in chosen.models]
        return tuple(make_motion(name, replace(settings, **keys)) for name, keys in zip(names, given, strict=True))
    calm = _noise(scenario, range_std, _CALM) if chosen.acceleration_std is None else chosen.acceleration_std
    middle, agile = (one / _CALM * calm for one in (_INDEX, _AGILE))
    if chosen.acceleration_std is None and chosen.defaults > 14:
        agile = max(agile, turning_round(scenario))
    fastest = reversing(scenario) if chosen.acceleration_std is None else 0.0
    sudden = [(chosen.agile, fastest)] if fastest > _SUDDEN * agile else []
    # In steps in which it may turn round all the same, hypotheses are split closely (telling.leaves_curves).
    strays = told and leaps and not sudden and agile > turning_round(scenario) and chosen.defaults > 20
    if sudden and not told:
        agile, sudden = fastest, []
    elif strays or (told is False and chosen.defaults > 17):
        # Ranges that no motion explains count for nothing there: a velocity may become any other one that is as fast.
        agile = max(agile, fastest / _ROUND)
    if chosen.acceleration_std is None and chosen.defaults > 13:
        calm = _noise(scenario, range_std, _CALMEST)
    between = [("ncv", (middle * agile) ** 0.5)] if told and chosen.defaults > 12 else []
    each = ("ncv", calm), ("turn", calm), ("ncv", middle), *between, (chosen.agile, agile), *sudden
    return tuple(make_motion(name, replace(settings, acceleration_std=std)) for name, std in each)


def farthest(scenario: Scenario) -> float:
    """The acceleration, m/s^2, of a target that may be anywhere in the box around the agents a step later."""
    return max(start.half_box(scenario), start.reach(scenario)) / scenario.dt**2


def doubted_noises(scenario: Scenario, motion: Motion, *, told: bool, leaps: bool = False) -> tuple[Motion, ...]:
    """A motion with several noises, where that of the target is not known: one is given to the filter, or none is.

    Not where ranges are real: there biases are estimated beside the motion, or errors last. told: agents tell each
    other their ranges, and each noise has many branches. leaps: the motion's noise is the largest one.
    """
    chosen, stage = scenario.filter, scenario.consensus
    told_of = scenario.target.motion == "ncv" and chosen.acceleration_std is None and not _begins_at_rest(scenario)
    known = told_of or chosen.defaults < 13
    exact = not (stage.precision.startswith("int") or stage.trigger or stage.lag or stage.trim)
    together = exact and scenario.count > 1 and stage.rounds > 0 and chosen.measurement == "range"
    doubted = together and not (known or trust.real(scenario))
    if not doubted or not isinstance(motion, LinearMotion) or motion.size > 2 * motion.axes:
        return ()
    return tuple(
        replace(motion, acceleration_std=factor * motion.acceleration_std)
        for factor in (_LESS if leaps else _FEWER if told else _FACTORS)
    )


def assumed_motion(scenario: Scenario, range_std: float, axes: int, *, leaps: bool = False) -> Motion:
    """The filter's model, if it is a single one. range_std: m, what the filter assumes. axes: 3, or 2 in a plane.

    leaps: the target may be anywhere a step later.

    Auto: decay where ranges are real. A real target may be unheard for long, and does not go straight on all the while.
    """
    chosen = scenario.filter
    silent = trust.real(scenario) and trust.rules(scenario) > 1 and abilities_of(chosen.kind).covariance
    names = {"auto": "decay" if silent else "ncv", "imm": "ncv"}
    settings = _settings(scenario, range_std, axes)
    if leaps:
        return make_motion(chosen.agile, replace(settings, acceleration_std=farthest(scenario)))
    return make_motion(names.get(chosen.motion, chosen.motion), settings)


def plain_motion(motions: Sequence[Motion], otherwise: Motion) -> LinearMotion:
    """The first of some motions that is linear in position and velocity and has no other state, or ncv."""
    for motion in motions:
        if isinstance(motion, LinearMotion) and motion.size == 2 * motion.axes:
            return motion
    return NearlyConstantVelocity(otherwise.dt, otherwise.acceleration_std, otherwise.axes)


def turning_round(scenario: Scenario) -> float:
    """The acceleration, m/s^2, that turns a target round in one step, as far as its velocity is known at first.

    In steps of a tenth of a second the most agile index allows for far more; in long ones, by ranges and step alone, a
    target could hardly turn.
    """
    return _ROUND * float(start.initial_std(scenario)[3]) / scenario.dt


def reversing(scenario: Scenario) -> float:
    """The same of a target as fast as it may be at first: the more precise ranges are, the less an index allows.

    0 by the fifteenth rules.
    """
    return _ROUND * start.reach(scenario) / scenario.dt**2 if scenario.filter.defaults > 15 else 0.0


def _settings(scenario: Scenario, range_std: float, axes: int) -> MotionSettings:
    chosen = scenario.filter
    return MotionSettings(
        dt=scenario.dt,
        acceleration_std=_acceleration_std(scenario, range_std),
        axes=axes,
        interval=chosen.acceleration_interval,
        velocity_time=chosen.velocity_time,
        turn_rate_std=chosen.turn_rate_std,
        turn_rate_change=turn_rate_change(scenario),
        throughout=chosen.defaults < 16,
        keeps_speed=chosen.defaults > 15,
    )


def turn_rate_change(scenario: Scenario) -> float | None:
    """By what share of its standard deviation at first a turn's rate changes in a step; None: by all in a second."""
    given = scenario.filter.turn_rate_change
    if given != "auto":
        return given
    return _TURNS * min(1.0, _STEP / scenario.dt) if scenario.filter.defaults > 22 else _TURNS


def _acceleration_std(scenario: Scenario, range_std: float) -> float:
    """The filter's q: given, or of a key that describes this very motion, or from noise and step."""
    target, given = scenario.target, scenario.filter.acceleration_std
    if given is not None:
        return given
    of_target = target.motion == "ncv" and not _begins_at_rest(scenario)
    if of_target or (scenario.filter.defaults == 1 and target.motion != "dataset"):
        return target.acceleration_std
    if target.motion == "dataset":
        return RECORDED_ACCELERATION
    index = _noise(scenario, range_std, _INDEX)
    if scenario.filter.defaults < 16 or not _begins_at_rest(scenario) or trust.real(scenario):
        return index
    # What takes a target from rest as far as it gets in a step.
    return max(index, 2.0 * start.reach(scenario) / scenario.dt**2)


def _begins_at_rest(scenario: Scenario) -> bool:
    """Whether each step does for the filter: its q then is no acceleration of a target that keeps its velocity."""
    return scenario.filter.motion == "stationary" and scenario.filter.defaults > 14


def _noise(scenario: Scenario, range_std: float, index: float) -> float:
    """The acceleration, m/s^2, of a tracking index, from one range of an agent to its next."""
    return index * range_std / (scenario.filter.acceleration_interval or scenario.dt) ** 2
