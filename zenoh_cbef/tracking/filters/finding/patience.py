"""How long a network that has lost its target waits until it looks for it again, and which ranges it leaves to that."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.ranging import Measurement
from zenoh_cbef.tracking.status import LOST, Status

_PATIENCE = 3.0
"""For how many windows the target is lost before the network begins again: outliers come in bursts."""

_SOON = 5.0
"""For how many steps, where its ranges do not fit even now."""

_MISFIT = 3.6
"""The cut NIS of a range that does not fit: that of an agent whose target has come back to where it looks is small."""

_HELD = 120.0
"""How many of the network's ranges fitted since the last fix, as a fix that did not help is no reason for one more."""


def gives_up(settings: FilterSettings, known: Status, ranges: Floats) -> Bools:
    """Which agents (n,) no longer wait for a lost target to come back. ranges: the latest of each, (n, 2 W).

    Soon, by the ninth rules, if an agent's latest range does not fit, it has enough of them for another fix, and the
    last one had helped.
    """
    long = np.asarray(known.which == LOST)
    if not long.nonzero()[0].size:
        return long
    window = ranges.shape[1] // 2
    steps = known.seconds / settings.motion.dt
    patient = steps >= _PATIENCE * window
    if settings.prompt:
        often = np.isfinite(ranges).sum(axis=1) >= window
        patient |= (steps >= _SOON) & (known.latest > _MISFIT) & often & (known.heard > _HELD)
    return np.asarray(long & patient)


def hears_again(settings: FilterSettings, known: Status, ranges: Floats, heard: Bools) -> Bools:
    """Which agents (n,) have heard the target since they began to coast; by the fifteenth rules all, as far as known.

    A fix on ranges from before that tells nothing new, and forgets how the target moved. ranges: the latest of each,
    (n, 2 W). heard: whether another one came in this step, (n,).
    """
    if not settings.awaits:
        return np.ones_like(heard)
    steps = np.round(known.seconds / settings.motion.dt)
    since = np.arange(ranges.shape[1], 0, -1) <= np.where(known.coasts, steps, ranges.shape[1])[:, None]
    return np.asarray(heard | (np.isfinite(ranges) & since).any(axis=1))


def left_to_a_fix(settings: FilterSettings, measurement: Measurement, rows: Bools) -> Measurement:
    """What the filter hears while some agents (n,) are adrift, or in a fix: none of their ranges.

    It would linearise them at where it coasted to, and learn biases that are wrong by as much as that, which a fix
    leaves as they are.
    """
    if not settings.prompt or settings.bias == "none" or not np.count_nonzero(rows):
        return measurement
    return replace(measurement, range=np.where(rows, np.nan, measurement.range))
