"""Processes that join through a router, as clients, compute what peers compute."""

import json
import signal

import pytest
import zenoh

from tests.processes.conftest import ended, settings
from tests.waiting import until


def test_clients_of_a_router_in_lockstep_equal_the_simulator(world, endpoint):
    join = ["--client", "--connect", endpoint, "--run", world.run, "--patience", "100"]
    # The router last: clients wait for it.
    processes = [
        world.start("target", "tracking", *settings(), *join),
        world.start("record", *join, "--output", str(world.log)),
        *(world.start("agent", str(agent), *join) for agent in range(4)),
    ]
    router = world.start("router", "--listen", endpoint)
    for process in processes:
        ended(process)
    assert router.poll() is None
    router.send_signal(signal.SIGTERM)
    out, err = router.communicate(timeout=100)
    assert (router.returncode, err) == (0, "")
    assert out == f"a router listens on {endpoint}\n"
    assert world.verdict().startswith("equal bit for bit")
    metrics = world.metrics()
    assert metrics["messages"]["missing"] == 0


def test_who_meets_a_router_and_listens_nowhere_joins_through_it(world, endpoint):
    router = world.start("router", "--listen", endpoint)
    assert router.stdout.readline()
    # Without gossip peers would never find each other: they need no --client to be the router's clients.
    join = ["--connect", endpoint, "--no-gossip", "--run", world.run, "--patience", "100"]
    processes = [
        world.start("target", "tracking", *settings(), "--client", *join),
        world.start("record", *join, "--output", str(world.log)),
        *(world.start("agent", str(agent), *join) for agent in range(4)),
    ]
    for process in processes:
        ended(process)
    assert world.verdict().startswith("equal bit for bit")


def test_without_a_router_a_client_says_so(world, endpoint):
    refused = world.done(
        "agent", "0", "--run", world.run, "--client", "--connect", endpoint, "--patience", "0.5", status=2
    )
    assert f"neither router nor target answers at {endpoint}" in refused.stderr
    assert len(refused.stderr.splitlines()) == 1


def test_a_router_listens_where_its_configuration_says(world, free_port, tmp_path):
    file = tmp_path / "router.json5"
    file.write_text(f'{{ listen: {{ endpoints: ["tcp/127.0.0.1:{free_port}"] }} }}')
    router = world.start("router", "--config", str(file))
    assert router.stdout.readline()
    # Refused for its run, not for want of a router.
    join = ["--run", world.run, "--client", "--connect", f"tcp/127.0.0.1:{free_port}", "--patience", "2"]
    asked = world.done("agent", "0", *join, status=2)
    assert "no target of run" in asked.stderr


@pytest.mark.parametrize("endpoint", ["tcp/0.0.0.0:{}", "tcp/[::]:{}"])
def test_an_endpoint_that_others_can_reach_without_certificate_is_warned_of(world, free_port, endpoint):
    router = world.start("router", "--listen", endpoint.format(free_port))
    assert router.stdout.readline()
    router.terminate()
    _, err = router.communicate(timeout=100)
    assert err.startswith("warning: ")
    assert len(err.splitlines()) == 1


def test_the_printed_configuration_is_one_that_zenoh_takes(world, free_port, tmp_path):
    world.done("certs", "new", "certs", "--agents", "1")
    printed = world.call("router", "--listen", f"tls/127.0.0.1:{free_port}", "--tls", "certs", "--print-config")
    assert (printed.returncode, printed.stderr) == (0, "")
    file = tmp_path / "zenohd.json5"
    file.write_text(printed.stdout)
    config = zenoh.Config.from_file(str(file))
    assert config.get_json("mode") == '"router"'
    assert json.loads(config.get_json("access_control"))["default_permission"] == "deny"
    assert json.loads(config.get_json("transport/link/tls"))["enable_mtls"] is True


def test_health_tells_a_process_that_is_there_from_one_that_is_not(world, endpoint):
    join = ["--client", "--connect", endpoint, "--run", world.run]

    def health(who: str) -> int:
        return world.call("health", who, *join, "--patience", "1").returncode

    assert health("agent/0") == 2
    router = world.start("router", "--listen", endpoint)
    assert router.stdout.readline()
    assert health("agent/0") == 2
    world.start("target", "tracking", *settings(), *join)
    agent = world.start("agent", "0", *join, "--patience", "100")
    until(lambda: health("agent/0") == 0)
    assert (health("target"), health("agent/1"), health("record")) == (0, 1, 1)
    agent.kill()
    agent.wait()
    assert health("agent/0") == 1
