"""Whether this host has enough open files, threads, ports, address space and memory left; which cores, and when."""

from __future__ import annotations

import os
import resource
from contextlib import suppress
from pathlib import Path

from zenoh_cbef.errors import UserError

_FILES_OF_A_PROCESS, _FILES_OF_A_LINK = 24, 2
_ADDRESS_SPACE = 1 << 30
"""Mapped by a process with its threads' stacks and heaps, bytes; most of it is never used."""
_MEMORY, _MEMORY_OF_A_LINK = 50e6, 600e3
"""Memory that a process shares with no other, and what each link adds, bytes."""
_FORKED_MEMORY = 25e6
"""The same of a process of a fleet, bytes."""
_THREADS = 12
"""Threads of a process: Zenoh's, and a few that keep its links."""
_UNLIMITED = resource.RLIM_INFINITY
_MEMORY_INFO = Path("/proc/meminfo")
_GROUPS = Path("/sys/fs/cgroup")
_PORTS = Path("/proc/sys/net/ipv4/ip_local_port_range")


def core_count() -> int:
    """How many cores this process may use; those of the machine where the system does not tell its own."""
    return len(_own_cores()) or os.cpu_count() or 1


def keep_to_core(pid: int, place: int, count: int) -> None:
    """Bind one process of so many to a core where cores are fewer: moving between them costs more than waiting."""
    cores = _own_cores()
    if 0 < len(cores) < count:
        with suppress(OSError):  # it has ended already, which the caller will notice
            os.sched_setaffinity(pid, {cores[place % len(cores)]})


def yield_to_others() -> None:
    """Ask the scheduler for fewer preemptions; the threads of sessions opened later inherit it."""
    if hasattr(os, "sched_setscheduler"):
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))


def _own_cores() -> list[int]:
    """The cores that this process may use, in order; none where the system does not tell them, as macOS."""
    return sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []


def files_needed(links: int) -> int:
    """How many files a process with so many links to others may have open at once."""
    return _FILES_OF_A_PROCESS + _FILES_OF_A_LINK * links


def files_short(links: int) -> str:
    """Raise the soft limit of open files as far as `links` need. Returns why that is not enough, "" where it is."""
    needed = files_needed(links)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == _UNLIMITED or soft >= needed:
        return ""
    possible = needed if hard == _UNLIMITED else min(needed, hard)
    with suppress(ValueError, OSError):  # macOS has a lower limit than it says
        resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, possible), hard))
    allowed = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    if allowed >= needed:
        return ""
    return (
        f"a process with {links} links needs {needed} open files, and may have {allowed}; take fewer "
        f"agents, or raise the hard limit: ulimit -Hn {needed} as administrator, or LimitNOFILE of systemd"
    )


def address_space_short() -> str:
    """Why there is too little address space for one process; empty where there is enough."""
    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    if soft == _UNLIMITED or soft >= _ADDRESS_SPACE:
        return ""
    return (
        f"a process needs {_ADDRESS_SPACE >> 20} MiB of address space, and may have {soft >> 20}; "
        "before the start: ulimit -v unlimited"
    )


def memory_needed(links: float) -> float:
    """Bytes that a process with so many links to others takes and shares with no other."""
    return _MEMORY + _MEMORY_OF_A_LINK * links


def memory_short(processes: int, *, forked: bool = False) -> str:
    """Why this host has too little memory for so many processes; empty where it has enough, or does not tell."""
    free, needed = available_bytes(), processes * (_FORKED_MEMORY if forked else _MEMORY)
    if free is None or free >= needed:
        return ""
    return (
        f"{processes} processes need about {1e-9 * needed:.2g} GB of memory, and {1e-9 * free:.2g} GB are "
        "free; end other programs, take fewer agents (agents.count), or use several hosts"
    )


def threads_short(processes: int) -> str:
    """Why this user may not have the threads of so many processes; empty where that is allowed."""
    needed, allowed = _THREADS * processes, _threads_allowed()
    if allowed is None or allowed >= needed:
        return ""
    return (
        f"{processes} processes need about {needed} threads, and this user may have {allowed}; take fewer agents, or "
        f"raise the limit: ulimit -u {needed}, TasksMax of systemd, or pids_limit of the container"
    )


def _threads_allowed() -> int | None:
    """The lowest limit of threads: of this user, and of the control groups that this process is in."""
    soft, _ = resource.getrlimit(resource.RLIMIT_NPROC)
    found = [] if soft == _UNLIMITED or os.geteuid() == 0 else [soft]
    own = next((line.removeprefix("0::/") for line in _lines(Path("/proc/self/cgroup")) if line.startswith("0::")), "")
    for group in (_GROUPS / own, *(_GROUPS / own).parents):
        most = "".join(_lines(group / "pids.max"))
        found += [int(most)] if most.isdecimal() else []
    return min(found, default=None)


def ports_short(processes: int) -> str:
    """Why the system may have too few TCP ports for processes that listen on any that is free; empty where not."""
    told = " ".join(_lines(_PORTS)).split()
    room = int(told[1]) - int(told[0]) + 1 if len(told) == 2 else None
    if room is None or room >= 2 * processes:
        return ""
    return (
        f"{processes} processes listen on a TCP port each, and the system hands out {room}; widen the range: "
        "sysctl -w net.ipv4.ip_local_port_range='10000 60999'"
    )


def require(*, links: int, processes: int = 1, forked: bool = False) -> None:
    """Make sure that this host can run `processes` with `links` each. Raises UserError that says what is missing.

    The limit of open files is raised where that is allowed; processes that are started later inherit it. forked: they
    share the memory that they do not change.
    """
    short = address_space_short(), files_short(links), memory_short(processes, forked=forked)
    for why in (*short, threads_short(processes), ports_short(processes)):
        if why:
            raise UserError(why)


def available_bytes() -> int | None:
    """How much memory this process may still take; None where the system does not say."""
    found = [one for one in (_host(), _group(), _limit()) if one is not None]
    return max(0, min(found)) if found else None


def _host() -> int | None:
    for line in _lines(_MEMORY_INFO):
        name, _, value = line.partition(":")
        if name == "MemAvailable":
            return int(value.split()[0]) * 1024
    return None


def _group() -> int | None:
    """What the control group, as of a container, leaves."""
    most, used = ("".join(_lines(_GROUPS / name)) for name in ("memory.max", "memory.current"))
    return int(most) - int(used) if most.isdecimal() and used.isdecimal() else None


def _limit() -> int | None:
    most, used = resource.getrlimit(resource.RLIMIT_AS)[0], _lines(Path("/proc/self/statm"))
    if most == resource.RLIM_INFINITY or not used:
        return None
    return most - int(used[0].split()[0]) * resource.getpagesize()


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="ascii").splitlines()
    except OSError:
        return []
