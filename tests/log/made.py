"""Logs of real contents without processes: a simulated world's beacons through the tracker."""

from pathlib import Path

import numpy as np

from zenoh_cbef.log.prove.reestimate import reestimate
from zenoh_cbef.log.read.columns import Columns
from zenoh_cbef.log.read.header import Header
from zenoh_cbef.log.read.measurements import Measurements
from zenoh_cbef.log.read.recording import Recording
from zenoh_cbef.protocol.keys import Address
from zenoh_cbef.protocol.kinds import BEACON, TRUTH
from zenoh_cbef.protocol.messages import decode, encode, nan_to_nil
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
        if np.isfinite(state).all():
            data = encode("made", "target", row, now, {"k": row + 1, "state": state})
            truth = decode(TRUTH, data, run="made")
            recording.take_truth(Address("made", "truth", "target"), np.array([now], np.uint64), Columns.of([truth]))
        for agent in range(scenario.count):
            emitted, arrived = (nan_to_nil(each[agent, row]) for each in (world.emitted, world.arrived))
            body = {"k": row + 1, "emitted": emitted, "arrived": arrived}
            beacon = decode(BEACON, encode("made", "target", row, now, body), run="made")
            recording.take_beacons(
                Address("made", "beacon", "", agent), np.array([now], np.uint64), Columns.of([beacon])
            )
    reestimate(Measurements(to_toml(scenario), recording), loaded, "made", path)
    return path
