"""Six agents, target, recorder and router, each on a host of its own, compute what the simulator computes."""

import time

import pytest

from tests.netlab.conftest import HOSTS


@pytest.mark.parametrize("way", ["peers", "router with certificates"])
def test_a_run_over_nine_hosts_equals_the_simulator(site, lab, world, way):
    run = site(way.split()[0])
    if "certificates" in way:
        hosts = [part for host in HOSTS for part in ("--host", lab.address(host))]
        world.done("certs", "new", "certificates", *hosts)
        run.secure(world.folder / "certificates")
    run.lease_ms = 20_000  # No link breaks here; a lockstep run has no use for one that seems to.
    run.start(steps=30)
    run.finish()
    assert world.verdict().startswith("equal bit for bit")
    metrics = world.metrics()
    assert metrics["steps"] == 30
    assert metrics["messages"]["missing"] == 0


@pytest.mark.parametrize("directions", ["one", "both"])
def test_a_broken_link_costs_time_and_no_bit(site, lab, world, directions):
    run = site("peers")
    run.start(steps=120)
    run.world.wait_for_messages()

    def cut(*, on: bool) -> None:
        if directions == "one":
            lab.mute("a4", on=on)
        else:
            lab.link("a4", up=not on)

    cut(on=True)
    time.sleep(2.5 * run.lease_ms / 1000)  # long enough for both ends to give the link up
    cut(on=False)
    run.finish()
    assert world.verdict().startswith("equal bit for bit")
    metrics = world.metrics()
    assert (metrics["steps"], metrics["messages"]["rejected"]) == (120, 0)
    assert all(link["lost"] == 0 for link in metrics["links"])
    world.done("check", str(world.log))


def test_who_does_without_a_message_in_lockstep_says_so(site, lab, world):
    run = site("peers")
    run.start("timing.patience=1", steps=120)
    run.world.wait_for_messages()
    lab.kill("a2")
    run.finish(["target", "record", "a0", "a1", "a3", "a4", "a5"])
    world.verdict(2)
    events = world.call("cat", str(world.log), "-y", ".*/event.*").stdout
    assert "agent/2 is not there any more; going on without it" in events
