"""How to read the payloads of a plan's filter."""

from __future__ import annotations

from typing import TYPE_CHECKING

from zenoh_cbef.tracking.payloads import InformationPayloads, Payloads, SeveralPayloads, StatePayloads

if TYPE_CHECKING:
    from zenoh_cbef.scenario.plan import Plan


def payloads_of(plan: Plan) -> Payloads:
    """As states, or as information: of one motion, or of several."""
    axes, size, chosen = plan.space.axes, plan.motion.size, plan.scenario.filter
    if not plan.abilities.information:
        return StatePayloads(axes)
    if plan.models:
        return SeveralPayloads(tuple(InformationPayloads(axes, one.size) for one in plan.models))
    omega = float(plan.scenario.count) if chosen.omega is None else chosen.omega
    size += plan.bias == "estimate" or plan.squares  # The bias's common part is a state, so is a square.
    return InformationPayloads(axes, size, (1.0, omega) if chosen.kind == "hcmci" else (1.0,))
