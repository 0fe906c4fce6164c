"""Which tests start processes or open sessions: `make fast` leaves these out, and those that are marked slow."""

import gc
import os
import signal
from collections import Counter
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import pytest

import tests.examples  # noqa: F401 - sets how many random examples there are

# As in every process of a run. It is read when NumPy is imported, which no plug-in of these tests does before.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
gc.disable()  # until all tests are collected: nothing of that is garbage

# A shell starts what runs in its background with Ctrl-C ignored, nohup without hang-ups, and processes hand that on:
# tests of both need them.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)

MANY_FILES = 300
HERE = Path(__file__).parent
WITH_PROCESSES = (
    "cli/calling/test_endings.py",
    "cli/test_errors.py",
    "experiment/test_experiments.py",
    "netlab",
    "outside/test_registry.py",
    "processes",
    "protocol/test_access.py",
    "test_benchmarks.py",
)
LONGEST = ("processes/test_tutorial.py", "processes/test_site.py", "processes/test_notebooks.py", "netlab")
"""Of these: what keeps a worker busy longest, and so begins first."""


@cache
def has_processes(path: Path) -> bool:
    return any(path.is_relative_to(HERE / one) for one in WITH_PROCESSES)


@cache
def is_long(path: Path) -> bool:
    return any(path.is_relative_to(HERE / one) for one in LONGEST)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Do not even import the files of which no test is asked for."""
    return True if config.option.markexpr.startswith("not processes") and has_processes(collection_path) else None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    for item in items:
        if has_processes(item.path):
            item.add_marker(pytest.mark.processes)
    if hasattr(config, "workerinput"):
        place = places([item.path for item in items])
        items.sort(key=lambda item: place[item.path])


def places(paths: Sequence[Path]) -> dict[Path, float]:
    """Where the files of these tests come in the order of all.

    What keeps a worker busy longest is first. Then files that wait and files that compute come by turns, as those
    leave the processors to these, and of either those with many tests first: what ends a worker's work is short.
    """
    many = Counter(paths)
    found = {path: -1.0 for path in many if is_long(path)}
    for waits in (True, False):
        alike = [path for path in many if path not in found and has_processes(path) is waits]
        alike.sort(key=lambda path: -many[path])
        found |= {path: place / len(alike) for place, path in enumerate(alike)}
    return found


def pytest_collection_finish() -> None:
    """Thousands of collected tests live to the end: the collector of garbage need not look through them.

    It looks seldom through what comes after them, too: else it takes a fifteenth of the time of all tests.
    """
    gc.freeze()
    gc.enable()
    gc.set_threshold(50_000, 20, 50)


def pytest_runtest_teardown() -> None:
    """What refers to itself holds its files until it is collected, and `select` takes none beyond the 1024th."""
    if len([*Path("/dev/fd").iterdir()]) > MANY_FILES:
        gc.collect()
