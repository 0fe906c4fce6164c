"""The documentation's site: it builds without a warning, has what is generated, and loads nothing from outside."""

from __future__ import annotations

import json
import os
import re
import runpy
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.command_line import leaves, parse
from tests.test_docs import keys_of, tables_of
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.tracking.filters import KINDS

ROOT = Path(__file__).resolve().parents[2]
LOADS = re.compile(r"<(?:script|link|img|iframe|source)\b[^>]*(?:src|href)=[\"']?(?:https?:)?//[^>]*>")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    for package in ("mkdocs", "nbconvert"):
        pytest.importorskip(package, reason="the group docs is not installed; 'make install' does it")
    folder = tmp_path_factory.mktemp("site")
    environment = os.environ | {"NO_MKDOCS_2_WARNING": "1", "DOCS_WITHOUT_SAMPLES": "1"}
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", folder],
        cwd=ROOT, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.mark.timeout(1200)
def test_nothing_is_loaded_from_outside(site):
    pages = [path for path in site.rglob("*.html") if "samples" not in path.parts]
    assert len(pages) > 40
    for path in pages:
        assert not LOADS.search(path.read_text(encoding="utf-8")), path


def test_formulas_are_drawn_without_a_script(site):
    for name in ("method", "motions", "starts", "biases", "status", "robustness", "smoothing"):
        page = (site / f"{name}.html").read_text(encoding="utf-8")
        assert page.count("<math") > 10, name
        assert "arithmatex" not in page, name


def test_the_reference_has_every_verb_key_and_filter(site):
    verbs, keys, kinds = (
        (site / "reference" / f"{name}.html").read_text(encoding="utf-8") for name in ("verbs", "keys", "kinds")
    )
    for words in leaves():
        assert f'id="{words.replace(" ", "-")}"' in verbs, words
    for table, field in Scenario.model_fields.items():
        if table != "fault":
            for model in tables_of(field.annotation):
                for key in keys_of(model):
                    assert f"<code>{table}.{key}</code>" in keys
    for kind in KINDS:
        assert f"<code>{kind}</code>" in kinds


def test_the_search_finds_keys(site):
    index = json.loads((site / "search" / "search_index.json").read_text(encoding="utf-8"))
    assert any("filter.planar_height" in one["text"] for one in index["docs"])


def test_each_notebook_has_a_page_and_can_be_downloaded(site):
    notebooks = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
    assert len(notebooks) == 8
    for path in notebooks:
        page = (site / "notebooks" / f"{path.stem}.html").read_text(encoding="utf-8")
        assert f'href="{path.name}"' in page
        assert (site / "notebooks" / path.name).is_file()


def test_the_samples_are_shown_under_commands_that_the_program_takes(site):
    """The site's build runs them; here no sample is made."""
    samples = runpy.run_path(str(ROOT / "docs" / "site" / "samples.py"))["SAMPLES"]
    page = (site / "reference" / "samples.html").read_text(encoding="utf-8")
    for one in samples:
        assert re.search(rf'<iframe[^>]*src="\.\./samples/{one.name}"', page)
        parse(shlex.split(one.command)[1:])
