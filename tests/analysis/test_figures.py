import dataclasses
import struct
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure

from zenoh_cbef.analysis import typeset
from zenoh_cbef.analysis.figures import Chart, agent_style, has_lone_points, log_range, paper_charts, thinned
from zenoh_cbef.analysis.metrics import Analysis, analyze
from zenoh_cbef.analysis.plots import time_plot, top_plot
from zenoh_cbef.analysis.printed import drawn
from zenoh_cbef.analysis.typeset import write_figures
from zenoh_cbef.errors import UserError
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.simulator import simulate


def analysis_of(**scenario: Any) -> Analysis:
    return analyze(simulate([Scenario(**{"steps": 12, **scenario})]))[0]


@pytest.fixture(scope="module")
def analysis() -> Analysis:
    return analysis_of()


@pytest.fixture(scope="module")
def written(analysis: Analysis, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return write_figures(analysis, tmp_path_factory.mktemp("run") / "figures")


@pytest.fixture
def sketched(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are drawn once and not written, where a test looks at no file."""

    def sketch(figure: Figure, path: Path, kind: str, _: str) -> Path:
        if kind == "svg":
            figure.draw_without_rendering()
        return path

    monkeypatch.setattr(typeset, "save", sketch)


@pytest.mark.slow
def test_three_figures_are_written_as_png_of_one_column_and_as_svg(written: list[Path]) -> None:
    names = ("innovation", "msee", "msee-average")
    assert [path.name for path in written] == [f"{name}{end}" for name in names for end in (".png", ".svg")]
    for path in written:
        if path.suffix == ".png":
            content = path.read_bytes()
            assert content[:8] == b"\x89PNG\r\n\x1a\n"
            assert struct.unpack(">I", content[16:20]) == (1050,)
        else:
            drawing = ET.parse(path).getroot()
            assert drawing.tag == "{http://www.w3.org/2000/svg}svg"
            assert drawing.get("width") == "252pt"


@pytest.mark.slow
def test_the_same_run_gives_the_same_files(written: list[Path], analysis: Analysis, tmp_path: Path) -> None:
    again = write_figures(analysis, tmp_path)

    assert [path.read_bytes() for path in again] == [path.read_bytes() for path in written]


@pytest.mark.slow
@pytest.mark.usefixtures("sketched")
def test_figures_take_any_filter_and_size_and_labels_with_dollar_signs_are_no_formulas(tmp_path: Path) -> None:
    labels = [r"$\nonsense$", "_", *map(str, range(22))]

    assert (
        len(write_figures(analysis_of(filter={"kind": "cbef"}, agents={"count": 24, "labels": labels}), tmp_path)) == 6
    )


@pytest.mark.slow
@pytest.mark.usefixtures("sketched")
def test_a_run_without_any_value_still_gives_figures(analysis: Analysis, tmp_path: Path) -> None:
    nothing = np.full_like(analysis.msee, np.nan)
    diagnostics = dataclasses.replace(analysis.trace.diagnostics, innovation=nothing)
    silent = dataclasses.replace(
        analysis, trace=dataclasses.replace(analysis.trace, diagnostics=diagnostics), msee=nothing
    )

    assert len(write_figures(silent, tmp_path)) == 6


@pytest.mark.usefixtures("sketched")
def test_without_a_truth_the_claimed_error_takes_the_place_of_the_msee(tmp_path: Path) -> None:
    [trace] = simulate([Scenario(steps=12)])
    unknown = dataclasses.replace(trace, truth=np.full_like(trace.truth, np.nan))
    written = write_figures(analyze([unknown])[0], tmp_path)

    assert {path.stem for path in written} == {"innovation", "position-error"}


def test_a_legend_of_long_names_stays_inside_of_the_figure() -> None:
    names = [f"the anchor behind the {what}" for what in ("door", "window", "shelf", "lamp", "desk", "fan")]
    figure = drawn(time_plot(paper_charts(found := analysis_of(agents={"count": 6, "labels": names}))[1], found))
    figure.draw_without_rendering()
    [legend] = figure.legends

    assert legend.get_window_extent().x0 >= 0.0
    assert legend.get_window_extent().x1 <= figure.bbox.width


def test_without_matplotlib_the_error_names_the_remedy(
    analysis: Analysis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)

    with pytest.raises(UserError, match=r"pip install 'zenoh-cbef\[report\]'"):
        write_figures(analysis, tmp_path)


def test_thinning_keeps_the_extremes_the_ends_and_gaps() -> None:
    values = np.sin(np.linspace(0.0, 60.0, 10_000))
    values[1234], values[8765] = 50.0, -50.0
    values[5000] = np.nan

    kept = thinned(values, 600)

    assert len(kept) <= 610
    assert {0, 1234, 5000, 8765, 9999} <= set(kept.tolist())
    assert np.all(np.diff(kept) > 0)


def test_a_short_line_keeps_every_point() -> None:
    assert thinned(np.arange(50.0), 50).tolist() == list(range(50))


def test_a_value_between_gaps_is_noticed() -> None:
    assert has_lone_points(np.array([1.0, np.nan, 2.0, 3.0]))
    assert not has_lone_points(np.array([1.0, 2.0, np.nan, 3.0, 4.0]))


def test_zeros_and_a_vanishing_value_do_not_stretch_the_log_axis() -> None:
    values = np.concatenate([np.linspace(1.0, 2.0, 999), [0.0, 1e-30]])[None]

    low, high = log_range(Chart("name", "title", "caption", "axis", values))

    assert 0.2 < low < 1.0
    assert 2.0 < high < 3.0


def test_24_agents_look_different() -> None:
    assert len({agent_style(agent) for agent in range(24)}) == 24


def test_names_on_a_map_stand_beside_their_markers_and_whole():
    labels = ["west", "north", "the eastern gate", "south"]
    corners = [[0, 0, 0], [5, 9, 1], [9, 5, 2], [4, 0, 3]]
    figure = drawn(top_plot(analysis_of(agents={"count": 4, "positions": corners, "labels": labels})))
    figure.canvas.draw()
    [axes] = figure.axes
    names = {text.get_text(): text for text in axes.texts}
    assert list(names) == labels
    [marks] = [one for one in axes.collections if isinstance(one, PathCollection)]
    radius = 0.5 * np.sqrt(marks.get_sizes()[0]) * figure.dpi / 72.0
    for name, (x, y, _) in zip(labels, corners, strict=True):
        box, (across, along) = names[name].get_window_extent(), axes.transData.transform((x, y))
        assert box.y0 > along + radius or box.x0 > across + radius
        assert figure.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1
        assert box.y1 <= figure.bbox.y1
        assert names[name].get_clip_path() is None
