"""The one place that makes and reads key expressions."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache, lru_cache


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
        """The target's true state; only a recorder subscribes to it."""
        return f"{self.root}/target/truth"

    @property
    def all_events(self) -> str:
        """Every process's events."""
        return f"{self.root}/event/**"

    @property
    def all_signals(self) -> str:
        """What the target tells all agents."""
        return f"{self.root}/beacon/*/signal"

    @property
    def control(self) -> str:
        """Queryable: what can be asked of a run while it goes on."""
        return f"{self.root}/control"

    @property
    def claims(self) -> str:
        """Queryable: which process has a name that several claim."""
        return f"{self.root}/claims"

    def links(self, process: str) -> str:
        """Queryable: a process, as in "agent/3", says where it listens, and is told which others to link to."""
        return f"{self.root}/links/{process}"

    @property
    def all_links(self) -> str:
        """What all processes ask of their links."""
        return self.links("**")

    def reached(self, recorder: str) -> str:
        """Queryable: how far a recorder, as in "record/host-b", has got with each agent."""
        return f"{self.root}/reached/{recorder}"

    def log(self, recorder: str) -> str:
        """Queryable: the files of the log of a recorder, as in "record/host-b", when it has closed them."""
        return f"{self.root}/log/{recorder}"

    @property
    def faults(self) -> str:
        """The faults that were injected while the run goes on."""
        return f"{self.root}/faults"

    @property
    def all_estimates(self) -> str:
        """Every agent's estimates."""
        return f"{self.root}/agent/*/estimate"

    @property
    def all_ranges(self) -> str:
        """Every agent's positions and ranges."""
        return f"{self.root}/agent/*/range"

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

    @property
    def all_beacons(self) -> str:
        """What all receivers measure."""
        return f"{self.root}/beacon/*"

    def of_agent(self, agent: int) -> str:
        """Everything that an agent publishes of its own."""
        return f"{self.root}/agent/{agent}/*"

    def signal(self, agent: int) -> str:
        """What the target tells an agent, and its receiver: the run begins, or is over."""
        return f"{self.beacon(agent)}/signal"

    def event(self, sender: str) -> str:
        """What a process, as in "agent/3", reports of itself: joins, leaves, rejected messages, ends."""
        return f"{self.root}/event/{sender}"

    def range(self, agent: int) -> str:
        """An agent's position and range of a step."""
        return f"{self.root}/agent/{agent}/range"

    def round(self, agent: int) -> str:
        """An agent's consensus messages."""
        return f"{self.root}/agent/{agent}/round"

    def estimate(self, agent: int) -> str:
        """An agent's result of a step."""
        return f"{self.root}/agent/{agent}/estimate"

    def smoothed(self, agent: int) -> str:
        """An agent's result of an earlier step, with what it knows since."""
        return f"{self.root}/agent/{agent}/smoothed"


ID = "0|[1-9][0-9]{0,2}"
"""An agent's number in a key, in ASCII digits: as many as a scenario can have."""

_AGENT = re.compile(f"agent/({ID})")
_BELOW = re.compile(r"cbef/([^/]+)/(.+)", re.DOTALL)
_SENDER = rf"target|agent/(?:{ID})|(?:record|replay|receiver)(?:/[^/*$]+)?"
"""Processes that have a key for their events. In older logs all share the key `event`, which belongs to no process."""

_MESSAGES = re.compile(
    rf"target/(?P<truth>truth)|(?P<shared>faults)|(?P<event>event)(?:/(?P<sender>{_SENDER}))?"
    rf"|(?P<beacon>beacon)/(?P<receiver>{ID})(?:/(?P<signal>signal))?"
    rf"|(?P<owner>agent/(?P<agent>{ID}))/(?P<own>range|round|estimate|smoothed)"
)
_KINDS = ("truth", "shared", "event", "signal", "beacon", "own")
_OWNERS = {"truth": "target", "faults": "target", "signal": "target"}


@dataclass(frozen=True)
class Address:
    """What a key of a run carries: the kind of message, and the process that owns the key ("" for any).

    agent: whose beacons, signals, ranges, rounds or estimates, smoothed or not, these are, -1 for a key of no agent.
    """

    run: str
    kind: str
    owner: str
    agent: int = -1

    @property
    def chosen(self) -> bool:
        """Whether the key has a name that its owner chose: there can be any number of such keys."""
        return self.owner not in {"", "target"} and agent_named(self.owner) is None

    def is_of(self, sender: object) -> bool:
        """Whether a process may send on the key: its owner; beacons come from the target or a receiver."""
        if self.owner:
            return sender == self.owner
        return isinstance(sender, str) and (self.kind == "event" or agent_named(sender) is None)


@lru_cache(maxsize=1024)  # a run has few keys; a flood of others must not fill the memory
def address(key: str) -> Address | None:
    """The address of a key; None for a key that no run has."""
    below = _BELOW.fullmatch(key)
    found = _MESSAGES.fullmatch(below[2]) if below else None
    if below is None or found is None:
        return None
    kind = next(found[group] for group in _KINDS if found[group])
    owner = found["owner"] or found["sender"] or _OWNERS.get(kind, "")
    return Address(below[1], kind, owner, int(found["receiver"] or found["agent"] or -1))


def run_of(key: str) -> str | None:
    """The run that a key is of, whatever the run has there; None for a key of no run."""
    below = _BELOW.fullmatch(key)
    return below[1] if below else None


def agent_named(process: str) -> int | None:
    """The agent that the name of a process, as in "agent/3", stands for; None for any other text."""
    found = _AGENT.fullmatch(process)
    return int(found[1]) if found else None


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
