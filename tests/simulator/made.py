"""Scenarios of five agents, with every filter and every fault, and runs compared bit for bit."""

from __future__ import annotations

from zenoh_cbef.scenario.load import parse
from zenoh_cbef.tracking.filters import KINDS

LOSS = {"kind": "loss", "probability": 0.3}


DELAY = {"kind": "delay", "milliseconds": 5.0, "jitter_ms": 10.0, "links": "agent:1"}


LIES = [{"kind": "byzantine", "agents": [1], "mode": mode, "steps": 2} for mode in ("random", "replay")]


FAULTS = {"no fault": [], "loss": [LOSS], "delay": [DELAY], "liar": [*LIES, LOSS]}


PARTS = (
    "truth",
    "positions",
    "ranges",
    "age",
    "initial",
    "estimates",
    "covariances",
)


def scenario(seed=1, **keys):
    """Five agents, with ranges missing now and then; every seed draws another graph."""
    base = {
        "seed": seed,
        "steps": 5,
        "agents": {"count": 5, "low": 0.0, "high": 0.8},
        "target": {"position": [0.4, 0.4, 0.4]},
        "sensor": {"range_std": 0.05, "dropout_probability": 0.2},
        "consensus": {"rounds": 3},
    }
    return parse(
        {
            name: {**base.get(name, {}), **keys[name]}
            if isinstance(keys.get(name), dict)
            else keys.get(name, base.get(name))
            for name in {*base, *keys}
        },
        "test",
    )


FILTERS = (
    {kind: {"kind": kind} for kind in KINDS}
    | {"sicf that recovers": {"kind": "sicf", "recovery": True}}
    | {"icf that distrusts": {"kind": "icf", "distrust": True}}
    | {f"{kind} of differences": {"kind": kind, "measurement": "difference"} for kind in ("ci", "local")}
)


def assert_same(first, second):
    for part in PARTS:
        assert getattr(first, part).tobytes() == getattr(second, part).tobytes(), part
    for name, values in first.diagnostics.named().items():
        assert values.tobytes() == second.diagnostics.named()[name].tobytes(), name
    counts = ("sent", "delivered", "lost", "late", "injected_lost", "injected_late", "corrupted", "duplicated")
    for part in ("source", "destination", *counts):
        assert getattr(first.links, part).tolist() == getattr(second.links, part).tolist(), part
