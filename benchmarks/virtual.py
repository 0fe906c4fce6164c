"""Processes on virtual hosts: what benchmarks of runs by hand share."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Protocol

from benchmarks.common import ROOT
from zenoh_cbef.errors import UserError

_LOOK_SECONDS = 0.1


class Lab(Protocol):
    """The parts of deploy/netlab's laboratory that are used here."""

    def address(self, host: str) -> str:
        """A host's address."""
        ...

    def command(self, host: str, words: Sequence[str]) -> list[str]:
        """The command that runs a command on a host."""
        ...

    def partition(self, apart: Sequence[str]) -> None:
        """Put these hosts on a switch of their own; no hosts: join all again."""
        ...


def _netlab() -> ModuleType:
    path = ROOT / "deploy" / "netlab" / "netlab.py"
    spec = importlib.util.spec_from_file_location("netlab", path)
    if spec is None or spec.loader is None:
        raise UserError(f"{path} is missing; run benchmarks in the repository")
    module = importlib.util.module_from_spec(spec)
    sys.modules["netlab"] = module
    spec.loader.exec_module(module)
    return module


@contextmanager
def laboratory(hosts: Sequence[str]) -> Iterator[Lab]:
    """A laboratory with these hosts; none is left. Raises UserError where there can be none."""
    netlab = _netlab()
    if (why := netlab.why_not()) is not None:
        raise UserError(f"no virtual hosts here: {why}")
    with netlab.Lab(hosts, f"b{time.time_ns() % 10**6}") as lab:
        yield lab


def links_on(lab: Lab, host: str) -> Counter[int]:
    """The links on a host by the processes that have them."""
    words = lab.command(host, ["ss", "-tnHp", "state", "established"])
    told = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    return Counter(int(pid) for pid in re.findall(r"pid=(\d+)", told))


class Processes:
    """One process of zenoh-cbef on each of some hosts. Those that end by themselves are waited for."""

    def __init__(self, lab: Lab, folder: Path) -> None:
        self.lab, self._folder = lab, folder
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, host: str, *words: str) -> None:
        """Start a process on a host."""
        with (self._folder / f"{host}.err").open("wb") as err:
            self._running[host] = subprocess.Popen(
                self.lab.command(host, [sys.executable, "-m", "zenoh_cbef", *words]),
                cwd=self._folder,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=err,
            )

    def pid(self, host: str) -> int:
        """The process on a host."""
        return self._running[host].pid

    def under_way(self) -> int:
        """How many agents the fleets say to be under way."""
        said = [(self._folder / f"{host}.err").read_text() for host in self._running]
        return sum(int(([0, *re.findall(r"(\d+) under way", one)])[-1]) for one in said)

    def _last_words(self, host: str) -> str:
        lines = (self._folder / f"{host}.err").read_text().splitlines()
        return lines[-1] if lines else "it says nothing"

    def watch(self, seconds: float, look: Callable[[], None], without: Sequence[str] = ()) -> None:
        """Call look() again and again until all have ended but those on the hosts of `without`.

        Raises RuntimeError where a process fails, or they take longer than `seconds`.
        """
        until = time.monotonic() + seconds
        awaited = [one for host, one in self._running.items() if host not in without]
        while any(one.poll() is None for one in awaited):
            look()
            failed = [host for host, one in self._running.items() if one.poll()]
            if failed or time.monotonic() > until:
                why = "they failed" if failed else f"it takes longer than {seconds:g} s"
                words = "; ".join(f"{host}: {self._last_words(host)}" for host in failed or self._running)
                raise RuntimeError(f"the run did not end well: {why}; {words}")
            time.sleep(_LOOK_SECONDS)
