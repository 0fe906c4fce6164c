import base64
import dataclasses
import json
import re
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from zenoh_cbef.analysis.links_table import is_wide, links_table
from zenoh_cbef.analysis.metrics import Analysis, analyze, notes
from zenoh_cbef.analysis.replayed import replayed
from zenoh_cbef.analysis.report import write_report
from zenoh_cbef.analysis.summary import pick
from zenoh_cbef.errors import UserError
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.simulator import simulate
from zenoh_cbef.trace import Trace
from zenoh_cbef.tracking.status import ACQUIRING

VOID = {"meta", "link", "img", "br", "hr", "input", "base"}


class Page(HTMLParser):
    """What a page holds: its attributes, its styles, its visible text, and scripts that carry data."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str, str]] = []
        self.open: list[str] = []
        self.styles, self.data, self.text = "", "", ""
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(tag, name, value or "") for name, value in attrs]
        if tag not in VOID:
            self.open.append("json" if ("type", "application/json") in attrs else tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open
        assert self.open.pop() in {tag, "json"}

    def handle_data(self, data: str) -> None:
        inside = self.open[-1] if self.open else ""
        if inside == "style":
            self.styles += data
        elif inside == "json":
            self.data += data
        elif inside != "script":
            self.text += data

    def plots(self) -> dict[str, dict]:
        return json.loads(self.data)


def trace_of(**scenario: Any) -> Trace:
    return simulate([Scenario(**{"steps": 20, **scenario})])[0]


def page_of(analysis: Analysis, folder: Path) -> Page:
    folder.mkdir(exist_ok=True)
    write_report(analysis, folder / "report.html")
    page = Page((folder / "report.html").read_text(encoding="utf-8"))
    assert page.open == []
    return page


def page_of_run(folder: Path, **scenario: object) -> Page:
    return page_of(analyze([trace_of(**scenario)])[0], folder)


def numbers(packed: dict[str, str]) -> np.ndarray:
    return np.frombuffer(base64.b64decode(packed["bdata"]), packed["dtype"])


def test_the_page_loads_nothing_from_outside(tmp_path: Path) -> None:
    page = page_of_run(tmp_path)

    assert not {"link", "iframe", "img", "object", "embed", "base", "form"} & set(page.tags)
    assert not [each for each in page.attributes if each[1] in {"src", "href", "srcset", "action", "data"}]
    assert "url(" not in page.styles
    assert "@import" not in page.styles
    assert any(value.startswith("default-src 'none'") for _, name, value in page.attributes if name == "content")


def test_the_page_tells_the_metrics(tmp_path: Path) -> None:
    analysis = analyze([trace_of(fault=[{"kind": "loss", "probability": 0.3}])])[0]
    metrics = analysis.metrics

    page = page_of(analysis, tmp_path)

    for name in ("position_rmse", "centralized.velocity_rmse", "bound.msee", "ratio_to_centralized", "nees.average"):
        assert f"{pick(metrics, name):.4g}" in page.text
    assert f"{pick(metrics, 'disagreement'):.4g}" in page.text
    assert "loss from 0 s on, probability 0.3" in page.text
    assert f"{metrics.links[0].lost}" in page.text
    assert 'kind = "sicf"' in page.text
    assert "not complete" not in page.text


def test_the_links_table_separates_what_faults_did_from_what_happened() -> None:
    fault = [{"kind": "loss", "probability": 0.2}, {"kind": "corrupt", "probability": 0.2}]
    links = trace_of(fault=fault).links
    links = dataclasses.replace(links, late=links.injected_late + 3 * (np.arange(len(links.late)) == 0))
    table = links_table(links, "abcdef")
    assert table.heads == [
        "link",
        "sent",
        "delivered",
        "lost by faults",
        "missed deadline",
        "damaged",
        "missed",
        "latency (ms)",
    ]
    found = [links.sent[0], links.delivered[0], links.injected_lost[0], 3, links.corrupted[0]]
    assert table.rows[0][1:6] == [str(one) for one in found]
    assert is_wide(links)
    assert not is_wide(trace_of().links)


def test_every_plot_has_its_place_and_is_valid(tmp_path: Path) -> None:
    graph_objects = pytest.importorskip("plotly.graph_objects")
    fault = [{"kind": "delay", "milliseconds": 90.0, "from": 0.5, "until": 1.0}]
    page = page_of_run(tmp_path, fault=fault, agents={"count": 5, "motion": "formation", "velocity": (1, 0, 0)})

    plots = page.plots()
    places = {value.removeprefix("plot-") for _, name, value in page.attributes if name == "id" and "plot-" in value}
    assert set(plots) == places
    named = {
        "innovation",
        "msee",
        "msee-average",
        "position-error",
        "space",
        "top",
        "nees",
        "nis",
        "disagreement",
        "network",
    }
    assert set(plots) == named
    for plot in plots.values():
        graph_objects.Figure(plot)


def test_the_lines_are_the_run(tmp_path: Path) -> None:
    analysis = analyze([trace_of()])[0]

    msee = page_of(analysis, tmp_path).plots()["msee"]["data"]

    assert np.allclose(numbers(msee[2]["y"]), analysis.msee[2])
    assert np.allclose(numbers(msee[2]["x"]), analysis.trace.time)
    references = {line["name"]: numbers(line["y"]) for line in msee[len(analysis.msee) :]}
    assert np.allclose(references["centralised filter"], analysis.centralized_msee)
    assert np.allclose(references["posterior bound"], analysis.bound_msee)


def test_what_comes_from_the_run_is_escaped(tmp_path: Path) -> None:
    hostile = "</script><script>alert(1)</script><img src=x>"
    trace = trace_of(agents={"count": 3, "labels": [hostile, hostile, "c"]}, network={"graph": "path"})
    events: list[dict[str, object]] = [{"from": hostile, "kind": hostile, "text": hostile, "data": {hostile: hostile}}]
    honest, attacked = tmp_path / "honest", tmp_path / "attacked"

    page = page_of(analyze([dataclasses.replace(trace, name=hostile, events=events)])[0], attacked)

    plain = page_of(analyze([dataclasses.replace(trace, events=[{"text": "ok"}])])[0], honest)
    assert page.tags.count("script") == plain.tags.count("script")
    assert "img" not in page.tags
    assert page.text.count(hostile) > 5
    assert "<" not in page.data
    assert page.plots()["msee"]["data"][0]["name"].startswith("agent &lt;/script&gt;")


def test_events_have_times_since_the_start_and_short_numbers(tmp_path: Path) -> None:
    start = 1_700_000_000
    events = [
        {"from": "agent/1", "kind": "here", "text": "early", "sent": 10**9 * start - 250_000_000, "data": {}},
        {"from": "target", "kind": "started", "text": "go", "sent": 10**9 * start, "data": {"at": float(start)}},
        {"from": "x", "kind": "y", "text": "late", "sent": 10**9 * start + 10**9, "data": {"clock": 0.1 + 0.2}},
    ]
    page = page_of(analyze([dataclasses.replace(trace_of(), events=events)])[0], tmp_path)
    html = (tmp_path / "report.html").read_text(encoding="utf-8")
    times = re.findall(r"<tr><td>(-?[\d.]+)</td><td>(?:agent/1|target|x)</td>", html)
    assert times == ["-0.250", "0.000", "1.000"]
    assert "clock = 300 ms" in page.text
    assert "0.30000000000000004" not in page.text


def test_a_filter_without_covariance_has_a_report_without_nees(tmp_path: Path) -> None:
    page = page_of_run(tmp_path, filter={"kind": "cbef"})

    assert "the filter has no covariance" in page.text
    assert "nees" not in page.plots()
    assert page.plots()["innovation"]["layout"]["yaxis"]["title"]["text"] == "innovation (m²)"


def test_an_agent_that_died_leaves_a_gap_and_a_banner(tmp_path: Path) -> None:
    trace = trace_of()
    for part in (
        trace.estimates,
        trace.covariances,
        trace.diagnostics.innovation,
        trace.diagnostics.weight,
        trace.positions,
    ):
        part[2, 9:] = np.nan

    page = page_of(analyze([dataclasses.replace(trace, complete=False)])[0], tmp_path)

    assert "This run is not complete." in page.text
    error = numbers(page.plots()["position-error"]["data"][2]["y"])
    assert np.isfinite(error[:9]).all()
    assert np.isnan(error[9:]).all()
    diamonds = page.plots()["top"]["data"][-1]
    assert np.isclose(numbers(diamonds["x"])[2], trace.positions[2, 8, 0])


def test_a_planar_run_is_drawn_from_above_only(tmp_path: Path) -> None:
    corners = [(0.0, 0.0, 0.0), (9.0, 0.0, 0.0), (9.0, 9.0, 0.0), (0.0, 9.0, 0.0)]
    scenario = {
        "agents": {"positions": corners},
        "target": {"position": (4, 4, 0)},
        "filter": {"planar_height": 0.0},
    }

    plots = page_of_run(tmp_path, **scenario).plots()

    assert "top" in plots
    assert "space" not in plots


def test_fault_periods_are_shaded(tmp_path: Path) -> None:
    fault = [{"kind": "loss", "probability": 0.5, "from": 0.5, "until": 1.0}]

    layout = page_of_run(tmp_path, fault=fault).plots()["innovation"]["layout"]

    assert [(shape["x0"], shape["x1"]) for shape in layout["shapes"]] == [(0.5, 1.0)]
    assert [note["text"] for note in layout["annotations"]] == ["loss"]


@pytest.mark.slow
def test_a_long_line_is_thinned_and_keeps_its_peak(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # The strong yardstick of so many steps would take seconds, and is not looked at.
    monkeypatch.setattr("zenoh_cbef.analysis.yardsticks.DOUBT", np.inf)
    analysis = analyze([trace_of(steps=2200, agents={"count": 2}, filter={"kind": "local"})])[0]
    analysis.trace.diagnostics.innovation[1, 1777] = 1e6

    shown = numbers(page_of(analysis, tmp_path).plots()["innovation"]["data"][1]["y"])

    assert len(shown) < 2100
    assert np.nanmax(shown) == 1e6


def test_paths_begin_with_the_first_fix_and_the_map_has_the_names_of_the_agents(tmp_path: Path) -> None:
    [analysis] = analyze([trace_of(seed=7, steps=60, agents={"count": 3, "labels": ["north", "south", "east"]})])
    acquiring = analysis.trace.diagnostics.status[0] == ACQUIRING
    assert 0 < acquiring.sum() < 60

    page = page_of(analysis, tmp_path)

    pale, line = page.plots()["top"]["data"][:2]
    assert [one["name"] for one in (pale, line)] == ["agent north"] * 2
    assert pale["opacity"] < line["opacity"] == 1.0
    assert np.isin(analysis.trace.estimates[0, :, 0].astype(np.float32), numbers(pale["x"])).all()
    drawn = np.isin(analysis.trace.estimates[0, :, 0].astype(np.float32), numbers(line["x"]))
    assert not drawn[acquiring].any()
    assert drawn[~acquiring].all()
    central = next(one for one in page.plots()["top"]["data"] if one["name"] == "centralised filter")
    assert len(numbers(central["x"])) == 60
    assert b'"names":["north","south","east"]' in replayed(analysis)


def test_verdicts_faults_and_notes_call_agents_by_their_names() -> None:
    agents = {"count": 4, "labels": ["door", "lamp", "desk", "fan"]}
    on = {"probability": 0.5, "kind": "loss"}
    faults = [
        {"kind": "crash", "agents": [1], "from": 0.5},
        {**on, "links": "agent:2"},
        {**on, "links": [[0, 3]]},
        {**on, "links": {"between": [[0, 1], [2, 3]]}},
    ]

    told = replayed(analyze([trace_of(steps=20, agents=agents, fault=faults)])[0]).decode("utf-8", errors="replace")

    assert "away: agent lamp" in told
    for words in ("crash of agent lamp", "at agent desk", "of door\\u2013fan", "between door, lamp and desk, fan"):
        assert words in told


def test_verdicts_are_about_honest_agents_and_name_the_others() -> None:
    liar = {"kind": "byzantine", "agents": [3], "mode": "drift", "magnitude": 3.0}
    agents = {"count": 4, "labels": ["door", "lamp", "desk", "fan"]}

    told = replayed(analyze([trace_of(steps=40, agents=agents, fault=[liar])])[0]).decode("utf-8", errors="replace")

    assert "left out: agent fan, as of wrong values" in told
    assert "of 3 agents" in told
    assert "of 4 agents" not in told


def test_agents_that_are_too_sure_are_told_in_a_note() -> None:
    sure, honest = (
        notes(analyze([trace_of(steps=60, filter={"kind": kind})], strongest=False)[0].metrics)
        for kind in ("local", "sicf")
    )

    assert any("agents are too sure of themselves: NEES is" in one for one in sure)
    assert honest == []


def test_the_path_of_a_run_that_ends_before_its_first_fix_is_drawn_whole(tmp_path: Path) -> None:
    [analysis] = analyze([trace_of(steps=5)])
    assert (analysis.trace.diagnostics.status == ACQUIRING).all()

    assert np.isfinite(numbers(page_of(analysis, tmp_path).plots()["top"]["data"][0]["x"])).all()


def test_a_single_agent_of_one_step_has_a_report(tmp_path: Path) -> None:
    page = page_of_run(tmp_path, steps=1, agents={"count": 1}, filter={"kind": "local"}, network={"edges": []})

    assert "The agents had no links." in page.text
    assert "disagreement" not in page.plots()


def test_without_plotly_the_error_names_the_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    analysis = analyze([trace_of()])[0]
    monkeypatch.setitem(sys.modules, "plotly.offline", None)

    with pytest.raises(UserError, match=r"pip install 'zenoh-cbef\[report\]'"):
        write_report(analysis, tmp_path / "report.html")
