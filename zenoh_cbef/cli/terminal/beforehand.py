"""What a verb tells of a scenario before it begins: warnings, and what was picked where the user leaves the choice."""

from __future__ import annotations

from zenoh_cbef.cli.terminal.console import tell, warn
from zenoh_cbef.scenario.checks import check
from zenoh_cbef.scenario.plan import Plan


def tell_beforehand(plan: Plan) -> None:
    """Print warnings, and what consensus.scheme = "auto" picked, and why."""
    warn(check(plan))
    if plan.scenario.consensus.scheme == "auto" and plan.rounds:
        scheme, reason = plan.scheme
        tell(f"consensus.scheme = {scheme}: {reason[0].lower()}{reason[1:]}")
