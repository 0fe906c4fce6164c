"""verify: prove a log."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer

from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.shared import LogFile
from zenoh_cbef.cli.terminal.one_line import OneLine
from zenoh_cbef.log.prove.verify import verify

Tolerance = Annotated[
    float, typer.Option(min=0.0, max=1.0, help="Relative difference to let pass, for logs of another processor family.")
]


def _verify(log: LogFile = Path("logs/latest"), tolerance: Tolerance = 0.0) -> None:
    """Execute a logged run again from its scenario and beacons and compare every estimate and consensus message.

    Exit status: 0 equal, 1 different (the first difference is shown), 2 cannot be judged.
    """
    with closing(OneLine()) as line:
        verdict = verify(log, tolerance=tolerance, report=line.show if line.over else lambda _: None)
    typer.echo(verdict.text if verdict.result != "unknown" else f"cannot be judged: {verdict.text}")
    raise typer.Exit(verdict.exit_status)


VERB = verb(_verify, "verify logs/latest")
