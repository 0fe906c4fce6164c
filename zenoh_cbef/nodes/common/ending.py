"""Why a process ends, as data for its launcher. Its words on standard error are for users."""

from __future__ import annotations

import json
import os
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

PLACE = "ZENOH_CBEF_ENDING"
"""The environment variable with the file that a launched process writes its ending into."""


@dataclass(frozen=True)
class Ending:
    """Why a process ends.

    cause: its scenario kills it ("crash"), another program holds its port ("port"), or the target was started again
    and waits for a new process ("again"). steps_away: after how many steps a killed process is to be there again;
    None: never. seconds_away: how long that is; 0 in lockstep, where the others wait for it.
    """

    cause: Literal["crash", "port", "again"]
    steps_away: int | None = None
    seconds_away: float = 0.0

    def tell(self) -> None:
        """Leave this for the launcher, if one has started this process."""
        if place := os.environ.get(PLACE):
            with suppress(OSError):  # the launcher and its folder are gone
                Path(place).write_text(json.dumps(asdict(self)), encoding="utf-8")


def ending_at(place: Path) -> Ending | None:
    """What a process left there; None where it left nothing."""
    try:
        return Ending(**json.loads(place.read_text(encoding="utf-8")))
    except (OSError, ValueError):
        return None
