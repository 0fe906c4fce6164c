"""What ranges count for, as some of them may be wrong, where the keys leave that to 'auto'."""

from __future__ import annotations

from zenoh_cbef.faults import SensorSpikes
from zenoh_cbef.scenario import trust
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.tracking.filters import abilities_of
from zenoh_cbef.tracking.outliers import Errors, Outliers, Untold

_XI = {1: 1.5, 2: 2.0}
"""Saturation level by the saturation's power, in standard deviations.

At 2 a redescending weight costs no more on Gaussian ranges than a bounded one at 1.5: a hundredth of the error.
"""


def saturation_power(scenario: Scenario, *, biased: bool, fixed: bool, several: bool) -> int:
    """The power of the saturation: 1 bounds the pull of an outlier, 2 lets it fall (redescending).

    Auto: 2 where ranges have outliers, by the fifteenth rules also spikes, or may have them untold. These are real
    ones, by the first rules (filter.defaults) only if biases are estimated or weighed (biased) and the noise is given:
    at a level of 1.5, good ranges looked alike otherwise. By today's they are also those of a network that begins with
    a first fix (fixed) and whose target moves as its filter assumes: from a wrong place, or after a turn, good ranges
    look alike, too. To several motions turns are nothing new, and what no motion explains is wrong.
    """
    chosen = scenario.filter
    if chosen.saturation != "auto":
        return 2 if chosen.saturation == "redescending" else 1
    trusted = trust.rules(scenario) == 1 and not (biased and chosen.range_std != "auto")
    if trust.real(scenario):
        untold = not trusted
    else:
        expected = scenario.target.motion == "ncv" and chosen.motion == "auto" and chosen.defaults > 2
        untold = fixed and (expected or (several and chosen.defaults > 17))
    told = scenario.sensor.outlier_probability > 0.0 or (chosen.defaults > 14 and trust.has(scenario, SensorSpikes))
    return 2 if told or untold else 1


def weighed_errors(scenario: Scenario, range_std: float, *, several: bool) -> Errors | None:
    """How wrong ranges of emulated receivers are distributed, where agents weigh ranges by that.

    As the scenario tells, or by today's rules, if they assume several motions, as wrong ranges are that it does not
    tell of. They saturate ranges alone where the scenario asks for that, or a filter of one motion is told nothing.
    """
    chosen, sensor = scenario.filter, scenario.sensor
    left_open = (chosen.xi, chosen.saturation) == ("auto", "auto") and abilities_of(chosen.kind).outliers
    if chosen.defaults < 16 or not left_open or trust.real(scenario):
        return None
    if sensor.outlier_probability > 0.0:
        return Outliers(sensor.outlier_probability, sensor.outlier_scale)
    return Untold.of(range_std, _XI[1], bursts=chosen.defaults > 18) if several and chosen.defaults > 17 else None


def widens(scenario: Scenario, *, power: int, wide: bool) -> float:
    """How far a range far off widens its whole innovation, not its noise alone: where the saturation redescends.

    And where priors may be wide against the noise: of several motions one is agile, squares are for wide priors (wide),
    and of real targets little is known. Elsewhere it is the same but for a thousandth of the error, which it costs.
    Of a real target that one motion follows a range far off may as well tell a turn as be wrong: halfway, by the rules
    from the 24th on.
    """
    if scenario.filter.defaults < 7 or power == 1 or not (wide or trust.real(scenario)):
        return 0.0
    return 1.0 if wide or scenario.filter.defaults < 24 else 0.5


def saturation_level(scenario: Scenario, power: int) -> float:
    """At how many standard deviations ranges saturate; for kinds that saturate otherwise see filter.xi."""
    chosen = scenario.filter
    if chosen.xi != "auto":
        return chosen.xi
    return _XI[power if abilities_of(chosen.kind).saturates else 1]
