"""The event with which a process says that it does not keep up with real time, and when it says so."""

from __future__ import annotations

SLOW = "slow"
"""Kind of the event with which a process says that it does not keep up."""
REMEDY = "raise dt, lower consensus.rounds, or run fewer agents on a host"
_FEWEST, _SHARE = 10, 0.1


WINDOW_SECONDS = 5.0
AGAIN_SECONDS = 60.0
"""A process that is still too slow says so again after this time, s."""


def too_slow(late: int, due: int) -> bool:
    """Whether `late` of `due` are too many for a short delay of the host."""
    return late >= _FEWEST and late >= _SHARE * due
