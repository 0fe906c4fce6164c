"""Parts of an experiment for array jobs: which runs a shard does, and where it keeps them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from pathlib import Path

from zenoh_cbef.errors import UserError
from zenoh_cbef.experiment.cells import Cell, seeds_of
from zenoh_cbef.experiment.journal import JOURNAL
from zenoh_cbef.plain import whole
from zenoh_cbef.words import first_of

_MOST = 1_000_000
_TOLD = 10


@dataclass(frozen=True)
class Shard:
    """One of several parts of all runs, which differ by one run at most; they count from 1."""

    number: int = 1
    of: int = 1

    def __str__(self) -> str:
        return f"{self.number}/{self.of}"

    def folder(self, experiment: Path) -> Path:
        """Where it keeps its runs: shards have folders of their own, as they cannot all write into one file."""
        return experiment if self.of == 1 else experiment / f"shard-{self.number}-of-{self.of}"

    def seeds_of(self, cell: Cell, seeds: int | Sequence[int]) -> list[int]:
        """The seeds of its runs of a cell. Shards take runs in turn, so that each gets its part of the slow cells."""
        every = seeds_of(cell, seeds)
        first = (self.number - 1 - cell.index * len(every)) % self.of
        return every[first :: self.of]


WHOLE = Shard()


def read_shard(text: str) -> Shard:
    """The shard that `2/4` names. Raises UserError where it names none."""
    number, _, of = text.partition("/")
    chosen = Shard(whole(number) or 0, whole(of) or 0)
    if not 1 <= chosen.number <= chosen.of <= _MOST:
        raise UserError(f"--shard {text} is no part of a whole; give the second of four as 2/4")
    return chosen


def shards_in(folder: Path) -> list[Shard]:
    """The shards that have kept runs in the folder of an experiment."""
    names = (re.fullmatch(r"shard-(\d+)-of-(\d+)", place.parent.name) for place in folder.glob(f"shard-*/{JOURNAL}"))
    return [Shard(int(name[1]), int(name[2])) for name in names if name]


def lacking(
    missing: AbstractSet[tuple[int, int]], cells: Sequence[Cell], seeds: int | Sequence[int], there: Sequence[Shard]
) -> str:
    """Which shards lack these runs (cell, seed), in words: of as many as those that are there are parts of."""
    of = max((one.of for one in there), default=1)
    shards = [Shard(number, of) for number in range(1, of + 1)]
    runs = {one: [(cell.index, seed) for cell in cells for seed in one.seeds_of(cell, seeds)] for one in shards}
    names = [str(one) for one in shards if not missing.isdisjoint(runs[one])]
    return f"--shard {names[0]}" if len(names) == 1 else f"the shards {first_of(names, _TOLD)}"
