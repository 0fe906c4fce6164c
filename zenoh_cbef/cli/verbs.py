"""The command line: finds the file of a verb."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import typer
from typer.core import TyperGroup

from zenoh_cbef import __version__
from zenoh_cbef.errors import Interrupted

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


class _Verbs(TyperGroup):
    """All verbs. Typer answers Ctrl-C by itself, without a word or with another status, so it is not shown any."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise Interrupted from None


def build(verb: str | None) -> typer.Typer:
    """The application with one verb, or with all: start-up pays for the imports of what is used."""
    app = typer.Typer(cls=_Verbs, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)
    app.callback()(_root)
    for name in [verb] if verb in _VERBS else _VERBS:
        import_module(f"zenoh_cbef.cli.{name}").register(app)
    return app
