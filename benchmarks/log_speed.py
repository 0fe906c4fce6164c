"""How fast logs are analysed and described: CPU time and memory of whole commands, on a log of a million messages."""

from __future__ import annotations

import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.table import Table

from benchmarks.common import ROOT, Row, at_least, below, results
from benchmarks.mcap_speed import payloads, write_ours
from zenoh_cbef.log.read.parts import open_log

_STEPS = 12_700
_WRITTEN = 200_000
_TOOLS = (("check",), ("cat",), ("filter", "-y", ".*/estimate", "-o", "{new}"), ("merge", "-o", "{new}"))


def command(arguments: Sequence[str], repeats: int, folder: Path) -> tuple[float, float]:
    """Run a verb; median of its CPU time (s), and the most memory that it took (MB)."""
    spent, most = [], 0.0
    for _ in range(repeats):
        (folder / "new.mcap").unlink(missing_ok=True)
        filled = [part.format(new=folder / "new.mcap") for part in arguments]
        words = [sys.executable, "-m", "zenoh_cbef", *filled]
        with subprocess.Popen(
            words, stdout=subprocess.DEVNULL, env=os.environ | {"OPENBLAS_NUM_THREADS": "1"}
        ) as process:
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
        assert process.returncode == 0, filled
        spent.append(usage.ru_utime + usage.ru_stime)
        most = max(most, usage.ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3))
    return statistics.median(spent), most


def described(path: Path, repeats: int) -> float:
    """CPU time of opening and describing a log, s, without the start of Python."""
    spent = []
    for _ in range(repeats):
        begun = time.process_time()
        open_log(path).summary()
        spent.append(time.process_time() - begun)
    return statistics.median(spent)


def written(folder: Path, repeats: int) -> float:
    """Messages of 200 bytes per second of CPU, with zstd."""
    messages, spent = payloads(_WRITTEN), []
    for _ in range(repeats):
        begun = time.process_time()
        write_ours(folder / "written.mcap", "zstd", messages)
        spent.append(time.process_time() - begun)
    return _WRITTEN / statistics.median(spent)


def run(repeats: int) -> Iterator[Table]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        log, cut = folder / "run.mcap", folder / "cut.mcap"
        # Another process makes the log: memory that this one once held would count as its children's.
        subprocess.run([sys.executable, "-m", "benchmarks.made_logs", str(log), str(_STEPS)], cwd=ROOT, check=True)
        shutil.copy(log, cut)
        os.truncate(cut, log.stat().st_size - 1000)
        count = open_log(log).summary().message_count
        start = command(["--version"], repeats, folder)[0]
        seconds, memory = command(["analyze", str(log), "--json"], repeats, folder)
        rows = [
            Row("start of the command alone, CPU", f"{start:.2f} s"),
            below(f"analyze, {count} messages: CPU", seconds, 5.0, "s"),
            Row("the same: memory", f"{memory:.0f} MB"),
            below("info, whole: CPU without start", described(log, repeats), 0.1, "s"),
            below("info, cut off: CPU without start", described(cut, repeats), 0.1, "s"),
        ]
        for tool in _TOOLS:
            seconds, memory = command([tool[0], str(log), *tool[1:]], 1, folder)
            rows.append(Row(f"{tool[0]}: CPU, memory", f"{seconds:.1f} s, {memory:.0f} MB"))
        speed = written(folder, repeats)
        rows.append(at_least("200-byte messages written with zstd per s of CPU", speed, 2e5))
    yield results(f"Logs, medians of {repeats}", rows)
