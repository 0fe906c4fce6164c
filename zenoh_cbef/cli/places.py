"""Where runs go."""

from __future__ import annotations

from pathlib import Path

from zenoh_cbef.errors import UserError


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
