"""design: what a scenario can be expected to reach, before any run."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from zenoh_cbef.analysis.design import design
from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.shared import AsJson, Overrides, ScenarioName, Skip
from zenoh_cbef.cli.terminal.console import console, warn
from zenoh_cbef.cli.terminal.design import design_lines
from zenoh_cbef.errors import UserError
from zenoh_cbef.numbers import SKIPPED
from zenoh_cbef.scenario.checks import check
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.size import refuse_a_trace_beyond_memory

Within = Annotated[
    str, typer.Option(metavar="PERCENT", help="Wanted excess of the position RMSE over the centralised filter's.")
]


Kbits = Annotated[
    float | None,
    typer.Option(
        metavar="NUMBER", help="Recommend settings for links of so many kbit/s, either way.", min=1e-3, max=1e9
    ),
]


def _design(
    scenario: ScenarioName = "tracking",
    overrides: Overrides = None,
    within: Within = "1%",
    kbits: Kbits = None,
    as_json: AsJson = False,
    skip: Skip = SKIPPED,
) -> None:
    """Predict errors, bytes and the rounds that are needed, without a run, from the scenario's geometry and graph."""
    wanted = _share(within)
    plan = load(scenario, overrides or ()).plan
    warn(check(plan))
    refuse_a_trace_beyond_memory(plan)
    told = design(plan, within=wanted, skip=skip, kbits=kbits)
    if as_json:
        print(json.dumps(told.as_json()))
        return
    for part in design_lines(told):
        console.print(part, highlight=False, soft_wrap=isinstance(part, str))


def _share(text: str) -> float:
    try:
        percent = float(text.strip().removesuffix("%"))
    except ValueError:
        percent = -1.0
    if not 0.0 < percent <= 1000.0:
        raise UserError(f"--within {text!r} is no percentage above 0; write it as in --within 1%")
    return percent / 100.0


VERB = verb(_design, "design paper --within 5%")
