"""A recording without a truth: no error is shown anywhere, and everything else is."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from rich.console import Console

from tests.datasets.made import ANCHORS, RANGES, write
from zenoh_cbef.analysis.compare import row
from zenoh_cbef.analysis.design import design
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.analysis.report import write_report
from zenoh_cbef.cli.compare import runs_table
from zenoh_cbef.cli.terminal.results import metrics_table
from zenoh_cbef.datasets import read_dataset, write_dataset
from zenoh_cbef.errors import UserError
from zenoh_cbef.scenario.checks import check
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate
from zenoh_cbef.viewers.arrays import export

EPOCH = 1.7e9


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    rows = "".join(f"{EPOCH + 0.1 * step:.1f},{('hall', 'door')[step % 2]},2.0\n" for step in range(40))
    anchors = ANCHORS.replace("3,", "hall,", 1).replace("7,", "door,", 1)
    folder = tmp_path_factory.mktemp("sets") / "set"
    return write(folder, anchors=anchors, ranges="t,anchor_id,range\n" + rows, truth=None)


@pytest.fixture(scope="module")
def plan(folder):
    settings = ["target.motion=dataset", f'target.path="{folder}"', "network.graph=complete", "dt=0.1"]
    return load("tracking", settings).plan


@pytest.fixture(scope="module")
def analysis(plan):
    return analyze(simulate([plan.scenario]))[0]


def shown(table):
    console = Console(width=200)
    with console.capture() as said:
        console.print(table)
    return said.get()


def test_anchors_have_names_and_each_range_its_own_step(plan):
    assert plan.scenario.agents.labels == ("hall", "door")
    assert plan.scenario.length == 40, "float64 tells times since 1970 to 0.2 microseconds only"
    assert not check(plan) or all("truth" not in said for said in check(plan))


def test_no_table_shows_an_error(analysis):
    told = shown(metrics_table(analysis.metrics))
    for word in ("RMSE", "MSEE", "NEES", "ratio", "bound", "centralised"):
        assert word not in told
    for word in ("position error, as claimed", "NIS", "disagreement"):
        assert word in told
    assert analysis.metrics.claimed_position_error == pytest.approx(
        np.sqrt(np.trace(analysis.trace.covariances[:, analysis.first :, :3, :3], axis1=2, axis2=3).mean())
    )
    compared = shown(runs_table([row(analysis, "one")]))
    assert "claimed" in compared
    assert not any(word in compared for word in ("pos", "NEES", "ratio"))


def test_the_report_draws_what_covariances_claim(analysis, tmp_path):
    write_report(analysis, tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Position error that each agent claims" in text
    for absent in ("This run has none", "Average MSEE", "position RMSE"):
        assert absent not in text


def test_exports_have_the_times_of_the_source(analysis, tmp_path):
    [path] = export(analysis.trace, tmp_path / "run.npz", "npz")
    times = np.load(path)["source_time"]
    np.testing.assert_allclose(times, EPOCH + 0.1 * np.arange(40), atol=1e-6)
    export(analysis.trace, tmp_path / "tables", "csv")
    with (tmp_path / "tables" / "estimates.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert float(rows[39]["source_time"]) == times[39]


def test_a_design_needs_a_path(plan):
    with pytest.raises(UserError, match=r"has no truth\.csv; run it instead"):
        design(plan, search=False)


def test_a_set_reads_back_as_it_was_written(folder, tmp_path):
    for first in (read_dataset(folder), read_dataset(write(tmp_path / "known", ranges=RANGES))):
        write_dataset(first, tmp_path / "copy")
        second = read_dataset(tmp_path / "copy")
        assert second.labels == first.labels
        for name in ("anchors", "range_time", "range_anchor", "ranges", "truth_time", "truth"):
            np.testing.assert_array_equal(getattr(second, name), getattr(first, name))
        assert (tmp_path / "copy" / "truth.csv").exists() == first.has_truth
    write_dataset(read_dataset(folder), tmp_path / "copy")
    assert not read_dataset(tmp_path / "copy").has_truth, "the truth of another recording is gone"
