"""Fetches the logs of a run from the recorders of its hosts."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.lives import new_life
from zenoh_cbef.protocol.log_service import Offer, fetch, offers
from zenoh_cbef.protocol.reach import unreachable
from zenoh_cbef.protocol.session import Connection, open_session

_AGAIN_SECONDS = 0.5


def fetch_logs(
    run: str,
    connection: Connection,
    folder: Path,
    *,
    wanted: int,
    patience: float,
    waiting: Callable[[int], None],
    progress: Callable[[Sequence[Offer], int], None],
) -> list[Path]:
    """Copy the logs of so many recorders into a folder; returns the first file of each.

    waiting: told how many recorders hand out their logs so far; they do after the run. progress: told what is fetched,
    and how many bytes of it have come. Raises UserError where too few recorders do within `patience` s.
    """
    keys, until = Keys(run), time.monotonic() + patience
    with open_session(replace(connection, life=new_life(())), patience) as session:
        while len(found := offers(session, keys)) < wanted:
            waiting(len(found))
            if time.monotonic() > until:
                raise UserError(_too_few(run, connection, found, wanted, patience))
            time.sleep(_AGAIN_SECONDS)
        come, firsts = 0, []
        progress(found, come)

        def more(count: int) -> None:
            nonlocal come
            come += count
            progress(found, come)

        for number, offer in enumerate(found):
            place = folder / str(number)
            place.mkdir()
            # The names of the parts of a log follow from that of the first.
            paths = [place / ("run.mcap" if one == 1 else f"run.{one}.mcap") for one in range(1, len(offer.names) + 1)]
            fetch(session, keys, offer, paths, more)
            firsts.append(paths[0])
    return firsts


def _too_few(run: str, connection: Connection, found: Sequence[Offer], wanted: int, patience: float) -> str:
    for endpoint in connection.connect:
        if trouble := unreachable(endpoint):
            return trouble
    here = f"only {', '.join(one.recorder for one in found)}" if found else "no recorder"
    return (
        f"after {patience:g} s {here} of run {run!r} hands out a log, of {wanted}; recorders do after the run, where "
        "they were started with --stay SECONDS; connect to each of them, or to their router, or set --logs"
    )
