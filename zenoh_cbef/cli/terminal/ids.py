"""Lists of agents, as users write and read them."""

from __future__ import annotations

import re
from collections.abc import Sequence

from zenoh_cbef.errors import UserError
from zenoh_cbef.quantities import MOST_AGENTS

_IDS = re.compile(r"(\d+)(?:-(\d+))?")


def ids_of(text: str, option: str = "IDS") -> list[int]:
    """The agents of a list such as "0-49" or "0,3,5-9", in ascending order. Raises UserError."""
    found: set[int] = set()
    for part in text.split(","):
        match = _IDS.fullmatch(part.strip())
        first, last = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
        if first > last or last >= MOST_AGENTS:
            raise UserError(
                f"{option} {text!r:.60} is no list of agents; write it as in 0-49, or 0,3,5-9, with ids from 0 to "
                f"{MOST_AGENTS - 1}"
            )
        found.update(range(first, last + 1))
    return sorted(found)


def shortened(ids: Sequence[int]) -> str:
    """A list of agents in ascending order as `ids_of` reads it."""
    runs: list[list[int]] = []
    for one in ids:
        if runs and one == runs[-1][-1] + 1:
            runs[-1].append(one)
        else:
            runs.append([one])
    return ",".join(str(run[0]) if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs)
