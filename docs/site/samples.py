"""The sample pages: reports of this version, made by the commands that stand above them."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "build" / "samples"


@dataclass(frozen=True)
class Sample:
    """A page that a command leaves in `made`. name: of its copy in the site."""

    title: str
    name: str
    command: str
    made: str


SAMPLES = (
    Sample(
        "Report of a run",
        "report.html",
        "zenoh-cbef run tracking --run tracking-loss --set 'fault=[{kind=\"loss\", probability=0.3}]'",
        "logs/tracking-loss/report.html",
    ),
    Sample(
        "Messages between agents",
        "timeline.html",
        "zenoh-cbef timeline tracking-loss",
        "logs/tracking-loss/timeline.html",
    ),
    Sample(
        "An experiment",
        "experiment.html",
        "zenoh-cbef experiment loss --seeds 2 -o loss",
        "loss/index.html",
    ),
)

_HEAD = """# Samples

Each page below is one file that opens offline. The command above it made it, with this version.
"""


def page() -> str:
    """The page that shows them, as Markdown."""
    parts = [_HEAD]
    for one in SAMPLES:
        shown = f'<iframe class="sample" loading="lazy" title="{one.title}" src="../samples/{one.name}"></iframe>'
        parts.append(f"## {one.title}\n\n    {one.command}\n\n{shown}\n")
    return "\n".join(parts)


def made() -> dict[str, Path]:
    """The files by name; made anew where the package is newer than they are. Raises CalledProcessError."""
    paths = {one.name: FOLDER / one.made for one in SAMPLES}
    newest = max(path.stat().st_mtime for path in (ROOT / "zenoh_cbef").rglob("*.*") if "__pycache__" not in path.parts)
    if not all(path.exists() and path.stat().st_mtime > newest for path in paths.values()):
        shutil.rmtree(FOLDER, ignore_errors=True)
        FOLDER.mkdir(parents=True)
        environment = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
        for one in SAMPLES:
            subprocess.run(["/bin/sh", "-c", one.command], cwd=FOLDER, env=environment, check=True)
    return paths
