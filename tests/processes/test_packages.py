"""Wheel and sdist: what they hold, and that the plain package tracks without any extra."""

from __future__ import annotations

import os
import subprocess
import sys
import tarfile
import tomllib
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
EXTRAS = ("plotly", "matplotlib", "joblib", "pyarrow", "starlette", "pandas", "xarray", "rosbags", "lz4")
WITHOUT_EXTRAS = f"""
import sys
from importlib.abc import MetaPathFinder

class NoExtras(MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {EXTRAS}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, NoExtras())
"""


def run(*words: str | Path, cwd: Path, **more: str) -> subprocess.CompletedProcess[str]:
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"} | more
    done = subprocess.run(words, cwd=cwd, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The folder with both packages, built without a network by the backend that pyproject.toml names."""
    pytest.importorskip("hatchling", reason="the build backend is not installed; 'make install' does it")
    folder = tmp_path_factory.mktemp("dist")
    run(sys.executable, "-m", "hatchling", "build", "-d", str(folder), cwd=ROOT)
    return folder


@pytest.fixture(scope="module")
def plain(built, tmp_path_factory):
    """An environment with the wheel alone. What it depends on comes from this one, less all packages of extras."""
    folder = tmp_path_factory.mktemp("plain")
    venv.create(folder, with_pip=False, symlinks=True)
    (wheel,) = built.glob("*.whl")
    (packages,) = folder.glob("lib/python*/site-packages")
    program = folder / "bin" / "python"
    run(sys.executable, "-m", "pip", "--python", program, "install", "--no-deps", "--no-index", wheel, cwd=folder)
    (here,) = {path for path in sys.path if path.endswith("site-packages")}
    (packages / "without_extras.py").write_text(WITHOUT_EXTRAS)
    # The second line follows the first: this environment's own editable package stays out, as .pth files of `here` do.
    (packages / "dependencies.pth").write_text(f"import without_extras\n{here}\n")
    return folder


@pytest.mark.timeout(600)
def test_the_plain_wheel_runs_to_its_table_and_proves_it(plain, tmp_path):
    program = plain / "bin" / "zenoh-cbef"
    asked = "import zenoh_cbef; print(zenoh_cbef.__file__)"
    assert str(plain) in run(plain / "bin" / "python", "-c", asked, cwd=tmp_path).stdout
    done = run(program, "run", "tracking", "--set", "steps=40", cwd=tmp_path, COLUMNS="80")
    assert "position RMSE" in done.stdout
    assert "'zenoh-cbef[report]'" in done.stderr + done.stdout
    assert run(program, "verify", cwd=tmp_path).stdout == "equal bit for bit: 2640 messages of 40 steps\n"


def test_the_sdist_has_what_it_takes_to_build_and_to_cite(built):
    (path,) = built.glob("*.tar.gz")
    with tarfile.open(path) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {"pyproject.toml", "README.md", "LICENSE", "CITATION.cff", "codemeta.json", "mkdocs.yml"} <= names
    assert not {name for name in names if name.startswith(("site/", "build/", "logs/run", ".venv"))}


def test_the_extras_that_are_kept_out_are_those_of_the_project():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    assert set(EXTRAS) <= {one.partition(">")[0] for packages in extras.values() for one in packages}
