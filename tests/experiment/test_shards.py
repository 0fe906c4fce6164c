"""Shards do every run once, whatever their number; joined, they say what is missing."""

from dataclasses import replace
from pathlib import Path

import pytest

from tests.cli.command_line import call
from zenoh_cbef.experiment.cells import Cell, cells_of
from zenoh_cbef.experiment.file import read_experiment
from zenoh_cbef.experiment.shards import Shard, lacking, read_shard
from zenoh_cbef.experiment.sweep import Sweep

TEXT = """
seeds = 5
[set]
steps = 3
"agents.count" = 4
network.graph = "complete"
[[vary]]
key = "consensus.rounds"
values = [1, -1, 2]
"""


@pytest.fixture
def cells(tmp_path) -> list[Cell]:
    (tmp_path / "mine.toml").write_text(TEXT)
    return cells_of(read_experiment(str(tmp_path / "mine.toml")))


@pytest.mark.parametrize("of", [1, 2, 3, 4, 7, 15, 20])
def test_every_run_is_in_one_shard_and_shards_are_equally_long(cells, of):
    runs = [
        [(cell.index, seed) for cell in cells for seed in Shard(number, of).seeds_of(cell, [5, 3, 9, 1, 7])]
        for number in range(1, of + 1)
    ]
    every = [(cell, seed) for cell in range(3) for seed in (1, 3, 5, 7, 9)]
    assert sorted(run for shard in runs for run in shard) == every
    assert max(map(len, runs)) - min(map(len, runs)) <= 1


def test_shards_joined_find_what_one_sweep_finds_also_of_a_run_that_failed_and_then_succeeds(tmp_path, cells):
    experiment = read_experiment(str(tmp_path / "mine.toml")).experiment
    whole = Sweep(experiment, cells, 0.25, jobs=1)
    expected = whole.run(tmp_path / "whole", lambda *_: None)
    parts = [replace(whole, shard=Shard(number, 3)) for number in (1, 2, 3)]
    # The first time two runs of shard 2 fail, as they may as processes: no memory, no port.
    broken = [replace(cells[0], scenario=_too_small(cells[0])), *cells[1:]]
    for part in (parts[0], replace(parts[1], cells=broken), parts[2]):
        part.run(tmp_path / "parts", lambda *_: None)
    with pytest.raises(Exception, match=r"2 of 15 runs are missing; run --shard 2/3 with"):
        whole.joined(tmp_path / "parts")
    parts[1].run(tmp_path / "parts", lambda *_: None)
    assert whole.joined(tmp_path / "parts") == expected
    # The folder has all runs now: the sweep goes on in it without shards, and finds nothing to do.
    todo: list[tuple[int, int]] = []
    assert whole.run(tmp_path / "parts", lambda *counts: todo.append(counts)) == expected
    assert todo == [(10, 10)]


def _too_small(cell: Cell):
    assert cell.scenario is not None
    return cell.scenario.changed(steps=2)


def test_a_failure_of_a_shard_is_joined_and_no_longer_once_it_succeeds(tmp_path):
    # Whether such a small radius joins all agents is a question of where the seed places them.
    text = 'seeds = 6\n[set]\nsteps = 3\nnetwork.graph = "geometric"\nnetwork.radius = 11.0\n'
    (tmp_path / "mine.toml").write_text(text)
    written = read_experiment(str(tmp_path / "mine.toml"))
    sweep = Sweep(written.experiment, cells_of(written), 0.25, jobs=1)
    expected = sweep.run(tmp_path / "whole", lambda *_: None)
    assert 0 < sum(one.error is not None for one in expected[0]) < 6
    for number in (1, 2):
        replace(sweep, shard=Shard(number, 2)).run(tmp_path / "parts", lambda *_: None)
    assert sweep.joined(tmp_path / "parts") == expected
    assert sweep.joined(tmp_path / "parts") == expected


def test_what_is_missing_names_few_shards(cells):
    every = {(cell.index, seed) for cell in cells for seed in range(1, 6)}
    assert lacking(every, cells, 5, [Shard(2, 4)]) == "the shards 1/4, 2/4, 3/4 and 4/4"
    assert lacking({(0, 2)}, cells, 5, [Shard(1, 4)]) == "--shard 2/4"
    assert lacking(every, cells, 5, [Shard(1, 15)]).endswith("10/15 and 5 more")


@pytest.mark.parametrize("text", ["0/4", "5/4", "2", "2/", "/4", "a/b", "1/0", "-1/4", "1/4/4", "1/99999999"])
def test_a_shard_that_is_none_is_refused(text):
    with pytest.raises(Exception, match="give the second of four as 2/4"):
        read_shard(text)


def test_join_without_shards_is_one_sentence(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    status, out, err = call(monkeypatch, capsys, "experiment", "join", "loss")
    assert (status, out) == (2, "")
    assert "holds no shard" in err
    assert len(err.strip().splitlines()) == 1
    assert not list(Path().iterdir())
