"""The command line: its verbs, each with its place in `--help`. The file of a verb is imported when it is called."""

from __future__ import annotations

import gc
import re
import sys
from functools import cache
from importlib import import_module
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperArgument, TyperGroup, TyperOption
from typer.exceptions import Abort, TyperException

from zenoh_cbef import __version__
from zenoh_cbef.cli.calling.interrupts import raise_from_here
from zenoh_cbef.errors import Interrupted, UserError

GROUPS = {
    "Run": {
        "run": "Run a scenario on this host as processes; analyse it",
        "sim": "Simulate a scenario without processes",
        "scenario": "List, show, check and make scenarios",
        "fault": "Inject faults into a run, list and end them",
        "stop": "End a run",
    },
    "Join a run, also from other hosts": {
        "target": "Be the target of a run",
        "agent": "Be an agent of a run",
        "fleet": "Be many agents, each a process; restart them",
        "record": "Be the recorder of a run",
        "receive": "Feed a run from real receivers",
        "router": "Be a router for runs",
        "certs": "Make certificates for runs over networks",
    },
    "Look at a run": {
        "status": "Show agents, links and errors as a table",
        "watch": "Show them with curves, on the whole terminal",
        "lab": "Show a run or a log in a browser, and touch it",
        "health": "Ask whether a process is there",
        "doctor": "Find what is wrong with this host or network",
    },
    "Logs": {
        "runs": "List, tag and delete the runs in logs/",
        "info": "Describe a log",
        "check": "Check structure, sequence numbers and messages",
        "cat": "Print messages as JSON",
        "filter": "Copy some topics, or a time range",
        "fetch": "Fetch the logs of a run from its hosts, joined",
        "merge": "Join the logs of several recorders",
        "recover": "Copy what can be read of a damaged log",
        "export": "Write arrays, tables, or scenes for viewers",
        "replay": "Publish a log again, or feed it to new agents",
        "verify": "Prove a log: execute its run again, and compare",
    },
    "Data of your own": {
        "import": "Make a dataset of CSV files or a ROS bag",
        "dataset": "Check and show a dataset",
    },
    "Study": {
        "analyze": "Compute errors, consistency, bytes and losses",
        "compare": "Put runs side by side",
        "figures": "Write figures for papers, as PDF, SVG or PGF",
        "timeline": "Draw the messages between agents over time",
        "reestimate": "Estimate a log again with another filter",
        "design": "Predict errors and rounds before any run",
        "experiment": "Sweep parameters and seeds, with a verdict",
    },
}
"""The verbs by the heading that they stand under in `--help`, each with what it does. zenoh_cbef/cli/VERB.py has it."""


FILES = {"import": "importing"}
"""The file of a verb whose name is a word of Python."""


@cache
def load(verb: str) -> TyperGroup:
    """Import a verb: the group that it is, or one that has it alone."""
    return typer.main.get_group(import_module(f"zenoh_cbef.cli.{FILES.get(verb, verb)}").VERB)


def rehearse(verb: str) -> None:
    """Make what a call of a verb makes of its options, which processes that are forked later then have."""
    built()
    for command in load(verb).commands.values():
        for one in command.params:
            if isinstance(one, TyperOption | TyperArgument):
                one.get_runtime_param()


class _Verbs(TyperGroup):
    """All verbs, of which only the one that is called is imported.

    Typer answers Ctrl-C by itself, without a word or with another status, so it is not shown any.
    """

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        name, known, rest = super().resolve_command(ctx, args)
        if name is not None:
            found = load(name)
            known = found.commands.get(name, found)
        _collect_from_here()
        raise_from_here()
        return name, known, rest

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise Interrupted from None


def _collect_from_here() -> None:
    """Let Python look for circles again, but not in what was imported by now, where `main` let it not."""
    if not gc.isenabled():
        gc.freeze()
        gc.enable()


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"zenoh-cbef {__version__}")
        raise typer.Exit


def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """Track a moving target with a network of agent processes that agree over Zenoh, under faults, logged."""


def _not_imported() -> None:
    """Stand for a verb where only its name is needed."""


def build() -> typer.Typer:
    """The application."""
    app = typer.Typer(
        cls=_Verbs,
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["--help", "-h"]},
        epilog="'zenoh-cbef VERB -h' explains a verb, with an example.",
    )
    app.callback()(_root)
    for heading, verbs in GROUPS.items():
        for name, what in verbs.items():
            app.command(name, short_help=what, rich_help_panel=heading)(_not_imported)
    return app


@cache
def built() -> Any:
    """The application as a command."""
    return typer.main.get_command(build())


_PLAIN = {
    r"^Invalid value for '([^']*)'(?: / '[^']*')*: (?:Value error, |Input )": r"\1 ",
    r"should be a valid integer, unable to.*": "must be a whole number",
    r"should be a valid number, unable to.*": "must be a number",
    r"\bshould be\b": "must be",
}
"""What the library says of the value of an option, and how this program says it."""


_ELSEWHERE = {
    "command 'report'": "'analyze --report'",
    "command 'plot'": "'analyze --report'",
    "command 'list'": "'scenario list'",
    "command 'kill'": "'stop'",
    "command 'bag'": "'record', 'info', 'filter' or 'replay'",
    "command 'convert'": "'export'",
    "command 'start'": "'run'",
    "option: --topic": "'-y'",
    "option: --topics": "'-y'",
}
"""What some look for, as other programs for logs call it, by what does it here."""


def _plain(said: str) -> str:
    sought = re.match(r"No such (command '\w+'|option: --\w+)", said)
    if sought and sought[1] in _ELSEWHERE:
        return f"{sought[0]}. Did you mean {_ELSEWHERE[sought[1]]}?"
    for library, ours in _PLAIN.items():
        said = re.sub(library, ours, said)
    return said


def call() -> NoReturn:
    """Call the verb of the command line, and exit with its status.

    Raises UserError where the command line is not one of the verb's: with where its help is.
    """
    try:
        status = built()(prog_name="zenoh-cbef", standalone_mode=False)
    except Abort:
        sys.exit(1)
    except TyperException as error:
        if not error.format_message():  # nothing was said, and help was the answer
            sys.exit(2)
        where = getattr(getattr(error, "ctx", None), "command_path", "zenoh-cbef")
        raise UserError(f"{_plain(error.format_message()).rstrip('.')}; see '{where} -h'") from None
    sys.exit(status if isinstance(status, int) else 0)
