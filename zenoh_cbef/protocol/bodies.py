"""The bodies of an agent's messages, the same for its process and for a log that is computed."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite

from zenoh_cbef.arrays import Floats
from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol.messages import pack_floats
from zenoh_cbef.tracking.diagnostics import SOMETIMES, Diagnostics
from zenoh_cbef.tracking.smoothing import Smoothed
from zenoh_cbef.tracking.tracker import Estimate


def range_body(step: int, position: Floats, range_: float) -> dict[str, object]:
    """An agent's position (3,) and the range (m) that it tells, NaN for none."""
    return {"k": step, "position": position.tolist(), "range": float(range_) if isfinite(range_) else None}


def diagnostics_body(told: Diagnostics, row: int) -> dict[str, float | int | None]:
    """The diagnostics of one agent, a row of the batch, as fields of a message."""
    body: dict[str, float | int | None] = {}
    for name, values in vars(told).items():
        value: float | int = values.item(row)
        if isfinite(value):
            body[name] = value
        elif name not in SOMETIMES:
            body[name] = None
    return body


def divergence(agent: int, step: int, plugged: str = "") -> str:
    """The sentence about an agent whose estimate is no longer finite. plugged: its filter, of another package."""
    why = "the filter diverges in this scenario, see docs/method.md"
    if plugged:
        why = f"the filter {plugged!r} diverges or has a mistake: zenoh_cbef.testing.check_filter tells more"
    return f"agent {agent}'s estimate is no longer finite at step {step}; {why}"


def estimate_body(
    step: int, estimate: Estimate, row: int, agent: int, counts: Mapping[str, object], *, plugged: str = ""
) -> dict[str, object]:
    """The result of a step of one agent, a row of the batch; counts: of its neighbours' messages.

    plugged: see `divergence`. Raises UserError where the estimate is no longer finite.
    """
    state, covariance = estimate.state[row].tolist(), estimate.covariance
    if not all(map(isfinite, state)):
        raise UserError(divergence(agent, step, plugged))
    return {
        "k": step,
        "state": state,
        **diagnostics_body(estimate.diagnostics, row),
        **counts,
        "covariance": None if covariance is None else pack_floats(covariance[row]),
    }


def smoothed_body(smoothed: Smoothed, row: int) -> dict[str, object]:
    """What later estimates say of an earlier step of one agent, a row of the batch."""
    return {
        "k": smoothed.step,
        "until": smoothed.until,
        "state": smoothed.state[row].tolist(),
        "covariance": pack_floats(smoothed.covariance[row]),
    }
