"""Mutation testing: change one thing in the package, and see whether a test fails.

    python -m benchmarks.mutants [FILE OR FOLDER ...] [--most N] [--seed S] [--jobs J] [--quick]

A mutant has one operator, number, condition, returned value or call changed (mutations.py), in the four packages whose
errors stay unseen longest. Of each package N mutants are drawn, the same ones for the same seed and the same sources.
Each meets the quick tests of its package; what survives these meets slower ones, of whole runs (mutant_stages.py).
Which tests reach which statement is found out first (mutant_reach.py). A mutant is killed when one that reaches its
statement fails, and survives when all pass (mutant_trial.py). Where a statement runs as its file is imported, all
tests of the stage are tried, in a fork that imports it anew. docs/mutants.md explains the survivors.
"""

from __future__ import annotations

import argparse
import os
import random
import subprocess
import sys
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

# What every fork would import again: the parent imports it once, and nothing of the package itself.
import numpy as np  # noqa: F401 - as told above
import pydantic  # noqa: F401 - as told above
import zenoh  # noqa: F401 - as told above
from hypothesis import Phase, settings

from benchmarks.mutant_reach import replace_code
from benchmarks.mutant_stages import QUICK, ROOT, SLOWER, Chosen, Named, Stage, fails, file_of, is_near, quick
from benchmarks.mutant_trial import HANGS, IMPORTED, KILLED, SURVIVES, Crew, Trial, Trying, in_fork
from benchmarks.mutations import Mutant, mutants_of

WORDS = {KILLED: "killed by", HANGS: "hangs in", SURVIVES: "survives"}

# A random example that fails is enough: it need not be short, nor be remembered.
settings.register_profile("mutants", phases=(Phase.explicit, Phase.generate), database=None)
settings.load_profile("mutants")


def imported_anew(mutant: Mutant, tests: Collection[str], seconds: float) -> int:
    """What becomes of a mutant in a fork that imports its source: first the tests that name its module, then all."""
    near = [test for test in tests if is_near(test, mutant)]
    far = [test for test in tests if not is_near(test, mutant)]

    def work() -> int:
        replace_code({mutant.path}, lambda _: mutant.tree())
        parts = [part for part in (near, far) if part]
        return KILLED if any(fails(sorted({*map(file_of, part)}), Named(part)) for part in parts) else SURVIVES

    return in_fork(work, seconds)


def outcomes(stage: Stage, trials: list[Trial], jobs: int) -> Iterator[tuple[Trial, int]]:
    """What becomes of each trial, as it is known."""
    left: list[tuple[int, Mutant]] = []
    crew = Crew(jobs)

    def collected() -> None:
        in_fork(lambda: fails(stage.tests, Chosen(stage.takes), Trying(trials, crew.turn, crew.tell)), 1e6)

    def alone() -> None:
        while (turn := crew.turn()) < len(left):
            number, mutant = left[turn]
            crew.tell(number, imported_anew(mutant, trials[number].tests, trials[number].seconds))

    for number, found in crew.found(collected, len(trials)):
        mutant = trials[number].mutant
        if mutant is not None and found == IMPORTED:
            left.append((number, mutant))
        else:
            yield trials[number], found
    for number, found in crew.found(alone, len(left)):
        yield trials[number], found


def tried(
    stage: Stage, mutants: list[Mutant], passed: Mapping[Mutant, Collection[str]], jobs: int
) -> dict[Mutant, tuple[int, Collection[str]]] | None:
    """What becomes of each mutant in a stage, and the tests that it met. None: its tests fail without any mutant.

    passed: tests that a mutant has met before.
    """
    reach = stage.reach(mutants)
    if reach is None:
        print(f"{stage.name} tests fail without any mutant: run pytest {' '.join(stage.tests)}", file=sys.stderr)
        return None
    trials = [stage.trial(mutant, reach, passed.get(mutant, ())) for mutant in mutants]
    every = {test: reach.seconds[test] for trial in trials for test in trial.tests}
    honest = Trial(None, dict(sorted(every.items(), key=lambda item: item[1])))
    found: dict[Mutant, tuple[int, Collection[str]]] = {}
    for trial, outcome in outcomes(stage, [honest, *trials], jobs):
        if trial.mutant is not None:
            found[trial.mutant] = outcome, trial.tests
        elif outcome != SURVIVES:
            print(f"{stage.name} tests fail in another order, without any mutant", file=sys.stderr)
            return None
        if trial.mutant is not None and (outcome != KILLED or passed):
            print(f"\r{WORDS[outcome]} {stage.name} tests: {trial.mutant.told(ROOT)}", flush=True)
        print(f"\r{stage.name} tests: {len(found)} of {len(mutants)} tried ", end="", file=sys.stderr, flush=True)
    return found


def drawn(places: list[str], most: int, seed: int) -> Iterator[tuple[str, int, list[Mutant]]]:
    """Of each package: its name, how many mutants there are, and those that are tried."""
    wanted = [Path(place).resolve() for place in places] or [ROOT]
    for package in QUICK:
        files = [file for file in sorted((ROOT / package).rglob("*.py")) if any(map(file.is_relative_to, wanted))]
        every = [mutant for file in files for mutant in mutants_of(file)]
        if every:
            chosen = random.Random(f"{package} {seed}").sample(range(len(every)), min(most, len(every)))  # noqa: S311 - again the same
            yield package, len(every), [every[place] for place in sorted(chosen)]


def main() -> int:
    """Try mutants; print the survivors, and a table of what became of each package's."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mutants", description=str(__doc__).split("\n", 1)[0])
    parser.add_argument("places", nargs="*", help="files or folders of the package (default: all four packages)")
    parser.add_argument("--most", type=int, default=100, help="mutants of each package (default: 100)")
    parser.add_argument("--seed", type=int, default=1, help="which ones are drawn (default: 1)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="at once (default: one for each core)")
    parser.add_argument("--quick", action="store_true", help="without the slower tests")
    chosen = parser.parse_args()
    os.chdir(ROOT)
    packages, commit = list(drawn(chosen.places, chosen.most, chosen.seed)), described()
    ends: dict[Mutant, tuple[int, Collection[str]]] = {}
    for package, _, mutants in packages:
        found = tried(quick(package), mutants, {}, chosen.jobs)
        if found is None:
            return 2
        ends.update(found)
    left = {mutant: tests for mutant, (end, tests) in ends.items() if end == SURVIVES}
    slower = tried(SLOWER, list(left), left, chosen.jobs) if left and not chosen.quick else {}
    if slower is None:
        return 2
    print(f"\nseed {chosen.seed}, commit {commit}\n")
    print("| package | mutants | drawn | killed by quick tests | by these or slower ones | of these hang | survive |")
    print("|---|---|---|---|---|---|---|")
    for package, count, mutants in packages:
        print(row(package, count, [(ends[one][0], slower.get(one, ends[one])[0]) for one in mutants]))
    return 0


def row(package: str, count: int, ends: list[tuple[int, int]]) -> str:
    """A package's line of the table. ends: of each mutant after the first and after the last stage."""
    first, last = [sum(end[stage] != SURVIVES for end in ends) for stage in (0, 1)]
    hang = sum(HANGS in end for end in ends)
    shares = [f"{killed} ({killed / len(ends):.0%})" for killed in (first, last)]
    return f"| `{package}` | {count} | {len(ends)} | {shares[0]} | {shares[1]} | {hang} | {len(ends) - last} |"


def described() -> str:
    """The commit of the sources; at the start, as a checkout can move meanwhile."""
    words = ["git", "describe", "--always", "--dirty"]
    return subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False).stdout.strip()


if __name__ == "__main__":
    sys.exit(main())
