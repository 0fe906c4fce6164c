"""An agent's host gets another address in the middle of a run: the agent is lost, and heard again."""

import json
import subprocess
from collections.abc import Callable

from tests.waiting import until

AGENT, HOST = 3, "a3"
REALTIME = ["timing.mode=realtime", "dt=0.5", "consensus.rounds=2"]
SECONDS = 150.0


def status(run, lab) -> dict:
    """What the run's status says, empty where it says nothing."""
    words = ["status", "--run", run.world.run, "--connect", run.endpoint("target"), "--json"]
    done = run.world.call(*words, prefix=lab.command("record", []))
    return json.loads(done.stdout) if done.returncode == 0 else {}


def said(run, lab) -> list[tuple[str, object]]:
    """The kinds of the latest events, and which process each is about."""
    return [(one["kind"], (one.get("data") or {}).get("name")) for one in status(run, lab).get("events", [])]


def step(run, lab) -> int:
    """The step of the agent's latest estimate that the target knows of, 0 where it knows of none."""
    found = {one["agent"]: one["step"] for one in status(run, lab).get("agents", [])}
    return found.get(AGENT) or 0


def wait(condition: Callable[[], bool], what: str) -> None:
    until(condition, what, SECONDS, every=0.5)


def test_an_agent_whose_address_changes_takes_part_again(site, lab):
    run = site("peers")
    own = run.endpoint
    run.endpoint = lambda host: own(host) if host in {"target", "record"} else f"{run.scheme}/0.0.0.0:0"
    run.start(*REALTIME, steps=5000)
    wait(lambda: step(run, lab) > 0, "the agent gives no estimate")
    for change, address in (("del", lab.address(HOST)), ("add", "10.77.0.200")):
        subprocess.run(lab.command(HOST, ["ip", "address", change, f"{address}/16", "dev", "eth0"]), check=True)
    wait(lambda: ("returned", f"agent/{AGENT}") in said(run, lab), "the recorder does not hear it again")
    before = step(run, lab)
    wait(lambda: step(run, lab) > before, "the target does not hear it again")
    words = ["stop", "--run", run.world.run, "--connect", run.endpoint("target")]
    run.world.call(*words, prefix=lab.command("record", []))
    run.finish()
