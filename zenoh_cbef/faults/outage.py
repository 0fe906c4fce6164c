"""Agents that are cut off."""

from __future__ import annotations

from typing import Literal

import numpy as np

from zenoh_cbef.faults.absence import Off
from zenoh_cbef.faults.base import Effect, Messages


class Outage(Off):
    """Agents are silent and deaf: every message from or to them is lost. They go on tracking by themselves."""

    kind: Literal["outage"]

    def effect(self, messages: Messages, index: int) -> Effect:  # noqa: ARG002 - nothing is drawn
        """All lost."""
        return Effect(lost=np.ones(messages.source.shape, dtype=bool))
