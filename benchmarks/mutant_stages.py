"""Which tests a mutant meets, in which order: first quick ones of its package, in a second stage slower ones."""

from __future__ import annotations

import math
import pickle
import tempfile
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

from benchmarks.mutant_reach import Reach, Reaching
from benchmarks.mutant_trial import KILLED, SURVIVES, Trial, in_fork
from benchmarks.mutations import Mutant

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Stage:
    """Tests that mutants meet.

    tests: files, folders and words for pytest; takes: which tests of these. first: files of tests that are tried before
    others. seconds: how long the tests that one mutant meets take at most, without it.
    """

    name: str
    tests: tuple[str, ...]
    takes: Callable[[pytest.Item], bool]
    first: tuple[str, ...] = ()
    seconds: float = math.inf

    def reach(self, mutants: list[Mutant]) -> Reach | None:
        """What the tests reach of the mutants' statements; None: one of them fails."""
        places = {mutant.place for mutant in mutants}
        with tempfile.TemporaryFile() as file:

            def work() -> int:
                reaching = Reaching(places)
                failed = fails(self.tests, Chosen(self.takes), reaching)
                pickle.dump(reaching.reach, file)
                file.flush()
                return KILLED if failed else SURVIVES

            if in_fork(work, 600) != SURVIVES:
                return None
            file.seek(0)
            reach: Reach = pickle.load(file)  # noqa: S301 - of our own fork
            return reach

    def trial(self, mutant: Mutant, reach: Reach, passed: Collection[str]) -> Trial:
        """A mutant with the tests that it meets, in order: those that reach it, and that it has not passed yet.

        The first ones come first, then those whose file names the mutant's module; of each the quick ones first. A test
        with which they would take longer than the limit is left out.
        """
        imported = not mutant.called or mutant.place in reach.imported
        tests = [test for test, places in reach.tests.items() if imported or mutant.place in places]
        taken: dict[str, float] = {}
        for test in sorted(set(tests) - set(passed), key=lambda test: self._turn(test, mutant, reach)):
            if sum(taken.values()) + reach.seconds[test] <= self.seconds:
                taken[test] = reach.seconds[test]
        return Trial(mutant, taken, imported)

    def _turn(self, test: str, mutant: Mutant, reach: Reach) -> tuple[bool, bool, float, str]:
        return not test.startswith(self.first), not is_near(test, mutant), reach.seconds[test], test


QUICK = {
    "zenoh_cbef/faults": ("tests/faults", "tests/scenario/test_plugins.py"),
    "zenoh_cbef/log/mcap": ("tests/log/mcap", "tests/log/read/test_columns.py", "tests/log/tools"),
    "zenoh_cbef/protocol": (
        "tests/protocol",
        "tests/log/write/test_run_log.py",
        "tests/processes/recorder/test_fetch.py",
    ),
    "zenoh_cbef/tracking": (
        "tests/tracking",
        "tests/scenario/test_build.py",
        "tests/test_golden.py",
        "tests/simulator/test_stress_runs.py",
        "tests/analysis/test_strokes.py",
    ),
}
"""The tests that a package's mutants meet first."""

LONG = (
    "test_fleets_record_their_agents",
    "test_where_no_recorder_stays",
    "test_access.py",
    "test_random_scenarios.py",
    "random_bit_flips",
    "test_shares_bursts_and_memory",
    "test_losses_in_good_and_bad_times",
    "test_trimming_holds_off",
    "test_components_of_information_must",
    "test_the_network_is_better_off",
    "test_a_network_",
    "test_noise_is_learned_from_half",
    "test_without_a_bias_auto",
    "test_one_liar_of_six",
    "test_a_circle_is_tracked",
    "test_the_backward_step_of_any_motion",
    "comes_out_the_same[supposing]",
)
"""Parts of the names of tests that are left out there, as they take a second or more."""


WHOLE_RUNS = ("tests/test_golden.py", "tests/simulator/")
"""Tests of whole runs."""


def is_long(test: pytest.Item) -> bool:
    """Whether a test takes too long for the first stage."""
    return any(part in test.nodeid for part in LONG)


def is_slower(test: pytest.Item) -> bool:
    """Whether it is one of the second stage."""
    return test.nodeid.startswith(WHOLE_RUNS) or test.get_closest_marker("slow") is not None or is_long(test)


def quick(package: str) -> Stage:
    """The first stage of a package's mutants."""
    return Stage("quick", QUICK[package], lambda test: not is_long(test))


SLOWER = Stage("slower", ("tests", "-m", "not processes"), is_slower, WHOLE_RUNS, seconds=60)
"""The second stage, of all packages."""


class Chosen:
    """A pytest plugin that leaves out what is not taken."""

    def __init__(self, takes: Callable[[pytest.Item], bool]) -> None:
        self._takes = takes

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Pytest's hook."""
        items[:] = [item for item in items if self._takes(item)]


class Named:
    """A pytest plugin that takes the tests of a list, in its order."""

    def __init__(self, tests: list[str]) -> None:
        self._turns = {test: turn for turn, test in enumerate(tests)}

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Pytest's hook."""
        chosen = [item for item in items if item.nodeid in self._turns]
        items[:] = sorted(chosen, key=lambda item: self._turns[item.nodeid])


def fails(words: Iterable[str], *plugins: object) -> bool:
    """Whether a test fails. Where there is none, none does."""
    alone = ["-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "--tb=no", *words]
    done = {pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED}
    return pytest.main(alone, plugins=[*plugins]) not in done


def is_near(test: str, mutant: Mutant) -> bool:
    """Whether a test's file names the mutant's module."""
    parts = mutant.path.with_suffix("").parts
    return ".".join(parts[parts.index("zenoh_cbef") :]).removesuffix(".__init__") in _text(file_of(test))


def file_of(test: str) -> str:
    """The file of a test."""
    return test.split("::", 1)[0]


@cache
def _text(file: str) -> str:
    return (ROOT / file).read_text(encoding="utf-8")
