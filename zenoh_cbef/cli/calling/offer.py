"""How the file of a verb offers it, as VERB: each command with an example, whose first words are its name."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import typer
from typer.core import TyperCommand, TyperGroup

Does = Callable[..., None]


def verb(does: Does, example: str, cls: type[TyperCommand] | None = None) -> typer.Typer:
    """A verb that is one command."""
    return _with(typer.Typer(add_completion=False), example.split(maxsplit=1)[0], does, example, cls)


def group(
    what: str,
    commands: Mapping[str, Does],
    cls: type[TyperCommand] | None = None,
    *,
    of: type[TyperGroup] | None = None,
    example: str = "",
) -> typer.Typer:
    """A verb with several commands, by their examples. what: it does; of: the type of the group.

    example: of the whole group; that of its first command where none is given.
    """
    epilog = f"Example: zenoh-cbef {example or next(iter(commands))}"
    app = typer.Typer(help=what, no_args_is_help=True, add_completion=False, cls=of, epilog=epilog)
    for words, does in commands.items():
        _with(app, words.split()[1], does, words, cls)
    return app


def _with(app: typer.Typer, name: str, does: Does, example: str, cls: type[TyperCommand] | None) -> typer.Typer:
    app.command(name, cls=cls, epilog=f"Example: zenoh-cbef {example}")(does)
    return app
