"""The notebooks, from the first cell to the last: nbmake runs them, as when the site is built."""

from __future__ import annotations

import json
import runpy
from pathlib import Path

import pytest

SITE = Path(__file__).resolve().parents[2] / "docs" / "site"


@pytest.mark.timeout(1800)
def test_all_notebooks_run_and_show_what_they_promise():
    pytest.importorskip("nbconvert", reason="the group docs is not installed; 'make install' does it")
    folder = runpy.run_path(str(SITE / "notebooks.py"))["executed"]()
    told = {}
    for path in sorted(folder.glob("*.ipynb")):
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        outputs = [output for cell in cells for output in cell.get("outputs", [])]
        told[path.stem] = {kind for output in outputs for kind in output.get("data", {})}
        assert not any("\x1b" in "".join(output.get("text", "")) for output in outputs), path.stem
    assert len(told) == 8
    drawn = {"image/png", "image/svg+xml"}
    assert [name for name, kinds in told.items() if not kinds & drawn] == ["8-reading-a-log"]
    assert json.loads((folder / "1-first-run.ipynb").read_text())["cells"][-1]["outputs"][0]["data"]["text/plain"] == [
        "True"
    ], "the simulation has the bits of the processes"
