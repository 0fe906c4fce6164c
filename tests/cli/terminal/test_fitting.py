"""No table cuts a number or the name of a row, however narrow the terminal is."""

import functools
import io
import re
from dataclasses import replace
from functools import cache
from typing import Any

import pytest
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from zenoh_cbef.analysis.compare import row
from zenoh_cbef.analysis.design import design
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.analysis.results import Distrust
from zenoh_cbef.analysis.summary import summarize
from zenoh_cbef.cli import compare, watch
from zenoh_cbef.cli.terminal.design import design_lines
from zenoh_cbef.cli.terminal.fitting import Fitting, Told
from zenoh_cbef.cli.terminal.results import metrics_table, summary_table
from zenoh_cbef.cli.terminal.status import agents_table, headline, links_table
from zenoh_cbef.outside.status import AgentStatus, LinkStatus, RunStatus, Whereabouts
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate

LOSSY = ["steps=12", 'fault=[{kind="loss", probability=0.3}]']
NOWHERE = Whereabouts()


def status(target: Whereabouts = NOWHERE) -> RunStatus:
    where = Whereabouts("a-host-with-a-long-name.example.org", 1234567, "0.1.0", "1.10.0", -0.001234567, 0.0002)
    agents = [AgentStatus(one, "paused", where, 299, 0.123456 * one, 0.2, 0.98, 1) for one in range(6)]
    links = [LinkStatus(one, (one + 1) % 6, 123456, 7891, 12, 0.0123) for one in range(6)]
    told: dict[str, Any] = {
        "error": 0.1,
        "disagreement": 0.002,
        "target": target,
        "recorder": NOWHERE,
        "faults": [],
        "events": [],
    }
    times: dict[str, Any] = {"step": 299, "steps": 300, "dt": 0.1, "time": 29.9, "now": 1e9}
    return RunStatus("mine", "sicf", "realtime", "running", agents=agents, links=links, **told, **times)


@functools.cache
@cache
def tables() -> dict[str, Fitting]:
    traces = simulate([load("tracking", [*LOSSY, f"seed={seed}"]).scenario for seed in (1, 2)])
    analyses = analyze(traces)
    told = design(load("tracking", ["steps=30"]).plan, within=0.01, skip=0.25)
    designs = [part for part in design_lines(told) if isinstance(part, Fitting)]
    rows = [row(one, f"tracking-with-a-long-name-{number}") for number, one in enumerate(analyses)]
    return {
        "metrics": metrics_table(analyses[0].metrics),
        "summary": summary_table(summarize([one.metrics for one in analyses])),
        "compare": compare.runs_table(rows),
        "agents": agents_table(status()),
        "agents, brief": agents_table(status(), brief=True),
        "links": links_table(status()),
    } | {f"design {number}": one for number, one in enumerate(designs)}


def drawn(fitting: Fitting, width: int) -> list[str]:
    text = io.StringIO()
    screen = Console(file=text, width=width, color_system=None)
    screen.print(fitting)
    lines = [line.rstrip() for line in text.getvalue().splitlines()]
    assert all(len(line) <= width for line in lines)
    return lines


def words(cell: object) -> list[str]:
    return (cell.plain if isinstance(cell, Text) else Text.from_markup(str(cell)).plain).split()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["metrics", "summary", "compare", "agents", "agents, brief", "links", "design 0"])
def test_every_number_and_every_name_is_whole_at_any_width(name):
    fitting = tables()[name]
    names, *others = [list(column.cells) for column in fitting.table.columns]
    wanted = {word for column in (names, *others) for cell in column for word in words(cell)}
    # Every width where it turns from one layout to another, elsewhere every fifth one.
    measure = Console(width=1000)
    widest = Measurement.get(measure, measure.options, fitting.table).maximum
    turns = range(widest - 2 * len(fitting.table.columns) - 3, widest + 3)
    for width in sorted({*range(40, 201, 5), *turns} & {*range(40, 201)}):
        lines = drawn(fitting, width)
        lines = [re.sub("[│┃]", " ", line) for line in lines]
        seen = {word.strip(";") for line in lines for word in line.split()}
        assert {word.strip(";") for word in wanted} <= seen, width
        for cell in names:
            assert any(" ".join(words(cell)) in " ".join(line.split()) for line in lines), (cell, width)
        assert not any("…" in line for line in lines)


def test_what_the_headline_says_of_the_target_is_not_said_again_of_every_agent():
    away = status()
    at_home = status(away.agents[0].where)
    heads = [[str(column.header) for column in agents_table(one).table.columns] for one in (away, at_home)]
    assert [head for head in heads[0] if head not in heads[1]] == ["host", "version"]
    lines = drawn(agents_table(at_home), 80)
    assert len(lines) == 1 + len(at_home.agents), "a line each, at eighty columns"
    assert "1234567" in lines[1]


def test_of_many_agents_the_worst_are_shown_and_others_are_found():
    one = status()
    states = {17: "gone", 250: "silent", 90: "on"}
    agents = [
        replace(one.agents[0], agent=agent, state=states.get(agent, "ready"), error=float(agent == 90), estimate=None)
        for agent in range(300)
    ]
    many = replace(one, agents=agents)
    lines = drawn(agents_table(many), 200)
    assert len(lines) == 1 + 10 + 1
    assert [line.split()[0] for line in lines[1:4]] == ["17", "250", "90"]
    assert "the worst of 300 agents" in lines[-1]
    for find, ids in (("3-5,200", ["3", "4", "5", "200"]), ("silent", ["250"])):
        assert [line.split()[0] for line in drawn(agents_table(many, find=find), 200)[1:]] == ids
    assert "not here: agent 17" in headline(many).plain


def test_a_table_that_lacks_a_little_room_keeps_a_blank_before_each_line():
    table = Table()
    table.add_column("name")
    table.add_column("value")
    table.add_row("a name", "a value")
    for width, line in (
        (20, "│ a name │ a value │"),
        (19, "│a name │a value │"),
        (18, "│a name │a value │"),
        (17, "│a name│a value│"),
        (15, "name a name"),
    ):
        assert line in drawn(Fitting(table), width), width


def test_a_small_terminal_shows_agents_before_curves(monkeypatch):
    text = io.StringIO()
    for width, height, curves in ((40, 15, False), (80, 24, True)):
        monkeypatch.setattr(watch, "console", screen := Console(file=text, width=width, height=height))
        screen.print(watch.Screen().take(status()), height=height)
        seen = text.getvalue()
        text.truncate(text.seek(0))
        assert "paused" in seen
        assert ("position error, m" in seen) == curves
        assert len(seen.splitlines()) <= height


def test_shares_of_distrust_are_whole_sentences():
    found = analyze(simulate([load("tracking", ["steps=12"]).scenario]))[0].metrics
    for agents, said in (
        ([0.001, 0.25, 0.0], "1: 25% of the steps and 0: under 1%"),
        ([0.0, 0.001, 0.0], "1: under 1% of the steps"),
        ([0.0, 0.0, 0.0], "none"),
    ):
        lines = drawn(metrics_table(replace(found, distrust=Distrust([*agents], [None] * 3, [None] * 3))), 60)
        assert any(line.endswith(f"network: {said}") for line in lines)
        assert not any("; of the steps" in line for line in lines)


def test_what_fits_is_a_table_with_its_title_and_caption():
    table = Table(title="a title", caption="a caption", title_justify="left")
    table.add_column("name")
    table.add_column("value", justify="right")
    table.add_row("first", "1.5")
    lines = drawn(Fitting(table), 40)
    assert lines[0] == "a title"
    assert lines[-1] == "a caption"
    assert any("│ first │   1.5 │" in line for line in lines)
    assert any("│first│  1.5│" in line for line in drawn(Fitting(table), 14))
    assert drawn(Fitting(table), 12) == ["a title", "name first", "  value: 1.5", "a caption"]


def test_a_cell_that_says_what_it_is_of_needs_no_head_below_its_name():
    table = Table()
    for head in ("", "network", "centralised"):
        table.add_column(head)
    table.add_row("error", "1.5 m", "1.4 m")
    table.add_row("on links", Told("660 sent"), Told("12 lost"))
    lines = drawn(Fitting(table), 24)
    assert lines[-1] == "  660 sent; 12 lost"
    assert "network: 1.5 m" in " ".join(lines)
