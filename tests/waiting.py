"""Waiting for what other threads and processes do: as long as a busy machine takes, and no longer than it takes."""

import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


def until(holds: Callable[[], T | None], why: object = None, seconds: float = 100.0, every: float = 0.01) -> T:
    """What holds gives as soon as that is true; a test in which it never is fails. why: what it then says."""
    end = time.monotonic() + seconds
    while not (found := holds()):
        assert time.monotonic() < end, why
        time.sleep(every)
    return found
