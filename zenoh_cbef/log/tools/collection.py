"""The runs in logs/, each in a folder of its own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from zenoh_cbef.errors import UserError


@contextmanager
def place_of_log(run: str, chosen: Path | None) -> Iterator[Path]:
    """The log to write: the chosen one, or one in a new folder of logs/, which goes again if nothing came into it.

    Raises UserError where the folder cannot be made.
    """
    path = chosen or new_folder(run) / "run.mcap"
    try:
        yield path
    finally:
        if chosen is None:
            with suppress(OSError):  # there is a log in it
                path.parent.rmdir()


def new_folder(run: str) -> Path:
    """Make logs/RUN, with a number behind it where that exists. Raises UserError where it cannot be made."""
    folder = Path("logs") / run
    for attempt in range(2, 100):
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            folder = Path("logs") / f"{run}-{attempt}"
        except OSError as error:
            raise UserError(f"cannot make {folder}: {error.strerror}; choose another place for the log") from None
        else:
            return folder
    raise UserError(f"logs/{run} and 98 more exist; choose another place for the log")
