"""How far a target goes off the straight lines that are drawn between the positions of its truth."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.datasets.dataset import Dataset
from zenoh_cbef.datasets.scatter import scatter

_LEAST = 10
"""Of fewer positions nothing is said."""


def strays(dataset: Dataset) -> tuple[float, float] | None:
    """How far, m, a truth is off such a line, if that is more than its ranges scatter, and its interval, s.

    Root mean square; what lasts of the errors of ranges scatters, too. Of a target that turns sharply half as far as a
    position is off the line through the two around it: the line between two of them cuts such a corner off, wherever in
    between it is.
    """
    time, places = dataset.truth_time, dataset.truth
    noise = scatter(dataset, 3)
    if len(time) < _LEAST or noise is None:
        return None
    after = ((time[1:-1] - time[:-2]) / (time[2:] - time[:-2]))[:, None]
    off = np.linalg.norm(places[1:-1] - (1.0 - after) * places[:-2] - after * places[2:], axis=1)
    # Beside a hole of the truth a position is next to one end of its line, and hardly off it.
    far = 0.5 * float(np.sqrt(np.mean(off**2)))
    return (far, float(np.median(np.diff(time)))) if far > noise else None
