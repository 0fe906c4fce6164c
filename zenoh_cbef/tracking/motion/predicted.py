"""A target that stays as it is, for a filter that is handed predictions."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.motion.base import LinearMotion


class Predicted(LinearMotion):
    """x(k+1) = x(k): what another one has predicted already."""

    @cached_property
    def transition(self) -> Floats:
        """The unit matrix."""
        return np.eye(self.size)

    @cached_property
    def process_noise(self) -> Floats:
        """None."""
        return np.zeros((self.size, self.size))
