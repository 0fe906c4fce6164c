"""What a recorder says of a run in its log, at the beginning and at the end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from platform import node as host_name

from zenoh_cbef import __version__
from zenoh_cbef.nodes.common.node import Identity
from zenoh_cbef.nodes.common.recording import Status
from zenoh_cbef.scenario import Scenario


def described(identity: Identity, scenario: Scenario, expressions: Sequence[str]) -> dict[str, str]:
    """Which run it is, and how it is recorded."""
    return {
        "run": identity.run,
        "name": scenario.name,
        "seed": str(scenario.seed),
        "version": __version__,
        "host": host_name(),
        "started": datetime.now(UTC).isoformat(),
        "keys": " ".join(expressions),
    }


def as_text(status: Status) -> dict[str, str]:
    """The last status, as the end record has it: of slow processes, how many they are."""
    said = asdict(status) | {"slow": len(status.slow)}
    return {name: str(value) for name, value in said.items() if name not in {"state", "agents"}}
