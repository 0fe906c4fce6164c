"""A run that its host is too slow for says so, with what helps; one in lockstep is never too slow."""

import json
import re

from zenoh_cbef.protocol.slow import REMEDY


def test_an_overloaded_run_says_so_while_it_runs_in_its_table_and_in_its_log(world):
    # A fifth of a millisecond for ten rounds of six processes: no host keeps up with that.
    overload = ("timing.mode=realtime", "dt=0.0002", "agents.count=6", "consensus.rounds=10", "steps=100")
    done = world.complete(*overload)
    out, err = done.stdout, done.stderr
    assert re.search(rf"^warning: .*\bagent [0-5]\b.* not keep up with real time; {REMEDY}$", err, re.MULTILINE)
    assert "late by own slowness" in out
    done = world.call("analyze", str(world.log), "--json")
    slow = json.loads(done.stdout)["slow"]
    assert len(slow["agents"]) == 6
    assert any(share > 0.1 for share in slow["agents"])
    assert REMEDY in done.stderr
    assert '"kind":"slow"' in world.call("cat", str(world.log), "-y", ".*event.*").stdout


def test_a_lockstep_run_is_never_too_slow(world):
    done = world.complete("dt=0.0002", "steps=10")
    assert "keep up" not in done.stdout + done.stderr
    assert "slowness" not in done.stdout
    assert world.metrics()["slow"] is None
    listed = world.call("cat", str(world.log), "-y", ".*event.*").stdout
    assert '"kind":"finished"' in listed
    assert '"kind":"slow"' not in listed
