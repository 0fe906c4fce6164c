"""Mutation testing: change one thing in the package, and see whether a test fails.

    python -m benchmarks.mutants [FILE OR FOLDER ...] [--most N] [--seed S]

A mutant has one operator, number, condition, returned value or call changed (mutations.py), in the four packages whose
errors stay unseen longest. Of each package N mutants are drawn, the same ones for the same seed and the same sources.
A mutant is killed when a fast test of its package fails; those that import the mutated module come first. It survives
when all pass. docs/mutants.md explains the survivors. One core, a few seconds for each mutant.
"""

from __future__ import annotations

import argparse
import os
import random
import resource
import signal
import sys
import time
from collections.abc import Iterator
from importlib.machinery import SourceFileLoader
from pathlib import Path
from typing import Any

# What every fork would import again: the parent imports it once, and nothing of the package itself.
import hypothesis  # noqa: F401
import numpy as np  # noqa: F401
import pydantic  # noqa: F401
import pytest
import zenoh  # noqa: F401

from benchmarks.mutations import Mutant, mutants_of

ROOT = Path(__file__).resolve().parents[1]
TESTS = {
    "zenoh_cbef/faults": ("tests/faults",),
    "zenoh_cbef/log/mcap": ("tests/log/mcap",),
    "zenoh_cbef/protocol": ("tests/protocol", "tests/log/write/test_run_log.py"),
    "zenoh_cbef/tracking": ("tests/tracking", "tests/scenario/test_build.py", "tests/test_golden.py"),
}
"""The tests that a package's mutants meet."""

SLOW = (
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

SECONDS = 60
"""Of processor time: tests that take longer hang, which a reader of their results notices, so the mutant is killed."""


class Chosen:
    """A pytest plugin: leaves slow tests out, and lets those of the mutated module come first."""

    def __init__(self, mutant: Mutant | None) -> None:
        self._module = "" if mutant is None else ".".join(mutant.path.relative_to(ROOT).with_suffix("").parts)

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        """Pytest's hook."""
        items[:] = [item for item in items if not any(slow in item.nodeid for slow in SLOW)]
        near = {path for path in {item.path for item in items} if self._module in path.read_text(encoding="utf-8")}
        items.sort(key=lambda item: item.path not in near)


def survives(mutant: Mutant | None, tests: tuple[str, ...]) -> bool:
    """Whether tests pass in a fork whose source is the mutant's; None: the source as it is."""
    child = os.fork()
    if child == 0:
        os.setpgid(0, 0)
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
        os._exit(_tested(mutant, tests))
    until = time.monotonic() + 10 * SECONDS
    while time.monotonic() < until:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return status == 0
        time.sleep(0.02)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return False


def _tested(mutant: Mutant | None, tests: tuple[str, ...]) -> int:
    if mutant is not None:
        mutated, honest = mutant, SourceFileLoader.get_code

        def get_code(self: SourceFileLoader, fullname: str) -> Any:
            if Path(self.path) == mutated.path:
                return compile(mutated.tree(), self.path, "exec")
            return honest(self, fullname)

        setattr(SourceFileLoader, "get_code", get_code)  # noqa: B010 - mypy lets no method be replaced
    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    words = ["-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "--tb=no", *tests]
    return int(pytest.main(words, plugins=[Chosen(mutant)]))


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
    """Try mutants; print the survivors, and the share of each package that was killed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mutants", description=str(__doc__).split("\n", 1)[0])
    parser.add_argument("places", nargs="*", help="files or folders of the package (default: all four packages)")
    parser.add_argument("--most", type=int, default=100, help="mutants of each package (default: 100)")
    parser.add_argument("--seed", type=int, default=1, help="which ones are drawn (default: 1)")
    chosen = parser.parse_args()
    os.chdir(ROOT)
    for package, count, mutants in drawn(chosen.places, chosen.most, chosen.seed):
        if not survives(None, TESTS[package]):
            print(f"the tests of {package} fail without any mutant: run {' '.join(TESTS[package])}", file=sys.stderr)
            return 2
        alive = 0
        for tried, mutant in enumerate(mutants, 1):
            if survives(mutant, TESTS[package]):
                alive += 1
                print(f"\rsurvived: {mutant.told(ROOT)}", flush=True)
            print(f"\r{package}: {tried} of {len(mutants)} tried", end="", file=sys.stderr, flush=True)
        killed = len(mutants) - alive
        share = f"{killed} of {len(mutants)} mutants killed ({killed / len(mutants):.0%})"
        print(f"\r{package}: {share}, drawn from {count}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
