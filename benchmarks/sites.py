"""Two sites with a router each, and a cut between them: how each site tracks, and when they agree again.

As docs/hosts.md starts them. Site 1 has the target, the recorder and half of the agents; site 2 has the others.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from rich.table import Table

from benchmarks.common import Row, plain_table, results
from benchmarks.processes import agents_of
from benchmarks.virtual import Lab, Processes, laboratory, links_on
from zenoh_cbef.arrays import Floats
from zenoh_cbef.log.prove.verify import verify
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.numbers import number
from zenoh_cbef.scenario.load import load

AGENTS = 6
SITES = (range(3), range(3, AGENTS))
SETTINGS = [f"agents.count={AGENTS}", "network.graph=ring", "consensus.rounds=3"]
REALTIME = ["timing.mode=realtime", "dt=0.2", "steps=100"]
_ROUTERS = ("router1", "router2")
_HOSTS = (*_ROUTERS, "target", "record", "site1", "site2")
_PORT = 7447
_BEFORE_STEPS = 25
"""A first fix takes 20: agents that are cut apart during it begin with different guesses."""
_CUT_SECONDS = 5.0
_LEASE_MS = 2000
_LIMIT_SECONDS = 200.0
CALM_STEPS = 15
"""What the sites' difference was in so many steps before the cut is what it is to become again."""


@dataclass
class Seen:
    """The log of a run, when its sites were cut apart and joined again, ns, and the links of each agent before."""

    log: Path
    cut: int = 0
    healed: int = 0
    links: dict[int, int] = field(default_factory=dict)


def _start(processes: Processes, overrides: Sequence[str]) -> None:
    address = processes.lab.address
    routers = [f"tcp/{address(host)}:{_PORT}" for host in _ROUTERS]
    run = ["--run", "sites", "--patience", "100", "--lease-ms", str(_LEASE_MS)]
    settings = [part for one in overrides for part in ("--set", one)]
    lease = ["--lease-ms", str(_LEASE_MS)]
    processes.start("router1", "router", "--listen", routers[0], *lease)
    processes.start("router2", "router", "--listen", routers[1], "--connect", routers[0], *lease)
    hub = [*run, "--client", "--connect", routers[0]]
    processes.start("target", "target", "tracking", *settings, *hub)
    processes.start("record", "record", *hub, "--output", "run.mcap")
    for router, agents, host in zip(routers, SITES, ("site1", "site2"), strict=True):
        ids, listen = f"{agents[0]}-{agents[-1]}", f"tcp/{address(host)}:7450"
        processes.start(host, "fleet", ids, *run, "--connect", router, "--listen", listen)


def _links(lab: Lab) -> dict[int, int]:
    links = links_on(lab, "site1") + links_on(lab, "site2")
    return {agent: links[pid] for agent, pid in agents_of("sites").items()}


def observe(overrides: Sequence[str], folder: Path, *, cut: bool) -> Seen:
    """Run a scenario on two sites; none is left. cut: between them, 25 steps after all agents are under way."""
    seen = Seen(folder / "run.mcap")
    before, began = _BEFORE_STEPS * load("tracking", overrides).scenario.dt, 0.0
    with laboratory(_HOSTS) as lab:
        processes = Processes(lab, folder)

        def look() -> None:
            nonlocal began
            if not began and processes.under_way() == AGENTS:
                began, seen.links = time.monotonic(), _links(lab)
            if not cut or not began:
                return
            if not seen.cut and time.monotonic() > began + before:
                lab.partition(["router2", "site2"])
                seen.cut = time.time_ns()
            elif seen.cut and not seen.healed and time.time_ns() > seen.cut + 1e9 * _CUT_SECONDS:
                lab.partition([])
                seen.healed = time.time_ns()

        _start(processes, overrides)
        processes.watch(_LIMIT_SECONDS, look, without=_ROUTERS)
    return seen


@dataclass(frozen=True)
class Figures:
    """What the log says of each step.

    apart: the distance (m) of the sites' mean positions. within: the largest distance (m) of an agent from its site's
    mean (sites, steps). error: the agents' mean position error (m) (sites, steps). cut, healed: the first steps after
    each. agreed: the first one after the cut's end in which the sites are no further apart than before the cut.
    """

    apart: Floats
    within: Floats
    error: Floats
    cut: int
    healed: int
    agreed: int | None


def figures(seen: Seen) -> Figures:
    """What the log of a run with a cut says."""
    trace = read_trace(seen.log)
    places, truth = trace.estimates[:, :, :3], trace.truth[:, :3]
    sites = [places[list(agents)] for agents in SITES]
    means = [site.mean(axis=0) for site in sites]
    apart = np.linalg.norm(means[0] - means[1], axis=1)
    within = [np.linalg.norm(site - mean, axis=2).max(axis=0) for site, mean in zip(sites, means, strict=True)]
    error = [np.linalg.norm(site - truth, axis=2).mean(axis=0) for site in sites]
    sent = [one.log_time for one in open_log(seen.log).messages() if one.channel.topic.endswith("/truth")]
    cut, healed = (int(np.searchsorted(sent, moment)) for moment in (seen.cut, seen.healed))
    calm = apart[cut - CALM_STEPS : cut].max()
    again = np.flatnonzero(apart[healed:] <= calm)
    agreed = healed + int(again[0]) if again.size else None
    return Figures(apart, np.array(within), np.array(error), cut, healed, agreed)


def beyond(links: dict[int, int]) -> dict[int, int]:
    """The links of each agent beyond those to neighbours of its own site."""
    edges = load("tracking", SETTINGS).plan.edges.tolist()
    near = [edge for edge in edges if any(edge[0] in site and edge[1] in site for site in SITES)]
    return {agent: count - sum(agent in edge for edge in near) for agent, count in sorted(links.items())}


def run(repeats: int) -> Iterator[Table]:
    del repeats
    with tempfile.TemporaryDirectory() as folder:
        seen = observe(SETTINGS, Path(folder), cut=False)
        verdict = verify(seen.log)
    with tempfile.TemporaryDirectory() as folder:
        seen = observe([*SETTINGS, *REALTIME], Path(folder), cut=True)
        found = figures(seen)
    last = found.apart.shape[0]
    # What comes right after the cut, and right before its end, is neither one thing nor the other.
    phases = {
        "15 steps before the cut": slice(found.cut - CALM_STEPS, found.cut),
        "its last 15 steps": slice(found.healed - CALM_STEPS, found.healed),
        "the run's last 15 steps": slice(last - CALM_STEPS, last),
    }
    both = [f"{what} {site} (m)" for what in ("error, site", "within site") for site in (1, 2)]
    rows = [
        [name, *found.error[:, one].mean(axis=1), *found.within[:, one].mean(axis=1), found.apart[one].mean()]
        for name, one in phases.items()
    ]
    title = "two sites, a router each, cut apart for five seconds in realtime"
    yield plain_table(title, ["mean of", *both, "apart (m)"], rows)
    most = max(beyond(seen.links).values())
    steps = "never" if found.agreed is None else number(float(found.agreed - found.healed))
    yield results(
        "and",
        [
            Row("links of an agent beyond its neighbours of the same site", f"at most {most}", "1", most == 1),
            Row("steps of 0.2 s from the cut's end until the sites differ no more than before it", steps),
            Row("lockstep without a cut: verify", verdict.text, "equal", verdict.result == "equal"),
        ],
    )
