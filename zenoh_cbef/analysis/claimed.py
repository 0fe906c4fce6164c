"""The error that agents' covariances claim: what can be said of a run's precision where its truth is not known."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.trace import Trace


def claimed_position_error(trace: Trace) -> Floats:
    """The root of the trace of each covariance's position block, (n, K), m; NaN where an agent has none."""
    variance = np.diagonal(trace.covariances, axis1=2, axis2=3)[..., :3].sum(axis=-1)
    return np.asarray(np.sqrt(np.where(variance >= 0.0, variance, np.nan)))
