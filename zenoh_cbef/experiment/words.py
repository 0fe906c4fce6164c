"""What is varied and what is measured, in words: pages, figures and tables show these in place of keys."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from zenoh_cbef.experiment.cells import Cell

_KEYS = {
    "agents.count": "agents",
    "consensus.acceleration": "acceleration of consensus",
    "consensus.rounds": "consensus rounds",
    "consensus.precision": "numbers of payloads",
    "consensus.scheme": "averaging",
    "consensus.trigger": "trigger of messages",
    "dt": "time step (s)",
    "filter.kind": "filter",
    "filter.motion": "assumed motion",
    "filter.range_std": "assumed noise of ranges (m)",
    "network.graph": "graph",
    "sensor.bias_std": "spread of biases (m)",
    "sensor.noise_std": "noise of ranges (m)",
    "sensor.outlier_probability": "share of outliers",
    "steps": "steps",
    "target.motion": "motion",
}
_OF_FAULTS = {
    "agents": "agents with the fault {kind}",
    "from": "begin of the {kind} (s)",
    "milliseconds": "{kind} (ms)",
    "probability": "probability of {kind}",
    "until": "end of the {kind} (s)",
}


@dataclass(frozen=True)
class Measured:
    """A metric that pages show. metric: its dotted name. question: what it answers. yardsticks: drawn with it."""

    metric: str
    words: str
    question: str
    yardsticks: Sequence[tuple[str, str]] = ()


MEASURED = (
    Measured(
        "position_rmse",
        "position RMSE (m)",
        "How large is the error of the position?",
        (("centralized.position_rmse", "centralised"),),
    ),
    Measured(
        "ratio_to_centralized", "position RMSE / centralised", "What does it cost that no process sees all ranges?"
    ),
    Measured(
        "velocity_rmse",
        "velocity RMSE (m/s)",
        "How large is the error of the velocity?",
        (("centralized.velocity_rmse", "centralised"),),
    ),
    Measured("disagreement", "disagreement (m)", "How far are the agents apart?"),
    Measured("nees.average", "NEES", "Do the agents know how large their errors are?"),
    Measured("links.missed", "share of messages lost or late", "How many messages do not come in time?"),
    Measured("bytes_per_step", "bytes per agent and step", "How much is sent?"),
    Measured("link_bytes_per_step", "bytes per step on a link", "How much does a link carry?"),
)
"""The metrics of tables and figures, one figure for each question."""


def key_words(cells: Sequence[Cell]) -> dict[str, str]:
    """The words of each varied key."""
    keys = dict.fromkeys(key for cell in cells for key in cell.values)
    return {key: _words_of(key, cells) for key in keys}


def metric_words(metric: str) -> str:
    """The words of a metric, also of one that no figure shows."""
    last = metric.removeprefix("final.")
    known = {one.metric: one.words for one in MEASURED}
    words = known.get(last, last.replace("_", " ").replace(".", " "))
    return words if last == metric else f"{words}, last tenth of the run"


def _words_of(key: str, cells: Sequence[Cell]) -> str:
    if key in _KEYS:
        return _KEYS[key]
    table, *rest = key.split(".")
    if table != "fault" or not rest:
        return " ".join([table, *rest]).replace("_", " ")
    if len(rest) == 1:
        return "fault"
    kind = rest[0] if not rest[0].isdecimal() else _kind_of(key, cells)
    number = " ".join(rest[1:])
    return _OF_FAULTS.get(number, f"{number} of {{kind}}").format(kind=kind).replace("_", " ")


def _kind_of(key: str, cells: Sequence[Cell]) -> str:
    """The kind of a fault that a key names by its place: a fact names the same values by the kind."""
    ending = key.split(".", 2)[2]
    named = [name for name in cells[0].facts if name.startswith("fault.") and name.endswith(f".{ending}")]
    for name in named:
        kind = name.split(".")[1]
        if not kind.isdecimal() and all(cell.facts.get(name) == cell.values[key] for cell in cells):
            return kind
    return "fault"
