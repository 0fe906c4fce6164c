"""The consensus scheme of a scenario, and why it was chosen."""

from __future__ import annotations

from zenoh_cbef.faults import MessageFault
from zenoh_cbef.scenario.model import Scenario


def chosen_scheme(scenario: Scenario, *, information: bool) -> tuple[str, str]:
    """Average or running-sums, and one sentence on why.

    information: whether the filter averages information.
    """
    faulty = any(isinstance(one, MessageFault) for one in scenario.fault)
    stage, kind = scenario.consensus, scenario.filter.kind
    if stage.scheme != "auto":
        return stage.scheme, f"consensus.scheme = {stage.scheme!r} was given."
    reasons = {
        "Messages of earlier steps are predicted forward, which running sums cannot be.": stage.lag > 0,
        "Neighbours' values are trimmed, which running sums cannot be.": stage.trim > 0,
        "No link has a fault, so averaging loses nothing.": not faulty,
        f"{kind} does not average information, and its exchange is defined by consensus weights.": not information,
        "Of running sums in integers too little would be left of the shares.": stage.precision.startswith("int"),
        "Agents that keep silent send no sums.": stage.trigger > 0.0,
        f"Running sums cannot be accelerated, and {stage.acceleration} was asked for.": stage.acceleration != "none",
    }
    for reason, holds in reasons.items():
        if holds:
            return "average", reason
    return "running-sums", "Links have faults, and with running sums the next message repairs a lost one."
