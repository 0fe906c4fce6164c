"""Pages fit a phone: as wide as its screen, and what is wider scrolls in its own place."""

import re
from pathlib import Path

import pytest

from zenoh_cbef.analysis.compare import write_picture
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate

PACKAGE = Path(__file__).resolve().parents[1] / "zenoh_cbef"
VIEWPORT = '<meta name="viewport" content="width=device-width, initial-scale=1">'


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.html")), ids=lambda path: path.name)
def test_tables_scroll_by_themselves_on_a_narrow_screen(path):
    page = path.read_text(encoding="utf-8")
    assert VIEWPORT in page
    (narrow,) = re.findall(r"^@media \(max-width: 640px\) \{(.*)\}$", page, re.MULTILINE)
    assert "table { display: block; overflow-x: auto; }" in narrow


def test_the_picture_of_compared_runs_is_as_wide_as_the_screen(tmp_path):
    pytest.importorskip("plotly")
    analyses = analyze(simulate([load("tracking", ["steps=5"]).scenario]))
    write_picture(analyses, ["a"], tmp_path / "curves.html")
    page = (tmp_path / "curves.html").read_text(encoding="utf-8")
    assert VIEWPORT in page
    assert '"responsive": true' in page
