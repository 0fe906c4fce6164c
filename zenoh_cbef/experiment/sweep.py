"""All runs of an experiment: spreads unfinished ones over the cores, and keeps each outcome at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from zenoh_cbef.errors import UserError
from zenoh_cbef.experiment.cells import Cell
from zenoh_cbef.experiment.cores import batches, spread
from zenoh_cbef.experiment.engines import executed, simulated
from zenoh_cbef.experiment.file import Experiment
from zenoh_cbef.experiment.journal import Journal, key_of
from zenoh_cbef.experiment.results import Outcome
from zenoh_cbef.experiment.shards import WHOLE, Shard, lacking, shards_in
from zenoh_cbef.words import counted

_NOTHING = "the run left no outcome"


@dataclass(frozen=True)
class Work:
    """Some runs of one cell that are done together."""

    cell: Cell
    key: str
    seeds: list[int]


Done = tuple[Work, list[Outcome]]


@dataclass(frozen=True)
class Sweep:
    """The settings that all runs of an experiment share.

    jobs: processes that simulate at a time; 0: one per core. dask: the address of a Dask scheduler, whose workers
    simulate in place of processes on this host. tell gets a sentence where one core has to do the work of all. shard:
    the part of the runs to do.
    """

    experiment: Experiment
    cells: Sequence[Cell]
    skip: float
    jobs: int = 0
    dask: str | None = None
    tell: Callable[[str], None] = lambda _: None
    shard: Shard = WHOLE

    def run(self, folder: Path, progress: Callable[[int, int], None]) -> list[list[Outcome]]:
        """The outcomes of every cell, in the order of its seeds; progress gets how many are finished, of how many.

        They are kept in the shard's folder, and of a shard they are its part.
        """
        folder = self.shard.folder(folder)
        with Journal(folder) as journal:
            work = [one for cell in self.cells for one in self._left(cell, journal)]
            total = sum(len(self._seeds(cell)) for cell in self.cells if cell.scenario)
            finished = total - sum(len(one.seeds) for one in work)
            progress(finished, total)
            for done, outcomes in self._spread(work, folder / "logs"):
                journal.add(done.key, outcomes)
                finished += len(outcomes)
                progress(finished, total)
            return [self._outcomes(cell, journal) for cell in self.cells]

    def joined(self, folder: Path) -> list[list[Outcome]]:
        """The outcomes of every cell from the shards in the folder, whose own journal keeps them from then on.

        Raises UserError where runs are missing, and names their shards.
        """
        shards = shards_in(folder)
        if not shards:
            raise UserError(
                f"{folder} holds no shard; run 'experiment' with --shard 1/4 and so on, or name their --output"
            )
        with Journal(folder) as journal:
            for shard in shards:
                journal.take_in(shard.folder(folder))
            found = [self._outcomes(cell, journal) for cell in self.cells]
        runs = [(cell.index, one) for cell, ones in zip(self.cells, found, strict=True) for one in ones]
        if missing := {(cell, one.seed) for cell, one in runs if one.error == _NOTHING}:
            which = lacking(missing, self.cells, self.experiment.seeds, shards)
            raise UserError(
                f"{len(missing)} of {counted(len(runs), 'run')} are missing; run {which} with the same file, --seeds "
                "and --skip, then join again"
            )
        return found

    def _seeds(self, cell: Cell) -> list[int]:
        return self.shard.seeds_of(cell, self.experiment.seeds)

    def _left(self, cell: Cell, journal: Journal) -> Iterator[Work]:
        if cell.scenario is None:
            return
        key = key_of(cell.scenario, self.experiment.engine, self.skip)
        seeds = [seed for seed in self._seeds(cell) if journal.outcome(key, seed) is None]
        most = 1
        if self.experiment.engine == "simulate":
            most = -(-len(seeds) // batches(cell.scenario, len(seeds), self.jobs)) or 1
        for start in range(0, len(seeds), most):
            yield Work(cell, key, seeds[start : start + most])

    def _spread(self, work: Sequence[Work], logs: Path) -> Iterator[Done]:
        do = partial(_do, engine=self.experiment.engine, skip=self.skip, logs=logs)
        # A run's processes fill the cores by themselves.
        jobs = 1 if self.experiment.engine == "processes" else self.jobs
        return spread(do, work, jobs, dask=self.dask, tell=self.tell)

    def _outcomes(self, cell: Cell, journal: Journal) -> list[Outcome]:
        seeds = self._seeds(cell)
        if cell.scenario is None:
            return [Outcome(seed, error=cell.error) for seed in seeds]
        key = key_of(cell.scenario, self.experiment.engine, self.skip)
        return [journal.outcome(key, seed) or Outcome(seed, error=_NOTHING) for seed in seeds]


def _do(work: Work, *, engine: str, skip: float, logs: Path) -> Done:
    """Do some runs. Never raises for what a run does: an outcome then holds its `error`."""
    cell, seeds = work.cell, work.seeds
    if cell.scenario is None:
        raise RuntimeError("a cell without a scenario cannot be run")
    if engine == "simulate":
        return work, simulated(cell.scenario, seeds, skip)
    folders = {seed: logs / f"cell-{cell.index}-seed-{seed}" for seed in seeds}
    return work, [executed(cell.scenario, seed, skip, folder) for seed, folder in folders.items()]
