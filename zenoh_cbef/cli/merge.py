"""merge: logs of one run, as recorders on several hosts wrote them, joined."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.choosing import LOSSY
from zenoh_cbef.cli.options.completing import logs
from zenoh_cbef.cli.options.shared import Compress, NewLog
from zenoh_cbef.cli.terminal.console import errors, warn
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.tools.merge import Clock, merge
from zenoh_cbef.words import counted


def _merge(
    logs: Annotated[
        list[Path], typer.Argument(metavar="LOG", autocompletion=logs, help="Logs of one run, or folders of its logs.")
    ],
    output: NewLog,
    compression: Compress = "zstd",
) -> None:
    """Join logs of one run by log time, each message once, and compare the clocks of the hosts that wrote them.

    Exit status 3 where not all could be read.
    """
    if len({path.resolve() for path in logs}) < len(logs):
        raise UserError("one log is named twice; name each once")
    join(logs, output, compression)


def join(logs: Sequence[Path], output: Path, compression: Compress, names: Sequence[str] = ()) -> None:
    """Merge logs, and say what came of it. Exits with status 3 where not all could be read.

    names: what the logs are called, where that is not the path.
    """
    opened = [open_log(path) for path in logs]
    with errors.status("merging"):
        found = merge(opened, output, compression)
    called = dict(zip([log.path for log in opened], names or map(str, logs), strict=True))
    damage = [f"{called[log.path]}: {sentence}" for log in opened for sentence in log.damage]
    warn(damage)
    typer.echo(f"{counted(found.messages, 'message')} in {output}, {counted(found.duplicates, 'duplicate')} left out")
    for clock in found.clocks:
        typer.echo(_words(clock, called[clock.log], called[opened[0].path]))
    if damage:
        raise typer.Exit(LOSSY)


def _words(clock: Clock, log: str, first: str) -> str:
    name = f"{log} ({clock.host})" if clock.host else log
    if clock.offset is None or clock.doubt is None:
        return f"clock of {name}: not compared, as it shares no message with {first}"
    side = "ahead of" if clock.offset >= 0 else "behind"
    doubt = f" +- {clock.doubt / 1e6:.3f} ms" if clock.doubt else ""
    return (
        f"clock of {name}: {abs(clock.offset) / 1e6:.3f} ms{doubt} {side} that of {first}, "
        f"by {clock.shared} shared messages"
    )


VERB = verb(_merge, "merge a.mcap b.mcap -o whole.mcap")
