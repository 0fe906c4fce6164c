"""Logs of real contents without processes: a simulated world's beacons through the tracker."""

from pathlib import Path

from zenoh_cbef.log.prove.reestimate import reestimate
from zenoh_cbef.log.read.header import Header
from zenoh_cbef.log.read.measurements import Measurements
from zenoh_cbef.log.read.recording import Recording
from zenoh_cbef.protocol.keys import Address
from zenoh_cbef.protocol.messages import nan_to_nil
from zenoh_cbef.scenario.load import load, to_toml
from zenoh_cbef.scenario.world import make_world

START = 1_700_000_000_000_000_000


def made_log(path: Path, *overrides: str) -> Path:
    """The log of a run named `made`."""
    loaded = load("tracking", overrides)
    scenario, world = loaded.scenario, make_world(loaded.scenario)
    recording = Recording(Header("made", loaded.plan, None))
    for row, state in enumerate(world.truth.tolist()):
        now = START + round(1e9 * scenario.dt) * (row + 1)
        truth = {"k": row + 1, "sent": now, "state": state}
        recording.take(Address("made", "truth", "target"), [now], [truth])
        for agent in range(scenario.count):
            times = (nan_to_nil(each[agent, row]) for each in (world.emitted, world.arrived))
            body = dict(zip(("emitted", "arrived"), times, strict=True))
            beacon = {"from": "target", "k": row + 1, "sent": now, **body}
            recording.take(Address("made", "beacon", "", agent), [now], [beacon])
    reestimate(Measurements(to_toml(scenario), recording), loaded, "made", path)
    return path
