"""The command line: finds the verb's file and turns a user's mistake into one sentence and exit status 2."""

from __future__ import annotations

import sys
from importlib import import_module

import typer

from zenoh_cbef import __version__
from zenoh_cbef.errors import UserError

_VERBS = (
    "run",
    "sim",
    "agent",
    "target",
    "record",
    "fault",
    "stop",
    "status",
    "watch",
    "doctor",
    "scenario",
    "analyze",
    "verify",
    "info",
    "check",
    "cat",
    "filter",
    "merge",
    "recover",
    "export",
    "reestimate",
    "replay",
    "design",
    "compare",
    "timeline",
    "experiment",
    "router",
    "certs",
    "health",
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"zenoh-cbef {__version__}")
        raise typer.Exit


def _root(
    version: bool = typer.Option(
        False, "--version", callback=_version, is_eager=True, help="Show the version and exit."
    ),
) -> None:
    """Track a moving target with a network of agent processes that agree over Zenoh, under faults, logged."""


def build(verb: str | None) -> typer.Typer:
    """The application with one verb, or with all: start-up pays for the imports of what is used."""
    app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)
    app.callback()(_root)
    for name in [verb] if verb in _VERBS else _VERBS:
        import_module(f"zenoh_cbef.cli.{name}").register(app)
    return app


def main() -> None:
    """Entry point."""
    verb = sys.argv[1] if len(sys.argv) > 1 else None
    try:
        build(verb)(prog_name="zenoh-cbef")
    except UserError as error:
        sys.stderr.write(f"zenoh-cbef: {error}\n")
        sys.exit(2)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(1)
    except (OverflowError, ValueError) as error:
        # NumPy's LinAlgError is one of them, and NumPy is not imported for this.
        if not isinstance(error, OverflowError) and type(error).__name__ != "LinAlgError":
            raise
        sys.stderr.write(
            f"zenoh-cbef: the arithmetic breaks down ({error}): some number of the scenario is far out of proportion; "
            "look at standard deviations, dt and positions\n"
        )
        sys.exit(2)
