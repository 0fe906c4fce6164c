"""Figures and tables for papers, and the runs in logs/ as a collection."""

from __future__ import annotations

import csv
import io
import json
import re
import resource
import shutil
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from tests.cli.command_line import call
from tests.log.hand_made import Maker
from tests.within import within
from zenoh_cbef.analysis.printed import Style, drawn
from zenoh_cbef.analysis.typeset import FORMATS, latex, save
from zenoh_cbef.experiment.figures import written_value
from zenoh_cbef.pages.parts import Table
from zenoh_cbef.plain import Json

GOLDEN = Path(__file__).parents[1] / "golden"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two runs in logs/."""
    place = tmp_path_factory.mktemp("collection")
    for name, log in (("first", "cbef"), ("second", "crash")):
        (place / "logs" / name).mkdir(parents=True)
        shutil.copy(GOLDEN / f"{log}.mcap", place / "logs" / name / "run.mcap")
    assert within(place, "analyze", "second").returncode == 0
    return place


@pytest.fixture
def old(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run in logs/ of a folder where the test is."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "logs" / "old").mkdir(parents=True)
    shutil.copy(GOLDEN / "loss.mcap", tmp_path / "logs" / "old" / "run.mcap")


@pytest.mark.slow
def test_a_figure_says_in_each_format_what_made_it(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nothing")  # no LaTeX is needed for PGF
    formats = [part for kind in ("pdf", "svg", "pgf", "png") for part in ("--format", kind)]
    wide = ["--width", "5", "--only", "msee", "--only", "timeline", "--label", "time (s)=Zeit (s)"]
    done = within(folder, "figures", "first", "-o", "paper", *formats, *wide)
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.split()) == 8
    for name in ("msee", "timeline"):
        files = {kind: (folder / "paper" / f"{name}.{kind}").read_bytes() for kind in ("pdf", "svg", "pgf", "png")}
        assert all(b"figures first -o paper" in text and b"zenoh-cbef 0" in text for text in files.values())
        assert files["pdf"].startswith(b"%PDF")
        assert ET.fromstring(files["svg"]).get("width") == "360pt"
        picture = files["pgf"].decode()
        assert "Zeit (s)" in picture
        assert picture.count("\\begin{pgfscope}") == picture.count("\\end{pgfscope}") > 10
        assert picture.count("{pgfpicture}") == 2


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--format", "bmp"], "pdf, svg, pgf, png"),
        (["--style", "no-such-style"], "name another"),
        (["--only", "nix"], "there are innovation"),
        (["--label", "time"], "TEXT=WORDS"),
        (["--only", "msee", "--label", "time (sec)=t"], "did you mean 'time (s)'?"),
    ],
)
def test_a_mistake_is_one_sentence(folder: Path, options: list[str], said: str) -> None:
    done = within(folder, "figures", "first", "-o", "wrong", *options)
    assert done.returncode == 2
    assert said in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_runs_are_found_tagged_compared_and_deleted(folder: Path) -> None:
    def names(*options: str) -> list[str]:
        return [one["name"] for one in json.loads(within(folder, "runs", "list", "--json", *options).stdout)]

    assert not (folder / "logs" / "first" / "metrics.json").exists()
    assert names() == ["first", "second"]
    assert names("--filter", "cbef") == ["first"]
    nothing = within(folder, "runs", "list", "--filter", "foo", "--json")
    assert (nothing.returncode, json.loads(nothing.stdout)) == (0, [])
    assert nothing.stderr == "note: no run in logs/ has the filter 'foo'; they have cbef and sicf\n"
    assert names("--fault", "crash") == ["second"]
    assert names("--result", "unknown") == []  # its log says what came of it
    assert names("--result", "lost", "--scenario", "cbef") == ["first"]
    Maker(folder / "logs" / "early.mcap").log.close({"status": "stopped"})
    (folder / "logs" / "early").mkdir()
    (folder / "logs" / "early.mcap").rename(folder / "logs" / "early" / "run.mcap")
    assert names("--result", "stopped") == ["early"], "it was stopped before its first step"
    shutil.rmtree(folder / "logs" / "early")
    assert (folder / "logs" / "first" / "metrics.json").exists()
    (folder / "empty").mkdir(exist_ok=True)
    nothing = within(folder / "empty", "runs", "list", "--filter", "foo")
    assert nothing.stderr == "note: there is no run in logs/ of this folder\n"
    refused = within(folder, "runs", "list", "--result", "finished")
    assert refused.returncode == 2
    assert "complete, stopped" in refused.stderr
    assert within(folder, "runs", "tag", "first", "second", "--add", "paper").returncode == 0
    assert names("--tag", "paper") == ["first", "second"]
    assert len(json.loads(within(folder, "compare", "@paper", "--json").stdout)) == 2
    assert within(folder, "runs", "tag", "first", "--remove", "paper").stdout == "first: no tag\n"
    assert names("--tag", "paper") == ["second"]
    refused = within(folder, "compare", "@nothing")
    assert refused.returncode == 2
    assert "runs list" in refused.stderr
    shutil.copytree(folder / "logs" / "first", folder / "logs" / "third")
    assert within(folder, "runs", "rm", "third", "third", "--yes").returncode == 0
    assert names() == ["first", "second"]
    assert within(folder, "runs", "rm", "third", "--yes").returncode == 2
    assert json.loads(within(folder, "runs", "show", "second").stdout)["agents"] > 0


@pytest.mark.parametrize(
    ("answer", "status", "said"),
    [
        ("", 2, "nothing was deleted, as no answer came; in a script give --yes"),
        ("n\n", 1, "nothing was deleted"),
        ("y\n", 0, ""),
    ],
)
@pytest.mark.usefixtures("old")
def test_a_run_is_deleted_only_where_the_user_agrees(monkeypatch, capsys, answer, status, said):
    monkeypatch.setattr("sys.stdin", io.StringIO(answer))
    found, _, err = call(monkeypatch, capsys, "runs", "rm", "old")
    assert found == status
    assert said in err
    assert Path("logs/old").exists() == (status != 0)


def test_tables_are_latex_or_csv(folder: Path) -> None:
    text = within(folder, "compare", "first", "second", "--table", "latex").stdout
    rows = [line for line in text.splitlines() if line.endswith(r"\\")]
    assert len(rows) == 3
    assert {line.count(" & ") for line in rows} == {
        len(re.findall(r"[lr]", text.split("tabular}{")[1].split("}")[0])) - 1
    }
    assert "compare first second" in text.splitlines()[0]
    table = list(csv.reader(io.StringIO(within(folder, "analyze", "first", "--table", "csv").stdout)))
    assert table[0][1:] == ["network", "centralised", "bound", "network / centralised"]
    assert table[1][0] == "position RMSE (m)"


def test_no_row_of_latex_begins_with_what_the_row_above_takes_for_its_own() -> None:
    text = latex(Table("", ["[a]", "b"], [["[]", "1"], ["*", "2"], ["c", "[3]"]]))
    assert text.splitlines()[-7:] == [
        r"{}[a] & b \\",
        r"\midrule",
        r"{}[] & 1 \\",
        r"{}* & 2 \\",
        r"c & [3] \\",
        r"\bottomrule",
        r"\end{tabular}",
    ]


def test_columns_of_words_stand_left_in_latex() -> None:
    table = Table("", ["loss", "graph", "filter", "RMSE"], [["0.1", "ring", "mine:Mine", "0.3 (0.1 to 0.4)"]] * 2)
    assert r"\begin{tabular}{lllr}" in latex(table)


def test_a_figure_that_does_not_fit_on_the_disk_is_an_error_of_the_disk(tmp_path: Path) -> None:
    times = list(range(3000))
    line = {"type": "scatter", "mode": "lines", "x": times, "y": [7 * one * one % 1000 for one in times], "name": "a"}
    picture = drawn({"data": [line], "layout": {}}, Style(3.0, 2.0))
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    for kind in FORMATS:
        resource.setrlimit(resource.RLIMIT_FSIZE, (4000, limits[1]))
        try:
            with pytest.raises(OSError, match="File too large"):
                save(picture, tmp_path / f"a.{kind}", kind, "a")
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize(("value", "words"), [([], "none"), ([{"kind": "loss"}], "loss"), (0, "0"), (False, "false")])
def test_no_fault_is_told_as_none(value: Json, words: str) -> None:
    assert written_value(value) == words


@pytest.mark.slow
def test_the_figures_and_the_table_of_an_experiment_are_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    (tmp_path / "base.toml").write_text("steps = 15\n[agents]\ncount = 4\n")
    (tmp_path / "small.toml").write_text(
        'base = "base.toml"\nseeds = 2\n'
        '[[vary]]\nkey = "consensus.rounds"\nvalues = [2, 4]\n'
        '[[vary]]\nkey = "filter.kind"\nvalues = ["icf", "sicf"]\n'
    )
    done = within(tmp_path, "experiment", "run", "small.toml", "-o", "found", "--jobs", "1")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "found" / "results.tex").read_text().count(r"\\") == 5
    assert r"\begin{tabular}{llrr}" in (tmp_path / "found" / "results.tex").read_text(), "all metrics do not fit a page"
    page = (tmp_path / "found" / "index.html").read_text()
    assert "How large is the error of the position?" in page
    assert "consensus rounds" in page
    assert "\x1b" not in done.stdout + done.stderr, "nothing moves in a pipe, also where a notebook wishes for colours"
    again = ["experiment", "run", "small.toml", "-o", "found", "--jobs", "1"]
    table = within(tmp_path, *again, "--metric", "position_rmse", "--table", "csv")
    rows = list(csv.reader(io.StringIO(table.stdout)))
    assert [row[0] for row in rows] == ["consensus rounds", "2", "4"]
    assert rows[0][1:] == ["icf", "sicf"]
    assert all(" to " in cell for row in rows[1:] for cell in row[1:])
    table = within(tmp_path, *again, "--table", "latex")
    assert "consensus rounds & filter & runs & position RMSE (m) \\\\" in table.stdout
    assert "experiment run small.toml" in table.stdout.splitlines()[0]
    for wrong, said in (("rmse", "position_rmse"), ("position_rmse", "--table")):
        options = ["--metric", wrong] + ["--table", "csv"] * (said != "--table")
        refused = within(tmp_path, *again, *options)
        assert refused.returncode == 2
        assert said in refused.stderr
    formats = [part for kind in ("pdf", "svg", "pgf") for part in ("--format", kind)]
    named = ["--only", "position-rmse", "--label", "consensus rounds=Runden", "--style", "grayscale"]
    done = within(tmp_path, "figures", "found", "-o", "paper", *named, *formats)
    assert done.returncode == 0, done.stderr
    printed = {path.name: path.read_bytes() for path in (tmp_path / "paper").iterdir()}
    assert set(printed) == {"position-rmse.pdf", "position-rmse.svg", "position-rmse.pgf"}
    assert all(b"figures found -o paper" in text and b"zenoh-cbef 0" in text for text in printed.values())
    assert b"Runden" in printed["position-rmse.pgf"]
    assert ET.fromstring(printed["position-rmse.svg"]).get("width") == "252pt"
