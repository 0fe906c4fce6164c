"""Cut links."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np

from zenoh_cbef.faults.base import Effect, LinkFault, Messages


class Partition(LinkFault):
    """The links are cut: every message on them is lost, until they heal."""

    kind: Literal["partition"]

    cuts: ClassVar[bool] = True

    def effect(self, messages: Messages, index: int) -> Effect:  # noqa: ARG002 - nothing is drawn
        """All lost."""
        return Effect(lost=np.ones(messages.source.shape, dtype=bool))
