"""The name and the scenario of a log's run."""

from __future__ import annotations

from dataclasses import dataclass

from zenoh_cbef.errors import UserError
from zenoh_cbef.log.common.naming import END, RESOLVED, RUN
from zenoh_cbef.log.read.parts import Log
from zenoh_cbef.plain import read_toml
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.legacy import as_meant
from zenoh_cbef.scenario.load import parse
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.size import refuse_too_many_processes


@dataclass(frozen=True)
class Header:
    """The run's name, its scenario, and whether the recorder ended it."""

    run: str
    plan: Plan
    end: dict[str, str] | None

    @property
    def scenario(self) -> Scenario:
        """What the run was to be."""
        return self.plan.scenario


def read_header(log: Log) -> Header:
    """The run and its scenario. Raises UserError where the log lacks them, PackageAbsentError as `parse`."""
    attached, described = log.attachments.get(RESOLVED), log.metadata.get(RUN)
    if attached is None or described is None or "run" not in described:
        cut = "it is damaged before its scenario" if log.damage or described else "it is no log of zenoh-cbef"
        raise UserError(f"{log.path} holds no scenario, as {cut}; 'info' tells what it holds")
    try:
        data = read_toml(attached.decode())
    except ValueError as error:
        raise UserError(f"the scenario in {log.path} is damaged: {error}") from None
    scenario = parse(as_meant(data), f"the scenario in {log.path}")
    refuse_too_many_processes(scenario)
    return Header(described["run"], Plan(scenario), log.metadata.get(END))
