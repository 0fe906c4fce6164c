"""What the lab reaches in a real browser: frames per second, winding, from click to log, a page's cost, long logs."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.table import Table

from benchmarks.browsing import browsing, command, lab_of, until
from benchmarks.common import ROOT, Row, at_least, below, results
from benchmarks.made_logs import MadeLog
from zenoh_cbef.analysis.slowness import slowness
from zenoh_cbef.log.read.parts import find_log, open_log
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.outside.registry import known_runs
from zenoh_cbef.scenario.load import load

_DRAWN_SECONDS = 10.0
_CLICKS = 20
_SCRUBS = 20
_SHORT_STEPS, _LONG_STEPS = 300, 12_700
_RUN_STEPS = 200
_DENSE = (
    "agents.count=100",
    "agents.high=40",
    "network.graph=geometric",
    "dt=0.05",
    "steps=1200",
    "consensus.rounds=2",
)

_SCRUB = """(step) => new Promise((done) => {
  const [bar, begun] = [document.getElementById("step"), performance.now()];
  bar.value = String(step);
  bar.dispatchEvent(new Event("input"));
  const look = () => (lab.state.frame.step === step ? done(performance.now() - begun) : requestAnimationFrame(look));
  look();
})"""
"""Winds to a step as a drag of the time bar does; gives the ms until it is drawn, to the next frame of the browser."""


@contextmanager
def _run(folder: Path, name: str, *settings: str) -> Iterator[None]:
    """A realtime run of six agents; ends by itself or with the block."""
    words = [part for one in ("timing.mode=realtime", *settings) for part in ("--set", one)]
    started = command("run", "tracking", *words, "--run", name, "--no-report")
    with subprocess.Popen(started, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as run:
        try:
            while name not in known_runs():
                assert run.poll() is None, f"run {name} did not start"
                time.sleep(0.05)
            yield
            if run.poll() is None:
                subprocess.run(command("stop", "--run", name), stdout=subprocess.DEVNULL, check=False)
            run.wait(60)
        finally:
            run.terminate()


def _drawn(browser: Any, folder: Path) -> float:
    """Frames per second of a log of a hundred agents, played as fast as it was."""
    log = folder / "dense.mcap"
    if not log.exists():
        MadeLog(log, load("tracking", _DENSE).scenario).write()
    with lab_of(folder, str(log)) as url:
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(url)
        until(page, "lab.state.frame !== null")
        page.keyboard.press("Home")
        page.keyboard.press(" ")
        page.wait_for_timeout(1000)
        before, begun = page.evaluate("lab.counts.frames"), time.monotonic()
        page.wait_for_timeout(1000 * _DRAWN_SECONDS)
        drawn = page.evaluate("lab.counts.frames") - before
        page.close()
        return float(drawn / (time.monotonic() - begun))


def _made(folder: Path, steps: int) -> Path:
    """The log of a run of six agents; 12 700 steps have a million messages."""
    log = folder / f"made{steps}.mcap"
    if not log.exists():
        subprocess.run([sys.executable, "-m", "benchmarks.made_logs", str(log), str(steps)], cwd=ROOT, check=True)
    return log


def _scrubbed(browser: Any, folder: Path, steps: int) -> list[float]:
    """Seconds from the input of the time bar to the drawn frame, to steps all over a log of so many; ascending."""
    places = [1 + (7 * one + 3) % _SCRUBS * (steps - 1) // _SCRUBS for one in range(_SCRUBS)]
    with lab_of(folder, str(_made(folder, steps))) as url:
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(url)
        until(page, f"lab.state.state === 'log' && lab.state.known === {steps}")
        taken = []
        for place in places:
            page.wait_for_timeout(200)  # so that the curves are drawn in this frame, too
            taken.append(1e-3 * page.evaluate(_SCRUB, place))
        page.close()
    return sorted(taken)


def _clicked(browser: Any, folder: Path) -> list[float]:
    """Seconds from a click on "cut" to the list of faults in the log."""
    clicked = []
    with _run(folder, "clicked", "steps=100000"), lab_of(folder, "clicked") as url:
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(url)
        until(page, "lab.state.frame !== null && lab.state.newest > 20")
        for _ in range(_CLICKS):
            page.click("#agents button")
            page.wait_for_timeout(100)
            clicked.append(time.time_ns())
            page.get_by_role("menuitem", name="cut off").click()
            page.wait_for_timeout(500)
        page.close()
    messages = open_log(find_log(folder / "logs" / "clicked")).messages()
    logged = [one.log_time for one in messages if one.channel.topic.endswith("/faults")]
    return [1e-9 * (min(one for one in logged if one > at) - at) for at in clicked]


def _late(folder: Path, name: str, browser: Any | None) -> float:
    """The share of rounds that agents came to too late, with a page open or without."""
    with _run(folder, name, f"steps={_RUN_STEPS}"):
        if browser is not None:
            with lab_of(folder, name) as url:
                page = browser.new_page(viewport={"width": 1280, "height": 800})
                page.goto(url)
                until(page, "lab.state.state === 'ended'")
                page.close()
        else:
            while name in known_runs():
                time.sleep(0.1)
    found = slowness(read_trace(folder / "logs" / name))
    shares = [share for share in (found.agents if found else []) if share is not None]
    return statistics.mean(shares) if shares else 0.0


def _opened(browser: Any, folder: Path) -> float:
    """Seconds from the command to the map of a log of a million messages."""
    log = _made(folder, _LONG_STEPS)
    begun = time.monotonic()
    with lab_of(folder, str(log)) as url:
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(url)
        until(page, "lab.state.frame !== null")
        taken = time.monotonic() - begun
        page.close()
    return taken


def run(repeats: int) -> Iterator[Table]:
    with tempfile.TemporaryDirectory() as name, browsing() as browser:
        folder = Path(name)
        opened = [_opened(browser, folder) for _ in range(repeats)]
        drawn = [_drawn(browser, folder) for _ in range(repeats)]
        scrubbed = {steps: _scrubbed(browser, folder, steps) for steps in (_SHORT_STEPS, _LONG_STEPS)}
        clicked = sorted(_clicked(browser, folder))
        pairs = [(_late(folder, f"bare{one}", None), _late(folder, f"seen{one}", browser)) for one in range(repeats)]
        more = 100.0 * statistics.median(seen - bare for bare, seen in pairs)
        yield results(
            f"The lab in headless Chromium, medians of {repeats}",
            [
                at_least("frames per second, 100 agents at 20 steps/s", statistics.median(drawn), 15.0),
                below("click to the fault in the log, p95", 1e3 * clicked[round(0.95 * len(clicked)) - 1], 200.0, "ms"),
                below("rounds late with a page open: more by, percentage points", more, 0.1),
                below("a log of a million messages: from the command to the map", statistics.median(opened), 3.0, "s"),
                *(
                    below(f"time bar to the drawn frame, {steps} steps: {name}", 1e3 * value, 100.0, "ms")
                    for steps, taken in scrubbed.items()
                    for name, value in (("median", statistics.median(taken)), ("worst of 20", taken[-1]))
                ),
                Row("load average", f"{os.getloadavg()[0]:.1f}"),
            ],
        )
