"""What the system tells of processes: processor time, memory, links; /proc, so Linux only."""

from __future__ import annotations

import os
import re
from collections import defaultdict
from pathlib import Path
from typing import NamedTuple


class Used(NamedTuple):
    """What processes have used since they began.

    main, others: CPU of their main and other threads, ns. waits: how often one of their threads has waited.
    """

    main: int
    others: int
    waits: int


def cpu_seconds(pid: int) -> float:
    """User and system time that a process has used."""
    # The name, in brackets, may hold anything; what follows it is numbers.
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def resident_megabytes(pid: int) -> float:
    """Memory of a process that is in use, shared with others or not, MB."""
    found = re.search(r"VmRSS:\s+(\d+)", Path(f"/proc/{pid}/status").read_text())
    return int(found[1]) / 1024 if found else 0.0


def own_megabytes(pid: int) -> float:
    """The part of it that the process shares with no other, MB."""
    told = Path(f"/proc/{pid}/smaps_rollup").read_text()
    return sum(int(one) for one in re.findall(r"^Private_\w+:\s+(\d+)", told, re.MULTILINE)) / 1024


def agents_of(run: str) -> dict[int, int]:
    """The pids of a run's agents on this machine by their ids."""
    found = {}
    for place in Path("/proc").iterdir():
        if place.name.isdecimal():
            try:
                words = (place / "cmdline").read_text().replace("\0", " ").split()
            except OSError:
                continue
            if run in words and "agent" in words:
                found[int(words[words.index("agent") + 1])] = int(place.name)
    return found


def bytes_on(pid: int, device: str) -> tuple[int, int]:
    """Bytes received and sent so far on a network device, as a process sees it."""
    for line in Path(f"/proc/{pid}/net/dev").read_text().splitlines():
        name, _, counts = line.partition(":")
        if name.strip() == device:
            numbers = counts.split()
            return int(numbers[0]), int(numbers[8])
    return 0, 0


def used_by(run: str) -> dict[str, Used]:
    """What the processes of a run on this machine have used, by role: "agent", all of them together, "target", ..."""
    found: dict[str, Used] = defaultdict(lambda: Used(0, 0, 0))
    for place in Path("/proc").iterdir():
        if place.name.isdecimal():
            try:
                words = (place / "cmdline").read_text().replace("\0", " ").split()
                role = next((word for word in words if word in {"agent", "target", "record"}), "")
                if run in words and role:
                    found[role] = Used(*map(sum, zip(found[role], _used_by_threads(place), strict=True)))
            except OSError:
                continue
    return dict(found)


def _used_by_threads(process: Path) -> Used:
    main = others = waits = 0
    for thread in (process / "task").iterdir():
        spent = int((thread / "schedstat").read_text().split()[0])
        waited = re.search(r"^voluntary_ctxt_switches:\s+(\d+)", (thread / "status").read_text(), re.MULTILINE)
        waits += int(waited[1]) if waited else 0
        if thread.name == process.name:
            main = spent
        else:
            others += spent
    return Used(main, others, waits)
