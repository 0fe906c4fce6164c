"""What an analysis leaves in a run's folder."""

from __future__ import annotations

import json
from pathlib import Path

from zenoh_cbef.analysis.figures import write_figures
from zenoh_cbef.analysis.metrics import Analysis
from zenoh_cbef.analysis.report import write_report
from zenoh_cbef.errors import UserError


def write_outputs(analysis: Analysis, folder: Path, *, report: bool) -> None:
    """Write metrics.json and, where wanted, report.html and figures/ into a folder."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "metrics.json").write_text(json.dumps(analysis.metrics, indent=1) + "\n")
        if report:
            write_report(analysis, folder / "report.html")
            write_figures(analysis, folder / "figures")
    except OSError as error:
        raise UserError(f"cannot write into {folder}: {error.strerror}; name another folder") from None
