"""The pages of the notebooks: a copy of each is run by nbmake, and nbconvert makes a page of what it shows."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from nbconvert import MarkdownExporter
from nbconvert.preprocessors import CoalesceStreamsPreprocessor

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = ROOT / "docs" / "notebooks"
FOLDER = ROOT / "build" / "notebooks"
_MARK = FOLDER / "run"
"""A file as old as the last run of all."""
_SECONDS = 600
"""For a cell, on a machine with other work."""
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")


def pages(*, run: bool = True) -> dict[str, str | bytes]:
    """Pages and their pictures, by their names. run: show what the cells print and draw. Raises RuntimeError."""
    folder = executed() if run else NOTEBOOKS
    found: dict[str, str | bytes] = {}
    exporter = MarkdownExporter()
    exporter.register_preprocessor(CoalesceStreamsPreprocessor, enabled=True)  # a table comes in pieces
    for path in sorted(folder.glob("*.ipynb")):
        resources = {"output_files_dir": path.stem}
        text, made = exporter.from_filename(str(path), resources)
        head, line, rest = text.partition("\n\n")
        note = f"[This page as a notebook]({path.name}), and [what it needs](../api.md#notebooks)."
        found[f"{path.stem}.md"] = _COLOUR.sub("", f"{head}{line}{note}{line}{rest}")
        found |= made["outputs"]
    return found


def executed() -> Path:
    """The folder of the notebooks with what they print; run anew where notebooks or package are newer."""
    sources = [*NOTEBOOKS.glob("*.ipynb"), *(ROOT / "zenoh_cbef").rglob("*.*")]
    newest = max(path.stat().st_mtime for path in sources if "__pycache__" not in path.parts)
    if not (_MARK.exists() and _MARK.stat().st_mtime > newest):
        shutil.rmtree(FOLDER, ignore_errors=True)
        shutil.copytree(NOTEBOOKS, FOLDER)
        environment = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
        runner = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-p", "no:xdist", "-o", "timeout=0"]
        options = ["--nbmake", "--overwrite", f"--nbmake-timeout={_SECONDS}"]
        done = subprocess.run(
            [*runner, *options, "."], cwd=FOLDER, env=environment, capture_output=True, text=True, check=False
        )
        if done.returncode:
            raise RuntimeError(f"a notebook of docs/notebooks fails:\n{done.stdout}{done.stderr}")
        _MARK.touch()
    return FOLDER
