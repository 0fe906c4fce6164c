"""A real browser, and a lab to open in it."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from zenoh_cbef.errors import UserError

_BROWSERS = ("chromium", "chromium-browser", "google-chrome")


@contextmanager
def browsing() -> Iterator[Any]:
    """Headless Chromium of this host, driven by Playwright. Raises UserError where there is none."""
    found = next(filter(None, map(shutil.which, _BROWSERS)), None)
    if found is None:
        raise UserError("no Chromium on this host; install the package chromium")
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 - needed here alone

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=found, args=["--no-sandbox"])
        yield browser
        browser.close()


def command(*words: str) -> list[str]:
    """The command line of a verb."""
    return [sys.executable, "-m", "zenoh_cbef", *words]


@contextmanager
def lab_of(folder: Path, what: str) -> Iterator[str]:
    """A lab of this log or run; gives its address."""
    with subprocess.Popen(command("lab", what, "--no-browser"), cwd=folder, stderr=subprocess.PIPE, text=True) as lab:
        assert lab.stderr is not None
        try:
            yield next(found[0] for line in lab.stderr if (found := re.search(r"http://\S+", line)))
        finally:
            lab.terminate()


def until(page: Any, what: str) -> None:
    """Wait until an expression is true on the page."""
    until = time.monotonic() + 120
    while not page.evaluate(what):
        assert time.monotonic() < until, what
        page.wait_for_timeout(10)
