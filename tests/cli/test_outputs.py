"""Where outputs go and when they are written over: docs/outputs.md, for every verb that writes."""

from __future__ import annotations

import json
import shutil
import zipfile
from pathlib import Path

import pytest

from tests.cli.command_line import call
from zenoh_cbef.analysis import outputs


@pytest.fixture
def place(log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A run's folder, a log of another name, and a working folder, which is where the test is."""
    for folder in ("logs/one", "other", "work"):
        (tmp_path / folder).mkdir(parents=True)
    shutil.copy(log, tmp_path / "logs/one/run.mcap")
    shutil.copy(log, tmp_path / "other/est.mcap")
    monkeypatch.chdir(tmp_path / "work")
    return tmp_path


def files(place: Path) -> set[str]:
    return {str(path.relative_to(place)) for path in place.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("analyze {log}", {"logs/one/metrics.json", "other/est.metrics.json"}),
        ("timeline {log}", {"logs/one/timeline.html", "other/est.timeline.html"}),
        ("export {log}", {"logs/one/run.npz", "other/est.npz"}),
        ("export {log} --to csv", {"logs/one/run-csv/truth.csv", "other/est-csv/truth.csv"}),
    ],
)
def test_without_a_name_an_output_goes_beside_its_log_and_is_called_after_it(
    monkeypatch, capsys, place, words, expected
):
    before = files(place)
    for _ in range(2):  # the second writes over the first
        for log in ("../logs/one", "../other/est.mcap"):
            status, _, err = call(monkeypatch, capsys, *words.format(log=log).split())
            # The made log's agents are too few to see a position, which is all that there is to say.
            assert (status, [line for line in err.splitlines() if "did not determine" not in line]) == (0, [])
    new = files(place) - before
    assert expected <= new
    assert not [name for name in new if name.startswith("work")]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "name"),
    [
        ("timeline ../logs/one -o {name}", "x.html"),
        ("timeline ../logs/one -o {name}", "x.svg"),
        ("export ../logs/one -o {name}", "x.npz"),
        ("export ../logs/one --to npz --output {name}", "run.npz"),
        ("compare ../logs/one -o {name}", "x.csv"),
        ("compare ../logs/one -o {name}", "x.html"),
        ("sim --set steps=2 -o {name}", "x.npz"),
        ("scenario new {name}", "x.toml"),
    ],
)
@pytest.mark.usefixtures("place")
def test_a_named_file_is_written_over_with_force_alone(monkeypatch, capsys, words, name):
    arguments = words.format(name=name).split()
    path = Path(name)
    path.write_text("precious")
    status, out, err = call(monkeypatch, capsys, *arguments)
    assert (status, out) == (2, "")
    assert f"{name} exists" in err
    assert "--force" in err
    assert path.read_text() == "precious"
    assert call(monkeypatch, capsys, *arguments, "--force")[0] == 0
    assert path.read_bytes() != b"precious"
    path.unlink()
    assert call(monkeypatch, capsys, *arguments)[0] == 0
    assert path.is_file()
    if path.suffix == ".npz":
        assert zipfile.is_zipfile(path)


@pytest.mark.parametrize(
    ("words", "name"),
    [
        ("analyze ../logs/one -o out", "metrics.json"),
        ("export ../logs/one -o out --to csv", "truth.csv"),
        ("experiment short.toml -o out", "index.html"),
    ],
)
@pytest.mark.usefixtures("place")
def test_a_named_folder_keeps_what_it_has_without_force(monkeypatch, capsys, words, name):
    Path("short.toml").write_text('seeds = 1\n[set]\nsteps = 3\n"agents.count" = 4\n')
    precious = Path("out") / name
    precious.parent.mkdir()
    precious.write_text("precious")
    (precious.parent / "mine.txt").write_text("mine")
    status, _, err = call(monkeypatch, capsys, *words.split())
    assert status == 2
    assert f"out/{name} exists" in err
    assert precious.read_text() == "precious"
    assert call(monkeypatch, capsys, *words.split(), "--force")[0] == 0
    assert precious.read_text() != "precious"
    assert (precious.parent / "mine.txt").read_text() == "mine"
    if "experiment" in words:
        assert call(monkeypatch, capsys, *words.split())[0] == 0, "a sweep goes on in its own folder"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("sim --set steps=2 -o x.csv", "must end with .npz"),
        ("timeline ../logs/one -o x.png", "must end with .svg for the picture or .html"),
        ("compare ../logs/one -o x.npz", "must end with .csv for the rows or .html for the curves"),
        ("export ../logs/one -o x.txt", "must end with one of .npz, .csv, .parquet, .mcap, .rrd"),
        ("export ../logs/one --to csv -o x.npz", "a name for npz, but --to says csv"),
        ("analyze ../logs/one -o x.html", "looks like a file, and is to be a folder; name one, as x"),
        ("figures ../logs/one -o ok.pdf", "looks like a file, and is to be a folder; name one, as ok"),
        ("export ../logs/one --to viz --force -o ../logs/one/run.mcap", "never overwritten"),
    ],
)
def test_a_name_that_means_something_else_is_refused(monkeypatch, capsys, place, words, told):
    before = files(place)
    status, out, err = call(monkeypatch, capsys, *words.split())
    assert (status, out) == (2, "")
    assert told in err
    assert len(err.splitlines()) == 1
    assert files(place) == before


@pytest.mark.usefixtures("place")
def test_the_suffix_chooses_the_format(monkeypatch, capsys):
    assert call(monkeypatch, capsys, "export", "../logs/one", "-o", "tables.csv")[0] == 0
    assert (Path("tables.csv") / "truth.csv").is_file()


@pytest.mark.usefixtures("place")
def test_a_folder_that_cannot_be_written_into_costs_a_note_not_the_table(monkeypatch, capsys):
    # A folder of the file's name is in the way of the superuser, too, whom permissions do not stop.
    Path("../logs/one/metrics.json").mkdir()
    status, out, err = call(monkeypatch, capsys, "analyze", "../logs/one")
    assert status == 0
    assert "position RMSE" in out
    assert "note: cannot write ../logs/one/metrics.json: Is a directory" in err
    status, out, _ = call(monkeypatch, capsys, "analyze", "../logs/one", "--json")
    assert status == 0
    assert json.loads(out)["run"] == "made"


@pytest.mark.usefixtures("place")
def test_what_was_asked_for_and_cannot_be_written_is_a_mistake_after_the_table(monkeypatch, capsys):
    Path("out/metrics.json").mkdir(parents=True)
    status, out, err = call(monkeypatch, capsys, "analyze", "../logs/one", "-o", "out", "--force")
    assert status == 2
    assert "position RMSE" in out
    assert "cannot write out/metrics.json: Is a directory" in err
    Path("../logs/one/timeline.html").mkdir()
    status, _, err = call(monkeypatch, capsys, "timeline", "../logs/one")
    assert status == 2
    assert "cannot write ../logs/one/timeline.html" in err


@pytest.mark.usefixtures("place")
def test_a_figure_that_cannot_be_written_costs_neither_the_table_nor_the_report(monkeypatch, capsys):
    (Path("../logs/one/figures") / "innovation.png").mkdir(parents=True)
    status, out, err = call(monkeypatch, capsys, "analyze", "../logs/one", "--report")
    assert status == 2
    assert "position RMSE" in out
    assert Path("../logs/one/report.html").is_file()
    assert "cannot write ../logs/one/figures: Is a directory; name another folder with --output" in err


@pytest.mark.usefixtures("place")
@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("experiment small.toml -o out --force --jobs 1", "verdict met"),
        ("experiment small.toml -o out --force --jobs 1 --json", '"verdict": "met"'),
    ],
)
def test_what_was_computed_is_told_before_it_is_written(monkeypatch, capsys, words, told):
    Path("out/results.csv").mkdir(parents=True)
    Path("small.toml").write_text("seeds = 1\n[set]\nsteps = 3\n")
    status, out, err = call(monkeypatch, capsys, *words.split())
    assert status == 2
    assert told in out
    assert "cannot write" in err


def test_compare_leaves_out_what_is_no_log_and_names_it(monkeypatch, capsys, place):
    logs = place / "logs"
    (logs / "empty").mkdir()
    (logs / "README").write_text("my runs")
    shutil.copytree(logs / "one", logs / "two")
    (logs / "latest").symlink_to("two")
    status, out, err = call(monkeypatch, capsys, "compare", *map(str, sorted(logs.iterdir())), "--json")
    assert status == 0
    assert [Path(row["run"].partition("(")[2]).parent.name for row in json.loads(out)] == ["one", "two"]
    told = [line for line in err.splitlines() if line.startswith("left out: ")]
    assert len(told) == 2
    assert "logs/README is no MCAP file" in "".join(told)
    assert "there is no log" in "".join(told)
    assert call(monkeypatch, capsys, "compare", str(logs / "latest"))[0] == 0
    status, out, err = call(monkeypatch, capsys, "compare", str(logs / "README"), str(logs / "empty"))
    assert (status, out) == (2, "")
    assert "none of these is a log of a run" in err
    status, out, err = call(monkeypatch, capsys, "compare", str(logs / "one"), "nope")
    assert (status, out) == (2, "")
    assert "there is no log nope" in err


@pytest.mark.parametrize(
    "words",
    [
        "analyze {log} -o {place}/out",
        "timeline {log} -o {place}/x.svg",
        "export {log} -o {place}/x.npz",
        "export {log} -o {place}/x.csv",
        "export {log} --to dataset -o {place}/set",
        "export {log} -o {place}/x.ros2",
        "compare {log} -o {place}/x.csv",
        "figures {log} -o {place}/paper",
        "filter {log} -o {place}/x.mcap",
        "reestimate {log} -o {place}/x.mcap",
        "sim --set steps=2 -o {place}/x.npz",
        "run --set steps=2 --log {place}/x.mcap",
        "experiment loss -o {place}/out",
        "import {log} -o {place}/out",
        "dataset show lawnmower -o {place}/x.png",
        "scenario new {place}/x.toml",
    ],
)
def test_a_name_in_a_file_is_refused(monkeypatch, capsys, place, words):
    before = files(place)
    Path("file").write_text("")
    for where in ("file", "file/in"):
        status, out, err = call(monkeypatch, capsys, *words.format(log="../logs/one", place=where).split())
        assert (status, out) == (2, "")
        assert "file is a file; " in err.splitlines()[-1]
    assert files(place) == before | {"work/file"}


@pytest.mark.parametrize(
    "words",
    [
        "timeline {log} -o new/in/x.svg",
        "export {log} -o new/in/x.npz",
        "export {log} -o new/in/x.ros2",
        "filter {log} -o new/in/x.mcap",
        "scenario new new/in/x.toml",
    ],
)
@pytest.mark.usefixtures("place")
def test_folders_that_are_not_there_are_made(monkeypatch, capsys, words):
    assert call(monkeypatch, capsys, *words.format(log="../logs/one").split())[0] == 0
    made = list(Path("new/in").iterdir())
    assert len(made) == 1
    assert made[0].stem == "x"


def test_analyze_says_where_its_report_is(monkeypatch, capsys, place):
    monkeypatch.setattr(outputs, "write_figures", lambda *_: None)  # which take longer than the report
    status, out, _ = call(monkeypatch, capsys, "analyze", "../other/est.mcap", "--report")
    said = next(line for line in out.splitlines() if line.startswith("report"))
    assert status == 0
    assert (place / "other" / Path(said.split()[-1]).name).is_file()
    assert "report" not in call(monkeypatch, capsys, "analyze", "../other/est.mcap")[1]
