"""Which tests start processes or open sessions: `make fast` leaves these out."""

from pathlib import Path

import pytest

HERE = Path(__file__).parent
WITH_PROCESSES = (
    "cli/test_endings.py",
    "cli/test_errors.py",
    "experiment/test_experiments.py",
    "netlab",
    "outside/test_registry.py",
    "processes",
    "protocol/test_access.py",
    "protocol/test_session.py",
    "test_benchmarks.py",
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    folders = [HERE / one for one in WITH_PROCESSES]
    for item in items:
        if any(item.path.is_relative_to(folder) for folder in folders):
            item.add_marker(pytest.mark.processes)
