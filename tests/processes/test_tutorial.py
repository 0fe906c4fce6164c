"""The tutorial, word for word: every command of its pages in their order, and what it prints."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted((ROOT / "docs" / "tutorial").glob("*.md"))
PATH = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
SAVED = re.compile(r"as `([\w.]+)`:\n\n```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)
MARK = "--- end of command"


def commands(page: str) -> list[tuple[str, str]]:
    """The commands of a page, each with what it prints."""
    found: list[tuple[str, str]] = []
    for kind, block in FENCE.findall(page):
        if kind == "console":
            first, *parts = re.split(r"^\$ (.*)\n", block, flags=re.MULTILINE)
            assert not first, f"output without a command: {first}"
            found += zip(parts[::2], parts[1::2], strict=True)
    return found


def as_shown(text: str) -> str:
    return "".join(f"{line.rstrip()}\n" for line in text.splitlines())


def pattern(shown: str) -> str:
    """A regular expression for an output in which `...` is any text, and a line of it any number of lines."""
    lines = (line.rstrip() for line in shown.splitlines())
    return "".join(
        r"(?:.*\n)*?" if line == "..." else re.escape(line).replace(r"\.\.\.", ".*") + r"\n" for line in lines
    )


def free_ports() -> int:
    """The first of a row of ports that are free on loopback."""
    for first in range(20_000, 30_000, 40):
        taken = [socket.socket() for _ in range(20)]
        try:
            for number, one in enumerate(taken):
                one.bind(("127.0.0.1", first + number))
        except OSError:
            continue
        else:
            return first
        finally:
            for one in taken:
                one.close()
    raise AssertionError("no row of ports is free")


class Reader:
    """A reader who follows the pages in one folder, each once: a page goes on from what those before it made."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.done = folder, list[Path]()

    def follow(self, path: Path) -> tuple[str, int]:
        """Call the commands of a page; returns what they print, and the status."""
        page, story, first = path.read_text(encoding="utf-8"), self.folder / "story", free_ports()
        for name, code in SAVED.findall(page):
            (story / name).write_text(code, encoding="utf-8")
        script = "".join(f"{line}\necho '{MARK}'\n" for line, _ in commands(page))
        script = re.sub(r":74(\d\d)\b", lambda port: f":{first + int(port[1]) - 47}", script)
        process = subprocess.Popen(
            ["bash", "-euc", f"exec 2>&1\n{script}"], cwd=story if story.exists() else self.folder, text=True,
            env=os.environ | {"PATH": PATH, "COLUMNS": "80", "XDG_RUNTIME_DIR": str(self.folder)},
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True,
        )  # fmt: skip
        try:
            said, _ = process.communicate(timeout=1100)
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
        self.done.append(path)
        return said, process.returncode


@pytest.fixture(scope="module")
def reader(tmp_path_factory):
    return Reader(tmp_path_factory.mktemp("tutorial"))


@pytest.mark.timeout(1200)
@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_every_command_does_what_the_page_shows(path, reader):
    # Where a test of one page is called alone.
    for before in PAGES[: PAGES.index(path)]:
        if before not in reader.done:
            reader.follow(before)
    told = commands(path.read_text(encoding="utf-8"))
    said, status = reader.follow(path)
    printed = said.split(f"{MARK}\n")
    for (line, shown), out in zip(told, printed, strict=False):
        assert re.fullmatch(pattern(shown), as_shown(out)), f"$ {line}\n{out}\nand the page has\n{shown}"
    assert status == 0, said
    assert len(printed) == len(told) + 1


def test_the_pages_lead_from_one_to_the_next_and_name_targets_of_make():
    targets = re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    for path, following in pairwise(PAGES):
        page = path.read_text(encoding="utf-8")
        assert f"({following.name})" in page.splitlines()[-1]
        assert set(re.findall(r"^make (\w+)$", page, re.MULTILINE)) <= set(targets)


def test_dots_stand_for_any_text_and_for_nothing_else():
    assert re.fullmatch(pattern("a\n...\nb ... m\n"), "a\nx\ny\nb 3 m\n")
    assert re.fullmatch(pattern("...\nb\n"), "b\n")
    assert re.fullmatch(pattern("b\n...\n"), "b\nc\nd\n")
    assert not re.fullmatch(pattern("a\nb\n"), "a\nb\nc\n")
    assert not re.fullmatch(pattern("0.0996 m\n"), "0.0997 m\n")
