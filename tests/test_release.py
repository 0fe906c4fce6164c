"""What a release says of itself in several places is the same everywhere."""

import json
import re
import subprocess
import tomllib
from pathlib import Path

import yaml

from zenoh_cbef import VERSION, __version__
from zenoh_cbef.checkout import commit

ROOT = Path(__file__).resolve().parents[1]


def test_the_citation_is_of_this_version_and_licence():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == VERSION
    assert f'license = "{citation["license"]}"' in (ROOT / "pyproject.toml").read_text()


def test_the_two_citations_and_the_project_say_the_same():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    meta = json.loads((ROOT / "codemeta.json").read_text())
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert (meta["name"], meta["version"], meta["description"]) == (citation["title"], VERSION, citation["abstract"])
    assert meta["license"] == f"https://spdx.org/licenses/{project['license']}"
    assert [one["name"] for one in meta["author"]] == [one["name"] for one in citation["authors"]]
    assert meta["keywords"] == citation["keywords"]
    assert meta["softwareRequirements"] == [re.split("[<>=]", one)[0] for one in project["dependencies"]]


def test_the_version_tells_checkouts_apart(tmp_path):
    def git(*words: str) -> str:
        who = ["-c", "user.name=a", "-c", "user.email=a@b"]
        return subprocess.run(["git", *who, *words], cwd=tmp_path, capture_output=True, text=True, check=True).stdout

    assert commit(tmp_path) == ""
    git("init", "-b", "main")
    assert commit(tmp_path) == "", "there is no commit yet"
    git("commit", "--allow-empty", "-m", "first")
    told = [commit(tmp_path)]
    git("pack-refs", "--all")
    told.append(commit(tmp_path))
    git("worktree", "add", "beside")
    told.append(commit(tmp_path / "beside"))
    git("checkout", "--detach")
    told.append(commit(tmp_path))
    assert {*told} == {git("rev-parse", "HEAD")[:9]}
    git("commit", "--allow-empty", "-m", "second")
    assert commit(tmp_path) != told[0] == commit(tmp_path / "beside")


def test_a_checkout_says_its_commit_with_its_version():
    here = commit(ROOT)
    assert __version__ == (f"{VERSION}+g{here}" if here else VERSION)


def test_the_workflow_tests_every_python_that_the_package_names():
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / "tests.yml").read_text())
    named = re.findall(r"Python :: (3\.\d+)", (ROOT / "pyproject.toml").read_text())
    assert workflow["jobs"]["test"]["strategy"]["matrix"]["python"] == named


def test_every_decision_is_listed_with_its_date():
    folder = ROOT / "docs" / "decisions"
    listed = re.findall(r"\]\((\d{4}-[\w-]+\.md)\) \| (\d{4}-\d\d-\d\d)", (folder / "README.md").read_text())
    assert [name for name, _ in listed] == sorted(path.name for path in folder.glob("0*.md"))
    for name, date in listed:
        assert (folder / name).read_text().splitlines()[2] == date


def test_the_make_file_explains_each_of_its_targets():
    text = (ROOT / "Makefile").read_text()
    (phony,) = re.findall(r"^\.PHONY: (.*)$", text, re.MULTILINE)
    assert set(phony.split()) <= set(re.findall(r"^(\w+):.*?## ", text, re.MULTILINE))
