"""What the system tells of processes: processor time, memory, links; /proc, so Linux only."""

from __future__ import annotations

import os
import re
from pathlib import Path


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
