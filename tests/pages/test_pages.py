"""All pages: one stylesheet, light and dark, as wide as a phone, nothing from outside, and what users name is text."""

import dataclasses
import re
from html.parser import HTMLParser
from importlib.resources import files

import pytest

from zenoh_cbef.analysis.compare import write_comparison
from zenoh_cbef.analysis.figures import COLOURS
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.analysis.report import write_report
from zenoh_cbef.analysis.timeline import write_timeline
from zenoh_cbef.experiment.cells import cells_of
from zenoh_cbef.experiment.engines import simulated
from zenoh_cbef.experiment.file import read_experiment
from zenoh_cbef.experiment.page import write_outputs
from zenoh_cbef.experiment.results import Outcome
from zenoh_cbef.experiment.summary import summarize
from zenoh_cbef.experiment.table import rows_of
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.simulator import simulate
from zenoh_cbef.trace import Exchange, Passage

STYLE = files("zenoh_cbef.pages").joinpath("style.css").read_text(encoding="utf-8")
HOSTILE = '</title></script><script>alert("1")</script><img src=x>'
KINDS = ("report", "comparison", "timeline", "index", "figures/position-rmse")
EXPERIMENT = f"""
# A purpose {HOSTILE}
base = "tracking"
seeds = 2
engine = "simulate"
[set]
steps = 6
"agents.count" = 2
[[vary]]
key = "agents.labels"
values = [['{HOSTILE}', "b"], ["c", "d"]]
[[expect]]
metric = "position_rmse"
at_most = 1.0
"""


class Tags(HTMLParser):
    """The tags of a page with their attributes, and its visible text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        if self.tags and self.tags[-1][0] not in {"script", "style"}:
            self.text += data


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """One page of each kind, with names and words that would be tags."""
    pytest.importorskip("plotly")
    folder = tmp_path_factory.mktemp("pages")
    agents = {"count": 2, "labels": [HOSTILE, "b"]}
    said = {"steps": 6, "agents": agents, "network": {"graph": "path"}}
    trace = simulate([Scenario.model_validate(said)])[0]
    events: list[dict[str, object]] = [{"from": HOSTILE, "kind": HOSTILE, "text": HOSTILE, "data": {HOSTILE: HOSTILE}}]
    analysis = analyze([dataclasses.replace(trace, name=HOSTILE, events=events)])[0]
    write_report(analysis, folder / "report.html")
    write_comparison([analysis, analysis], [HOSTILE, "b"], folder / "comparison.html")
    drawn = Exchange(
        name=HOSTILE,
        labels=(HOSTILE, "b"),
        dt=0.1,
        since=1.0,
        until=2.0,
        passages=[Passage(0, 1, 4, 1, 1.2, 1.4, "in time")],
        rounds=[(4, 0, 1.0)],
        estimates=[(0, 4, 1.5)],
        events=[(HOSTILE, 1.4, HOSTILE)],
        notes=[HOSTILE],
    )
    write_timeline(drawn, folder / "timeline.html")
    (folder / "sweep.toml").write_text(EXPERIMENT)
    written = read_experiment(str(folder / "sweep.toml"), {})
    cells = cells_of(written)
    outcomes = [simulated(cell.scenario, [1], 0.25) for cell in cells if cell.scenario is not None]
    assert len(outcomes) == len(cells)
    outcomes[0].append(Outcome(2, error=HOSTILE))
    write_outputs(summarize(written, cells, outcomes), rows_of(cells, outcomes), written.source, folder)
    return {kind: (folder / f"{kind}.html").read_text(encoding="utf-8") for kind in KINDS}


@pytest.mark.parametrize("kind", KINDS)
def test_a_page_has_the_one_stylesheet_and_the_width_of_the_screen(pages, kind):
    page = pages[kind]
    assert re.findall(r"<style>\n(.*?)</style>", page, re.DOTALL) == [STYLE.rstrip("\n")]
    assert '<meta name="viewport" content="width=device-width, initial-scale=1">' in page
    assert not re.search(r"<[a-z]+ [^>]*style=", page[page.index("<main") : page.index("</main>")])


@pytest.mark.parametrize("kind", KINDS)
def test_a_page_fetches_nothing_from_outside(pages, kind):
    tags = Tags(pages[kind]).tags
    policies = [each["content"] for _, each in tags if each.get("http-equiv") == "Content-Security-Policy"]
    assert len(policies) == 1
    assert str(policies[0]).startswith("default-src 'none'")
    fetched = [each[name] for _, each in tags for name in ("src", "href", "srcset", "action") if name in each]
    assert fetched == (["plotly.min.js"] if kind.startswith("figures") else [])


@pytest.mark.parametrize("kind", KINDS)
def test_what_users_name_is_text(pages, kind):
    page = Tags(pages[kind])
    assert "img" not in {tag for tag, _ in page.tags}
    assert sum(tag == "script" for tag, _ in page.tags) == {"timeline": 0, "report": 5}.get(kind, 3)
    if not kind.startswith("figures"):
        assert HOSTILE in page.text


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "timeline"])
def test_plots_are_drawn_in_the_colours_of_the_page(pages, kind):
    data = re.findall(r'<script type="application/json" id="plots">(.*?)</script>', pages[kind], re.DOTALL)[0]
    assert "<" not in data
    assert '"template"' not in data
    assert "Plotly.react(" in pages[kind]
    places = set(re.findall(r'id="plot-([^"]+)"', pages[kind]))
    assert places
    assert all(f'"{name}":' in data for name in places)


def colours(block: str) -> dict[str, str]:
    return dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6});", block))


def contrast(first: str, second: str) -> float:
    """The ratio of luminances of WCAG 2.2."""
    light = []
    for colour in (first, second):
        parts = [int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5)]
        linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
        light.append(0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2])
    return (max(light) + 0.05) / (min(light) + 0.05)


def test_every_colour_has_one_for_the_dark_and_stands_in_one_place():
    light, dark = re.split(r"@media \(prefers-color-scheme: dark\)", STYLE.partition("/* Text. */")[0])
    assert colours(light).keys() == colours(dark).keys()
    assert colours(light) != colours(dark)
    assert set(re.findall(r"#[0-9a-f]{3,8}\b(?! ?\{)", STYLE)) == {*colours(light).values(), *colours(dark).values()}
    assert set(re.findall(r"var\(--([\w-]+)\)", STYLE)) <= colours(light).keys()
    for scheme in (colours(light), colours(dark)):
        for name in ("ink", "muted", "alarm", "accent", "good", "doubt"):
            assert contrast(scheme[name], scheme["paper"]) >= 4.5, name
        for name in ("time", "twice", "late", "lost", "damaged", "missed"):
            assert contrast(scheme[name], scheme["paper"]) >= 3.0, name


def test_a_picture_by_itself_is_dark_where_its_reader_is(tmp_path):
    empty = Exchange("a", ("0",), 0.1, 0.0, 1.0, [], [], [], [], [])
    write_timeline(empty, tmp_path / "a.svg")
    picture = (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert STYLE.rstrip("\n") in picture


def test_an_agent_has_one_colour_on_maps_and_in_figures():
    text = files("zenoh_cbef.pages").joinpath("scene", "colours.js").read_text(encoding="utf-8")
    assert tuple(re.findall(r"#[0-9A-F]{6}", text)) == COLOURS
