"""Runs from logs."""

from __future__ import annotations

from pathlib import Path

from zenoh_cbef.api.paths import path_of
from zenoh_cbef.api.run import Run
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.prove.reestimate import reestimate as _reestimate
from zenoh_cbef.log.prove.smoothed import smoothed_trace
from zenoh_cbef.log.read.measurements import read_measurements
from zenoh_cbef.log.read.parts import find_log
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.log.tools.collection import place_of_log
from zenoh_cbef.numbers import SKIPPED
from zenoh_cbef.protocol.names import checked


def load(log: str | Path = "logs/latest", /, *, smooth: bool = False, skip: float = SKIPPED) -> Run:
    """Read a log: a file, the folder of a run, or its name in logs/.

    smooth: with the path that all measurements of the run give. skip: the share of steps that errors leave out at the
    start. Raises UserError where there is no log of a run.
    """
    path = find_log(path_of(log, "a log"))
    trace = read_trace(path)
    return Run(smoothed_trace(trace, path)[0] if smooth else trace, path, skip)


def reestimate(
    source: Run | str | Path,
    /,
    *,
    output: str | Path | None = None,
    run: str | None = None,
    **values: object,
) -> Run:
    """Estimate again from the measurements of a log, with another filter or parameters, without processes.

    output: the log that is written; None: in a folder of its own in logs/. run: its name. values: by their keys, as in
    **{"filter.kind": "icf"}. Raises UserError with the remedy.
    """
    log = source.log if isinstance(source, Run) else path_of(source, "a log")
    if log is None:
        raise UserError("a simulated run has no log; simulate it again with other values, or use zenoh_cbef.run")
    found = read_measurements(log)
    loaded = found.loaded((), values)
    name = f"{found.header.run}-{loaded.scenario.filter.kind}" if run is None else checked(run, "run")
    with place_of_log(name, None if output is None else path_of(output, "a log")) as path:
        _reestimate(found, loaded, name, path)
    return load(path)
