"""experiment: sweeps of scenarios with a verdict; run, join, list, show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from typer.core import TyperGroup

from zenoh_cbef.cli.calling.interrupts import INTERRUPTED
from zenoh_cbef.cli.calling.offer import group
from zenoh_cbef.cli.options.completing import experiments
from zenoh_cbef.cli.options.places import new_folder_of
from zenoh_cbef.cli.options.shared import AsJson, Force, Jobs, Skip
from zenoh_cbef.cli.options.typesetting import AsTable, Typesetting
from zenoh_cbef.cli.terminal.console import console, errors, say, tell
from zenoh_cbef.cli.terminal.fitting import Fitting
from zenoh_cbef.cli.terminal.listing import list_named
from zenoh_cbef.cli.terminal.progress import Lines
from zenoh_cbef.errors import UserError
from zenoh_cbef.experiment.cells import cells_of
from zenoh_cbef.experiment.figures import written_value
from zenoh_cbef.experiment.file import Written, purposes, read_experiment, read_source
from zenoh_cbef.experiment.journal import JOURNAL
from zenoh_cbef.experiment.numbers import check_number
from zenoh_cbef.experiment.page import (
    RESULTS,
    limits_of,
    other_experiment,
    runs_in,
    summary_text,
    values_of,
    write_outputs,
)
from zenoh_cbef.experiment.results import CellSummary, Outcome, Summary
from zenoh_cbef.experiment.shards import WHOLE, read_shard, shards_in
from zenoh_cbef.experiment.summary import EXIT_STATUS, check_expectations, summarize
from zenoh_cbef.experiment.sweep import Sweep
from zenoh_cbef.experiment.table import rows_of
from zenoh_cbef.experiment.typeset import FITTING, metric_table, results_table
from zenoh_cbef.numbers import SKIPPED, number
from zenoh_cbef.plain import read_toml
from zenoh_cbef.words import counted

_COLUMNS = {
    "position_rmse": "position RMSE (m)",
    "ratio_to_centralized": "ratio",
    "nees.average": "NEES",
    "disagreement": "apart (m)",
    "links.missed": "missed",
}


What = Annotated[
    str, typer.Argument(metavar="FILE", autocompletion=experiments, help="A built-in experiment or a TOML file.")
]


Folder = Annotated[
    Path | None, typer.Option("--output", "-o", metavar="DIR", help="Where results go; default: experiments/NAME.")
]
Seeds = Annotated[
    str | None, typer.Option(metavar="N", help="Other seeds than the file's: a number, or a list as [1, 5].")
]

Metric = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="--table of this metric alone; with two varied keys the second goes across."),
]


class _Experiments(TyperGroup):
    """The commands of `experiment`. A first word that is none of them is an experiment to run."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put `run` in front of an experiment and its options."""
        if args and args[0] not in {*self.commands, *ctx.help_option_names}:
            args = ["run", *args]
        return super().parse_args(ctx, args)

    def shell_complete(self, ctx: Any, incomplete: str) -> list[Any]:
        """Complete the commands, and the experiments that `run` takes."""
        what, *_ = self.commands["run"].params
        return [*super().shell_complete(ctx, incomplete), *what.shell_complete(ctx, incomplete)]


def _list() -> None:
    """List the built-in experiments."""
    list_named(purposes())


def _show(what: What) -> None:
    """Print an experiment as it is written."""
    typer.echo(read_source(what)[0], nl=False)


def _run(
    what: What,
    output: Folder = None,
    seeds: Seeds = None,
    jobs: Jobs = 0,
    dask: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Simulate on the workers of this Dask scheduler.")
    ] = None,
    shard: Annotated[
        str | None, typer.Option(metavar="I/N", help="Only the I-th of N parts of all runs; 'join' joins them.")
    ] = None,
    skip: Skip = SKIPPED,
    as_json: AsJson = False,
    as_table: AsTable = None,
    metric: Metric = None,
    force: Force = False,
) -> None:
    """Run a sweep of scenarios; exit status 0: as expected, 1: not, 2: cannot be judged."""
    printed = _Printed(as_json, as_table, metric)
    written = read_experiment(what, _changes(seeds))
    cells = cells_of(written)
    check_expectations(written, cells)
    part = WHOLE if shard is None else read_shard(shard)
    sweep = Sweep(experiment=written.experiment, cells=cells, skip=skip, jobs=jobs, dask=dask, tell=tell, shard=part)
    folder = _own(output, written, force=force)
    if shard is not None:
        _tell_shard(sweep, _swept(sweep, folder), folder)
        return
    own = force or (folder / JOURNAL).exists()
    folder = new_folder_of(folder, RESULTS, force=own)
    _conclude(written, sweep, _swept(sweep, folder), folder, printed)


def _join(
    what: What,
    output: Folder = None,
    seeds: Seeds = None,
    skip: Skip = SKIPPED,
    as_json: AsJson = False,
    as_table: AsTable = None,
    metric: Metric = None,
    force: Force = False,
) -> None:
    """Join the shards of a sweep, with the results and the exit status of one that was not divided."""
    printed = _Printed(as_json, as_table, metric)
    written = read_experiment(what, _changes(seeds))
    sweep = Sweep(written.experiment, cells_of(written), skip)
    check_expectations(written, sweep.cells)
    folder = _own(output, written, force=force)
    folder = new_folder_of(folder, RESULTS, force=force or bool(shards_in(folder)))
    _conclude(written, sweep, sweep.joined(folder), folder, printed)


def _own(output: Path | None, written: Written, *, force: bool) -> Path:
    """The folder of an experiment, which goes on in its own one. Raises UserError for another's, without `force`."""
    folder = output or Path("experiments") / written.name
    if not force and (whose := other_experiment(folder, written)):
        raise UserError(f"{folder} holds the results of {whose}; name another --output, or write over it with --force")
    return folder


def _changes(seeds: str | None) -> dict[str, object]:
    if seeds is None:
        return {}
    try:
        return read_toml(f"seeds = {seeds}")
    except ValueError:
        raise UserError(f"--seeds {seeds} is neither a number nor a list as [1, 2, 3]; give one of these") from None


def _swept(sweep: Sweep, folder: Path) -> list[list[Outcome]]:
    columns = (TextColumn("runs"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    try:
        with Progress(*columns, console=errors, transient=True, disable=not errors.is_terminal) as bar:
            task, lines = bar.add_task("", total=None), Lines("runs")

            def show(done: int, total: int) -> None:
                bar.update(task, completed=done, total=total)
                lines.show(done, total)

            return sweep.run(folder, show)
    except KeyboardInterrupt:
        place = sweep.shard.folder(folder)
        tell(f"interrupted; what is finished is in {place}, and the same command goes on from there")
        raise typer.Exit(INTERRUPTED) from None


def _tell_shard(sweep: Sweep, outcomes: list[list[Outcome]], folder: Path) -> None:
    runs = [one for cell in outcomes for one in cell]
    failures = [one.error for one in runs if one.error is not None]
    say(f"shard {sweep.shard} has finished its {counted(len(runs), 'run')}")
    say(f"in    {sweep.shard.folder(folder)}")
    if failures:
        tell(f"failed: {len(failures)} of {counted(len(runs), 'run')}: {failures[0]}")


@dataclass(frozen=True)
class _Printed:
    """What is printed in place of the usual table, if anything."""

    as_json: bool
    as_table: Typesetting | None
    metric: str | None

    def __post_init__(self) -> None:
        if self.metric is not None and self.as_table is None:
            raise UserError("--metric is for --table; give --table latex or --table csv too")
        if self.metric is not None:
            check_number(self.metric, "--metric")


def _conclude(written: Written, sweep: Sweep, outcomes: list[list[Outcome]], folder: Path, printed: _Printed) -> None:
    summary = summarize(written, sweep.cells, outcomes)
    # What was found is told before anything is written that may fail.
    if printed.as_json:
        print(summary_text(summary), end="")
    elif printed.as_table is not None:
        metric, most = printed.metric, FITTING if printed.as_table is Typesetting.latex else None
        table = results_table(summary, most) if metric is None else metric_table(summary, metric)
        print(printed.as_table.text(table), end="")
    else:
        _tell(summary)
    if (before := runs_in(folder)) > summary.runs and (folder / JOURNAL).exists():
        tell(f"note: the results were of {before} runs, and are of {summary.runs} now; {JOURNAL} keeps the others")
    for sentence in write_outputs(summary, rows_of(sweep.cells, outcomes), written.source, folder):
        tell(sentence)
    if not (printed.as_json or printed.as_table):
        say(f"page    {folder / 'index.html'}")
    raise typer.Exit(EXIT_STATUS[summary.verdict])


def _tell(summary: Summary) -> None:
    failed = f", {summary.failed} more failed" if summary.failed else ""
    of = counted(summary.runs - summary.failed, "run")
    table = Table(title=f"{summary.experiment}: medians of {of}{failed}", title_justify="left")
    for name in _short(summary.varied):
        table.add_column(name)
    metrics = {name: head for name, head in _COLUMNS.items() if any(name in one.metrics for one in summary.cells)}
    for head in metrics.values():
        table.add_column(head, justify="right")
    for cell in summary.cells:
        found = [None if one is None else one.median for one in map(cell.metrics.get, metrics)]
        table.add_row(*map(written_value, cell.values.values()), *map(number, found))
    console.print(Fitting(table))
    for cell in summary.cells:
        if cell.failed:
            why = cell.failures[0].error
            said = f"failed: {cell.failed} of {counted(cell.runs, 'run')} with {values_of(cell)}: {why}"
            tell(said)
        _tell_losses(cell)
    for one in summary.expect:
        for judged in one.cells:
            median = number(None if judged.found is None else judged.found.median)
            said = f"{judged.verdict}: {one.metric} {limits_of(one)} with {values_of(judged)}: {median}"
            say(said)
        if one.why:
            tell(f"{one.metric}: {one.why}")
    untold = summary.verdict == "met" and not summary.expect
    say(f"verdict {summary.verdict}{', as the file has no [[expect]]' * untold}")


def _short(varied: Sequence[str]) -> list[str]:
    """The last part of each varied key, or all of it where that is a number or not unique."""
    last = [key.rpartition(".")[2] for key in varied]
    alone = [last.count(name) == 1 and not name.isdecimal() for name in last]
    return [name if unique else key for key, name, unique in zip(varied, last, alone, strict=True)]


def _tell_losses(cell: CellSummary) -> None:
    for name, who in (("lost", "network"), ("twin_lost", "centralised filter")):
        if share := cell.shares.get(name):
            said = f"lost: the {who} loses the target in {share:.0%} of the runs with {values_of(cell)}"
            say(said)


VERB = group(
    "Run sweeps of scenarios, which end with a verdict. 'experiment FILE' is short for 'experiment run FILE'.",
    {
        "experiment run loss --seeds 5 --jobs 2": _run,
        "experiment join loss": _join,
        "experiment list": _list,
        "experiment show loss": _show,
    },
    of=_Experiments,
    example="experiment loss --seeds 5",
)
