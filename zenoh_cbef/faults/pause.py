"""Agents that are stopped for a while."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import model_validator

from zenoh_cbef.faults.absence import Absence


class Pause(Absence):
    """Agents' processes are stopped (SIGSTOP), and continued at `until`: they go on from their last estimates."""

    kind: Literal["pause"]

    @model_validator(mode="after")
    def _ends(self) -> Self:
        if self.until is None:
            raise ValueError("fault.until is missing: a pause ends; say when, or use fault.kind = 'crash'")
        return self
