"""What an experiment leaves in its folder: tables, summary, figures, and one page with all that matters."""

from __future__ import annotations

import json
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

from zenoh_cbef.errors import UserError
from zenoh_cbef.experiment.figures import SHOWN, Figure, figures_of, written_value
from zenoh_cbef.experiment.table import write_table
from zenoh_cbef.extras import MissingExtra, from_extra
from zenoh_cbef.words import counted

RESULTS = ("results.csv", "results.parquet", "summary.json", "index.html", "figures")
"""What is written into an experiment's folder."""

_MOST_FAILURES = 20
_CONFIG = {"displaylogo": False, "displayModeBar": "hover", "responsive": True}


def write_outputs(summary: dict[str, Any], rows: Sequence[dict[str, Any]], source: str, folder: Path) -> list[str]:
    """Write results.csv, results.parquet, summary.json, figures/, index.html; returns what could not be written.

    Raises UserError where the folder cannot be written into.
    """
    try:
        missing = [write_table(rows, folder)]
        # Curves are in the figures; the summary stays something to read.
        cells = [{name: value for name, value in cell.items() if name != "curve"} for cell in summary["cells"]]
        text = json.dumps({**summary, "cells": cells}, indent=1)
        (folder / "summary.json").write_text(text + "\n", encoding="utf-8")
        missing.append(_write_page(summary, source, folder))
    except OSError as error:
        raise UserError(f"cannot write into {folder}: {error.strerror}; choose another --output") from None
    return [sentence for sentence in missing if sentence]


def _write_page(summary: dict[str, Any], source: str, folder: Path) -> str:
    figures, place = figures_of(summary), folder / "figures"
    place.mkdir(exist_ok=True)
    for stale in place.glob("*.html"):
        stale.unlink()
    plotly: Any = None
    try:
        plotly = from_extra("plotly.io", "the folder of figures", extra="experiment")
    except MissingExtra as error:
        missing = str(error)
    else:
        missing = ""
        for figure in figures:
            text = plotly.to_html(figure.plot, include_plotlyjs="directory", default_height="100vh", config=_CONFIG)
            (place / f"{figure.name}.html").write_text(text, encoding="utf-8")
        if figures:
            script = from_extra("plotly.offline", "the page").get_plotlyjs()
            (place / "plotly.min.js").write_text(script, encoding="utf-8")
    page = Template(files(__package__).joinpath("page.html").read_text(encoding="utf-8"))
    text = page.substitute(
        name=escape(summary["experiment"]),
        purpose=escape(summary["purpose"]),
        facts=_facts(summary),
        level=f"{summary['level']:.0%}",
        expectations=_expectations(summary),
        failures=_failures(summary),
        table=_table(summary),
        figures="".join(_placed(figure, plotly, first=not place) for place, figure in enumerate(figures)) or missing,
        source=escape(source),
    )
    (folder / "index.html").write_text(text, encoding="utf-8")
    return missing


def _placed(figure: Figure, plotly: Any, *, first: bool) -> str:
    if plotly is None:
        return ""
    drawn = plotly.to_html(figure.plot, full_html=False, include_plotlyjs=first, config=_CONFIG)
    return f"<figure><h3>{escape(figure.title)}</h3><figcaption>{escape(figure.caption)}</figcaption>{drawn}</figure>"


def _facts(summary: dict[str, Any]) -> str:
    how = {"simulate": "simulated", "processes": "run as processes"}[summary["engine"]]
    verdict = summary["verdict"]
    return (
        f"{counted(summary['runs'], 'run')} of {escape(summary['base'])} in "
        f"{counted(len(summary['cells']), 'cell')}, {how}; "
        f"{summary['failed']} failed. Verdict: {_marked(verdict)}."
    )


def _marked(verdict: str) -> str:
    return f'<span class="{verdict.replace(" ", "-")}">{verdict}</span>'


def limits_of(one: dict[str, Any]) -> str:
    """The limits of an expectation in words."""
    parts = [f"{name.replace('_', ' ')} {one[name]:g}" for name in ("at_least", "at_most") if name in one]
    return " and ".join(parts)


def values_of(cell: dict[str, Any]) -> str:
    """The varied values of a cell in words."""
    return ", ".join(f"{key} = {written_value(value)}" for key, value in cell["values"].items()) or "all runs"


def _expectations(summary: dict[str, Any]) -> str:
    if not summary["expect"]:
        return ""
    rows = [
        [escape(one["metric"]), limits_of(one), escape(values_of(cell)), _interval(cell), _marked(cell["verdict"])]
        for one in summary["expect"]
        for cell in one["cells"]
    ]
    return "<h2>Expectations</h2>" + _rows(["metric", "expected", "where", "found", "verdict"], rows)


def _failures(summary: dict[str, Any]) -> str:
    failures = [(cell, one) for cell in summary["cells"] for one in cell["failures"]]
    if not failures:
        return ""
    rows = [[escape(values_of(cell)), str(one["seed"]), escape(one["error"])] for cell, one in failures]
    more = f"<p>and {len(rows) - _MOST_FAILURES} more in results.csv</p>" if len(rows) > _MOST_FAILURES else ""
    return '<h2 class="alarm">Failed runs</h2>' + _rows(["cell", "seed", "why"], rows[:_MOST_FAILURES]) + more


def _table(summary: dict[str, Any]) -> str:
    metrics = [name for name, *_ in SHOWN if any(name in cell["metrics"] for cell in summary["cells"])]
    rows = [
        [
            *(escape(written_value(value)) for value in cell["values"].values()),
            f"{cell['runs'] - cell['failed']} of {cell['runs']}",
            *(_interval(cell["metrics"].get(name, {})) for name in metrics),
        ]
        for cell in summary["cells"]
    ]
    return _rows([*map(escape, summary["varied"]), "runs", *metrics], rows)


def _interval(found: dict[str, Any]) -> str:
    if "median" not in found:
        return "-"
    return f"{found['median']:.4g} ({found['low']:.4g} to {found['high']:.4g})"


def _rows(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    head = "".join(f"<th>{one}</th>" for one in heads)
    body = "".join("<tr>" + "".join(f"<td>{one}</td>" for one in row) + "</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
