"""A target that goes in a figure of eight."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.courses.closed import Closed


@dataclass(frozen=True)
class Lemniscate(Closed):
    """A horizontal figure of eight (the lemniscate of Gerono) of `radius` around `position`, once in a `period`."""

    @staticmethod
    def unit(cosine: Floats, sine: Floats, rate: float) -> tuple[Floats, Floats]:
        """Sine, and sine times cosine."""
        position = np.stack([sine, sine * cosine], axis=1)
        return position, np.stack([rate * cosine, rate * (cosine**2 - sine**2)], axis=1)
