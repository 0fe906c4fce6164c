"""The one place that knows a key expression."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache


@dataclass(frozen=True)
class Keys:
    """The key expressions of one run."""

    run: str

    @property
    def root(self) -> str:
        """What every key of the run starts with."""
        return f"cbef/{self.run}"

    @property
    def everything(self) -> str:
        """All traffic of the run."""
        return f"{self.root}/**"

    @property
    def scenario(self) -> str:
        """Queryable: the scenario, as written and as resolved."""
        return f"{self.root}/scenario"

    @property
    def replay(self) -> str:
        """Queryable of a replay: pauses it, seeks, and so on."""
        return f"{self.root}/replay"

    @property
    def truth(self) -> str:
        """The target's true state; nobody but a recorder subscribes to it."""
        return f"{self.root}/target/truth"

    @property
    def event(self) -> str:
        """Joins, leaves, rejected messages, ends."""
        return f"{self.root}/event"

    @property
    def control(self) -> str:
        """Queryable: what can be asked of a run while it goes on."""
        return f"{self.root}/control"

    @property
    def faults(self) -> str:
        """The faults that were injected while the run goes on."""
        return f"{self.root}/faults"

    @property
    def all_estimates(self) -> str:
        """Every agent's estimates."""
        return f"{self.root}/agent/*/estimate"

    @property
    def all_live(self) -> str:
        """Every process's liveliness tokens."""
        return f"{self.root}/live/**"

    @property
    def target_live(self) -> str:
        """The target's liveliness token."""
        return f"{self.root}/live/target/target"

    def beacon(self, agent: int) -> str:
        """What an agent's receiver measures."""
        return f"{self.root}/beacon/{agent}"

    def range(self, agent: int) -> str:
        """An agent's position and range of a step."""
        return f"{self.root}/agent/{agent}/range"

    def round(self, agent: int) -> str:
        """An agent's consensus messages."""
        return f"{self.root}/agent/{agent}/round"

    def estimate(self, agent: int) -> str:
        """An agent's result of a step."""
        return f"{self.root}/agent/{agent}/estimate"


@dataclass(frozen=True)
class Address:
    """What a key of a run carries: the kind of message, and the process that owns the key ("" for any)."""

    kind: str
    owner: str


def address(key: str) -> Address | None:
    """The address that a key stands for, None for a key that no run has."""
    match key.split("/")[2:]:
        case ["target", "truth"]:
            return Address("truth", "target")
        case ["faults"]:
            return Address("faults", "target")
        case ["event"]:
            return Address("event", "")
        case ["beacon", agent] if agent.isdecimal():
            return Address("beacon", "")
        case ["agent", agent, "range" | "round" | "estimate" as kind] if agent.isdecimal():
            return Address(kind, f"agent/{agent}")
    return None


def run_of(key: str) -> str:
    """The run that a key belongs to."""
    return key.split("/")[1]


def agent_of(key: str) -> int:
    """The agent whose key (beacon, range, round, estimate) this is."""
    parts = key.split("/")
    return int(parts[3])


def matches(expression: str, key: str) -> bool:
    """Whether a key expression stands for a key: * is any part of it, ** any number of parts, $* any characters."""
    return _pattern(expression).fullmatch("/" + key) is not None


@cache
def _pattern(expression: str) -> re.Pattern[str]:
    parts = []
    for part in expression.split("/"):
        inside = "[^/]*".join(re.escape(piece) for piece in part.split("$*"))
        parts.append({"*": "/[^/]+", "**": "(?:/[^/]+)*"}.get(part, "/" + inside))
    return re.compile("".join(parts))
