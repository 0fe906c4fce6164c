"""A recorder's reports while it records: on a terminal, and to its launcher as lines of JSON."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class Status:
    """What the recorder sees of a run.

    began: whether any estimate was seen. step: what all estimates have reached; error: the network's position error
    (m) there. messages: recorded. lost, late: on links, as their receivers counted. missing: gaps in the sequence
    numbers of what was recorded. foreign: messages on more keys that no run has than a log names, not recorded.
    behind: how often the recorder fell behind. dropped: messages that could not be written, and failure: why not.
    slow: the processes that have said that they do not keep up with real time. agents: how many are there.
    """

    run: str
    log: str
    steps: int
    began: bool = False
    step: int = 0
    error: float | None = None
    messages: int = 0
    lost: int = 0
    late: int = 0
    missing: int = 0
    behind: int = 0
    dropped: int = 0
    foreign: int = 0
    failure: str = ""
    slow: list[str] = field(default_factory=list)
    agents: int = 0
    state: str = "recording"
