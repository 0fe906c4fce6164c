"""What an agent says: the bodies of its messages, the same for its process and for a log that is computed."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol.messages import BIAS, DISTRUST, nan_to_nil, pack_floats
from zenoh_cbef.tracking.tracker import Estimate


def range_body(step: int, position: NDArray[np.float64], range_: float) -> dict[str, Any]:
    """An agent's position (3,) and the range (m) that it tells, NaN for none."""
    return {"k": step, "position": position.tolist(), "range": nan_to_nil(range_)}


def estimate_body(step: int, estimate: Estimate, row: int, agent: int, counts: Mapping[str, Any]) -> dict[str, Any]:
    """The result of a step of one agent, a row of the batch; counts: of its neighbours' messages.

    Raises UserError where the estimate is no longer finite.
    """
    if not np.isfinite(estimate.state[row]).all():
        raise UserError(
            f"agent {agent}'s estimate is no longer finite at step {step}; "
            "the filter diverges in this scenario, see docs/method.md"
        )
    covariance = estimate.covariance
    sometimes = zip((DISTRUST, *BIAS), (estimate.distrust[row], *estimate.bias[row]), strict=True)
    return {
        "k": step,
        "state": estimate.state[row].tolist(),
        "innovation": nan_to_nil(estimate.innovation[row]),
        "weight": nan_to_nil(estimate.weight[row]),
        "nis": nan_to_nil(estimate.nis[row]),
        "nis_degrees": int(estimate.nis_degrees[row]),
        **{name: float(value) for name, value in sometimes if isfinite(value)},
        **counts,
        "covariance": None if covariance is None else pack_floats(covariance[row]),
    }
