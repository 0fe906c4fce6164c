"""Runs on virtual hosts, each with a network stack and an address of its own; the machine's network is not touched."""

import importlib.util
import os
import sys
import time
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest

from tests.processes.conftest import World, world
from tests.processes.forked import Process

AGENTS = 6
HOSTS = ["router", "target", "record", *(f"a{agent}" for agent in range(AGENTS))]
PORT = 7447
__all__ = ["world"]


def _load() -> ModuleType:
    path = Path(__file__).resolve().parents[2] / "deploy" / "netlab" / "netlab.py"
    spec = importlib.util.spec_from_file_location("netlab", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["netlab"] = module
    spec.loader.exec_module(module)
    return module


netlab = _load()
_why_not = cache(netlab.why_not)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    here = Path(__file__).parent
    mine = [item for item in items if item.path.is_relative_to(here)]
    if mine and (reason := _why_not()):
        for item in mine:
            item.add_marker(pytest.mark.skip(reason=reason))


class Site:
    """One run on the laboratory's hosts. way: "router" or "peers"."""

    def __init__(self, lab, world: World, way: str) -> None:
        self.lab, self.world, self.way = lab, world, way
        self.processes: dict[str, Process] = {}
        self.options = ["--run", world.run, "--patience", "100"]
        # Short, so that a broken link shows soon; a starved machine must still keep its links alive.
        self.lease_ms = 2000
        self.scheme = "tcp"
        self.security: list[str] = []

    def secure(self, certificates: Path) -> None:
        self.scheme, self.security = "tls", ["--tls", str(certificates)]

    def endpoint(self, host: str) -> str:
        return f"{self.scheme}/{self.lab.address(host)}:{PORT}"

    def start_on(self, host: str, *words: str) -> Process:
        process = self.world.start(*words, *self.security, prefix=self.lab.command(host, []))
        self.processes[host] = process
        return process

    def start_router(self) -> None:
        router = self.start_on("router", "router", "--listen", self.endpoint("router"))
        assert router.stdout is not None
        assert router.stderr is not None
        assert router.stdout.readline().startswith("a router listens"), router.stderr.read()

    def start(self, *overrides: str, steps: int) -> None:
        """Start all processes, each on its host."""
        settings = [part for one in (f"steps={steps}", *overrides) for part in ("--set", one)]
        if self.way == "router":
            self.start_router()
        self.start_on("target", "target", "tracking", *settings, *self.options, *self._links("target"))
        self.start_on("record", "record", *self.options, *self._links("record"), "--output", str(self.world.log))
        for agent in range(AGENTS):
            self.start_agent(agent)

    def start_agent(self, agent: int) -> None:
        self.start_on(f"a{agent}", "agent", str(agent), *self.options, *self._links(f"a{agent}"))

    def _links(self, host: str) -> list[str]:
        lease = ["--lease-ms", str(self.lease_ms)]
        if self.way == "router":
            return [*lease, "--client", "--connect", self.endpoint("router")]
        connect = [] if host == "target" else ["--connect", self.endpoint("target")]
        return [*lease, *connect, "--listen", self.endpoint(host)]

    def finish(self, hosts: Iterable[str] | None = None, timeout: float = 100) -> None:
        """Wait until the processes on these hosts, by default all but the router, have ended well."""
        chosen = [host for host in self.processes if host != "router"] if hosts is None else list(hosts)
        for host in chosen:
            _, err = self.processes[host].communicate(timeout=timeout)
            assert self.processes[host].returncode == 0, f"{host}: {err}"


@pytest.fixture
def lab():
    with netlab.Lab(HOSTS, f"t{os.getpid()}{time.monotonic_ns() % 1000}") as one:
        yield one


@pytest.fixture
def site(lab, world):
    def make(way: str) -> Site:
        return Site(lab, world, way)

    return make
