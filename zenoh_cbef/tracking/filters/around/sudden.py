"""A network notices by real ranges that its target suddenly moves otherwise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.around.distrusting import CALM
from zenoh_cbef.tracking.filters.around.recovering import widened
from zenoh_cbef.tracking.filters.around.wrapping import Wrapping
from zenoh_cbef.tracking.filters.base import Belief, Update
from zenoh_cbef.tracking.ranging import Measurement

_DOUBTFUL, _WIDTH = 5.0, 4.0
"""The NIS that says neither, of one in forty good ranges, and how far apart those are that say all they can."""

_INFLATION = 2.0
"""By how much the covariance grows in a step: by little, as half of real ranges may be wrong for a step or two."""


@dataclass(frozen=True)
class Sudden(Wrapping):
    """Any filter that saturates, with one number more in its payload: how implausible its own innovation is.

        y_i = clip((NIS_i - 5)/4, -1/2, 1/2)          of its latest range, if no more than `steps` steps old and
                                                      trusted, otherwise 0
        P_i <- 2 P_i, y_i <- 0                        where the average of y is positive

    Real ranges saturate so that none far off pulls: at a corner, or when a target that rested drives off, they all seem
    wrong, and an estimate of one motion goes straight on. Innovations of 2.2 standard deviations of most agents at once
    are no chance, and to wait for three, as `Recovering` does, takes steps in which the target gets away. In a step in
    which few agents hear the target one of them would decide, so those that heard it just before take part. An agent
    that distrusts its receiver expects large innovations: none of its own says anything of the target.

    steps: in how many of them each agent has a range.
    """

    steps: int

    more = 1

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The filter's update, and the number."""
        inner = belief.parts[0] if belief.parts else belief
        none = np.zeros(len(belief.state))
        said, since = belief.memory or (none, none)
        update = self.filter.update(inner, measurement)
        nis = update.diagnostics.nis
        heard = np.isfinite(nis)
        now = np.clip((np.where(heard, nis, _DOUBTFUL) - _DOUBTFUL) / _WIDTH, -0.5, 0.5)
        if measurement.distrust is not None:
            now = np.where(measurement.distrust > CALM, 0.0, now)
        since = np.where(heard, 0.0, since + 1.0)
        said = np.where(heard, now, np.where(since <= self.steps, said, 0.0))
        payload = np.concatenate([update.payload, said[:, None]], axis=1)
        return Update(payload, update.diagnostics, (said, since), (update,))

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The filter's belief, with a larger covariance where most innovations were implausible."""
        belief = self.filter.conclude(np.ascontiguousarray(payload[:, :-1]), update.parts[0])
        said, since = update.kept
        wide = payload[:, -1] > 0.0
        inner = widened(self.filter, belief, np.where(wide, _INFLATION, 1.0))
        return replace(inner, memory=(np.where(wide, 0.0, said), since), parts=(inner,), chance=None)
