"""Six agents, target, recorder and router, each on a host of its own, compute what the simulator computes."""

import json

import pytest

from tests.netlab.conftest import HOSTS


@pytest.mark.parametrize("way", ["router", "peers", "router with certificates", "peers with certificates"])
def test_a_run_over_nine_hosts_equals_the_simulator(site, lab, world, way):
    run = site(way.split()[0])
    if "certificates" in way:
        hosts = [part for host in HOSTS for part in ("--host", lab.address(host))]
        assert world.call("certs", "new", "certificates", *hosts).returncode == 0
        run.secure(world.folder / "certificates")
    run.lease_ms = 20_000  # No link breaks here; a lockstep run has no use for one that seems to.
    run.start(steps=60)
    run.finish()
    verdict = world.call("verify", str(world.log))
    assert verdict.stdout.startswith("equal bit for bit"), verdict.stdout
    metrics = json.loads(world.call("analyze", str(world.log), "--json").stdout)
    assert metrics["steps"] == 60
    assert metrics["messages"]["missing"] == 0
