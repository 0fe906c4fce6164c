"""A network notices by real ranges that its target suddenly moves otherwise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.filters.around.distrusting import CALM
from zenoh_cbef.tracking.filters.around.recovering import Recovering
from zenoh_cbef.tracking.ranging import Measurement

_DOUBTFUL, _WIDTH = 4.0, 4.0
"""The NIS that says neither, two standard deviations, and how far apart those are that say all they can."""


@dataclass(frozen=True)
class Sudden(Recovering):
    """`Recovering` by how implausible innovations are, not by how many are beyond three standard deviations.

        y_i = clip((NIS_i - 4)/4, -1/2, 1/2) + 1/2 - share    where a range was measured that is trusted, otherwise 0

    Real ranges saturate so that none far off pulls: at a corner, or when a target that rested drives off, they all seem
    wrong, and an estimate of one motion goes straight on. Innovations of two standard deviations of most agents at once
    are no chance, and to wait for three takes steps in which the target gets away. An agent that distrusts its receiver
    expects large innovations, so that none of its own says anything of the target.
    """

    def said(self, nis: Floats, measurement: Measurement) -> Floats:
        """What agents say of the innovations of their ranges, (n,)."""
        doubt = np.clip((nis - _DOUBTFUL) / _WIDTH, -0.5, 0.5) + 0.5 - self.share
        return doubt if measurement.distrust is None else np.where(measurement.distrust > CALM, 0.0, doubt)
