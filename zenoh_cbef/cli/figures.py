"""figures: for papers."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from zenoh_cbef.analysis import compare, report
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.analysis.printed import Style, drawn
from zenoh_cbef.analysis.timeline_plot import timeline_figure
from zenoh_cbef.analysis.typeset import FORMATS, Format, save
from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.completing import logs
from zenoh_cbef.cli.options.places import new_folder_of
from zenoh_cbef.cli.options.shared import Force, Skip
from zenoh_cbef.cli.terminal.console import errors
from zenoh_cbef.errors import UserError
from zenoh_cbef.experiment.page import PRINTED, read_figures
from zenoh_cbef.log.read.exchange import read_exchange
from zenoh_cbef.log.read.parts import find_log
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.log.tools.collection import expanded
from zenoh_cbef.numbers import SKIPPED
from zenoh_cbef.pages.parts import Figure
from zenoh_cbef.words import first_of, meant
from zenoh_cbef.writing import make_folder, writing

Sources = Annotated[
    list[Path],
    typer.Argument(metavar="LOG...", autocompletion=logs, help="Logs, @TAG, or the folder of an experiment."),
]
_STEPS = (1, 2)
"""The part of a run that its timeline shows."""


def _figures(
    sources: Sources,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="DIR", help="The folder.")] = Path("figures"),
    formats: Annotated[
        list[str] | None, typer.Option("--format", help="pdf, svg, pgf or png; repeatable; default: pdf.")
    ] = None,
    width: Annotated[float, typer.Option(min=0.5, max=50.0, help="Inches.")] = 3.5,
    height: Annotated[float | None, typer.Option(min=0.5, max=50.0, help="Inches; default: 3/4 of the width.")] = None,
    style: Annotated[list[str] | None, typer.Option(help="A style of matplotlib, name or file; repeatable.")] = None,
    label: Annotated[
        list[str] | None, typer.Option(metavar="TEXT=WORDS", help="Other words for an axis or a line; repeatable.")
    ] = None,
    only: Annotated[list[str] | None, typer.Option(metavar="NAME", help="This figure alone; repeatable.")] = None,
    skip: Skip = SKIPPED,
    force: Force = False,
) -> None:
    """Write the figures of a run, of several compared, or of an experiment for a paper, one column wide.

    Each file says which command and version made it. PGF is for LaTeX's own fonts and needs no LaTeX to be written.
    """
    kinds = [_format(one) for one in formats or ["pdf"]]
    look = Style(width, height, style or (), dict(map(_pair, label or ())))
    with errors.status("reading and drawing"):
        found = [one for one in _found(sources, skip) if one.plot is not None]
        chosen = [one for one in found if not only or one.name in only]
        if missing := set(only or ()) - {one.name for one in found}:
            there = ", ".join(one.name for one in found)
            raise UserError(f"there is no figure {min(missing)!r}; there are {there}")
        names = [f"{one.name}.{kind}" for one in chosen for kind in kinds]
        folder = new_folder_of(output, names, force=force)
        command = shlex.join(["zenoh-cbef", *sys.argv[1:]])
        pictures = [(one, drawn(one.plot or {}, look)) for one in chosen]
        _check_labels(look)
        make_folder(folder)
        for one, picture in pictures:
            for kind in kinds:
                path = folder / f"{one.name}.{kind}"
                with writing(path):
                    typer.echo(save(picture, path, kind, one.title, command))


def _found(sources: list[Path], skip: float) -> Iterator[Figure]:
    paths = expanded(sources)
    if len(paths) == 1 and (paths[0] / "figures" / PRINTED).is_file():
        yield from read_figures(paths[0])
        return
    found = [find_log(path) for path in paths]
    traces = [read_trace(path) for path in found]
    analyses = [analyze([trace], skip)[0] for trace in traces]
    if len(analyses) > 1:
        yield from compare.figures_of(analyses, compare.names_of(traces, found))
        return
    yield from report.figures_of(analyses[0])
    yield timeline_figure(read_exchange(found[0], steps=_STEPS))


def _format(text: str) -> Format:
    for one in FORMATS:
        if text == one:
            return one
    raise UserError(f"--format {text} is none of {', '.join(FORMATS)}; give one of these")


def _check_labels(look: Style) -> None:
    """Refuse other words for what none of the figures says."""
    for one in look.labels:
        if one not in look.met:
            said = sorted(word for word in look.met if word)
            near = meant(one, look.met, f"they say {first_of(list(map(repr, said)), 10)}")
            raise UserError(f"--label {one!r} is no text of these figures; {near}")


def _pair(text: str) -> tuple[str, str]:
    before, equals, after = text.partition("=")
    if not equals:
        raise UserError(f"--label {text!r} is not of the form TEXT=WORDS, as in 'time (s)=Zeit (s)'")
    return before, after


VERB = verb(_figures, "figures logs/latest -o paper --format pdf --width 3.5")
