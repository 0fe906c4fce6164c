"""lab: a run in a browser."""

from __future__ import annotations

import webbrowser
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Annotated
from urllib.parse import urljoin

import typer

from zenoh_cbef.cli.calling.leash import follow_parent
from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.asking import locate
from zenoh_cbef.cli.options.joining import JoiningCommand, JoiningContext
from zenoh_cbef.cli.options.shared import Overrides
from zenoh_cbef.cli.terminal.console import tell
from zenoh_cbef.errors import UserError
from zenoh_cbef.lab.bench import Bench
from zenoh_cbef.lab.guard import LOOPBACK, Guard
from zenoh_cbef.lab.server import Serving, address, bound
from zenoh_cbef.outside.registry import known_runs
from zenoh_cbef.protocol.session import Connection
from zenoh_cbef.scenario.load import builtin_names, purposes
from zenoh_cbef.viewers.colours import LAYOUT

_PORT = 8765
"""Where Foxglove looks first."""
_WHAT = "A scenario to start, a run to look at, or a log; default: choose on the page."


def _lab(
    ctx: JoiningContext,
    what: Annotated[str | None, typer.Argument(metavar="[SCENARIO|RUN|LOG]", help=_WHAT)] = None,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in a browser.")] = True,
    host: Annotated[str, typer.Option(help="Where the page is served; others than this host should not see it.")] = (
        "127.0.0.1"
    ),
    beside: Annotated[
        str | None, typer.Option(metavar="LOG", help="A log to show beside it, over the same time.")
    ] = None,
    overrides: Overrides = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Its port; default: a free one.")] = 0,
    foxglove: Annotated[bool, typer.Option("--foxglove", help="Serve Foxglove, Lichtblick and PlotJuggler, too.")] = (
        False
    ),
    foxglove_port: Annotated[int, typer.Option(min=0, max=65535, help="Where these connect; 0: a free port.")] = _PORT,
    controls: Annotated[
        bool, typer.Option("--controls", help="With --foxglove: take orders with the lab's token from there.")
    ] = False,
) -> None:
    """See a run in a browser while it goes on, or its log: map, errors, links. Cut links and wind back by mouse."""
    if controls and not foxglove:
        raise UserError("--controls says what viewers may do; name --foxglove, too")

    def reach(run: str) -> tuple[str, Connection]:
        name, connection = locate(run, ctx.joining)
        return name, replace(connection, mode="client", detour=True)

    follow_parent()
    bench = Bench(purposes(), reach, measured=foxglove)
    guard = Guard(hosts=(*LOOPBACK, f"[{host}]" if ":" in host else host))
    with ExitStack() as held:
        listening = held.enter_context(bound(host, port))
        held.callback(bench.close)
        url = address(listening, host, guard)
        told = [f"the lab is at {url}  (Ctrl-C ends it)"]
        if foxglove:
            from zenoh_cbef.lab.foxglove import Foxglove  # noqa: PLC0415 - time that only its users should wait

            served = held.enter_context(Foxglove(bench, LOOPBACK[0], foxglove_port, guard if controls else None))
            told.append(f"viewers connect to ws://{LOOPBACK[0]}:{served.port}; a layout: {urljoin(url, LAYOUT)}")
        if beside is not None:
            bench.put_beside(beside)
        if what is not None and (ctx.joining.connect or ctx.joining.config):
            bench.join(what)
        elif what is not None:
            _open(bench, what, overrides or [])
        Serving(bench, guard, lambda: _ready(told, url if browser else None)).run(listening)


def _ready(told: list[str], url: str | None) -> None:
    for line in told:
        tell(line)
    if url is not None:
        webbrowser.open(url)


def _open(bench: Bench, what: str, overrides: list[str]) -> None:
    """Open what the command line names on this host: a run that goes on, else a scenario, else a log."""
    if what in known_runs():
        bench.join(what)
    elif what in builtin_names() or what.endswith(".toml"):
        tell(f"starting {what}")
        bench.start(what, overrides)
    elif Path(what).exists() or (Path("logs") / what).is_dir():
        bench.open_log(what)
    else:
        raise UserError(f"{what!r} is no run on this host, no log and no scenario; see 'scenario list' and 'status'")


VERB = verb(_lab, "lab tracking", JoiningCommand)
