"""Takes the screenshots of the documentation anew: the lab in the middle of a partition, the report of a lossy run."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rich.table import Table

from benchmarks.browsing import browsing, command, lab_of, until
from benchmarks.common import ROOT

IMAGES = ROOT / "docs" / "images"
_LOSSY = 'fault=[{kind="loss", probability=0.3}]'
"""As in the README."""
_PARTED = (
    'fault=[{kind="loss", probability=0.3, from=3.0, until=8.0},'
    '{kind="partition", links={between=[[0, 1, 2], [3, 4, 5]]}, from=12.0, until=18.0}]'
)
_STEP = "168"
_SIZE = {"width": 1280, "height": 800}


def _run(folder: Path, name: str, fault: str) -> None:
    words = ("run", "tracking", "--set", fault, "--run", name)
    subprocess.run(command(*words), cwd=folder, stdout=subprocess.DEVNULL, check=True)


def _lab(browser: Any, folder: Path) -> None:
    _run(folder, "my-run", _PARTED)
    with lab_of(folder, "my-run") as url:
        page = browser.new_page(viewport=_SIZE, device_scale_factor=1.5)
        page.goto(url)
        until(page, "lab.state.frame !== null && lab.state.state === 'log'")
        page.fill("#step", _STEP)
        until(page, f"lab.state.frame.step === {_STEP}")
        page.evaluate("document.activeElement.blur()")
        page.wait_for_timeout(500)
        page.screenshot(path=IMAGES / "lab.png")
        page.close()


def _report(browser: Any, folder: Path) -> None:
    _run(folder, "tracking-loss", _LOSSY)
    page = browser.new_page(viewport={"width": 1280, "height": 1000})
    page.goto((folder / "logs" / "tracking-loss" / "report.html").as_uri())
    page.wait_for_function("globalThis.replay && document.querySelector('.js-plotly-plot')", timeout=120_000)
    page.fill("#moment", str(int(_STEP) - 1))
    page.evaluate("document.activeElement.blur()")
    page.wait_for_timeout(500)
    page.screenshot(path=IMAGES / "report.png")
    page.close()


def run(repeats: int) -> Iterator[Table]:  # noqa: ARG001 - as all benchmarks
    with tempfile.TemporaryDirectory() as name, browsing() as browser:
        for picture in (_lab, _report):
            picture(browser, Path(name))
    table = Table("picture", "kB", title="Screenshots of the documentation")
    for taken in ("lab.png", "report.png"):
        table.add_row(f"docs/images/{taken}", f"{(IMAGES / taken).stat().st_size / 1000:.0f}")
    yield table
