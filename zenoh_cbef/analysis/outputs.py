"""Writes the files of an analysis into a run's folder."""

from __future__ import annotations

import errno
import json
from pathlib import Path

from zenoh_cbef.analysis.metrics import Analysis
from zenoh_cbef.analysis.report import write_report
from zenoh_cbef.analysis.typeset import write_figures
from zenoh_cbef.errors import UserError
from zenoh_cbef.extras import MissingExtra

_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
METRICS, REPORT, FIGURES = "metrics.json", "report.html", "figures"


def write_outputs(analysis: Analysis, folder: Path, prefix: str = "", *, report: bool) -> list[UserError]:
    """Write metrics.json and, where wanted, report.html and figures/ into a folder, their names behind a prefix.

    Returns what could not be written, each as a sentence: a package is missing, or the folder cannot be written into.
    """
    failed: list[UserError] = []
    for write, name in ((_write_metrics, METRICS), (write_report, REPORT), (write_figures, FIGURES)):
        if not report and name != METRICS:
            continue
        path = folder / f"{prefix}{name}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            write(analysis, path)
        except MissingExtra as error:
            failed.append(error)
        except OSError as error:
            if error.errno in _FULL and path.is_file():
                path.unlink()  # half a file would be taken for a whole one
            failed.append(UserError(f"cannot write {path}: {error.strerror}; name another folder with --output"))
    return failed


def _write_metrics(analysis: Analysis, path: Path) -> None:
    path.write_text(json.dumps(analysis.metrics.as_json(), indent=1) + "\n", encoding="utf-8")
