"""One run as one HTML file that opens anywhere, offline: tables, the paper's figures, maps, the scenario."""

from __future__ import annotations

import json
from collections.abc import Mapping
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import tomli_w

from zenoh_cbef.analysis.coverage import spelt, why_no_nees, why_no_nis
from zenoh_cbef.analysis.error_charts import error_charts
from zenoh_cbef.analysis.figures import Chart, agent_names, agent_style, paper_charts
from zenoh_cbef.analysis.html_parts import NOTHING, counted, definitions, number, ratio, table
from zenoh_cbef.analysis.links_table import is_wide, links_table
from zenoh_cbef.analysis.metrics import Analysis
from zenoh_cbef.analysis.metrics import notes as noted
from zenoh_cbef.analysis.plots import Plot, network_plot, space_plot, time_plot, top_plot
from zenoh_cbef.extras import from_extra
from zenoh_cbef.numbers import written
from zenoh_cbef.trace import began

_MOST_ROWS = 200
_ENVELOPE = ("v", "run", "seq", "sent", "from", "kind", "text", "data")
_SVG_DASH = {"solid": "", "dash": "6 3", "dot": "2 2", "dashdot": "6 2 1.5 2"}


def write_report(analysis: Analysis, path: Path) -> None:
    """Write a run's report, with plotly.js inside. Raises MissingExtra where plotly is not installed."""
    plotly = from_extra("plotly.offline", "the report")
    trace = analysis.trace
    plots: dict[str, Plot] = {}
    scenario = trace.scenario.model_dump(mode="json", by_alias=True, exclude_none=True)
    sections = _sections(analysis, plots)
    page = Template(files(__package__).joinpath("report.html").read_text(encoding="utf-8"))
    text = page.substitute(
        name=escape(trace.name),
        lead=_lead(analysis),
        banner=_banner(analysis),
        facts=_facts(analysis),
        summary=_summary(analysis),
        agents=_agents(analysis),
        sections=sections,
        scenario=escape(tomli_w.dumps(scenario)),
        # A "<" could end the script element that carries the data.
        plots=json.dumps(plots, separators=(",", ":")).replace("<", "\\u003c"),
        plotly=plotly.get_plotlyjs(),
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def _sections(analysis: Analysis, plots: dict[str, Plot]) -> str:
    """Write the page below the summary; the plots it has places for are put into `plots`."""
    innovation, msee, average = paper_charts(analysis)
    position, nees, nis, disagreement = error_charts(analysis)

    def timed(chart: Chart) -> str:
        if chart.empty:
            return f'<h3>{chart.title}</h3><p class="note">{chart.caption} This run has none.</p>'
        return _figure(plots, chart.name, chart.title, chart.caption, time_plot(chart, analysis))

    return "\n".join(
        [
            "<h2>The paper's figures</h2>",
            *map(timed, (innovation, msee, average)),
            "<h2>Tracking</h2>",
            timed(position),
            _maps(analysis, plots),
            "<h2>Honesty and agreement</h2>",
            timed(nees),
            timed(nis),
            timed(disagreement),
            "<h2>Network</h2>",
            _network(analysis, plots),
            _events(analysis),
        ]
    )


def _figure(plots: dict[str, Plot], name: str, title: str, caption: str, plot: Plot) -> str:
    plots[name] = plot
    place = f'<div class="plot" id="plot-{name}"></div>'
    return f"<figure><h3>{title}</h3><figcaption>{caption}</figcaption>{place}</figure>"


def _maps(analysis: Analysis, plots: dict[str, Plot]) -> str:
    caption = "Diamonds: agents, where they ended; dotted: their way. Estimates in the agents' colours."
    above = _figure(plots, "top", "Seen from above", caption, top_plot(analysis))
    if analysis.trace.scenario.filter.planar_height is not None:
        return above
    caption = "Drag to turn, scroll to zoom. Estimates far from everything else are cut off."
    space = _figure(plots, "space", "Trajectory", caption, space_plot(analysis))
    return f'<div class="pair">{space}{above}</div>'


def _network(analysis: Analysis, plots: dict[str, Plot]) -> str:
    links, names = analysis.trace.links, agent_names(analysis)
    if not len(links.source):
        return '<p class="note">The agents had no links.</p>'
    told = "Wider and redder: more messages lost or late. Point at an arrow for its counts."
    drawing = _figure(plots, "network", "Links", told, network_plot(analysis))
    listed = f'<div class="scroll">{links_table(links, names)}</div>'
    return drawing + listed if is_wide(links) else f'<div class="pair">{drawing}{listed}</div>'


def _events(analysis: Analysis) -> str:
    events = analysis.trace.events
    if not events:
        return ""
    rows = []
    start = began(events)
    for event in events[:_MOST_ROWS]:
        data = event.get("data")
        rest = {key: value for key, value in event.items() if key not in _ENVELOPE}
        rest |= data if isinstance(data, dict) else {}
        details = ", ".join(f"{key} = {written(value)}" for key, value in rest.items())
        words = [str(event.get(key, NOTHING)) for key in ("from", "kind", "text")]
        rows.append([_when(event, start), *words, details[:400]])
    caption = "What the processes reported, in order, s after the start by their clocks"
    if len(events) > _MOST_ROWS:
        caption += f"; the first {_MOST_ROWS} of {len(events)}"
    shown = table(caption, ["time (s)", "from", "kind", "text", "data"], rows)
    return f'<h2>Events</h2><div class="words scroll">{shown}</div>'


def _when(event: Mapping[str, object], start: float | None) -> str:
    sent = event.get("sent")
    return f"{1e-9 * sent - start:.3f}" if isinstance(sent, int) and start is not None else NOTHING


def _lead(analysis: Analysis) -> str:
    scenario, steps = analysis.trace.scenario, analysis.metrics["steps"]
    return (
        f"{counted(len(analysis.trace.estimates), 'agent')} tracking one target with "
        f"{escape(scenario.filter.kind)}, {counted(steps, 'step')} of {scenario.dt:g} s."
    )


def _banner(analysis: Analysis) -> str:
    trace, metrics = analysis.trace, analysis.metrics
    notes = "".join(f'<p class="note">{escape(said[0].upper() + said[1:])}.</p>' for said in noted(metrics))
    if trace.complete:
        return notes
    steps = f"{metrics['steps']} of {trace.scenario.length} steps"
    return (
        '<p class="alarm" role="alert"><strong>This run is not complete.</strong> It did not end as planned, its log '
        f"was not closed, or messages are not in it. All below is about what was recorded: {steps}.</p>{notes}"
    )


def _facts(analysis: Analysis) -> str:
    trace, scenario = analysis.trace, analysis.trace.scenario
    consensus, network = scenario.consensus, scenario.network
    graph = "given edges" if network.edges is not None else network.graph
    chebyshev = ", Chebyshev" if consensus.acceleration == "chebyshev" else ""
    how = "running sums" if trace.plan.sums else f"{consensus.weights} weights"
    faults = [_fault(fault.model_dump(mode="json", by_alias=True, exclude_defaults=True)) for fault in scenario.fault]
    left = {
        "Filter": f"{scenario.filter.kind}, ξ = {scenario.filter.xi:g}",
        "Consensus": f"{counted(consensus.rounds, 'round')}, {how}{chebyshev}",
        "Agents": f"{len(trace.estimates)}, {scenario.agents.motion}",
        "Graph": f"{graph}, {counted(len(trace.edges), 'edge')}",
        "Target": scenario.target.motion,
    }
    right = {
        "Steps": f"{analysis.metrics['steps']} of {scenario.length}, {scenario.dt:g} s each",
        "Timing": scenario.timing.mode,
        "Seed": str(scenario.seed),
        "Faults": "; ".join(faults) or "none",
        "Complete": "yes" if trace.complete else "no",
    }
    return f'<div class="pair">{definitions(left)}{definitions(right)}</div>'


def _fault(fault: dict[str, Any]) -> str:
    since, until = fault.pop("from", 0.0), fault.pop("until", None)
    when = f"from {since:g} s" + (" on" if until is None else f" to {until:g} s")
    return ", ".join([f"{fault.pop('kind')} {when}", *(f"{key} {value}" for key, value in fault.items())])


def _summary(analysis: Analysis) -> str:
    metrics = analysis.metrics
    central, bound = metrics["centralized"], metrics["bound"]
    errors = [
        [name, *(number(value) for value in (own, central[key], bound[key], ratio(own, central[key])))]
        for name, key, own in (
            ("position RMSE (m)", "position_rmse", metrics["position_rmse"]),
            ("velocity RMSE (m/s)", "velocity_rmse", metrics["velocity_rmse"]),
            ("average MSEE at the end (m² + m²/s²)", "msee", metrics["msee"]["average"]),
        )
    ]
    skipped = counted(analysis.first, "step")
    caption = f"Errors. RMSE, NEES and disagreement leave out the first {skipped}; MSEE starts at step 1."
    caption += " The target moves in a plane: errors are those of x and y alone." if metrics["planar"] else ""
    heads = ["", "network", "centralised", "bound", "network / centralised"]
    messages = metrics["messages"]
    rows = [["disagreement of the agents", f"{number(metrics['disagreement'])} m"]]
    if metrics["left_out"]:
        rows.append(["left out: agents that send wrong values", ", ".join(map(str, metrics["left_out"]))])
    if metrics["unobservable_steps"]:
        rows.append(["position not determined", spelt(metrics["unobservable_steps"])])
    for name, found in (("NEES", metrics["nees"]), ("NIS", metrics["nis"])):
        if found is None:
            rows.append([name, (why_no_nees if name == "NEES" else why_no_nis)(analysis.trace)])
            continue
        low, high = found["band"]
        rows.append([f"{name}, average", f"{number(found['average'])}, expected {found['dimension']}"])
        rows.append([f"{name} inside {low:.3g} to {high:.3g}", f"{_percent(found['inside'])}, expected 95 %"])
    traffic = [[f"messages {key}", f"{count:,}".replace(",", "\u2009")] for key, count in messages.items()]
    if not any(messages.values()):
        traffic = [["messages", "none logged: a simulated run"]]
    tables = table("Honesty and agreement", [], rows) + table("Traffic", [], traffic)
    return f'{table(caption, heads, errors)}<div class="pair">{tables}</div>{_each_agent(analysis)}'


def _percent(share: float | None) -> str:
    return "none" if share is None else f"{100.0 * share:.1f} %"


def _each_agent(analysis: Analysis) -> str:
    metrics = analysis.metrics
    columns = {"MSEE at the end": metrics["msee"]["agents"]}
    columns |= {name: found["agents"] for name in ("NEES", "NIS") if (found := metrics[name.lower()]) is not None}
    if (bias := metrics["bias"]) is not None:
        columns |= {"bias of ranges (m)": bias["agents"], "its std (m)": bias["std"], "relied on": bias["weight"]}
    if (distrust := metrics["distrust"]) is not None:
        columns["steps of distrust (%)"] = [share and 100.0 * share for share in distrust["agents"]]
    if (slow := metrics["slow"]) is not None:
        columns["rounds too late by itself (%)"] = [share and 100.0 * share for share in slow["agents"]]
    rows = zip(agent_names(analysis), *(map(number, values) for values in columns.values()), strict=True)
    return f'<div class="scroll">{table("Each agent", ["agent", *columns], list(rows))}</div>'


def _agents(analysis: Analysis) -> str:
    buttons = []
    for agent, name in enumerate(agent_names(analysis)):
        colour, dash = agent_style(agent)
        stroke = f'stroke="{colour}" stroke-width="3" stroke-dasharray="{_SVG_DASH[dash]}"'
        swatch = f'<svg width="22" height="10" aria-hidden="true"><path d="M0 5H22" {stroke}/></svg>'
        state = f'type="button" aria-pressed="true" data-group="agent-{agent}"'
        buttons.append(f"<button {state}>{swatch}{escape(name)}</button>")
    return "".join(buttons)
