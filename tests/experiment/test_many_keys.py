"""Figures of several varied keys can be read, on the page and on paper."""

from itertools import product

import numpy as np
import pytest
from matplotlib.collections import PathCollection

from zenoh_cbef.analysis.figures import MUTED
from zenoh_cbef.analysis.printed import drawn
from zenoh_cbef.experiment.figures import figures_of
from zenoh_cbef.experiment.results import CellSummary, Curve, Summary
from zenoh_cbef.experiment.statistics import median_interval
from zenoh_cbef.pages.parts import Figure, Plot
from zenoh_cbef.plain import Json

FAULTS: list[Json] = [[], [{"kind": "loss", "probability": 0.1}], [{"kind": "loss", "probability": 0.3}]]


def figures(graphs: list[str], centralized: dict[str, float] | None = None) -> list[Figure]:
    """The figures of three filters, these graphs and three faults. centralized: RMSE of a graph's yardstick, m."""
    cells = [
        CellSummary(
            cell=place,
            values={"filter.kind": kind, "network.graph": graph, "fault": fault},
            runs=2,
            failed=0,
            failures=[],
            metrics={"position_rmse": median_interval([1.0 + place, 1.2 + place])}
            | ({"centralized.position_rmse": median_interval([centralized[graph]])} if centralized else {}),
            shares={},
            curve=Curve([0.1, 0.2], [1.0, 2.0], [0.1, 0.2]),
        )
        for place, (kind, graph, fault) in enumerate(product(["sicf", "icf", "hcmci"], graphs, FAULTS))
    ]
    return _figures_of(cells, {"filter.kind": "filter", "network.graph": "graph", "fault": "fault"})


def _figures_of(cells: list[CellSummary], words: dict[str, str]) -> list[Figure]:
    return figures_of(
        Summary(
            experiment="three",
            purpose="",
            engine="simulate",
            base="tracking",
            varied=list(words),
            words=words,
            level=0.95,
            runs=2 * len(cells),
            failed=0,
            cells=cells,
            expect=[],
            verdict="met",
        )
    )


def plot_of(figure: Figure) -> Plot:
    assert figure.plot is not None
    return figure.plot


def test_of_more_lines_than_can_be_told_apart_a_map_takes_the_place_also_for_three_keys():
    [rmse, *_] = figures(["ring", "star", "path"])
    [heat] = plot_of(rmse)["data"]
    assert heat["type"] == "heatmap"
    assert heat["x"] == ["sicf", "icf", "hcmci"]
    assert heat["y"][:3] == ["ring, none", "ring, loss probability=0.1", "ring, loss probability=0.3"]
    assert [len(row) for row in heat["z"]] == [3] * 9
    assert heat["z"][1] == [2.1, 11.1, 20.1]
    assert plot_of(rmse)["layout"]["yaxis"]["title"]["text"] == "graph, fault"
    picture = drawn(plot_of(rmse))
    assert [name.get_text() for name in picture.axes[0].get_yticklabels()] == heat["y"]
    # Twice as many rows have more room.
    taller = drawn(plot_of(figures(["ring", "star", "path", "grid", "complete", "radio"])[0]))
    assert taller.get_figheight() > picture.get_figheight() >= 9 * 0.18


def test_points_of_one_category_stand_side_by_side_in_colours_of_their_own_with_intervals():
    [rmse, *_] = figures(["ring", "star"])
    picture = drawn(plot_of(rmse))
    picture.draw_without_rendering()
    axes = picture.axes[0]
    points = [one for one in axes.collections if isinstance(one, PathCollection)]
    assert len(points) == 6
    assert len({tuple(np.asarray(one.get_facecolor())[0]) for one in points}) == 6
    across = np.sort(np.concatenate([np.asarray(one.get_offsets())[:, 0] for one in points])).tolist()
    assert len(set(across)) == 18
    assert all(abs(place - round(place)) < 0.5 for place in across)
    assert [name.get_text() for name in axes.get_xticklabels()] == ["sicf", "icf", "hcmci"]
    assert len(axes.containers) == 6
    # A legend of many long names makes the figure taller, and the axes no smaller.
    [legend] = picture.legends
    assert axes.get_window_extent().height > picture.get_size_inches()[0] * picture.dpi * 0.4
    assert legend.get_window_extent().y1 < axes.get_window_extent().y0


def test_faults_have_few_words_below_an_axis_and_a_large_error_hides_no_small_one():
    def plot(faults: list[Json], errors: list[float]) -> Plot:
        cells = [
            CellSummary(place, {"fault": fault}, 2, 0, [], {"position_rmse": median_interval([error] * 2)}, {}, None)
            for place, (fault, error) in enumerate(zip(faults, errors, strict=True))
        ]
        return plot_of(_figures_of(cells, {"fault": "fault"})[0])

    crash: Json = [{"kind": "crash", "agents": [2], "from": 5.0}, {"kind": "loss", "probability": 0.5}]
    far = plot([[], FAULTS[1], crash], [0.1, 0.12, 6.0])
    assert far["data"][0]["x"] == ["none", "loss", "crash; loss"]
    assert far["layout"]["yaxis"]["type"] == "log"
    assert drawn(far).axes[0].get_yscale() == "log"
    near = plot(FAULTS, [0.1, 0.12, 0.6])
    assert near["data"][0]["x"] == ["none", "loss probability=0.1", "loss probability=0.3"]
    assert near["layout"]["yaxis"]["type"] == "linear"


def test_several_yardsticks_have_the_colours_of_what_they_are_beside():
    [rmse, *_] = figures(["ring", "star"], {"ring": 0.5, "star": 0.25})
    marks = plot_of(rmse)["data"]
    ring, star = (one for one in marks if "error_y" not in one)
    assert (ring["name"], star["name"]) == ("ring, fault none centralised", "star, fault none centralised")
    colours = {one["name"]: one["line"]["color"] for one in marks}
    assert colours["ring, fault none centralised"] == colours["ring, fault none"]
    assert colours["star, fault none centralised"] == colours["star, fault none"] != colours["ring, fault none"]
    [rmse, *_] = figures(["ring", "star"], {"ring": 0.5, "star": 0.5})
    [only] = (one for one in plot_of(rmse)["data"] if "error_y" not in one)
    assert (only["name"], only["line"]["color"]) == ("centralised", MUTED)


@pytest.mark.parametrize("name", ["position-error-over-time", "disagreement-over-time"])
def test_a_figure_of_the_first_cells_says_so(name):
    [over_time] = [one for one in figures(["ring", "star"]) if one.name == name]
    *lines, last = plot_of(over_time)["data"]
    assert len(lines) == 12
    assert last["name"] == "6 more cells not drawn"
    assert over_time.caption.endswith("Only the first 12 of 18 cells are drawn.")
    [legend] = drawn(plot_of(over_time)).legends
    assert legend.get_texts()[-1].get_text() == "6 more cells not drawn"
