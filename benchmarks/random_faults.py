"""Random fault scenarios as processes: no crash, no hang, finite estimates, and `verify` proves each log."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from hypothesis import HealthCheck, Phase, given, seed, settings
from rich.table import Table

from benchmarks.common import Row, results
from tests.faults.strategies import scenarios
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.prove.verify import verify
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.scenario.checks import check
from zenoh_cbef.scenario.load import parse
from zenoh_cbef.scenario.plan import Plan

SCENARIOS, SECONDS = 200, 120.0
KINDS = ("equal", "different", "unknown", "failed", "hung", "not finite")


def drawn(count: int) -> list[dict[str, Any]]:
    """Random scenarios over kinds, times and links; the same ones every time."""
    found: list[dict[str, Any]] = []

    @seed(1)
    @settings(
        max_examples=2 * count,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(scenarios())
    def draw(scenario: dict[str, Any]) -> None:
        try:
            check(Plan(parse(scenario, "a drawn scenario")))
        except UserError:
            return  # No agent is there to track, for example: the command line refuses it, too.
        if scenario not in found:
            found.append(scenario)

    draw()
    return found[:count]


def outcome(scenario: dict[str, Any], folder: Path) -> str:
    """Run one as processes and prove its log: what came of it, with the first words where that is not equality."""
    source, log = folder / "scenario.toml", folder / "run.mcap"
    source.write_text(tomli_w.dumps(scenario), encoding="utf-8")
    command = [
        sys.executable,
        "-m",
        "zenoh_cbef",
        "run",
        str(source),
        "--run",
        folder.name,
        "--log",
        str(log),
        "--no-report",
    ]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, check=False)
    except subprocess.TimeoutExpired:
        return "hung"
    if done.returncode != 0:
        return f"failed: {done.stderr.strip().splitlines()[-1:]}"
    trace = read_trace(log)
    told = ~np.isnan(trace.diagnostics.weight)
    if not np.isfinite(trace.estimates[told]).all():
        return "not finite"
    verdict = verify(log)
    return verdict.result if verdict.result == "equal" else f"{verdict.result}: {verdict.text}"


def run(repeats: int, count: int = SCENARIOS) -> Iterator[Table]:
    """Nothing is timed, so nothing is repeated."""
    del repeats
    found: Counter[str] = Counter()
    with tempfile.TemporaryDirectory(prefix="faults-") as place:
        for number, scenario in enumerate(drawn(count)):
            folder = Path(place) / f"faults-{number}"
            folder.mkdir()
            told = outcome(scenario, folder)
            found[told.partition(":")[0]] += 1
            if told != "equal":
                print(f"{told}\n{scenario}", file=sys.stderr, flush=True)
    total = found.total()
    rows = [Row("proved by verify", f"{found['equal']}", f"{total} of {total}", found["equal"] == total)]
    rows += [Row(kind, f"{found[kind]}", "0", found[kind] == 0) for kind in KINDS[1:]]
    yield results(f"{total} random fault scenarios as processes", rows)
