"""One run as one HTML file that opens anywhere, offline: the map, errors, the paper's figures, links, the scenario."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import tomli_w

from zenoh_cbef.analysis.coverage import spelt, why_no_nees, why_no_nis
from zenoh_cbef.analysis.error_charts import error_charts
from zenoh_cbef.analysis.events_table import events_table
from zenoh_cbef.analysis.figures import (
    MOST_SHOWN,
    PERCENTILES,
    Chart,
    agent_names,
    agent_style,
    paper_charts,
    percentiles,
)
from zenoh_cbef.analysis.links_table import is_wide, links_table
from zenoh_cbef.analysis.metrics import Analysis
from zenoh_cbef.analysis.metrics import notes as noted
from zenoh_cbef.analysis.nearest import nearest
from zenoh_cbef.analysis.plots import network_plot, space_plot, time_plot, top_plot
from zenoh_cbef.analysis.replayed import replayed
from zenoh_cbef.extras import from_extra
from zenoh_cbef.faults import Fault
from zenoh_cbef.pages.parts import Figure, Table, number, plots_of
from zenoh_cbef.pages.render import render
from zenoh_cbef.words import counted

_SVG_DASH = {"solid": "", "dash": "6 3", "dot": "2 2", "dashdot": "6 2 1.5 2"}


def write_report(analysis: Analysis, path: Path) -> None:
    """Write a run's report, with plotly.js inside. Raises MissingExtra where plotly is not installed."""
    plotly = from_extra("plotly.offline", "the report")
    trace = analysis.trace
    paper = _shown(paper_charts(analysis), analysis)
    first, *rest = error_charts(analysis)
    position, honest = _timed(first, analysis), _shown(rest, analysis)
    near = nearest(analysis)
    maps, network = _maps(near), _network(near)
    text = render(
        "report.html",
        name=trace.name,
        lead=_lead(analysis),
        incomplete="" if trace.complete else f"{analysis.metrics.steps} of {trace.scenario.length} steps",
        notes=[f"{said[0].upper()}{said[1:]}." for said in [*noted(analysis.metrics), *_shown_in_part(analysis)]],
        facts=_facts(analysis),
        errors=errors_table(analysis),
        honesty=_honesty(analysis),
        traffic=_traffic(analysis),
        each_agent=_each_agent(analysis),
        agents=_agents(near),
        paper=paper,
        position=position,
        maps=maps,
        honest=honest,
        network=network,
        links=links_table(trace.links, agent_names(analysis)) if network.plot else None,
        links_are_wide=is_wide(trace.links),
        events=events_table(trace),
        scenario=tomli_w.dumps(trace.scenario.model_dump(mode="json", by_alias=True, exclude_none=True)),
        plots=plots_of([*paper, position, *maps, *honest, network]),
        plotly=plotly.get_plotlyjs(),
        scene=replayed(analysis),
    )
    path.write_text(text, encoding="utf-8")


def _shown(charts: Sequence[Chart], analysis: Analysis) -> list[Figure]:
    """The figures of charts; without a truth those of errors are left out and not shown empty."""
    figures = [_timed(chart, analysis) for chart in charts]
    return [one for one in figures if one.plot is not None or analysis.metrics.scored.steps]


def figures_of(analysis: Analysis) -> list[Figure]:
    """All figures of the report, in its order."""
    charts, near = [*paper_charts(analysis), *error_charts(analysis)], nearest(analysis)
    return [*_shown(charts, analysis), *_maps(near), _network(near)]


def _timed(chart: Chart, analysis: Analysis) -> Figure:
    plot = None if chart.empty else time_plot(chart, analysis)
    return Figure(chart.name, chart.title, chart.caption, plot)


def _maps(analysis: Analysis) -> list[Figure]:
    caption = (
        "Diamonds: agents, where they ended; dotted: their way. In their colours: estimates from the first fix on."
    )
    above = Figure("top", "Seen from above", caption, top_plot(analysis))
    if analysis.trace.scenario.filter.planar_height is not None:
        return [above]
    caption = "Drag to turn, scroll to zoom. Estimates far from everything else are cut off."
    return [Figure("space", "Trajectory", caption, space_plot(analysis)), above]


def _network(analysis: Analysis) -> Figure:
    plot = network_plot(analysis) if len(analysis.trace.links.source) else None
    caption = "Wider and redder: more messages lost or late. Point at an arrow for its counts."
    return Figure("network", "Links", caption, plot)


def _shown_in_part(analysis: Analysis) -> list[str]:
    """A sentence on what is drawn of a large network."""
    count = len(analysis.trace.estimates)
    drawn = f"maps show the {MOST_SHOWN} agents nearest to the target and the links between them, out of {count}"
    return [f"{drawn}; charts and tables show percentiles of all"] if count > MOST_SHOWN else []


def _lead(analysis: Analysis) -> str:
    scenario, steps = analysis.trace.scenario, analysis.metrics.steps
    return (
        f"{counted(len(analysis.trace.estimates), 'agent')} tracking one target with "
        f"{scenario.filter.kind}, {counted(steps, 'step')} of {scenario.dt:g} s."
    )


def _facts(analysis: Analysis) -> tuple[dict[str, str], dict[str, str]]:
    trace, scenario = analysis.trace, analysis.trace.scenario
    consensus, network = scenario.consensus, scenario.network
    graph = "given edges" if network.edges is not None else network.graph
    chebyshev = ", Chebyshev" if consensus.acceleration == "chebyshev" else ""
    how = "running sums" if trace.plan.sums else f"{consensus.weights} weights"
    metrics = analysis.metrics
    quiet = "" if metrics.silent is None else f", silent in {100.0 * metrics.silent:.0f} % of the rounds"
    faults = [_fault(fault) for fault in scenario.fault]
    left = {
        "Filter": f"{scenario.filter.kind}, ξ = {trace.plan.xi:g}",
        "Consensus": f"{counted(consensus.rounds, 'round')}, {how}{chebyshev}",
        "Messages": f"{consensus.precision}{quiet}, {number(metrics.link_bytes_per_step)} bytes a step on a link",
        "Agents": f"{len(trace.estimates)}, {scenario.agents.motion}",
        "Graph": f"{graph}, {counted(len(trace.edges), 'edge')}",
        "Target": scenario.target.motion,
    }
    right = {
        "Steps": f"{analysis.metrics.steps} of {scenario.length}, {scenario.dt:g} s each",
        "Timing": scenario.timing.mode,
        "Seed": str(scenario.seed),
        "Faults": "; ".join(faults) or "none",
        "Complete": "yes" if trace.complete else "no",
    }
    return left, right


def _fault(fault: Fault) -> str:
    when = f"from {fault.since:g} s" + (" on" if fault.until is None else f" to {fault.until:g} s")
    rest = fault.model_dump(mode="json", by_alias=True, exclude_defaults=True, exclude={"kind", "since", "until"})
    told = (key if value is True else f"{key} {value}" for key, value in rest.items())
    return ", ".join([f"{fault.kind} {when}", *told])


def errors_table(analysis: Analysis) -> Table:
    """Errors of the network, the centralised filter and the bound."""
    metrics = analysis.metrics
    central, bound = metrics.centralized, metrics.bound
    rows = [
        [name, *map(number, (own, other, least, own / other if own and other else None))]
        for name, own, other, least in (
            ("position RMSE (m)", metrics.position_rmse, central.position_rmse, bound.position_rmse),
            ("velocity RMSE (m/s)", metrics.velocity_rmse, central.velocity_rmse, bound.velocity_rmse),
            ("average MSEE at the end (m² + m²/s²)", metrics.msee.average, central.msee, bound.msee),
        )
    ]
    if told := metrics.smoothed:
        own, other = told.position_rmse, told.centralized_position_rmse
        rows.append(["smoothed position RMSE (m)", *map(number, (own, other, None, told.ratio_to_centralized))])
        rows.append(["smoothed velocity RMSE (m/s)", *map(number, (told.velocity_rmse, None, None, None))])
    skipped = counted(analysis.first, "step")
    caption = f"Errors. RMSE, NEES and disagreement leave out the first {skipped}; MSEE starts at step 1."
    caption += " The target moves in a plane: errors are those of x and y alone." if metrics.planar else ""
    strong = metrics.strong
    if strong != central:
        caption += " The centralised filter lost the target itself." if metrics.twin_lost else ""
        caption += f" The strong yardstick reaches {number(strong.position_rmse)} m, and the network's error is "
        caption += f"{number(metrics.ratio_to_strong)} times that."
    if not metrics.scored.steps:
        claimed = ["position error that the covariances claim (m)", number(metrics.claimed_position_error)]
        return Table("Without a truth no error is known", ["", "network"], [claimed])
    return Table(caption, ["", "network", "centralised", "bound", "network / centralised"], rows)


def _honesty(analysis: Analysis) -> Table:
    metrics = analysis.metrics
    rows = [["disagreement of the agents", f"{number(metrics.disagreement)} m"]]
    if metrics.left_out:
        names = agent_names(analysis)
        rows.append(["left out: agents that send wrong values", ", ".join(names[agent] for agent in metrics.left_out)])
    if metrics.unobservable_steps:
        rows.append(["position not determined", spelt(metrics.unobservable_steps)])
    found_in = [("NEES", metrics.nees, why_no_nees), ("NIS", metrics.nis, why_no_nis)]
    if metrics.smoothed:
        found_in.insert(1, ("smoothed NEES", metrics.smoothed.nees, why_no_nees))
    for name, found, why in found_in:
        if found is None:
            rows.append([name, why(analysis.trace)])
            continue
        low, high = found.band
        rows.append([f"{name}, average", f"{number(found.average)}, expected {found.dimension}"])
        inside = "none" if found.inside is None else f"{100.0 * found.inside:.1f} %"
        rows.append([f"{name} inside {low:.3g} to {high:.3g}", f"{inside}, expected 95 %"])
    for name, stood in (metrics.status or {}).items():
        if stood.share:
            said = f"{100.0 * stood.share:.1f} % of the run"
            if metrics.scored.steps:
                said += f", RMSE {number(stood.position_rmse)} m, NEES {number(stood.nees)}"
            rows.append([f"position, while {name}" if metrics.scored.steps else name, said])
    return Table("Consistency and disagreement", [], rows)


def _traffic(analysis: Analysis) -> Table:
    messages = vars(analysis.metrics.messages)
    rows = [[f"messages {name}", f"{count:,}".replace(",", "\u2009")] for name, count in messages.items()]
    return Table("Traffic", [], rows if any(messages.values()) else [["messages", "none logged: a simulated run"]])


def _each_agent(analysis: Analysis) -> Table:
    metrics = analysis.metrics
    columns = {"MSEE at the end": metrics.msee.agents} if metrics.scored.steps else {}
    columns |= {name: found.agents for name, found in (("NEES", metrics.nees), ("NIS", metrics.nis)) if found}
    if bias := metrics.bias:
        columns |= {"bias of ranges (m)": bias.agents, "its std (m)": bias.std, "relied on": bias.weight}
    if metrics.distrust:
        columns["steps of distrust (%)"] = [share and 100.0 * share for share in metrics.distrust.agents]
    if metrics.slow:
        columns["rounds too late by itself (%)"] = [share and 100.0 * share for share in metrics.slow.agents]
    if len(analysis.trace.estimates) > MOST_SHOWN:
        return _of_many(columns)
    rows = zip(agent_names(analysis), *(map(number, values) for values in columns.values()), strict=True)
    return Table("Each agent", ["agent", *columns], list(rows))


def _of_many(columns: Mapping[str, Sequence[float | None]]) -> Table:
    """Percentiles in place of a row for each agent."""
    count = max(map(len, columns.values()), default=0)
    found = [percentiles(np.array(values, dtype=np.float64)) for values in columns.values()]
    rows = [[name, *(number(float(one[name])) for one in found)] for name in PERCENTILES]
    return Table(f"Percentiles of {count} agents", ["agents", *columns], rows)


def _agents(analysis: Analysis) -> list[dict[str, str]]:
    styles = map(agent_style, range(len(analysis.trace.estimates)))
    return [
        {"name": name, "colour": colour, "dashes": _SVG_DASH[dash]}
        for name, (colour, dash) in zip(agent_names(analysis), styles, strict=True)
    ]
