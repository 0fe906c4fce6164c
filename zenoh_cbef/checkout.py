"""Which commit a checkout of the project is at: a version alone does not tell one checkout from another."""

from __future__ import annotations

from pathlib import Path

_SHORT = 9


def here() -> str:
    """The commit of the checkout that this package is in; empty where it is in none."""
    return commit(Path(__file__).parents[1])


def commit(root: Path) -> str:
    """The abbreviated commit of a Git checkout, read without Git; empty where a folder is none."""
    try:
        folder = _git_folder(root)
        head = (folder / "HEAD").read_text(encoding="ascii").strip()
        name = head.removeprefix("ref: ")
        return (head if name == head else _named(folder, name))[:_SHORT]
    except (OSError, ValueError):
        return ""


def _git_folder(root: Path) -> Path:
    place = root / ".git"
    if place.is_dir():
        return place
    # A worktree's `.git` is a file that names its folder.
    return root / place.read_text(encoding="utf-8").removeprefix("gitdir: ").strip()


def _named(folder: Path, name: str) -> str:
    """The commit of a branch: in a file of its own, or in the list of packed ones."""
    shared = folder / "commondir"
    common = folder / shared.read_text(encoding="utf-8").strip() if shared.exists() else folder
    if (common / name).exists():
        return (common / name).read_text(encoding="ascii").strip()
    lines = (common / "packed-refs").read_text(encoding="utf-8").splitlines()
    return next((line.partition(" ")[0] for line in lines if line.endswith(f" {name}")), "")
