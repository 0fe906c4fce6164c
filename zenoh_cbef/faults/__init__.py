"""Faults, one kind per file. Adding one is a file with a class as in loss.py, and a place in AnyFault."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from zenoh_cbef.faults.base import Fate, LinkFault, Messages
from zenoh_cbef.faults.delay import Delay
from zenoh_cbef.faults.fates import Fates
from zenoh_cbef.faults.loss import Loss

__all__ = ["AnyFault", "Delay", "Fate", "Fates", "LinkFault", "Loss", "Messages"]

AnyFault = Annotated[Loss | Delay, Field(discriminator="kind")]
