"""What of a scenario is of other packages, told apart by version and source."""

from __future__ import annotations

from collections.abc import Sequence

from zenoh_cbef.errors import UserError
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.tracking.filters import mark_of, options_of


def stamped(scenario: Scenario) -> Scenario:
    """The scenario with all options of its plug-ins, and what these are on this host: so it travels, and is logged.

    Raises UserError where it says that they are something else.
    """
    chosen = scenario.filter
    here = mark_of(chosen.kind)
    _compare("filter.kind", chosen.kind, told=chosen.plugin, here=here)
    if here is None:
        return scenario
    told = {"plugin": here, "options": options_of(chosen.kind, chosen.options or {})}
    return scenario.model_copy(update={"filter": chosen.model_copy(update=told)})


def forget_plugins(data: dict[str, object], keys: Sequence[str]) -> None:
    """Take from a log's tables what its plug-ins were, for a run of them as they are now.

    keys: those that the run has otherwise; with another kind the options of the log's go, too.
    """
    table = data.get("filter")
    if isinstance(table, dict):
        table.pop("plugin", None)
        if "filter.kind" in keys:
            table.pop("options", None)


def _compare(key: str, name: str, *, told: str | None, here: str | None) -> None:
    if told is None or told == here:
        return
    if here is None:
        raise UserError(f"{key} = {name!r} is of no other package, but is to be of {told}; leave `plugin` out")
    raise UserError(
        f"{key} = {name!r} is to be {told}, but on this host it is {here}; install the same package on every host"
    )
