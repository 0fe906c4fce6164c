"""The documentation names what there is: keys, verbs, files."""

import json
import os
import re
import runpy
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import get_args

import numpy as np
import pytest
from pydantic import BaseModel

from tests.cli.command_line import leaves
from tests.log.made import made_log
from zenoh_cbef.faults import KINDS as FAULTS
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.kinds import MESSAGE_KINDS
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.filters import KINDS

ROOT = Path(__file__).resolve().parents[1]
NAMED = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md", "deploy/README.md", "docs/**/*.md")
PAGES = sorted(path for pattern in NAMED for path in ROOT.glob(pattern))
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
VERB = re.compile(r"zenoh-cbef +(-{0,2}[a-z]+)(?: +([a-z]+))?")


def read(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def tables_of(annotation: object) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [table for part in get_args(annotation) for table in tables_of(part)]


def keys_of(table: type[BaseModel]) -> list[str]:
    return [field.alias or name for name, field in table.model_fields.items()]


def sections() -> dict[str, str]:
    parts = re.split(r"^## (.+)$", read("docs/scenario.md"), flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def rows_of(section: str) -> set[str]:
    """What the rows of a section's tables name, in the cells before the meaning."""
    cells = [line.split(" | ")[:-1] for line in section.splitlines() if line.startswith("| `")]
    return {name for row in cells for cell in row for name in re.findall(r"`([^`]+)`", cell)}


TABLES = [name for name, field in Scenario.model_fields.items() if tables_of(field.annotation)]


def test_every_table_of_the_scenario_is_documented_with_its_keys():
    documented = sections()
    for name, field in Scenario.model_fields.items():
        tables = tables_of(field.annotation)
        if not tables:
            assert name in rows_of(documented["Top level"])
        elif name != "fault":
            assert set(keys_of(tables[0])) <= rows_of(documented[f"`[{name}]`"]), name


def test_every_fault_is_documented_with_its_keys():
    documented = rows_of(sections()["`[[fault]]`"])
    for kind, fault in FAULTS.items():
        assert {kind, *keys_of(fault)} <= documented, kind


def test_defaults_stand_in_the_code_alone():
    for name, section in sections().items():
        for line in section.splitlines():
            if line.startswith("| `"):
                said = f"{name}: a key and its meaning, no type or default: {line}"
                assert len(re.split(r" \| (?:\| )?", line)) in {2, 3}, said


@pytest.mark.parametrize(
    "table", [name for name, field in Scenario.model_fields.items() if tables_of(field.annotation)]
)
def test_every_value_that_a_key_can_name_is_told(table):
    for model in tables_of(Scenario.model_fields[table].annotation):
        for key, field in model.model_fields.items():
            named = [one for one in get_args(field.annotation) if isinstance(one, str) and one != "auto"]
            section = sections()["`[[fault]]`" if table == "fault" else f"`[{table}]`"]
            if key != "kind" and named:
                told = [line for line in section.splitlines() if line.startswith("| `")]
                rows = [line for line in told if f"`{key}`" in line.rpartition(" | ")[0]]
                assert any(all(one in row for one in named) for row in rows), f"{table}.{key}"


def test_every_key_expression_and_message_field_is_documented():
    page = read("docs/log-format.md")
    keys = Keys("{run}")
    named = [
        keys.scenario,
        keys.control,
        keys.truth,
        keys.event("{sender}"),
        keys.faults,
        keys.replay,
        keys.all_live.replace("**", "{role}/{name}"),
    ]
    # The keys of an agent take its number; the page writes {id} for it.
    named += [
        one(7).replace("/7", "/{id}") for one in (keys.beacon, keys.signal, keys.range, keys.round, keys.estimate)
    ]
    for key in named:
        assert f"`{key}`" in page, key
    for field in {field for kind in MESSAGE_KINDS.values() for field in kind.fields}:
        assert f"`{field}`" in page, field


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_relative_links_lead_somewhere(path):
    for target in LINK.findall(path.read_text(encoding="utf-8")):
        if not target.startswith(("http://", "https://", "#")):
            assert (path.parent / target.split("#")[0]).exists(), target


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_named_verbs_exist(path):
    calls = leaves()
    text = path.read_text(encoding="utf-8")
    blocks = re.findall(r"^```\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    commands = [*"\n".join(blocks).splitlines(), *re.findall(r"`([^`\n]+)`", text)]
    for command in commands:
        for verb, second in VERB.findall(command):
            known = verb in calls or verb == "experiment" or f"{verb} {second}" in calls
            assert verb.startswith("-") or known, command


def test_the_example_of_a_new_filter_works_as_it_stands(monkeypatch):
    page = read("docs/adding-a-filter.md")
    code, line = re.findall(r"^```python\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    names: dict[str, object] = {"__name__": "alpha_beta"}
    monkeypatch.setitem(sys.modules, "alpha_beta", ModuleType("alpha_beta"))
    exec(compile(code, "alpha_beta.py", "exec"), names)  # noqa: S102 - the documentation's own code
    (added,) = eval(f"{{{line}}}", names).items()  # noqa: S307 - likewise
    monkeypatch.setitem(KINDS, *added)
    traces = simulate([load("tracking", ["filter.kind=alpha-beta", f"seed={seed}"]).scenario for seed in range(5)])
    errors = [np.linalg.norm((one.estimates - one.truth)[:, 75:, :3], axis=2) for one in traces]
    assert np.median(errors) < 1.0


STEP_LOSS = """
import sys
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate
settings = ["steps=40", "consensus.rounds=3", 'fault=[{kind="step-loss", probability=0.5, links="agent:1"}]']
[trace] = simulate([load("tracking", settings).scenario])
links = trace.links
for link in zip(links.source, links.destination, links.sent, links.lost, links.injected_lost, strict=True):
    print(*link)
"""


@pytest.mark.processes
def test_the_example_of_a_new_fault_works_in_a_copy_of_the_package(tmp_path):
    page = read("docs/adding-a-fault.md")
    code, beginning = re.findall(r"^```python\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    package = shutil.copytree(ROOT / "zenoh_cbef", tmp_path / "zenoh_cbef")
    (named,) = re.findall(r"^`zenoh_cbef/(.+\.py)`:$", page, re.MULTILINE)
    (package / named).write_text(code, encoding="utf-8")
    registry = package / "faults" / "__init__.py"
    text = registry.read_text(encoding="utf-8")
    old = "    for one in (\n        Loss,\n"
    assert old in text
    imported = "from zenoh_cbef.faults.step_loss import StepLoss\n"
    first = "from zenoh_cbef.faults.absence"
    registry.write_text(text.replace(old, beginning).replace(first, imported + first), encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", STEP_LOSS], capture_output=True, text=True, cwd=tmp_path, env=environment, check=False
    )
    assert done.returncode == 0, done.stderr
    links = [list(map(int, line.split())) for line in done.stdout.splitlines()]
    assert links
    for source, destination, sent, lost, injected in links:
        assert lost == injected
        if 1 in (source, destination):
            assert 0 < lost < sent
            assert lost % (sent // 40) == 0, "a step is lost as a whole"
        else:
            assert lost == 0


def test_the_reference_has_every_public_name(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs" / "site")
    page = import_module("api").page()
    for module in ("zenoh_cbef", "zenoh_cbef.extending"):
        for name in import_module(module).__all__:
            assert f"### `{name}`\n" in page
    assert " at 0x" not in page  # a default that is a function would differ from build to build
    assert "ndarray(shape" not in page  # NumPy's own text


def test_the_example_reader_needs_mcap_and_msgpack_alone_and_is_what_the_page_shows(tmp_path, monkeypatch, capsys):
    example = ROOT / "docs" / "examples" / "read_log.py"
    code = example.read_text(encoding="utf-8")
    assert f"```python\n{code}```" in read("docs/log-format.md")
    assert set(re.findall(r"^(?:from|import) (\w+)", code, re.MULTILINE)) - sys.stdlib_module_names == {
        "mcap",
        "msgpack",
    }
    log = made_log(tmp_path / "run.mcap", "steps=7", "agents.count=3")
    monkeypatch.setattr(sys, "argv", [str(example), str(log)])
    runpy.run_path(str(example))
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == [
        "scenario.toml",
        "scenario.resolved.toml",
        *map("agent/{}".format, range(3)),
    ]
    assert re.fullmatch(r"agent/1 step 7( -?\d+\.\d{3}\+-\d+\.\d{3}){3}", lines[3])


def test_named_files_of_the_package_exist():
    for path in PAGES:
        text = path.read_text(encoding="utf-8")
        made = re.findall(r"^`(.+)`:$", text, re.MULTILINE)  # above the code of a file that the reader makes
        for name in re.findall(r"`((?:zenoh_cbef|tests|benchmarks|deploy)/[\w./-]+)`", text):
            assert name in made or (ROOT / name).exists(), f"{path.name}: {name}"


def test_the_pages_name_the_files_that_have_what_they_speak_of():
    page = read("docs/adding-a-filter.md")
    for name, file in re.findall(r"`(\w+)` (?:of|in) `(zenoh_cbef/[\w/.]+)`", page):
        assert re.search(rf"^(class|def) {name}\b", read(file), re.MULTILINE), f"{name} is not in {file}"


def test_every_page_is_in_the_sites_nav():
    nav = read("mkdocs.yml").partition("\nnav:\n")[2]
    named = re.findall(r"[\w./-]+\.md", nav)
    assert len(named) == len(set(named)), "a page stands in one place"
    folder = ROOT / "docs"
    pages = {path.relative_to(folder).as_posix() for path in folder.rglob("*.md") if path.parent.name != "paper"}
    pages |= {f"notebooks/{path.stem}.md" for path in NOTEBOOKS}
    assert pages <= set(named), f"give each of these a line under nav in mkdocs.yml: {sorted(pages - set(named))}"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_are_kept_without_outputs_and_lead_somewhere(path):
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    assert "".join(cells[0]["source"]).startswith("# ")
    for cell in cells:
        if cell["cell_type"] == "code":
            assert cell["outputs"] == []
            assert cell["execution_count"] is None
            assert not "".join(cell["source"]).startswith("!"), "%%bash fails where its command does, ! does not"
        else:
            for target in LINK.findall("".join(cell["source"])):
                assert (path.parent / target.split("#")[0]).exists(), target
    assert f"(notebooks/{path.name})" in read("docs/api.md")


def test_documentation_names_no_place_of_the_machine_it_was_written_on():
    for path in PAGES:
        assert not re.search(r"/(work|home|root|tmp|Users)/", path.read_text(encoding="utf-8")), path.name
