"""How the runs of a cell are done: simulated as one batch, or as processes one after the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from zenoh_cbef.analysis.averages import rms_over_agents
from zenoh_cbef.analysis.metrics import Analysis, analyze, ratio_to_centralized
from zenoh_cbef.analysis.traffic import other_bytes, round_bytes
from zenoh_cbef.errors import UserError
from zenoh_cbef.experiment.numbers import SUMMED
from zenoh_cbef.experiment.results import Curve, Outcome
from zenoh_cbef.log.read.parts import find_log
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.nodes.launch.attempts import launch
from zenoh_cbef.plain import Json
from zenoh_cbef.protocol.short import SILENT_BYTES
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.checks import check
from zenoh_cbef.scenario.load import Loaded, to_toml
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate

_CURVE_POINTS = 100


def simulated(scenario: Scenario, seeds: Sequence[int], skip: float) -> list[Outcome]:
    """The outcomes of a cell's seeds, simulated and analysed as one batch."""
    plans, outcomes = list[Plan](), list[Outcome]()
    for seed in seeds:
        one = Plan(scenario.changed(seed=seed))
        try:
            check(one)
        except UserError as error:
            outcomes.append(Outcome(seed, error=str(error)))
        else:
            plans.append(one)
    if not plans:
        return outcomes
    try:
        with np.errstate(all="ignore"):
            analyses = analyze(simulate([one.scenario for one in plans]), skip)
        sent = _bytes(Plan(scenario))  # not of a run: which runs are in a batch would decide
        return outcomes + [outcome_of(one, sent - _unsaid(one)) for one in analyses]
    except Exception as error:  # noqa: BLE001 - one run's failure is reported, and the others go on
        if len(plans) == 1:
            return [*outcomes, Outcome(plans[0].scenario.seed, error=described(error))]
    for one in plans:
        outcomes += simulated(scenario, [one.scenario.seed], skip)
    return outcomes


def executed(scenario: Scenario, seed: int, skip: float, folder: Path) -> Outcome:
    """The outcome of one run as processes, whose log stays in the folder."""
    one = scenario.changed(seed=seed)
    folder.mkdir(parents=True, exist_ok=True)
    source, log = folder / "scenario.toml", folder / "run.mcap"
    for stale in folder.glob("run.mcap*"):
        stale.unlink()
    try:
        text = to_toml(one)
        loaded = Loaded(text, one)
        check(loaded.plan)
        source.write_text(text, encoding="utf-8")
        deaths = _launched([str(source)], loaded, f"{one.name}-{folder.name}"[:100], log)
        if deaths:
            return Outcome(seed, error=deaths[0])
        return outcome_of(analyze([read_trace(find_log(log))], skip)[0], None)
    except Exception as error:  # noqa: BLE001 - likewise
        return Outcome(seed, error=described(error))


def _launched(arguments: list[str], loaded: Loaded, run: str, log: Path) -> list[str]:
    launcher = launch(arguments, loaded, run, log)
    if not launcher.started and not launcher.deaths:
        return ["the run did not start"]
    return [str(death) for death in launcher.deaths]


def outcome_of(analysis: Analysis, bytes_per_step: float | None) -> Outcome:
    """The outcome of a run; position_error of its curve is the root mean square of the agents."""
    metrics = scalars(analysis.metrics.as_json())
    del metrics["seed"]  # no result
    metrics["bytes_per_step"] = analysis.metrics.bytes_per_step or bytes_per_step
    links = analysis.trace.links
    metrics |= {f"links.{name}": int(getattr(links, name).sum()) for name in SUMMED}
    metrics["links.missed"] = links.missed
    metrics |= _final(analysis)
    steps = np.unique(np.linspace(0, len(analysis.trace.time) - 1, _CURVE_POINTS).round().astype(int))
    curves = (
        analysis.trace.time[steps],
        rms_over_agents(analysis.position_error[analysis.counted][:, steps]),
        analysis.disagreement[steps],
    )
    curve = Curve(*([_short(value) for value in values.tolist()] for values in curves))
    return Outcome(analysis.trace.scenario.seed, metrics, curve)


def _final(analysis: Analysis) -> dict[str, float | None]:
    """Metrics of the last tenth of the run alone: the errors that remain after a fault."""
    last = slice(-max(1, len(analysis.trace.time) // 10), None)
    position = float(rms_over_agents(analysis.position_error[analysis.counted, last].ravel()))
    ratio = ratio_to_centralized(analysis, last)
    found = {
        "final.position_rmse": position,
        "final.ratio_to_centralized": np.nan if ratio is None else ratio,
        "final.disagreement": float(rms_over_agents(analysis.disagreement[last])),
    }
    return {name: value if np.isfinite(value) else None for name, value in found.items()}


def _short(value: float) -> float | None:
    return float(f"{value:.4g}") if np.isfinite(value) else None


def scalars(metrics: Mapping[str, Json], above: str = "") -> dict[str, str | float | None]:
    """Numbers, words and truths by dotted names; lists are left out."""
    found: dict[str, str | float | None] = {}
    for name, value in metrics.items():
        if isinstance(value, Mapping):
            found |= scalars(value, f"{above}{name}.")
        elif not isinstance(value, Sequence) or isinstance(value, str):
            found[above + name] = None if isinstance(value, float) and not np.isfinite(value) else value
    return found


def described(error: Exception) -> str:
    """An error in one sentence."""
    first = (str(error).strip().splitlines() or [""])[0]
    return first if isinstance(error, UserError) else f"{type(error).__name__}: {first}"


def _bytes(plan: Plan) -> float:
    """Bytes that an agent would publish in a step, which a simulation does not send."""
    return other_bytes(plan) + plan.rounds * round_bytes(plan)


def _unsaid(analysis: Analysis) -> float:
    """Of those, the ones that agents which kept silent did not publish."""
    plan = analysis.trace.plan
    return (analysis.metrics.silent or 0.0) * plan.rounds * (round_bytes(plan) - SILENT_BYTES)
