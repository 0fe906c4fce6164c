"""Whether a simulated filter diverged."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol.bodies import divergence
from zenoh_cbef.trace import Trace

_FINITE = 1e75
"""Beyond, errors squared twice leave float64."""


def refuse_divergence(trace: Trace) -> None:
    """Raise UserError where an agent that was there has an estimate that is not finite, or soon is not."""
    absences = trace.plan.absences
    for step in np.flatnonzero(~(np.abs(trace.estimates) < _FINITE).all(axis=(0, 2))).tolist():
        wrong = ~(np.abs(trace.estimates[:, step]) < _FINITE).all(axis=1) & ~absences.at(step + 1)
        if wrong.any():
            raise UserError(divergence(int(wrong.argmax()), step + 1, trace.scenario.filter.plugged))
