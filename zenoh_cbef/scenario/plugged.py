"""What of a scenario is of other packages, told apart by version and source."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pydantic import BaseModel

from zenoh_cbef import courses, faults
from zenoh_cbef.errors import UserError
from zenoh_cbef.faults import Fault
from zenoh_cbef.plugins import NotInstalledError
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.tracking import filters


def stamped(scenario: Scenario) -> Scenario:
    """The scenario with all options of its plug-ins, and what these are on this host: so it travels, and is logged.

    Raises UserError where it says that they are something else.
    """
    chosen, target = scenario.filter, scenario.target
    filter_mark = filters.mark_of(chosen.kind)
    _compare("filter.kind", chosen.kind, told=chosen.plugin, here=filter_mark)
    target_mark = courses.mark_of(target.motion)
    _compare("target.motion", target.motion, told=target.plugin, here=target_mark)
    changed: dict[str, object] = {}
    if filter_mark is not None:
        options = filters.options_of(chosen.kind, chosen.options or {}, "filter.options")
        changed["filter"] = {"plugin": filter_mark, "options": options}
    if target_mark is not None:
        options = courses.options_of(target.motion, target.options or {}, "target.options")
        changed["target"] = {"plugin": target_mark, "options": options}
    if scenario.fault:
        changed["fault"] = tuple(map(_stamped_fault, scenario.fault))
    return scenario.changed(**changed)


def _stamped_fault(fault: Fault) -> Fault:
    here = faults.mark_of(fault.kind)
    _compare("fault.kind", fault.kind, told=fault.plugin, here=here)
    return fault if here is None else fault.model_copy(update={"plugin": here})


class PackageAbsentError(UserError):
    """A scenario has a filter, motion or fault of a package that is not on this host."""


def lacking(data: object) -> str:
    """Which package a scenario's tables were made with that this host lacks, in a sentence; "" where all are here."""
    if not isinstance(data, Mapping):
        return ""
    listed = data.get("fault")
    tables = [
        ("target.motion", data.get("target"), courses.mark_of),
        ("filter.kind", data.get("filter"), filters.mark_of),
    ]
    tables += [("fault.kind", one, faults.mark_of) for one in (listed if isinstance(listed, list) else ())]
    for key, table, mark_of in tables:
        if not isinstance(table, Mapping) or not isinstance(told := table.get("plugin"), str):
            continue
        name = str(table.get(key.rpartition(".")[2]))
        try:
            mark_of(name)
        except NotInstalledError:
            return f"{key} = {name!r} is of {told:.200}, which is not on this host; install that package here, too"
        except ValueError:
            continue
    return ""


def forget_plugins(data: dict[str, object], keys: Sequence[str]) -> None:
    """Take from a log's tables what its plug-ins were, for a run of them as they are now.

    keys: those that the run has otherwise; with another kind the options of the log's go, too.
    """
    listed = data.get("fault")
    for table in (data.get("filter"), data.get("target"), *(listed if isinstance(listed, list) else ())):
        if isinstance(table, dict):
            table.pop("plugin", None)
    chosen = data.get("filter")
    if isinstance(chosen, dict) and "filter.kind" in keys:
        chosen.pop("options", None)


def same_but_for_plugins(one: BaseModel, other: BaseModel) -> bool:
    """Whether two tables say the same, whatever version of a plug-in each names."""
    return one.model_dump(exclude={"plugin"}) == other.model_dump(exclude={"plugin"})


def _compare(key: str, name: str, *, told: str | None, here: str | None) -> None:
    if told is None or told == here:
        return
    if here is None:
        raise UserError(f"{key} = {name!r} is of no other package, but is to be of {told}; leave `plugin` out")
    raise UserError(
        f"{key} = {name!r} is to be {told}, but on this host it is {here}; install the same package on every host"
    )
