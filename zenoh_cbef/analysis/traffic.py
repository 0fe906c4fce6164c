"""How many bytes a scenario's agents will publish, by encoding what they would send."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.protocol.messages import BIAS, DISTRUST, encode, pack_floats
from zenoh_cbef.protocol.round_codec import RoundCodec
from zenoh_cbef.scenario import Scenario, network
from zenoh_cbef.scenario.build import bias_of, distrusts_own, message_size
from zenoh_cbef.tracking.filters import WITHOUT_COVARIANCE

_SENT = 1_700_000_000_000_000_000


def round_bytes(scenario: Scenario) -> int:
    """Bytes of one consensus message."""
    width = message_size(scenario)
    return len(RoundCodec(scenario.name, "agent/0", width).encode(0, _SENT, 1, 1, np.zeros(width)))


def other_bytes(scenario: Scenario) -> float:
    """Bytes that an agent publishes in a step besides its consensus messages: its range and its estimate."""
    step, place = scenario.length // 2, [0.5] * 3
    reported = encode(scenario.name, "agent/0", step, _SENT, {"k": step, "position": place, "range": 0.5})
    degree = round(2.0 * len(network.edges(scenario)) / scenario.count)
    counts = {name: [step * scenario.consensus.rounds] * degree for name in ("received", "lost", "late")}
    estimate = {"k": step, "state": [0.5] * 6, "innovation": 0.5, "weight": 0.5, "nis": 0.5, "nis_degrees": 1}
    estimate |= {"neighbours": [0] * degree, **counts, "latency": [0.5] * degree, "covariance": None}
    if distrusts_own(scenario):
        estimate[DISTRUST] = 0.0
    if bias_of(scenario) != "none":
        estimate |= dict.fromkeys(BIAS, 0.5)
    if scenario.filter.kind not in WITHOUT_COVARIANCE:
        estimate["covariance"] = pack_floats(np.zeros((6, 6)))
    return len(reported) + len(encode(scenario.name, "agent/0", step, _SENT, estimate))
