"""The plain wheel, without any extra: every verb does its main work, and says what more an extra would give."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
from importlib.metadata import distribution, packages_distributions
from pathlib import Path
from typing import NamedTuple

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from zenoh_cbef.extras import EXTRA_OF

PROJECT = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())["project"]

HOOK = """
import sys

class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in NAMES:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Refuse())
"""

CALLS = """
import contextlib, io, json, sys
from zenoh_cbef.cli.calling.main import main

for words in json.loads(sys.argv[1]):
    sys.argv = ["zenoh-cbef", *words]
    out, err, status = io.StringIO(), io.StringIO(), 0
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main()
        except SystemExit as ended:
            status = ended.code or 0
    print(json.dumps([status, out.getvalue(), err.getvalue()]), flush=True)
"""

EXPERIMENT = """
base = "tracking"
seeds = 2
engine = "simulate"
[set]
steps = 5
[[vary]]
key = "consensus.rounds"
values = [1, 2]
"""

RUN = "run tracking --run plain --set steps=5 --set agents.count=3"
MAIN_WORK = (
    "--help",
    "analyze logs/plain",
    "analyze logs/plain --json",
    "compare logs/plain",
    "timeline logs/plain -o picture.html",
    "timeline logs/plain -o picture.svg",
    "export logs/plain -o run.npz",
    "export logs/plain --to csv -o tables",
    "export logs/plain --to tum -o trajectories",
    "verify logs/plain",
    "check logs/plain",
    "info logs/plain",
    "cat logs/plain -y .*/event/.*",
    "filter logs/plain -o part.mcap",
    "merge logs/plain -o joined.mcap",
    "recover logs/plain -o whole.mcap",
    "reestimate logs/plain --run again -o again.mcap",
    "design --set steps=5",
    "sim --set steps=5",
    "sim --set steps=5 --seeds 2",
    "scenario check tracking",
    "doctor",
    "certs new certificates --agents 1",
    "experiment list",
)
WITH_NOTES = {
    RUN: {"plotly": "report", "matplotlib": "report"},
    "experiment sweep.toml": dict.fromkeys(("joblib", "pyarrow", "plotly"), "experiment"),
}
REFUSED = {
    "analyze logs/plain --report": "plotly",
    "compare logs/plain -o curves.html": "plotly",
    "export logs/plain --to parquet -o parquet": "pyarrow",
    "export logs/plain --to viz -o viz.mcap": "foxglove",
    "export logs/plain --to rrd -o run.rrd": "rerun",
    "export logs/plain --to ros2 -o bag": "rosbags",
    "experiment sweep.toml --dask tcp://127.0.0.1:9 -o other": "joblib",
}


class Said(NamedTuple):
    status: int
    out: str
    err: str


def plain_distributions() -> set[str]:
    """The distributions that `pip install zenoh-cbef` brings."""
    found: set[str] = set()
    wanted = list(PROJECT["dependencies"])
    while wanted:
        requirement = Requirement(wanted.pop())
        name = canonicalize_name(requirement.name)
        if name in found or (requirement.marker and not requirement.marker.evaluate({"extra": ""})):
            continue
        found.add(name)
        wanted += distribution(name).requires or []
    return found


@pytest.fixture(scope="module")
def said(tmp_path_factory) -> dict[str, Said]:
    """What every verb says where nothing but the plain wheel's packages can be imported."""
    folder = tmp_path_factory.mktemp("plain")
    brought = plain_distributions() | {"zenoh-cbef"}
    absent = {
        name
        for name, owners in packages_distributions().items()
        if not brought & {canonicalize_name(owner) for owner in owners}
    }
    assert absent >= EXTRA_OF.keys() - {"lz4", "rerun", "distributed"}, "what is blocked is installed here"
    (folder / "sitecustomize.py").write_text(f"NAMES = {sorted(absent | {'rerun', 'distributed'})}\n{HOOK}")
    (folder / "sweep.toml").write_text(EXPERIMENT)
    lines = [RUN, *MAIN_WORK, *(line for line in WITH_NOTES if line != RUN), *REFUSED]
    done = subprocess.run(
        [sys.executable, "-c", CALLS, json.dumps([line.split() for line in lines])],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder), "COLUMNS": "200"},
        capture_output=True,
        text=True,
        check=False,
    )
    answers = [Said(*json.loads(line)) for line in done.stdout.splitlines()]
    assert len(answers) == len(lines), f"{lines[len(answers)]}: {done.stderr}"
    return dict(zip(lines, answers, strict=True))


@pytest.mark.parametrize("line", [RUN, *MAIN_WORK, *WITH_NOTES])
def test_a_verb_does_its_main_work_without_any_extra(said, line):
    assert said[line].status == 0, said[line]
    assert said[line].out


@pytest.mark.parametrize("line", WITH_NOTES)
def test_what_an_extra_would_add_is_a_note(said, line):
    for package, extra in WITH_NOTES[line].items():
        assert f"needs {package}; run: pip install 'zenoh-cbef[{extra}]'" in said[line].err


@pytest.mark.parametrize("line", REFUSED)
def test_what_only_an_extra_can_make_is_refused_in_a_sentence(said, line):
    status, _, err = said[line]
    assert (status, "Traceback" in err) == (2, False)
    assert REFUSED[line] in err
    assert "run: pip install 'zenoh-cbef[" in err


@pytest.mark.parametrize("line", ["analyze logs/plain --report", "compare logs/plain -o curves.html"])
def test_the_table_comes_before_the_refusal(said, line):
    assert "sicf" in said[line].out


def test_a_run_without_plotly_shows_its_table_and_names_no_report(said):
    out = said[RUN].out
    assert "position RMSE" in out
    assert "report.html" not in out


def test_every_extra_that_is_named_exists():
    assert set(EXTRA_OF.values()) <= PROJECT["optional-dependencies"].keys()
