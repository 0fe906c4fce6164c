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

import numpy as np
from rich.table import Table

from benchmarks.browsing import browsing, command, lab_of, until
from benchmarks.common import ROOT, Row, at_least, below, results
from benchmarks.made_logs import MadeLog
from zenoh_cbef.arrays import Floats
from zenoh_cbef.lab.scene import Scene
from zenoh_cbef.log.read.parts import find_log, open_log
from zenoh_cbef.log.read.recording import read_recording
from zenoh_cbef.outside.registry import known_runs
from zenoh_cbef.scenario.load import load

_DRAWN_SECONDS = 10.0
_CLICKS = 20
_SCRUBS = 20
_SHORT_STEPS, _LONG_STEPS = 300, 12_700
_RUN_STEPS = 300
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
                subprocess.run(command("stop", "--run", name), capture_output=True, check=False)
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


def _late(folder: Path, name: str, browser: Any | None) -> tuple[Floats, int]:
    """The share of messages that came too late or not at all, in each step; the step at which a page was open."""
    shown = 0
    with _run(folder, name, f"steps={_RUN_STEPS}"):
        if browser is not None:
            with lab_of(folder, name) as url:
                page = browser.new_page(viewport={"width": 1280, "height": 800})
                page.goto(url)
                until(page, "lab.state.frame !== null")
                shown = page.evaluate("lab.state.newest")
                while page.evaluate("lab.state.state") != "ended":
                    page.wait_for_timeout(500)
                page.close()
        else:
            while name in known_runs():
                time.sleep(0.1)
    recording = read_recording(open_log(find_log(folder / "logs" / name)))
    came, lost, late, _ = np.nansum(Scene(recording).fresh(0, recording.estimates.last), axis=0).T
    return (lost + late) / np.maximum(came + lost + late, 1.0), shown


def _more(folder: Path, repeats: int, browser: Any) -> tuple[float, float]:
    """By how many percentage points more messages miss their deadline: while a page is open; while lab and page start.

    Medians of pairs of runs, one with a page and one without, over the same steps.
    """
    opened, starting = [], []
    for one in range(repeats):
        bare, _ = _late(folder, f"bare{one}", None)
        seen, since = _late(folder, f"seen{one}", browser)
        rise = 100.0 * (seen[: len(bare)] - bare[: len(seen)])
        opened.append(float(rise[since:].mean()))
        starting.append(float(rise[:since].mean()))
    return statistics.median(opened), statistics.median(starting)


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
        more, starting = _more(folder, repeats, browser)
        yield results(
            f"The lab in headless Chromium, medians of {repeats}",
            [
                at_least("frames per second, 100 agents at 20 steps/s", statistics.median(drawn), 15.0),
                below("click to the fault in the log, p95", 1e3 * clicked[round(0.95 * len(clicked)) - 1], 200.0, "ms"),
                below("messages late with a page open: more by, percentage points", more, 0.1),
                Row("the same while lab and page start beside the run", f"{starting:.3f}"),
                below("a log of a million messages: from the command to the map", statistics.median(opened), 3.0, "s"),
                *(
                    below(f"time bar to the drawn frame, {steps} steps: {name}", 1e3 * value, 100.0, "ms")
                    for steps, taken in scrubbed.items()
                    for name, value in (("median", statistics.median(taken)), ("worst of 20", taken[-1]))
                ),
                Row("load average", f"{os.getloadavg()[0]:.1f}"),
            ],
        )
