"""Reports of more agents than lines can be told apart: percentiles, and maps of those nearest to the target."""

from __future__ import annotations

import dataclasses
import json
import re

import numpy as np
import pytest

from zenoh_cbef.analysis.error_charts import error_charts
from zenoh_cbef.analysis.figures import MOST_SHOWN, PERCENTILES, paper_charts, percentiles
from zenoh_cbef.analysis.metrics import Analysis, analyze
from zenoh_cbef.analysis.nearest import nearest
from zenoh_cbef.analysis.plots import network_plot, time_plot
from zenoh_cbef.analysis.printed import drawn
from zenoh_cbef.analysis.replayed import replayed
from zenoh_cbef.analysis.report import write_report
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate

AGENTS = 130


def analysed(agents, *keys):
    given = [f"agents.count={agents}", "network.graph=grid", "steps=8", "consensus.rounds=2", *keys]
    return analyze(simulate([load("tracking", given).scenario]))[0]


def agents_of(part):
    assert part.trace.agents is not None
    return part.trace.agents


@pytest.fixture(scope="module")
def large():
    return analysed(AGENTS, "filter.lag_seconds=0.2", "agents.high=30.0", "target.position=[5.0, 5.0, 5.0]")


def test_percentiles_are_values_of_agents_that_have_one():
    values = np.random.default_rng(1).permutation(101.0 * np.arange(101))[:, None] + np.array([0.0, 7.0])
    without = np.concatenate([values, np.full((4, 2), np.nan)])
    found = percentiles(without)
    assert list(found) == list(PERCENTILES)
    for name, (share, _) in PERCENTILES.items():
        assert found[name].tolist() == [101.0 * 100 * share, 101.0 * 100 * share + 7.0]
    assert np.isnan(percentiles(np.full((3, 2), np.nan))["median"]).all()


def test_charts_of_many_agents_have_percentiles_in_place_of_a_line_each(large):
    charts = [*paper_charts(large), *error_charts(large)]
    [position] = [one for one in charts if one.name == "position-error"]
    lines = time_plot(position, large)["data"]
    names = [one["name"] for one in lines]
    assert names[: len(PERCENTILES)] == list(PERCENTILES)
    assert not any("legendgroup" in one for one in lines)
    values = {one.name: one.values for one in position.references}
    assert np.array_equal(values["largest"], np.nanmax(large.position_error, axis=0))
    assert np.array_equal(values["least"], np.nanmin(large.position_error, axis=0))
    assert all(one.agents is None for one in charts)


def test_few_agents_have_a_line_and_a_row_each_and_are_all_on_maps():
    few = analysed(MOST_SHOWN)
    assert nearest(few) is few
    assert [len(one.agents) for one in paper_charts(few) if one.agents is not None] == [MOST_SHOWN] * 2


def test_maps_show_the_agents_nearest_to_the_target_and_the_links_between_them(large):
    near = nearest(large)
    target = large.trace.truth[4, :3]
    away = np.linalg.norm(large.trace.positions[:, 4] - target, axis=1)
    agents = agents_of(near)
    assert sorted(agents) == sorted(np.argsort(away)[:MOST_SHOWN])
    assert np.array_equal(near.trace.estimates, large.trace.estimates[agents])
    assert np.array_equal(near.position_error, large.position_error[agents])
    links = set(zip(large.trace.links.source.tolist(), large.trace.links.destination.tolist(), strict=True))
    between = {(first, second) for first, second in links if {first, second} <= set(agents.tolist())}
    shown = near.trace.links
    assert {*zip(agents[shown.source].tolist(), agents[shown.destination].tolist(), strict=True)} == between
    assert {tuple(sorted(pair)) for pair in between} == {*map(tuple, agents[near.trace.edges].tolist())}
    assert near.metrics is large.metrics
    assert len(network_plot(near)["data"][-1]["text"]) == MOST_SHOWN


def test_a_report_of_many_agents_is_of_a_hundred_and_percentiles(large, tmp_path):
    write_report(large, tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert text.count('data-group="agent-') == MOST_SHOWN
    assert (
        f"Maps show the {MOST_SHOWN} agents nearest to the target and the links between them, out of {AGENTS}" in text
    )
    table = text[text.index(f"Percentiles of {AGENTS} agents<") :]
    table = table[: table.index("</table>")]
    assert re.findall(r"<tr><t[dh][^>]*>([^<]*)</t", table)[-len(PERCENTILES) :] == list(PERCENTILES)


def test_the_map_is_of_a_hundred_agents_and_its_words_are_of_all(large):
    scene = replayed(large)
    told = json.loads(scene[4 : 4 + int.from_bytes(scene[:4], "little")])
    assert told["names"] == [str(agent) for agent in agents_of(nearest(large))]
    assert dict(told["arrays"])["estimate"] == [8, MOST_SHOWN, 3]
    assert all(f" of {AGENTS} agents" in words for _, words in told["verdicts"])


def test_percentiles_are_drawn_on_paper_by_name(large):
    [chart] = [one for one in paper_charts(large) if one.name == "msee"]
    labels = [line.get_label() for line in drawn(time_plot(chart, large)).axes[0].lines]
    assert labels[: len(PERCENTILES)] == list(PERCENTILES)


def test_where_the_truth_is_unknown_maps_show_the_middle_of_the_network(large):
    trace = dataclasses.replace(large.trace, truth=np.full_like(large.trace.truth, np.nan))
    near: Analysis = nearest(dataclasses.replace(large, trace=trace))
    middle = large.trace.positions[:, 4].mean(axis=0)
    away = np.linalg.norm(large.trace.positions[:, 4] - middle, axis=1)
    assert agents_of(near).tolist() == sorted(np.argsort(away)[:MOST_SHOWN].tolist())
