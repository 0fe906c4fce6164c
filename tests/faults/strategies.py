"""Random fault scenarios: every kind, with random times, links and parameters."""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st

from zenoh_cbef.tracking.filters import KINDS

AGENTS, SECONDS = 4, 1.0

_agent = st.integers(0, AGENTS - 1)
_agents = st.lists(_agent, min_size=1, max_size=AGENTS, unique=True)
_chance = st.floats(0.0, 1.0)
_milliseconds = st.floats(0.0, 200.0)
_PRECISIONS = ["float64", "float32", "int12", "int8"]


@st.composite
def _groups(draw: st.DrawFn) -> dict[str, list[list[int]]]:
    agents = draw(st.permutations(range(AGENTS)))
    cut, end = draw(st.integers(1, AGENTS - 1)), draw(st.integers(2, AGENTS))
    return {"between": [list(agents[:cut]), list(agents[cut : max(end, cut + 1)])]}


_links = st.one_of(
    st.just("all"),
    _agent.map("agent:{}".format),
    st.lists(st.tuples(_agent, _agent).map(list), max_size=5),
    _groups(),
)

_KEYS: dict[str, dict[str, st.SearchStrategy[Any]]] = {
    "loss": {"probability": _chance},
    "burst-loss": {
        "good_to_bad": st.floats(0.001, 1.0),
        "bad_to_good": st.floats(0.001, 0.998),
        "loss_in_good": _chance,
        "loss_in_bad": _chance,
    },
    "delay": {"milliseconds": _milliseconds, "jitter_ms": _milliseconds, "reorder": st.booleans()},
    "duplicate": {"probability": _chance},
    "reorder": {"probability": _chance},
    "corrupt": {"probability": _chance},
    "rate-limit": {"messages_per_second": st.floats(0.0, 60.0)},
    "partition": {},
    "clock": {"offset": st.floats(-1e-7, 1e-7), "drift": st.floats(-1e-8, 1e-8)},
    "sensor-bias": {"bias": st.floats(-50.0, 50.0)},
    "sensor-spikes": {"probability": _chance, "std": st.floats(0.1, 100.0)},
    "sensor-dropout": {"probability": _chance},
    "sensor-stuck": {},
    "outage": {},
    "pause": {},
    "crash": {},
    "byzantine": {
        "mode": st.sampled_from(["constant", "random", "drift", "scale", "replay"]),
        "magnitude": st.floats(-10.0, 10.0),
        "steps": st.integers(1, 5),
    },
}
_DISTRIBUTIONS: dict[str, dict[str, st.SearchStrategy[Any]]] = {
    "constant": {},
    "uniform": {},
    "normal": {"std_ms": _milliseconds},
    "exponential": {},
    "pareto": {"shape": st.floats(1.1, 10.0)},
}


@st.composite
def faults(draw: st.DrawFn) -> dict[str, Any]:
    """One [[fault]] of any kind."""
    kind = draw(st.sampled_from(sorted(_KEYS)))
    fault = {"kind": kind, **draw(st.fixed_dictionaries(_KEYS[kind]))}
    if kind == "delay":
        distribution = draw(st.sampled_from(sorted(_DISTRIBUTIONS)))
        fault |= {"distribution": distribution, **draw(st.fixed_dictionaries(_DISTRIBUTIONS[distribution]))}
    if kind in {"outage", "byzantine", "pause", "crash"}:
        fault["agents"] = draw(_agents)
    elif kind.startswith("sensor") or kind == "clock":
        fault["agents"] = draw(st.one_of(st.just("all"), _agents))
    else:
        fault["links"] = draw(_links)
    if draw(st.booleans()) or kind == "pause":
        fault["from"] = draw(st.floats(0.0, SECONDS))
        if draw(st.booleans()) or kind == "pause":
            fault["until"] = fault["from"] + draw(st.floats(0.05, SECONDS))
    return fault


@st.composite
def scenarios(draw: st.DrawFn) -> dict[str, Any]:
    """A short run of four agents with up to five faults. The paper's own filter, whose gain diverges, is left out."""
    kind = draw(st.sampled_from([one for one in KINDS if one != "cbef"]))
    scheme = draw(st.sampled_from(["auto", "average", "running-sums"]))
    whole = kind in {"sicf", "icf", "ci"} and scheme != "running-sums"
    quiet = {"trigger": 0.3, "isolate": False} if whole and draw(st.booleans()) else {}
    return {
        "seed": draw(st.integers(0, 2**63 - 1)),
        "steps": 10,
        "agents": {"count": AGENTS},
        "network": {"graph": draw(st.sampled_from(["ring", "star", "complete", "path"]))},
        "consensus": {
            "rounds": draw(st.integers(1, 3)),
            "scheme": scheme,
            "precision": draw(st.sampled_from(_PRECISIONS if whole else _PRECISIONS[:2])),
            **quiet,
        },
        "filter": {"kind": kind},
        "fault": draw(st.lists(faults(), min_size=1, max_size=5)),
    }
