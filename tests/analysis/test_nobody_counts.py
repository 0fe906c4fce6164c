"""Runs in which no agent is left whose errors count: there is nothing to average, and that is said."""

import pytest
from rich.console import Console

from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.analysis.outputs import write_outputs
from zenoh_cbef.cli.terminal.results import metrics_table
from zenoh_cbef.scenario.load import parse
from zenoh_cbef.simulator import simulate

LIARS_AND_DEAD = {
    "steps": 10,
    "agents": {"count": 4},
    "network": {"graph": "star"},
    "fault": [{"kind": "crash", "agents": [1, 2, 3]}, {"kind": "byzantine", "agents": [0]}],
}


@pytest.mark.slow
def test_tables_and_report_are_written_all_the_same(tmp_path):
    scenario = parse(LIARS_AND_DEAD, "test")
    analyses = analyze(simulate([scenario, scenario.changed(seed=2)]))
    metrics = analyses[0].metrics
    assert metrics.position_rmse is None
    console = Console(record=True, width=120)
    console.print(metrics_table(metrics))
    assert "position RMSE" in console.export_text()
    write_outputs(analyses[0], tmp_path, report=True)
    assert "none, expected 95 %" in (tmp_path / "report.html").read_text()
