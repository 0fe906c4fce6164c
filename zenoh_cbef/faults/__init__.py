"""Faults, one kind per file. Adding one is a file with a class as in loss.py, and a place in AnyFault."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from zenoh_cbef.faults.base import Fate, Fault, LinkFault, Messages
from zenoh_cbef.faults.byzantine import Byzantine
from zenoh_cbef.faults.delay import Delay
from zenoh_cbef.faults.fates import Fates
from zenoh_cbef.faults.loss import Loss
from zenoh_cbef.faults.outgoing import Outgoing, SenderFault

__all__ = [
    "AnyFault",
    "Byzantine",
    "Delay",
    "Fate",
    "Fates",
    "Fault",
    "LinkFault",
    "Loss",
    "Messages",
    "Outgoing",
    "SenderFault",
]

AnyFault = Annotated[Loss | Delay | Byzantine, Field(discriminator="kind")]
