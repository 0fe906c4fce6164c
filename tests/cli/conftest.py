"""A short log for all tests; and the program takes Ctrl-C for itself: the tests give it back."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.log.hand_made import written


@pytest.fixture(autouse=True)
def _ctrl_c_is_pytests() -> Iterator[None]:
    before = signal.getsignal(signal.SIGINT)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="session")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of ten steps, which tests only read."""
    return written(tmp_path_factory.mktemp("log") / "run.mcap", 10)
