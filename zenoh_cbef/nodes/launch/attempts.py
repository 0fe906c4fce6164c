"""A run from its start to its end, started again where another program takes one of its ports first."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from zenoh_cbef.nodes.common.recording import Status
from zenoh_cbef.nodes.launch.launcher import Death, Launcher
from zenoh_cbef.scenario.load import Loaded

_ATTEMPTS = 4


def launch(
    arguments: Sequence[str],
    loaded: Loaded,
    run: str,
    log: Path,
    *,
    sync: bool = False,
    on_start: Callable[[str], None] = lambda _: None,
    on_status: Callable[[Status], None] = lambda _: None,
    on_death: Callable[[Death], None] = lambda _: None,
    asked_to_stop: Callable[[], int] = lambda: 0,
) -> Launcher:
    """Run all processes to their end, as Launcher and its `watch` describe. Returns the last attempt's launcher.

    on_start: gets the target's endpoint, again where another attempt has another.
    """
    for _ in range(_ATTEMPTS):
        with Launcher(arguments, loaded, run, log, sync=sync) as launcher:
            on_start(launcher.endpoint)
            launcher.watch(on_status, asked_to_stop, on_death)
        if not launcher.lost_a_port:
            break
        log.unlink(missing_ok=True)  # the log of no step
    return launcher
