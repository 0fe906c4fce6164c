"""The types of arrays, by what is in them; a docstring says the shape."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
Ids = NDArray[np.int64]
"""Numbers of agents."""
