"""The verbs of the command line, called, and walked through as the program itself finds them."""

from __future__ import annotations

import sys
from functools import cache
from typing import Any

import pytest
import typer
from typer.core import TyperCommand, TyperGroup

from zenoh_cbef.cli.calling import main, verbs


def call(monkeypatch, capsys, *arguments: str) -> tuple[int, str, str]:
    """The exit status of a command line, and what it prints on standard output and on standard error."""
    monkeypatch.setattr(sys, "argv", ["zenoh-cbef", *arguments])
    with pytest.raises(SystemExit) as ended:
        main.main()
    captured = capsys.readouterr()
    return int(ended.value.code or 0), captured.out, captured.err


def names() -> list[str]:
    return [name for group in verbs.GROUPS.values() for name in group]


def loaded(verb: str) -> TyperCommand | TyperGroup:
    group = verbs.load(verb)
    found = group.commands.get(verb, group)
    assert isinstance(found, TyperCommand | TyperGroup)
    return found


@cache
def leaves() -> dict[str, TyperCommand]:
    """Every command that does something, by the words that call it, as in "fault add"."""
    found: dict[str, TyperCommand] = {}
    for name in names():
        verb = loaded(name)
        if isinstance(verb, TyperGroup):
            for one, command in verb.commands.items():
                assert isinstance(command, TyperCommand)
                found[f"{name} {one}"] = command
        else:
            found[name] = verb
    return found


def parse(words: list[str]) -> None:
    """Let the command line parse the words after "zenoh-cbef", and do nothing. Raises its error for what it refuses."""
    command: Any = typer.main.get_command(verbs.build())
    context = command.make_context("zenoh-cbef", list(words))
    while isinstance(command, TyperGroup):
        name, command, rest = command.resolve_command(context, [*context._protected_args, *context.args])  # noqa: SLF001 - typer tells it nowhere else
        context = command.make_context(name, rest, parent=context)
