"""What doctor finds, and what it says to do."""

import json
import sys
from collections.abc import Sequence

from tests.processes.conftest import unused_endpoint
from tests.processes.launch.test_refusals import mute
from zenoh_cbef import __version__
from zenoh_cbef.outside.registry import known_runs

FEW_FILES = """
import os, resource, sys
resource.setrlimit(resource.RLIMIT_NOFILE, (200, 200))
os.execv(sys.argv[1], sys.argv[1:])
"""


def examine(world, *options: str, status: int, prefix: Sequence[str] = ()) -> dict[str, list[dict]]:
    done = world.done("doctor", "--json", *options, prefix=prefix, status=status)
    found: dict[str, list[dict]] = {}
    for finding in json.loads(done.stdout)["findings"]:
        found.setdefault(finding["subject"], []).append(finding)
    return found


def levels(findings: list[dict]) -> list[str]:
    return [one["level"] for one in findings]


def test_a_host_by_itself(world):
    found = examine(world, status=0)
    assert {"Python", "Zenoh", "cores", "files", "disk", "loopback", "port", "multicast"} <= found.keys()
    assert {"links", "memory", "threads", "ports"} <= found.keys()
    assert levels(found["loopback"]) == ["ok"]
    assert __version__ in found["Python"][0]["text"]


def test_too_few_files_and_no_place_for_logs_are_problems(world):
    (world.folder / "file").write_text("")
    few = [sys.executable, "-c", FEW_FILES]
    found = examine(world, "--agents", "1000", "--output", "file", status=2, prefix=few)
    assert levels(found["files"]) == levels(found["disk"]) == ["problem"]


def test_more_agents_than_a_run_of_processes_has_are_a_problem_and_what_they_need_is_told(world):
    found = examine(world, "--agents", "1200", status=2)
    assert levels(found["agents"]) == ["problem"]
    assert "at most 1000 agents as processes" in found["agents"][0]["text"]
    assert "with 1200 agents may need 1201" in found["links"][0]["text"]
    assert levels(examine(world, "--agents", "24", status=0)["agents"]) == ["ok"]


def test_a_warning_is_an_exit_status_only_where_it_is_wanted(world):
    key = world.folder / "certificates" / "operator.key"
    world.done("certs", "new", "certificates", "--agents", "1")
    key.chmod(0o644)
    found = examine(world, "--tls", "certificates", status=0)
    assert levels(found["TLS"]) == ["warning"]
    assert levels(found["loopback"]) == ["ok"]
    examine(world, "--tls", "certificates", "--strict", status=1)
    (world.folder / "certificates" / "operator.pem").write_text("no certificate")
    assert levels(examine(world, "--tls", "certificates", status=2)["TLS"]) == ["problem"]


def test_endpoints_are_told_apart(world):
    with mute() as endpoint:
        found = examine(world, "--connect", endpoint, status=2)
        assert levels(found["endpoint"]) == ["ok"]
        assert "does not answer as Zenoh does" in found["link"][0]["text"]
    silent = unused_endpoint()
    found = examine(world, "--connect", silent, "--connect", "tcp/no-such-host.invalid:1", status=2)
    assert "no process listens" in found["endpoint"][0]["text"]
    assert "has no address" in found["endpoint"][1]["text"]


def test_a_run_its_versions_and_its_clocks(world):
    run = world.under_way("timing.mode=realtime", "dt=0.1", "steps=5000")
    found = examine(world, "--run", world.run, status=0)
    assert "running, 4 agents, realtime" in found["run"][0]["text"]
    assert "with 4 agents a process may need" in found["files"][0]["text"]
    assert levels(found["versions"]) == levels(found["clock"]) == levels(found["clocks"]) == ["ok"]
    endpoint = known_runs()[world.run].endpoints[0]
    assert world.run in examine(world, "--connect", endpoint, status=0)["link"][0]["text"]
    assert "there is" in examine(world, "--run", "other", "--connect", endpoint, status=2)["run"][0]["text"]
    world.done("stop", "--run", world.run)
    run.communicate(timeout=100)
