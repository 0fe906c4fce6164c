"""Mutation testing: change one thing in the package, and see whether a test fails.

    python -m benchmarks.mutants [FILE OR FOLDER ...] [--most N] [--seed S] [--jobs J]

A mutant has one operator, number, condition, returned value or call changed (mutations.py), in the four packages whose
errors stay unseen longest. Of each package N mutants are drawn, the same ones for the same seed and the same sources.
Which tests reach which statement is found out first (mutant_reach.py). A mutant is killed when one that reaches its
statement fails, and survives when all pass (mutant_trial.py). Where a statement runs as its file is imported, all fast
tests of the package are tried, in a fork that imports it anew. docs/mutants.md explains the survivors.
"""

from __future__ import annotations

import argparse
import os
import pickle
import random
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

# What every fork would import again: the parent imports it once, and nothing of the package itself.
import numpy as np  # noqa: F401
import pydantic  # noqa: F401
import pytest
import zenoh  # noqa: F401
from hypothesis import Phase, settings

from benchmarks.mutant_reach import Reach, Reaching, replace_code
from benchmarks.mutant_trial import HANGS, IMPORTED, KILLED, SURVIVES, Crew, Trying, in_fork, is_near
from benchmarks.mutations import Mutant, mutants_of

ROOT = Path(__file__).resolve().parents[1]
TESTS = {
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
"""The tests that a package's mutants meet."""

SLOW = (
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
)
"""Parts of the names of tests that are left out, as they take a second or more."""

# A random example that fails is enough: it need not be short, nor be remembered.
settings.register_profile("mutants", phases=(Phase.explicit, Phase.generate), database=None)
settings.load_profile("mutants")


class Chosen:
    """A pytest plugin that leaves slow tests out."""

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        """Pytest's hook."""
        items[:] = [item for item in items if not any(slow in item.nodeid for slow in SLOW)]


def fails(tests: list[str], *plugins: object) -> bool:
    """Whether a test fails. Where all are slow, none does."""
    words = ["-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "--tb=no", *tests]
    done = {pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED}
    return pytest.main(words, plugins=[Chosen(), *plugins]) not in done


def reached(package: str) -> Reach | None:
    """What the tests of a package reach; None: one of them fails."""
    with tempfile.TemporaryFile() as file:

        def work() -> int:
            reaching = Reaching(ROOT / package)
            failed = fails([*TESTS[package]], reaching)
            pickle.dump(reaching.reach, file)
            file.flush()
            return KILLED if failed else SURVIVES

        if in_fork(work, 600) != SURVIVES:
            return None
        file.seek(0)
        reach: Reach = pickle.load(file)  # noqa: S301 - of our own fork
        return reach


def imported_anew(mutant: Mutant, tests: tuple[str, ...], seconds: float) -> int:
    """What becomes of a mutant in a fork that imports its source: first the tests that name its module, then all."""
    files = sorted(file for place in tests for file in ([ROOT / place] if place.endswith(".py") else tests_in(place)))
    near = [str(file) for file in files if is_near(file, mutant)]
    far = [str(file) for file in files if not is_near(file, mutant)]

    def work() -> int:
        replace_code(mutant.path, lambda _: mutant.tree())
        return KILLED if any(fails(part) for part in (near, far) if part) else SURVIVES

    return in_fork(work, seconds)


def tests_in(folder: str) -> list[Path]:
    """The files of tests in a folder."""
    return list((ROOT / folder).rglob("test_*.py"))


def outcomes(mutants: list[Mutant], package: str, reach: Reach, jobs: int) -> Iterator[tuple[Mutant | None, int]]:
    """What becomes of each mutant, as it is known; first, with None, of the source as it is."""
    every: list[Mutant | None] = [None, *mutants]
    left: list[tuple[int, Mutant]] = []
    crew, whole = Crew(jobs), sum(reach.seconds.values())

    def collected() -> None:
        in_fork(lambda: fails([*TESTS[package]], Trying(every, reach, crew.turn, crew.tell)), 1e6)

    def alone() -> None:
        while (turn := crew.turn()) < len(left):
            number, mutant = left[turn]
            crew.tell(number, imported_anew(mutant, TESTS[package], whole))

    for number, found in crew.found(collected, len(every)):
        mutant = every[number]
        if mutant is not None and found == IMPORTED:
            left.append((number, mutant))
        else:
            yield mutant, found
    for number, found in crew.found(alone, len(left)):
        yield every[number], found


def drawn(places: list[str], most: int, seed: int) -> Iterator[tuple[str, int, list[Mutant]]]:
    """Of each package: its name, how many mutants there are, and those that are tried."""
    wanted = [Path(place).resolve() for place in places] or [ROOT]
    for package in TESTS:
        files = [file for file in sorted((ROOT / package).rglob("*.py")) if any(map(file.is_relative_to, wanted))]
        every = [mutant for file in files for mutant in mutants_of(file)]
        if every:
            chosen = random.Random(f"{package} {seed}").sample(range(len(every)), min(most, len(every)))  # noqa: S311
            yield package, len(every), [every[place] for place in sorted(chosen)]


def main() -> int:
    """Try mutants; print the survivors, and a table of what became of each package's."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mutants", description=str(__doc__).split("\n", 1)[0])
    parser.add_argument("places", nargs="*", help="files or folders of the package (default: all four packages)")
    parser.add_argument("--most", type=int, default=100, help="mutants of each package (default: 100)")
    parser.add_argument("--seed", type=int, default=1, help="which ones are drawn (default: 1)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="at once (default: one for each core)")
    chosen = parser.parse_args()
    os.chdir(ROOT)
    rows, tried = [], commit()  # at the start: a checkout can move meanwhile
    for package, count, mutants in drawn(chosen.places, chosen.most, chosen.seed):
        found = counted(package, mutants, chosen.jobs)
        if found is None:
            return 2
        killed = found[KILLED] + found[HANGS]
        share = f"{killed} ({killed / len(mutants):.0%})"
        rows.append(f"| `{package}` | {count} | {len(mutants)} | {share} | {found[HANGS]} | {found[SURVIVES]} |")
    print(f"\nseed {chosen.seed}, commit {tried}\n")
    print(
        "| package | mutants | drawn | killed | of these hang | survive |", "|---|---|---|---|---|---|", *rows, sep="\n"
    )
    return 0


def counted(package: str, mutants: list[Mutant], jobs: int) -> Counter[int] | None:
    """How many mutants of a package have which end; tells each that no test fails for. None: its tests fail anyway."""
    reach, found = reached(package), Counter[int]()
    if reach is None:
        print(f"the tests of {package} fail without any mutant: run {' '.join(TESTS[package])}", file=sys.stderr)
        return None
    for mutant, outcome in outcomes(mutants, package, reach, jobs):
        if mutant is not None:
            found[outcome] += 1
        elif outcome != SURVIVES:
            print(f"the tests of {package} fail in another order, without any mutant", file=sys.stderr)
            return None
        if mutant is not None and outcome != KILLED:
            print(f"\r{'hangs' if outcome == HANGS else 'survives'}: {mutant.told(ROOT)}", flush=True)
        print(f"\r{package}: {found.total()} of {len(mutants)} tried ", end="", file=sys.stderr, flush=True)
    return found


def commit() -> str:
    """Of the sources."""
    described = ["git", "describe", "--always", "--dirty"]
    return subprocess.run(described, cwd=ROOT, capture_output=True, text=True, check=False).stdout.strip()


if __name__ == "__main__":
    sys.exit(main())
