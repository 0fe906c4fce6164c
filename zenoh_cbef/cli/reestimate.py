"""reestimate: a log's measurements through another filter."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.shared import LogFile, Overrides, Smooth
from zenoh_cbef.cli.terminal.beforehand import tell_beforehand
from zenoh_cbef.cli.terminal.console import say, tell_what_lacks
from zenoh_cbef.cli.terminal.progress import bar
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.prove.reestimate import Reestimated, reestimate
from zenoh_cbef.log.read.measurements import read_measurements
from zenoh_cbef.log.tools.collection import place_of_log
from zenoh_cbef.numbers import number
from zenoh_cbef.protocol.names import check_run
from zenoh_cbef.scenario.load import Loaded
from zenoh_cbef.words import counted


def _reestimate(
    log: LogFile = Path("logs/latest"),
    overrides: Overrides = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="The log to write; default: a folder of its own in logs/.")
    ] = None,
    run: Annotated[
        str | None, typer.Option("--run", callback=check_run, help="Its run's name; default: the log's and the filter.")
    ] = None,
    smooth: Smooth = False,
) -> None:
    """Estimate again from the measurements of a log, with another filter or parameters, without processes.

    With --smooth the log also has each agent's smoothed estimates, made from all of its own: the best path.

    The result is a log too, for 'compare', 'analyze', 'verify' and 'export'.
    """
    found = read_measurements(log)
    loaded = found.loaded(overrides or ())
    if smooth:
        loaded = found.loaded([*(overrides or ()), f"filter.lag_seconds={_whole(loaded)}"])
    tell_what_lacks(found.lacks())
    tell_beforehand(loaded.plan)
    name = run or f"{found.header.run}-{loaded.scenario.filter.kind}"
    with place_of_log(name, output) as path, bar("estimating", loaded.scenario.length) as estimated:
        done = reestimate(found, loaded, name, path, estimated)
    say(_figures(done))
    say(f"log     {path}")
    say(f"errors  zenoh-cbef analyze {path}")


def _whole(loaded: Loaded) -> float:
    """A lag as long as the run, s: every estimate waits for all later ones. Raises UserError where none can."""
    if not loaded.plan.abilities.covariance:
        kind = loaded.scenario.filter.kind
        raise UserError(
            f"--smooth needs a filter with a covariance, which {kind!r} has not; add --set filter.kind=sicf"
        )
    return loaded.scenario.length * loaded.scenario.dt


def _figures(done: Reestimated) -> str:
    whole = done.computing_seconds + done.writing_seconds
    return (
        f"{counted(done.steps, 'step')} of {number(done.run_seconds, 's')}: "
        f"estimated in {number(done.computing_seconds, 's')}, "
        f"{number(done.run_seconds / done.computing_seconds)} times faster than real time; "
        f"with its log in {number(whole, 's')}, {number(done.run_seconds / whole)} times"
    )


VERB = verb(_reestimate, "reestimate logs/latest --set filter.kind=icf")
