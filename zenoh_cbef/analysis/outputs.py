"""Writes the files of an analysis into a run's folder."""

from __future__ import annotations

import json
from pathlib import Path

from zenoh_cbef.analysis.metrics import Analysis
from zenoh_cbef.analysis.report import write_report
from zenoh_cbef.analysis.typeset import write_figures
from zenoh_cbef.errors import UserError
from zenoh_cbef.writing import replacing, writing

METRICS, REPORT, FIGURES = "metrics.json", "report.html", "figures"


def write_outputs(
    analysis: Analysis, folder: Path, prefix: str = "", *, report: bool, remedy: str = "choose another folder"
) -> list[UserError]:
    """Write metrics.json and, where wanted, report.html and figures/ into a folder, their names behind a prefix.

    Returns what could not be written, each as a sentence: a package is missing, or the folder cannot be written into,
    for which the caller knows the remedy.
    """
    failed: list[UserError] = []
    for write, name in ((_write_metrics, METRICS), (_write_report, REPORT), (write_figures, FIGURES)):
        if not report and name != METRICS:
            continue
        path = folder / f"{prefix}{name}"
        try:
            with writing(path, remedy):
                write(analysis, path)
        except UserError as error:
            failed.append(error)
    return failed


def _write_metrics(analysis: Analysis, path: Path) -> None:
    with replacing(path) as fresh:
        fresh.write_text(json.dumps(analysis.metrics.as_json(), indent=1) + "\n", encoding="utf-8")


def _write_report(analysis: Analysis, path: Path) -> None:
    with replacing(path) as fresh:
        write_report(analysis, fresh)
