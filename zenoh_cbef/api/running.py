"""Runs as processes."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

from zenoh_cbef.api.logs import load
from zenoh_cbef.api.paths import path_of
from zenoh_cbef.api.run import Run
from zenoh_cbef.api.simulating import warn_of
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.tools.collection import place_of_log
from zenoh_cbef.machine import require
from zenoh_cbef.nodes.launch.attempts import launch
from zenoh_cbef.protocol.names import checked
from zenoh_cbef.scenario.calling import What, described
from zenoh_cbef.scenario.load import Loaded, to_toml
from zenoh_cbef.scenario.size import refuse_a_trace_beyond_memory, refuse_too_many_processes
from zenoh_cbef.writing import must_be_new


def run(
    what: What = "tracking",
    /,
    *,
    run: str | None = None,
    log: str | Path | None = None,
    progress: Callable[[float, int], None] | None = None,
    **values: object,
) -> Run:
    """Run a scenario on this host: target, agents and recorder as processes over Zenoh; returns when all have ended.

    what, values: as of `scenario`. run: the run's name; default: the scenario's and the time. log: the file to write;
    default: run.mcap in a folder of its own in logs/. progress: called now and then with the step, and how many there
    are; None: nothing is. Ctrl-C ends all processes. Raises UserError where the run does not start, or one of its
    processes dies; what was logged is in its log.
    """
    if progress is not None and not callable(progress):
        raise UserError(
            f"progress = {progress!r} is to be a function of the step and of how many there are, as print; leave it out"
        )
    loaded = described(what, values)
    refuse_too_many_processes(loaded.scenario)
    warn_of(loaded.plan)
    refuse_a_trace_beyond_memory(loaded.plan)
    require(links=loaded.scenario.count + 1, processes=loaded.scenario.count + 2)
    name = f"{loaded.scenario.name}-{datetime.now().astimezone():%Y%m%d-%H%M%S}" if run is None else checked(run, "run")
    with place_of_log(name, None if log is None else path_of(log, "a log")) as path:
        must_be_new(path, "choose another log, or move it away")
        _execute(loaded, name if log is not None else path.parent.name, path, progress)
    return load(path)


def _execute(loaded: Loaded, name: str, path: Path, progress: Callable[[float, int], None] | None) -> None:
    with tempfile.TemporaryDirectory(prefix="zenoh-cbef-") as folder:
        written = Path(folder) / "scenario.toml"
        written.write_text(to_toml(loaded.scenario), encoding="utf-8")
        tell = progress or (lambda _done, _steps: None)
        launcher = launch(
            [str(written)], loaded, name, path, on_status=lambda told: tell(told.step, loaded.scenario.length)
        )
    deaths = "; ".join(map(str, launcher.deaths))
    if not launcher.started:
        raise UserError(f"the run did not start: {deaths or 'no step was ever finished; see its log'}")
    if deaths:
        raise UserError(f"{deaths}; what was logged is in {path}, for zenoh_cbef.load")
