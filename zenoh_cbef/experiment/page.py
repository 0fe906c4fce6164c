"""Writes an experiment's folder: tables, summary, figures, and one page with all of them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from zenoh_cbef.analysis.typeset import latex
from zenoh_cbef.errors import UserError
from zenoh_cbef.experiment.figures import cell_words, figures_of, written_value
from zenoh_cbef.experiment.file import Written
from zenoh_cbef.experiment.results import CellSummary, Expectation, Judged, Summary
from zenoh_cbef.experiment.table import Row, write_table
from zenoh_cbef.experiment.typeset import FITTING, interval, results_table
from zenoh_cbef.experiment.words import metric_words
from zenoh_cbef.extras import MissingExtra, from_extra
from zenoh_cbef.pages.parts import Figure, Table, plots_of
from zenoh_cbef.pages.render import render
from zenoh_cbef.words import counted
from zenoh_cbef.writing import writing

SUMMARY = "summary.json"
RESULTS = ("results.csv", "results.parquet", SUMMARY, "index.html", "results.tex", "figures")
"""What is written into an experiment's folder."""

PRINTED = "figures.json"
"""The figures as data, for `figures`."""

_MOST_FAILURES = 20
_FIGURES = TypeAdapter(list[Figure])


def write_outputs(summary: Summary, rows: Sequence[Row], source: str, folder: Path) -> list[str]:
    """Write results.csv, .parquet and .tex, summary.json, figures/, index.html; returns what could not be written.

    Raises UserError where the folder cannot be written into.
    """
    with writing(f"into {folder}"):
        missing = [write_table(rows, folder)]
        (folder / SUMMARY).write_text(summary_text(summary), encoding="utf-8")
        (folder / "results.tex").write_text(
            latex(results_table(summary, most=FITTING), f"experiment {summary.experiment}"), encoding="utf-8"
        )
        missing.append(_write_page(summary, source, folder))
    return [sentence for sentence in missing if sentence]


def summary_text(summary: Summary) -> str:
    """The text of summary.json."""
    return json.dumps(summary.as_json(), indent=1) + "\n"


@dataclass(frozen=True)
class _Held:
    """Which experiment the results in a folder are of, and of how many runs."""

    experiment: str
    base: str
    varied: list[str]
    runs: int


_HELD = TypeAdapter(_Held)


def other_experiment(folder: Path, written: Written) -> str:
    """The other experiment whose results the folder holds, in words: another name, base, or keys. Empty if none."""
    if (held := _held_in(folder)) is None:
        return ""
    keys = [one.key for one in written.experiment.vary]
    # Keys come and go while a study grows; one that shares none of them is another.
    same = set(held.varied) & set(keys) or not (held.varied and keys)
    if (held.experiment, held.base) == (written.name, written.experiment.base) and same:
        return ""
    return f"another experiment ({held.experiment} of {held.base}, over {' and '.join(held.varied) or 'no key'})"


def runs_in(folder: Path) -> int:
    """How many runs the results in the folder are of; 0 where there are none."""
    held = _held_in(folder)
    return 0 if held is None else held.runs


def _held_in(folder: Path) -> _Held | None:
    """None where there are no results, or their summary is damaged."""
    try:
        return _HELD.validate_json((folder / SUMMARY).read_bytes())
    except (OSError, ValidationError):
        return None


def read_figures(folder: Path) -> list[Figure]:
    """The figures of an experiment's folder. Raises UserError where they are damaged."""
    try:
        return _FIGURES.validate_json((folder / "figures" / PRINTED).read_bytes())
    except (OSError, ValidationError):
        raise UserError(f"the figures in {folder} cannot be read; run the experiment again") from None


def _write_page(summary: Summary, source: str, folder: Path) -> str:
    figures, place = figures_of(summary), folder / "figures"
    place.mkdir(exist_ok=True)
    for stale in place.glob("*.html"):
        stale.unlink()
    (place / PRINTED).write_bytes(_FIGURES.dump_json(figures))
    script = missing = ""
    try:
        script = from_extra("plotly.offline", "the folder of figures", extra="experiment").get_plotlyjs()
    except MissingExtra as error:
        missing = str(error)
        figures = []
    if figures:
        (place / "plotly.min.js").write_text(script, encoding="utf-8")
    for figure in figures:
        text = render("figure.html", name=summary.experiment, it=figure, plots=plots_of([figure]))
        (place / f"{figure.name}.html").write_text(text, encoding="utf-8")
    text = render(
        "experiment.html",
        name=summary.experiment,
        purpose=summary.purpose,
        facts=_facts(summary),
        verdict=summary.verdict,
        expectations=_expectations(summary),
        failures=_failures(summary),
        results=results_table(summary),
        figures=figures,
        missing=missing,
        source=source,
        plots=plots_of(figures),
        plotly=script,
    )
    (folder / "index.html").write_text(text, encoding="utf-8")
    return missing


def _facts(summary: Summary) -> str:
    how = {"simulate": "simulated", "processes": "run as processes"}[summary.engine]
    return (
        f"{counted(summary.runs, 'run')} of {summary.base} in {counted(len(summary.cells), 'cell')}, {how}; "
        f"{summary.failed} failed."
    )


def limits_of(one: Expectation) -> str:
    """The limits of an expectation in words."""
    return " and ".join(f"{name.replace('_', ' ')} {limit:g}" for name, limit in reversed(one.limits.items()))


def values_of(cell: CellSummary | Judged) -> str:
    """The varied keys of a cell with their values, as in the experiment's file."""
    return ", ".join(f"{key} = {written_value(value)}" for key, value in cell.values.items()) or "all runs"


def _expectations(summary: Summary) -> list[list[str]]:
    return [
        [
            metric_words(one.metric),
            limits_of(one),
            cell_words(cell.values, summary.words),
            interval(cell.found),
            cell.verdict,
        ]
        for one in summary.expect
        for cell in one.cells
    ]


def _failures(summary: Summary) -> Table:
    failures = [(cell, one) for cell in summary.cells for one in cell.failures]
    rows = [[cell_words(cell.values, summary.words), str(one.seed), one.error] for cell, one in failures]
    more = len(rows) - _MOST_FAILURES
    return Table(f"{more} more are in results.csv" if more > 0 else "", ["cell", "seed", "why"], rows[:_MOST_FAILURES])
