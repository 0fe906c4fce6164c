"""The draft of the paper: it has the journal's form, cites what it lists, and claims what was measured."""

import re
from pathlib import Path

import yaml

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "paper"
_, HEAD, TEXT = (FOLDER / "paper.md").read_text(encoding="utf-8").split("---\n", 2)


def test_it_has_the_form_of_the_journal():
    head = yaml.safe_load(HEAD)
    assert {"title", "tags", "authors", "affiliations", "date", "bibliography"} <= set(head)
    assert (FOLDER / head["bibliography"]).exists()
    headings = re.findall(r"^# (.+)$", TEXT, re.MULTILINE)
    assert headings[:4] == ["Summary", "Statement of need", "State of the field", "Software design"]
    assert "Research impact statement" in headings
    assert headings[-3:] == ["AI usage disclosure", "Acknowledgements", "References"]
    assert 750 <= len(TEXT.split()) <= 1750


def test_what_it_cites_is_listed_and_what_is_listed_is_cited():
    listed = re.findall(r"^@\w+\{(\w+),", (FOLDER / "paper.bib").read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(set(re.findall(r"@(\w+)", TEXT))) == sorted(listed)


def test_its_figures_are_those_of_the_benchmarks():
    measured = (FOLDER.parent / "benchmarks.md").read_text(encoding="utf-8")
    (section,) = re.findall(r"^# Quality and measurements\n(.*?)^# ", TEXT, re.DOTALL | re.MULTILINE)
    for figure in re.findall(r"\d+\.\d+", section):
        assert figure in measured, figure
