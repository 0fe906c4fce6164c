"""The runs in logs/, each in a folder of its own."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from zenoh_cbef.errors import UserError
from zenoh_cbef.log.common.naming import ACTIVE, LOGS, RUN
from zenoh_cbef.log.read.header import read_header
from zenoh_cbef.log.read.parts import Log, find_log, open_log
from zenoh_cbef.outside.registry import known_runs
from zenoh_cbef.writing import writing

LATEST = "latest"
"""The name in logs/ that leads to the newest run."""
UNKNOWN = "unknown"
"""The result of a run that goes on, or that was not analysed."""
_TAGS = "tags.json"
_NAME = re.compile(r"\w[\w.-]*")


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
    """Make logs/RUN, with a number behind it where that exists. Raises UserError where it cannot be made.

    The name that leads to the newest run is none of a run.
    """
    folder = LOGS / run
    if run == LATEST:
        raise UserError(f"{folder} leads to the newest run; choose another --run")
    for attempt in range(2, 100):
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            folder = LOGS / f"{run}-{attempt}"
        except OSError as error:
            raise UserError(f"cannot make {folder}: {error.strerror}; choose another place for the log") from None
        else:
            return folder
    raise UserError(f"logs/{run} and 98 more exist; choose another place for the log")


GOES_ON = "the run goes on: this is what was written so far"


def goes_on(log: Log) -> bool:
    """Whether a log is still being written, as its run goes on on this host."""
    return [*log.files][-1].name.endswith(ACTIVE) and log.metadata.get(RUN, {}).get("run") in known_runs()


@dataclass(frozen=True)
class Kept:
    """A run in logs/: where its log is, what it was, and what came of it.

    name: of its folder. run: of the run. result: complete, stopped, incomplete or lost; unknown where no metrics.json
    says so. rmse: position, m.
    """

    name: str
    run: str
    log: Path
    scenario: str
    filter: str
    faults: list[str]
    agents: int
    seed: int
    tags: list[str]
    result: str
    rmse: float | None

    @property
    def goes_on(self) -> bool:
        """Whether its log is still being written, as it goes on on this host."""
        return self.log.name.endswith(ACTIVE) and self.run in known_runs()


def runs(folder: Path = LOGS) -> list[Kept]:
    """The runs in logs/ by name; a folder whose log tells no scenario is left out."""
    found = []
    for place in sorted(folder.glob("*")):
        if place.is_dir() and not place.is_symlink():
            with suppress(UserError):
                found.append(_kept(place))
    return found


def find_run(name: str) -> Kept:
    """The run of this name. Raises UserError where there is none."""
    place = LOGS / Path(name).name
    if not place.is_dir():
        raise UserError(f"there is no run {name} in {LOGS}/; see 'zenoh-cbef runs list'")
    return _kept(place.resolve())


def expanded(paths: Sequence[Path]) -> list[Path]:
    """Logs as a user gives them, with those of a tag in place of @TAG. Raises UserError where none has the tag."""
    found: list[Path] = []
    for path in paths:
        if not str(path).startswith("@"):
            found.append(path)
            continue
        tag = str(path)[1:]
        tagged = [place for place in sorted(LOGS.glob(f"*/{_TAGS}")) if tag in _tags(place.parent)]
        if not tagged:
            raise UserError(f"no run in {LOGS}/ has the tag {tag!r}; see 'zenoh-cbef runs list'")
        found += [place.parent for place in tagged if not place.parent.is_symlink()]
    return found


def tag(run: Kept, add: Sequence[str], remove: Sequence[str]) -> list[str]:
    """Give a run tags and take some away; returns those that it has now. Raises UserError."""
    for one in add:
        if not _NAME.fullmatch(one):
            raise UserError(f"{one!r} is no tag; use letters, digits, dot, dash and underscore")
    now = sorted({*run.tags, *add} - set(remove))
    place = run.log.parent / _TAGS
    with writing(place, "make room, or change its permissions"):
        place.write_text(json.dumps(now) + "\n", encoding="utf-8")
    return now


def remove(run: Kept) -> None:
    """Delete a run's folder. Raises UserError where its log is still being written, or the folder cannot be deleted."""
    if run.goes_on:
        raise UserError(f"{run.name} goes on; end it first with 'zenoh-cbef stop --run {run.run}'")
    try:
        shutil.rmtree(run.log.parent)
    except OSError as error:
        raise UserError(f"cannot delete {run.log.parent}: {error.strerror}; change its permissions") from None


def _kept(place: Path) -> Kept:
    log = find_log(place)
    header = read_header(open_log(log))
    scenario = header.scenario
    found = Kept(
        name=place.name,
        run=header.run,
        log=log,
        scenario=scenario.name,
        filter=scenario.filter.kind,
        faults=list(dict.fromkeys(fault.kind for fault in scenario.fault)),
        agents=scenario.count,
        seed=scenario.seed,
        tags=_tags(place),
        result=UNKNOWN,
        rmse=None,
    )
    return again(found, _metrics(place))


def again(run: Kept, metrics: Mapping[str, object]) -> Kept:
    """The run with what its metrics say came of it."""
    rmse = metrics.get("position_rmse")
    return replace(run, result=_result(metrics), rmse=rmse if isinstance(rmse, float) else None)


def _result(told: Mapping[str, object]) -> str:
    if not told:
        return UNKNOWN
    if told.get("lost"):
        return "lost"
    return "complete" if told.get("complete") else "stopped" if told.get("stopped") else "incomplete"


def _metrics(place: Path) -> dict[str, object]:
    try:
        told = json.loads((place / "metrics.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return told if isinstance(told, dict) else {}


def _tags(place: Path) -> list[str]:
    try:
        told = json.loads((place / _TAGS).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return []
    return [str(one) for one in told] if isinstance(told, list) else []
