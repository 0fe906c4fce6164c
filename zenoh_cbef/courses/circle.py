"""A target that goes round."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.courses.closed import Closed


@dataclass(frozen=True)
class Circle(Closed):
    """A horizontal circle of `radius` around `position`, once in a `period`."""

    @staticmethod
    def unit(cosine: Floats, sine: Floats, rate: float) -> tuple[Floats, Floats]:
        """Cosine and sine."""
        return np.stack([cosine, sine], axis=1), np.stack([-rate * sine, rate * cosine], axis=1)
