"""The page of all verbs: what typer knows of each, with arguments, options and an example."""

from __future__ import annotations

import re
from collections.abc import Iterator

from typer.core import TyperArgument, TyperCommand, TyperGroup, TyperOption

from zenoh_cbef.cli.calling.verbs import GROUPS, load
from zenoh_cbef.cli.options.joining import JoiningCommand

_HEAD = """# Verbs

Made from the code: what `zenoh-cbef VERB -h` says. SCENARIO is `tracking`, LOG `logs/latest` unless given. After a
mistake in the input a verb prints one sentence and ends with exit status 2. `zenoh-cbef --install-completion` lets the
shell complete verbs, options, scenarios, experiments, runs and logs. [Where outputs go](../outputs.md) says what each
verb writes.
"""
_JOINING = "Options of every verb that joins a run"


def page() -> str:
    """The page as Markdown."""
    parts = [_HEAD]
    for heading, verbs in GROUPS.items():
        parts.append(f"## {heading}\n\n| verb | what it does |\n|---|---|\n")
        parts[-1] += "".join(f"| [`{verb}`](#{verb}) | {what} |\n" for verb, what in verbs.items())
    parts.append(f"## {_JOINING}\n\n" + _options(JoiningCommand.shared))
    for heading, verbs in GROUPS.items():
        parts.append(f"## {heading}: in full\n")
        for verb in verbs:
            parts += [_verb(words, command) for words, command in _commands(verb)]
    return "\n".join(parts)


def _commands(verb: str) -> Iterator[tuple[str, TyperCommand | TyperGroup]]:
    """A verb and its sub-verbs, by the words that call them."""
    group = load(verb)
    found = group.commands.get(verb, group)
    if isinstance(found, TyperCommand | TyperGroup):
        yield verb, found
    if isinstance(found, TyperGroup):
        for name, command in found.commands.items():
            if isinstance(command, TyperCommand):
                yield f"{verb} {name}", command


def _verb(words: str, command: TyperCommand | TyperGroup) -> str:
    arguments = [one for one in command.params if isinstance(one, TyperArgument)]
    shared = JoiningCommand.shared if isinstance(command, JoiningCommand) else []
    options = [one for one in command.params if isinstance(one, TyperOption) and one not in shared and not one.hidden]
    usage = " ".join(command.collect_usage_pieces(command.make_context(words, [], resilient_parsing=True)))
    parts = [f"### `{words}` {{ #{words.replace(' ', '-')} }}\n", f"    zenoh-cbef {words} {usage}\n"]
    if command.help:
        parts.append(_text(command.help) + "\n")
    named = [one for one in arguments if one.help]
    if named:
        parts.append(
            "| argument | meaning |\n|---|---|\n"
            + "".join(f"| `{_plain(one)}` | {_cell(one.help)} |\n" for one in named)
        )
    if options:
        parts.append(_options(options))
    if shared:
        parts.append(f"And the [options of every verb that joins a run](#{_slug(_JOINING)}).\n")
    if command.epilog:
        parts.append(f"Example: `{command.epilog.removeprefix('Example: ')}`\n")
    return "\n".join(parts)


def _plain(argument: TyperArgument) -> str:
    return str(argument.metavar or argument.name or "").upper()


def _options(options: list[TyperOption]) -> str:
    rows = []
    for one in options:
        names = ", ".join(f"`{name}`" for name in (*one.opts, *one.secondary_opts))
        default = one.default if isinstance(one.default, int | float | str) and one.default is not False else None
        said = f"{_cell(one.help)}" + (
            f" Default: `{default}`." if default not in {None, True} and one.show_default else ""
        )
        rows.append(f"| {names} | {said} |\n")
    return "| option | meaning |\n|---|---|\n" + "".join(rows)


def _text(text: str) -> str:
    return re.sub(r"\s*\f?\n(?!\n)\s*", " ", text.replace("\n\n", "\0")).replace("\0", "\n\n")


def _cell(text: str | None) -> str:
    return " ".join((text or "").split()).replace("|", "\\|").replace("<", "&lt;")


def _slug(text: str) -> str:
    return re.sub(r"[^a-z]+", "-", text.lower())
