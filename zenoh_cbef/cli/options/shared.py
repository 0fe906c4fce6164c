"""Options that several verbs share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from zenoh_cbef.cli.options.completing import logs, runs, scenarios
from zenoh_cbef.numbers import MOST_SKIPPED
from zenoh_cbef.protocol.names import check_run

LONGEST_SECONDS = 1e9
"""What options of time take at most, s: some thirty years, so that every time can be told in whole nanoseconds."""

ScenarioName = Annotated[
    str,
    typer.Argument(
        metavar="SCENARIO", autocompletion=scenarios, help="A built-in scenario (see 'scenario list') or a TOML file."
    ),
]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Override a scenario key, as in consensus.rounds=5; repeatable."),
]
LogFile = Annotated[
    Path, typer.Argument(metavar="LOG", autocompletion=logs, help="A log, the folder of a run, or its name in logs/.")
]
Force = Annotated[bool, typer.Option("--force", "-f", help="Overwrite what --output names.")]
Stay = Annotated[
    float,
    typer.Option(
        min=0.0, max=LONGEST_SECONDS, metavar="SECONDS", help="After the run, let 'fetch' get the log for so long."
    ),
]
NewLog = Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="The log to write.")]
Compress = Annotated[Literal["zstd", "lz4", "none"], typer.Option("--compression", help="Compression of the new log.")]
WHICH = "Which messages"
"""Heading of the options that choose messages of a log."""
Include = Annotated[
    list[str] | None,
    typer.Option(
        "-y",
        "--include-topic-regex",
        metavar="REGEX",
        rich_help_panel=WHICH,
        help="Only topics that match as a whole, as in '.*/estimate'; repeatable.",
    ),
]
Exclude = Annotated[
    list[str] | None,
    typer.Option(
        "-n",
        "--exclude-topic-regex",
        metavar="REGEX",
        rich_help_panel=WHICH,
        help="No topics that match as a whole; repeatable. Either -y or -n.",
    ),
]
_TIME = "ns since the epoch, an RFC 3339 date, or seconds since the log's start as 12.5s."
Start = Annotated[
    str | None,
    typer.Option(
        "-S", "--start", metavar="TIME", rich_help_panel=WHICH, help=f"Only what was logged at or after it: {_TIME}"
    ),
]
End = Annotated[
    str | None,
    typer.Option("-E", "--end", metavar="TIME", rich_help_panel=WHICH, help=f"Only what was logged before it: {_TIME}"),
]
Smooth = Annotated[
    bool, typer.Option("--smooth", help="Smooth each agent's estimates: what later ones say of earlier steps.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of a table.")]
Skip = Annotated[
    float,
    typer.Option(min=0.0, max=MOST_SKIPPED, help="Share of steps left out at the start of RMSE, NEES and ratios."),
]
Jobs = Annotated[int, typer.Option(min=0, max=10_000, help="Processes that simulate at a time; 0: one per core.")]
Run = Annotated[
    str,
    typer.Option(
        "--run", callback=check_run, autocompletion=runs, help="The run's name, the same for all its processes."
    ),
]
