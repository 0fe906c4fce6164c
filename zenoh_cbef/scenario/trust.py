"""How far a scenario's agents trust ranges and each other, where the keys leave that to 'auto'."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.faults import Fault, SenderFault, SensorBias, SensorDropout, SensorFault, SensorSpikes, SensorStuck
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.tracking.filters import abilities_of
from zenoh_cbef.tracking.filters.around.returning import ALONE_BEND
from zenoh_cbef.tracking.filters.models import joint_biases

_SHOWS = 6.0
"""How large a bias is, in noises, that each range shows: all but a fiftieth of them are beyond what is taken for right.
"""

_SCALE_STD = 0.05
"""By what share recorded ranges are all too long or too short: sound is 2 % faster in air that is 10 K warmer, and
clocks, radios and maps have errors of their own."""


def real(scenario: Scenario) -> bool:
    """Whether ranges come from real receivers, live or recorded: then they have biases and outliers."""
    return scenario.target.motion == "dataset" or scenario.sensor.real


def rules(scenario: Scenario) -> int:
    """By which rules (filter.defaults) 'auto' decides on real ranges: the first where agents learn noise alone.

    The later ones judge ranges by a noise that is known, or that the network learns as errors that last ask for.
    """
    chosen = scenario.filter
    return 1 if real(scenario) and chosen.range_std == "auto" and not lasts(scenario) else chosen.defaults


def presumes(scenario: Scenario) -> bool:
    """Whether agents presume that ranges fit and that others are there before they know; today where ranges are real.

    Errors of real ranges last, and a target at rest repeats them.
    """
    return scenario.filter.defaults < 12 or real(scenario)


def alone_bend(scenario: Scenario) -> float | None:
    """See `FilterSettings.alone_bend`: by earlier rules, and where ranges are real, agents know less of being alone."""
    return ALONE_BEND if scenario.filter.defaults > 19 and not presumes(scenario) else None


def proves(scenario: Scenario) -> bool:
    """Whether ranges that fit another fix prove it, and nothing less does: where ranges are real."""
    return scenario.filter.defaults > 15 and real(scenario)


def lasts(scenario: Scenario) -> bool:
    """Whether errors of successive ranges may be alike, and agents learn how much: where ranges are recorded.

    Not of live receivers: of those a scenario often tells an acceleration that is too small. An estimate that lags has
    alike residuals, too, and to trust ranges less would make it lag the more.
    """
    chosen = scenario.filter
    known = abilities_of(chosen.kind).noise and chosen.measurement == "range"
    return scenario.target.motion == "dataset" and chosen.defaults > 3 and known


def doubts_noise(scenario: Scenario, *, several: bool) -> bool:
    """Whether agents compare the noise that they begin with, with half and double of it: where ranges are recorded.

    And where a filter that saturates is told a noise of emulated ranges, of a target that moves as it assumes, or by
    one of several motions. Not of live receivers: of those a scenario often tells an acceleration that is too small. An
    estimate that lags has large innovations, and to trust ranges less would make it lag the more.
    """
    chosen = scenario.filter
    if scenario.target.motion == "dataset":
        # A noise that is learned is that of what does not last of errors, and leaves agents too sure of themselves.
        return lasts(scenario) and chosen.defaults > (11 if chosen.range_std == "auto" else 5)
    told = isinstance(chosen.range_std, float) and chosen.defaults > 6 and not real(scenario)
    able = abilities_of(chosen.kind)
    known = able.biases and able.saturates and chosen.measurement == "range" and chosen.acceleration_std is None
    assumed = scenario.target.motion == "ncv" and chosen.motion in ("auto", "ncv")
    return told and known and (assumed or several)


def may_be_biased(scenario: Scenario) -> bool:
    """Whether ranges may have a constant error: where they are real, or the scenario says so."""
    sensor = scenario.sensor
    told = bool(np.any(np.array(sensor.bias))) or sensor.bias_std > 0.0
    return told or _lastingly_at_fault(scenario) or real(scenario)


def zero_is_none(scenario: Scenario) -> bool:
    """Whether a range of zero is none: its receiver may be wrong by a constant, and found less than nothing.

    It tells zero then, however large its constant. Real ones write zero where they measured nothing.
    """
    return may_be_biased(scenario) and scenario.filter.defaults > 27


def may_be_wrong(scenario: Scenario) -> bool:
    """Whether ranges may have an error beside their noise, of which the scenario tells."""
    return may_be_biased(scenario) or scenario.sensor.outlier_probability > 0.0


def tells_biases(scenario: Scenario) -> bool:
    """Whether the scenario tells how large the biases of its emulated receivers are."""
    drawn = scenario.sensor.bias_std > 0.0 and scenario.filter.defaults > 6
    return (drawn or any(_given_biases(scenario)) or hidden_bias(scenario) > 0.0) and not real(scenario)


def hidden_bias(scenario: Scenario) -> float:
    """The size of constant biases of which faults tell and that agents estimate, root mean square over agents, m.

    Agents may know it, but not whose they are. They are estimated by few agents alone, which do so together. None where
    a receiver has another fault as well, which no constant explains.
    """
    faults = [one for one in scenario.fault if isinstance(one, SensorFault) and one.error > 0.0]
    few = 1 < scenario.count <= joint_biases.MOST and scenario.consensus.rounds > 0
    if scenario.filter.defaults < 16 or real(scenario) or not few or np.any(np.array(scenario.sensor.bias)):
        return 0.0
    if not all(_is_hidden(one, scenario) for one in faults):
        return 0.0
    shares = [one.error**2 * (len(one.named()) or scenario.count) / scenario.count for one in faults]
    return float(np.sqrt(sum(shares)))


def _is_hidden(fault: SensorFault, scenario: Scenario) -> bool:
    """Whether it is a bias of a whole run that is too small for single ranges to show it, or one among drawn biases.

    Those are estimated anyway, and one that is larger than most would have to be as large as they are.
    """
    whole = fault.since <= scenario.dt and fault.until is None
    small = fault.error < _SHOWS * scenario.sensor.range_std
    return isinstance(fault, SensorBias) and whole and (small or scenario.sensor.bias_std > 0.0)


def _given_biases(scenario: Scenario) -> tuple[float, float]:
    """The size of the bias that a scenario gives its receivers, and their spread about it, m, of most of them.

    Agents may know these sizes, and no signs. Medians, as a single receiver that is wrong is found by other means.
    """
    if scenario.filter.defaults < 12 or real(scenario):
        return 0.0, 0.0
    given = np.atleast_1d(scenario.sensor.bias)
    return abs(float(np.median(given))), float(np.median(np.abs(given - np.median(given))))


def bias(scenario: Scenario, *, unfit: bool) -> str:
    """What the filter does about biases: none, estimate, or auto where it can weigh them.

    Auto: emulated receivers of which the scenario tells no bias need no states for it, half of the bytes, and biases
    that are told need no weighing. unfit: the filter is of another sort than biases are estimated beside.
    """
    chosen = scenario.filter
    if not abilities_of(chosen.kind).biases:
        return "none"
    if chosen.bias != "auto":
        return chosen.bias
    if unfit or not may_be_biased(scenario):
        return "none"
    return "estimate" if tells_biases(scenario) else "auto"


def shares_biases(scenario: Scenario) -> bool:
    """Whether agents estimate all biases together, if any: where they are few.

    And where the scenario tells all that is constant of emulated ranges, or ranges are recorded.
    """
    chosen = scenario.filter
    few = 1 < scenario.count <= joint_biases.MOST and scenario.consensus.rounds > 0
    if scenario.target.motion == "dataset":
        return few and chosen.defaults > 11
    unexplained = errs(scenario) and not hidden_bias(scenario)
    told = tells_biases(scenario) and not unexplained and _are_alike(scenario)
    return told and few and chosen.defaults > 8 and chosen.bias_common_std is None


def _are_alike(scenario: Scenario) -> bool:
    """Whether no single receiver has a bias of another size than most have."""
    return any(_given_biases(scenario)) or not np.any(np.array(scenario.sensor.bias))


def common_bias_std(scenario: Scenario, range_std: float, *, joint: bool) -> float:
    """Prior standard deviation of what all agents' biases have in common, m; where each is a state (joint), as told."""
    given = scenario.filter.bias_common_std
    if given is not None:
        return given
    told = _given_biases(scenario)[0]
    return told if joint and not real(scenario) else max(1.5 * range_std, told)


def own_bias_std(scenario: Scenario, range_std: float) -> float:
    """Prior standard deviation of the agents' own biases, m: as told, or a share of the noise."""
    given = scenario.filter.bias_own_std
    if given is not None:
        return given
    least = (0.2 if real(scenario) and scenario.filter.defaults > 27 else 0.15) * range_std
    told = scenario.sensor.bias_std if tells_biases(scenario) else 0.0
    return max(least, float(np.hypot(np.hypot(told, _given_biases(scenario)[1]), hidden_bias(scenario))))


def scale_std(scenario: Scenario) -> float:
    """Prior standard deviation of the share by which all ranges of agents that share their biases are too long."""
    return _SCALE_STD if scenario.target.motion == "dataset" and scenario.filter.defaults > 13 else 0.0


def distrusts(scenario: Scenario, *, others: bool) -> bool:
    """Whether agents distrust their own receivers while implausible.

    Auto: where receivers are real or at fault, and what neighbours say of theirs is not to be doubted (others).
    """
    chosen = scenario.filter
    if chosen.distrust != "auto":
        return chosen.distrust
    comparable = abilities_of(chosen.kind).information and chosen.measurement == "range" and not others
    return comparable and (_at_fault(scenario) or (real(scenario) and rules(scenario) > 1))


def recovers(scenario: Scenario) -> bool:
    """Whether the network widens its covariances where most innovations are implausible.

    Auto: where ranges are real, which saturate so much that a target seems to be where it was. A real one stops, starts
    and turns as it likes, and one motion does not allow for that.
    """
    chosen = scenario.filter
    if chosen.recovery != "auto":
        return chosen.recovery
    together = scenario.count > 1 and scenario.consensus.rounds > 0
    return real(scenario) and together and abilities_of(chosen.kind).information and chosen.defaults > 21


def notices(scenario: Scenario) -> int:
    """In how many steps each agent has a range, where the network recovers by real ranges; 0: it does not."""
    interval = scenario.filter.acceleration_interval or scenario.dt
    asked = recovers(scenario) and real(scenario) and scenario.filter.defaults > 21
    return asked * max(1, round(interval / scenario.dt))


def curves(scenario: Scenario) -> bool:
    """Whether agents count what linearising a range leaves out: where it is real, and one motion has to explain it."""
    chosen = scenario.filter
    able = abilities_of(chosen.kind).information and chosen.measurement == "range"
    return able and real(scenario) and chosen.defaults > 23


def suspects(scenario: Scenario) -> bool:
    """Whether neighbours may send wrong values."""
    stage = scenario.consensus
    return stage.trim > 0 or stage.isolate is True or _has_liars(scenario)


def isolates(scenario: Scenario) -> bool:
    """Whether agents leave out implausible neighbours; auto: with liars, where messages are judged as they are sent."""
    stage = scenario.consensus
    if stage.isolate != "auto":
        return stage.isolate
    return _has_liars(scenario) and stage.acceleration == "none" and not stage.lag and not stage.trim


def _has_liars(scenario: Scenario) -> bool:
    return has(scenario, SenderFault)


def errs(scenario: Scenario) -> bool:
    """Whether the scenario tells of receivers that will be wrong."""
    return any(isinstance(one, SensorFault) and one.error > 0.0 for one in scenario.fault)


def _lastingly_at_fault(scenario: Scenario) -> bool:
    """Whether receivers will have faults that make ranges wrong for long; by the fourteenth rules any faults.

    A receiver that is silent is not wrong, spikes are outliers, and one that is stuck gives itself away.
    """
    if scenario.filter.defaults < 15:
        return _at_fault(scenario)
    passing = SensorDropout, SensorSpikes, SensorStuck
    return any(isinstance(one, SensorFault) and not isinstance(one, passing) for one in scenario.fault)


def _at_fault(scenario: Scenario) -> bool:
    return has(scenario, SensorFault)


def has(scenario: Scenario, kind: type[Fault]) -> bool:
    """Whether the scenario has a fault of some kind."""
    return any(isinstance(one, kind) for one in scenario.fault)
