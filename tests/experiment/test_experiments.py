"""Small experiments from the command line: what they leave, how they judge, fail and go on."""

import csv
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.cli.command_line import call
from tests.waiting import until
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.experiment.cells import cells_of
from zenoh_cbef.experiment.engines import simulated
from zenoh_cbef.experiment.figures import figures_of
from zenoh_cbef.experiment.file import read_experiment
from zenoh_cbef.experiment.numbers import numbers
from zenoh_cbef.experiment.summary import summarize
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate

SMALL = """
# A small experiment. It is a test's.
base = "tracking"
seeds = 3
engine = "simulate"
[set]
steps = 12
"agents.count" = 4
"network.graph" = "ring"
[[fault]]
kind = "loss"
probability = 0.0
[[vary]]
key = "fault.0.probability"
values = [0.0, 0.3]
[[vary]]
key = "consensus.rounds"
values = [2, 5]
"""


def expect(metric: str, limit: str, where: str = "") -> str:
    return f'[[expect]]\nmetric = "{metric}"\n{limit}\n{where}\n'


def run(monkeypatch, capsys, folder: Path, text: str, *options: str) -> tuple[int, str, str]:
    monkeypatch.chdir(folder)
    (folder / "mine.toml").write_text(text)
    return call(monkeypatch, capsys, "experiment", "mine.toml", "-o", "out", *(options or ("--jobs", "1")))


def rows_of(folder: Path) -> list[dict[str, str]]:
    with (folder / "out" / "results.csv").open() as stream:
        return list(csv.DictReader(stream))


def summary_of(folder: Path) -> dict:
    return json.loads((folder / "out" / "summary.json").read_text())


def test_an_experiment_leaves_its_tables_figures_and_page(monkeypatch, capsys, tmp_path):
    status, out, _ = run(monkeypatch, capsys, tmp_path, SMALL + expect("ratio_to_centralized", "at_most = 9.0"))
    assert status == 0
    assert "verdict met" in out
    rows = rows_of(tmp_path)
    assert len(rows) == 4 * 3
    assert {(row["fault.0.probability"], row["consensus.rounds"], row["seed"]) for row in rows} == {
        (loss, rounds, seed) for loss in ("0.0", "0.3") for rounds in ("2", "5") for seed in ("1", "2", "3")
    }
    assert {"msee.average", "centralized.position_rmse", "nees.inside", "links.lost", "bytes_per_step"} <= set(rows[0])
    page = (tmp_path / "out" / "index.html").read_text()
    assert "A small experiment" in page
    assert "Plotly.react(" in page
    figures = {path.name for path in (tmp_path / "out" / "figures").iterdir()}
    assert {"position-rmse.html", "position-error-over-time.html"} <= figures


def test_the_parquet_table_is_the_csv_table(monkeypatch, capsys, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    run(monkeypatch, capsys, tmp_path, SMALL.replace("seeds = 3", "seeds = [3, 18446744073709551615]"))
    table = parquet.read_table(tmp_path / "out" / "results.parquet").to_pylist()
    assert [{name: "" if value is None else str(value) for name, value in row.items()} for row in table] == rows_of(
        tmp_path
    )


def test_every_row_and_median_is_that_of_single_simulations(monkeypatch, capsys, tmp_path):
    run(monkeypatch, capsys, tmp_path, SMALL, "--jobs", "2")
    found: dict[tuple[str, str], list[float]] = {}
    for row in rows_of(tmp_path):
        cell = row["fault.0.probability"], row["consensus.rounds"]
        settings = [f'fault=[{{kind="loss", probability={cell[0]}}}]', f"consensus.rounds={cell[1]}", "steps=12"]
        settings += ["agents.count=4", "network.graph=ring", f"seed={row['seed']}"]
        metrics = analyze(simulate([load("tracking", settings).scenario]))[0].metrics
        assert float(row["position_rmse"]) == metrics.position_rmse
        assert int(row["links.lost"]) == sum(link.lost for link in metrics.links)
        found.setdefault(cell, []).append(metrics.position_rmse)
    for cell in summary_of(tmp_path)["cells"]:
        first, second = map(str, cell["values"].values())
        values = found[first, second]
        assert cell["metrics"]["position_rmse"]["median"] == np.median(values)


@pytest.mark.parametrize(
    ("rules", "verdict"),
    [
        ("", "met"),
        (expect("ratio_to_centralized", "at_most = 9.0", "where = { loss = 0.3 }"), "met"),
        (expect("ratio_to_centralized", "at_least = 9.0"), "not met"),
        (expect("bytes_per_step", "at_least = 1\nat_most = 1e9", "where = { rounds = 5 }"), "met"),
        (expect("slow.target", "at_most = 9.0"), "cannot be judged"),
        (expect("agents", "at_most = 4") + expect("agents", "at_most = 3"), "not met"),
        (expect("smoothed.lag", "at_most = 4") + expect("agents", "at_most = 3"), "not met"),
    ],
)
def test_the_exit_status_is_the_verdict(monkeypatch, capsys, tmp_path, rules, verdict):
    found, _, err = run(monkeypatch, capsys, tmp_path, SMALL + rules)
    assert found == {"met": 0, "not met": 1, "cannot be judged": 2}[verdict]
    assert summary_of(tmp_path)["verdict"] == verdict
    assert "Traceback" not in err
    if verdict == "cannot be judged":
        assert "no run has such a number" in err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ([], "did you mean 'ratio_to_centralized'"),
        (["--table", "csv", "--metric", "nope"], "--metric 'nope' is no number that runs have; docs/"),
        (["--table", "csv", "--metric", "seed"], "--metric 'seed' is no number that runs have"),
        (["--table", "csv", "--metric", "msee"], "did you mean 'msee.average'?"),
    ],
)
def test_a_wrong_name_of_a_number_is_refused_before_anything_runs(monkeypatch, capsys, tmp_path, options, said):
    rules = "" if options else expect("ratio_to_centralised", "at_most = 9.0")
    found, _, err = run(monkeypatch, capsys, tmp_path, SMALL + rules, "--jobs", "1", *options)
    assert found == 2
    assert said in err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("setting", ["filter.lag_seconds=0.5", "target.motion=circle"])
def test_the_numbers_that_runs_have_are_all_known_beforehand(setting):
    outcome, *_ = simulated(load("tracking", ["steps=12", setting]).scenario, [1], 0.25)
    told = {name for name, value in outcome.metrics.items() if type(value) in {int, float}}
    assert told >= {"position_rmse", "status.tracking.share", "links.missed", "final.disagreement"}
    assert told <= numbers()


def test_a_cell_that_cannot_run_is_reported_and_the_rest_goes_on(monkeypatch, capsys, tmp_path):
    bad = SMALL.replace("values = [2, 5]", "values = [2, -1]")
    judged = expect("agents", "at_most = 4", "where = { rounds = 2 }")
    status, _, err = run(monkeypatch, capsys, tmp_path, bad + judged)
    assert status == 0
    assert "failed: 3 of 3 runs with fault.0.probability = 0.0, consensus.rounds = -1" in err
    summary = summary_of(tmp_path)
    assert [cell["failed"] for cell in summary["cells"]] == [0, 3, 0, 3]
    assert sum(bool(row["error"]) for row in rows_of(tmp_path)) == 6
    assert run(monkeypatch, capsys, tmp_path, bad)[0] == 2
    assert run(monkeypatch, capsys, tmp_path, bad + expect("agents", "at_most = 4"))[0] == 2


def test_medians_are_said_to_be_of_the_runs_that_succeeded(monkeypatch, capsys, tmp_path):
    text = 'seeds = 2\n[set]\nsteps = 5\n[[vary]]\nkey = "consensus.rounds"\nvalues = [2, -1]\n'
    assert "mine: medians of 2 runs, 2 more failed" in run(monkeypatch, capsys, tmp_path, text)[1]


def test_a_seed_that_cannot_run_fails_alone(monkeypatch, capsys, tmp_path):
    # Whether such a small radius joins all agents is a question of where the seed places them.
    text = 'seeds = 12\n[set]\nsteps = 4\nnetwork.graph = "geometric"\nnetwork.radius = 11.0\n'
    status, _, err = run(monkeypatch, capsys, tmp_path, text)
    failed = [row["error"] for row in rows_of(tmp_path) if row["error"]]
    assert 0 < len(failed) < 12
    assert all("falls apart" in error for error in failed)
    assert status == 2
    assert "falls apart" in err


def test_finished_runs_are_not_done_again_and_what_is_missing_is(monkeypatch, capsys, tmp_path):
    run(monkeypatch, capsys, tmp_path, SMALL)
    rows, journal = rows_of(tmp_path), tmp_path / "out" / "finished.jsonl"
    lines = journal.read_text().splitlines()
    assert len(lines) == 12
    # As if it had been killed in the middle of a line; a kept result is marked, to be known again.
    marked = json.loads(lines[0])
    marked["metrics"]["position_rmse"] = 123.0
    journal.write_text("\n".join([json.dumps(marked), *lines[1:5], lines[5][:40]]))
    run(monkeypatch, capsys, tmp_path, SMALL)
    again = rows_of(tmp_path)
    assert again[0]["position_rmse"] == "123.0"
    assert again[1:] == rows[1:]
    assert len(journal.read_text().splitlines()) == 13
    # Other seeds and values are added to what is there; other settings share nothing with it.
    assert "123.0" in {row["position_rmse"] for row in _rows(run, monkeypatch, capsys, tmp_path, "seeds = 4")}
    assert "123.0" not in {row["position_rmse"] for row in _rows(run, monkeypatch, capsys, tmp_path, "seeds = [2]")}
    run(monkeypatch, capsys, tmp_path, SMALL.replace("steps = 12", "steps = 13"))
    assert "123.0" not in {row["position_rmse"] for row in rows_of(tmp_path)}


def test_an_experiment_writes_over_no_other_ones_results_but_over_its_own(monkeypatch, capsys, tmp_path):
    text = SMALL.replace("seeds = 3", "seeds = 1")
    assert run(monkeypatch, capsys, tmp_path, text)[0] == 0
    first = (tmp_path / "out" / "results.csv").read_bytes()
    (tmp_path / "other.toml").write_text(text)
    said = "out holds the results of another experiment (mine of tracking, over fault.0.probability and"
    for name, changed in (("other", text), ("mine", text.replace('"tracking"', '"paper"')), ("mine", _OTHER_KEY)):
        (tmp_path / f"{name}.toml").write_text(changed)
        for command in (["run"], ["run", "--shard", "1/2"], ["join"]):
            status, _, err = call(monkeypatch, capsys, "experiment", *command, f"{name}.toml", "-o", "out")
            assert status == 2
            assert said in err
    assert (tmp_path / "out" / "results.csv").read_bytes() == first
    assert run(monkeypatch, capsys, tmp_path, text.replace("[2, 5]", "[2, 3, 5]"))[0] == 0
    assert len(rows_of(tmp_path)) == 6
    fewer = run(monkeypatch, capsys, tmp_path, text)
    assert fewer[0] == 0
    assert "note: the results were of 6 runs, and are of 4 now; finished.jsonl keeps the others" in fewer[2]
    assert call(monkeypatch, capsys, "experiment", "other.toml", "-o", "out", "--force")[0] == 0
    assert summary_of(tmp_path)["experiment"] == "other"


_OTHER_KEY = 'seeds = 1\n[set]\nsteps = 5\n[[vary]]\nkey = "agents.count"\nvalues = [4]\n'


def _rows(run, monkeypatch, capsys, folder: Path, seeds: str) -> list[dict[str, str]]:
    run(monkeypatch, capsys, folder, SMALL.replace("seeds = 3", seeds))
    return rows_of(folder)


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_an_interrupted_experiment_goes_on(tmp_path, how):
    asked = how != signal.SIGKILL
    text = SMALL.replace("seeds = 3", "seeds = 40").replace("steps = 12", "steps = 100")
    (tmp_path / "mine.toml").write_text(text)
    command = [sys.executable, "-m", "zenoh_cbef", "experiment", "mine.toml", "-o", "out"]
    command += ["--jobs", "2" if how == signal.SIGTERM else "1"]  # other processes must not complain
    process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
    journal = tmp_path / "out" / "finished.jsonl"
    try:
        until(lambda: journal.exists() and journal.stat().st_size > 100)
        os.kill(process.pid, how)
        _, err = process.communicate(timeout=100)
    finally:
        process.kill()
    assert process.returncode == (130 if asked else -how)
    assert ("the same command goes on from there" in err) == asked
    assert len(err.splitlines()) == int(asked), err
    kept = len(journal.read_text().splitlines())
    assert 0 < kept < 160
    (tmp_path / "mine.toml").write_text(text.replace("values = [2, 5]", "values = [2]").replace("[0.0, 0.3]", "[0.0]"))
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    assert len(rows_of(tmp_path)) == 40


def test_four_shards_as_an_array_job_joined_are_the_undivided_sweep_to_the_byte(monkeypatch, capsys, tmp_path):
    text = SMALL + expect("ratio_to_centralized", "at_most = 0.5")
    assert run(monkeypatch, capsys, tmp_path, text)[0] == 1
    (tmp_path / "out").rename(tmp_path / "whole")
    script = ["bash", str(Path(__file__).parents[2] / "deploy" / "slurm" / "experiment.sh"), "mine.toml"]
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    environment = os.environ | {"PATH": path, "SLURM_CPUS_PER_TASK": "1"}
    tasks = [
        subprocess.Popen([*script, "4", "-o", "out"], env=environment | {"SLURM_ARRAY_TASK_ID": str(task)}, text=True,
                         stdout=subprocess.PIPE)
        for task in (1, 2, 3, 4)
    ]  # fmt: skip
    for number, task in enumerate(tasks, 1):
        out, _ = task.communicate(timeout=100)
        assert task.returncode == 0
        assert f"shard {number}/4 has finished its 3 runs" in out
    joined = subprocess.run([*script, "-o", "out"], env=environment, check=False, capture_output=True, text=True)
    assert (joined.returncode, joined.stderr) == (1, "")
    files = [path.relative_to(tmp_path / "whole") for path in (tmp_path / "whole").rglob("*") if path.is_file()]
    assert len(files) > 5
    for name in files:
        ours, theirs = ((tmp_path / place / name).read_bytes() for place in ("out", "whole"))
        if name.name == "finished.jsonl":
            ours, theirs = sorted(ours.splitlines()), sorted(theirs.splitlines())
        assert ours == theirs, name


def test_a_dask_cluster_finds_what_one_core_finds_to_the_byte(monkeypatch, capsys, tmp_path):
    distributed = pytest.importorskip("distributed", reason="Dask is not installed: pip install 'zenoh-cbef[dask]'")
    assert run(monkeypatch, capsys, tmp_path, SMALL)[0] == 0
    (tmp_path / "out").rename(tmp_path / "alone")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        status, _, err = run(monkeypatch, capsys, tmp_path, SMALL, "--dask", cluster.scheduler_address)
        assert len(cluster.scheduler.computations) > 0, "the workers had nothing to do"
    assert (status, err) == (0, "")
    for name in ("results.csv", "summary.json", "index.html"):
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "alone" / name).read_bytes()


def test_seeds_can_be_given_and_json_is_the_summary(monkeypatch, capsys, tmp_path):
    status, out, _ = run(monkeypatch, capsys, tmp_path, SMALL, "--seeds", "[5, 9]", "--json", "--jobs", "1")
    assert status == 0
    assert json.loads(out) == summary_of(tmp_path)
    assert {row["seed"] for row in rows_of(tmp_path)} == {"5", "9"}


def test_values_may_be_tables_and_words(monkeypatch, capsys, tmp_path):
    text = 'seeds = 1\n[set]\nsteps = 5\n[[vary]]\nkey = "network"\nvalues = [{ graph = "ring" }, { graph = "star" }]\n'
    status, _, _ = run(monkeypatch, capsys, tmp_path, text)
    assert status == 0
    assert [json.loads(row["network"]) for row in rows_of(tmp_path)] == [{"graph": "ring"}, {"graph": "star"}]


def test_built_in_experiments_are_listed_and_shown(monkeypatch, capsys):
    status, out, _ = call(monkeypatch, capsys, "experiment", "list")
    assert status == 0
    names = [line.split()[0] for line in out.splitlines()]
    assert {"loss", "delay", "bursts", "partition", "rounds", "topology", "scale", "outliers"} <= set(names)
    assert 'base = "tracking"' in call(monkeypatch, capsys, "experiment", "show", "loss")[1]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["los"], "did you mean 'loss'"),
        (["show"], "Missing argument 'FILE'; see 'zenoh-cbef experiment show -h'"),
        (["loss", "delay"], "unexpected extra argument"),
        (["loss", "--seeds", "many"], "neither a number nor a list"),
        (["loss", "--seeds", "0"], "at least 1"),
    ],
)
def test_a_wrong_command_is_one_sentence(monkeypatch, capsys, tmp_path, arguments, words):
    monkeypatch.chdir(tmp_path)
    status, out, err = call(monkeypatch, capsys, "experiment", *arguments)
    assert (status, out) == (2, "")
    assert words in err
    assert len(err.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("values", "mode"), [('["sicf", "ci"]', "markers"), ("[3, 4]", "lines+markers")])
def test_only_numbers_are_joined_by_lines(tmp_path, values, mode):
    key = "filter.kind" if "sicf" in values else "consensus.rounds"
    (tmp_path / "mine.toml").write_text(f'seeds = 1\n[set]\nsteps = 5\n[[vary]]\nkey = "{key}"\nvalues = {values}\n')
    written = read_experiment(str(tmp_path / "mine.toml"))
    cells = cells_of(written)
    outcomes = [simulated(cell.scenario, [1], 0.25) for cell in cells if cell.scenario is not None]
    plot = figures_of(summarize(written, cells, outcomes))[0].plot
    assert plot is not None
    modes = {line["mode"] for line in plot["data"]}
    assert modes == {mode, mode.split("+")[0]}
