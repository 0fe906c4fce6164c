"""What a release says of itself in several places is the same everywhere."""

import re
from pathlib import Path

import yaml

from zenoh_cbef import __version__

ROOT = Path(__file__).resolve().parents[1]


def test_the_citation_is_of_this_version_and_licence():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == __version__
    assert f'license = "{citation["license"]}"' in (ROOT / "pyproject.toml").read_text()


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
