"""Files that get their name when they are whole, and those that cannot be written, as sentences."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from zenoh_cbef.errors import UserError


@contextmanager
def writing(place: object, remedy: str = "choose another --output") -> Iterator[None]:
    """Raise UserError, with the remedy, where what the block writes to this place cannot be written."""
    try:
        yield
    except OSError as error:
        raise UserError(f"cannot write {place}: {error.strerror}; {remedy}") from None


def refuse_in_file(path: Path, remedy: str = "choose another --output") -> None:
    """Raise UserError, with the remedy, where a file is in the place of a folder that is to hold the path."""
    there = next((folder for folder in path.parents if folder.exists()), Path())
    if not there.is_dir():
        raise UserError(f"cannot write {path}: {there} is a file; {remedy}")


def make_folder(folder: Path, remedy: str = "choose another --output") -> None:
    """Make a folder, and those that it stands in, where they are not there. Raises UserError where that fails."""
    with writing(folder, remedy):
        folder.mkdir(parents=True, exist_ok=True)


def must_be_new(log: Path, remedy: str) -> None:
    """Raise UserError, with the remedy, where a log is there already, or cannot be there."""
    refuse_in_file(log, "choose another place for the log")
    if log.exists():
        raise UserError(f"{log} exists and logs are never overwritten; {remedy}")


@contextmanager
def whole(output: Path) -> Iterator[Path]:
    """Where to write what is to be `output`, a file or a folder, which has that name when the block has ended.

    Where the block fails nothing is left, and what was there before stays. Raises UserError for an OSError.
    """
    with writing(output, "make room, or choose another --output"), replacing(output) as fresh:
        yield fresh


def write_whole(path: Path, text: str) -> None:
    """Write a text file, which is whole or not there. Raises UserError."""
    with whole(path) as fresh:
        fresh.write_text(text, encoding="utf-8")


@contextmanager
def replacing(output: Path) -> Iterator[Path]:
    """As `whole`, for callers with a remedy of their own. Raises OSError, and UserError if it gets no folder."""
    make_folder(output.parent)
    with tempfile.TemporaryDirectory(prefix=".export-", dir=output.parent) as folder:
        fresh = Path(folder) / output.name
        yield fresh
        fresh.replace(output)
