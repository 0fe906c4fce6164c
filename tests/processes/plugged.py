"""The example package of docs/plugins.md, installed by pip into a folder of its own."""

import shutil
import subprocess
import sys
from pathlib import Path

EXAMPLE = Path(__file__).resolve().parents[2] / "docs" / "examples" / "plugin"


def installed(folder: Path) -> Path:
    """Where the package is, after `pip install`."""
    source = shutil.copytree(EXAMPLE, folder / "source")
    site = folder / "site"
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps", "--no-build-isolation"]
    subprocess.run([*pip, "--disable-pip-version-check", "--target", site, source], check=True)
    return site
